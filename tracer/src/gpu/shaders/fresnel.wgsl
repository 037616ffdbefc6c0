// Fresnel reflectance of smooth dielectrics.

// Unpolarised Fresnel reflectance for a relative index of refraction; 0 for an index of 0.
fn fresnel_dielectric(cos_theta: f32, eta: f32) -> f32 {
    let cos_i = clamp(cos_theta, 0.0, 1.0);
    // η²cos²θt = (η²−1) + cos²θi, factored so that an index of 1 reflects exactly nothing.
    let cos_t = sqrt(max(0.0, (eta - 1.0) * (eta + 1.0) + cos_i * cos_i)) / eta;
    // No coat, or an index of 1 at grazing incidence: there is no boundary.
    if (eta == 0.0 || (eta >= 1.0 && cos_i == 0.0 && cos_t == 0.0)) {
        return 0.0;
    }
    if (cos_t == 0.0) {
        return 1.0; // total reflection from inside
    }
    let parallel = (eta * cos_i - cos_t) / (eta * cos_i + cos_t);
    let perpendicular = (cos_i - eta * cos_t) / (cos_i + eta * cos_t);
    return 0.5 * (parallel * parallel + perpendicular * perpendicular);
}
