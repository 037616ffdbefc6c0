//! Contact of a marble: a spring and dashpot along the normal, a spring with Coulomb's bound along the surface.

use glam::DVec3;

use crate::marble::{Marble, MarbleState};

/// What a marble touches, as the marble meets it.
pub(crate) struct Surface {
    /// From the surface to the marble's centre, in m.
    pub(crate) distance_m: f64,
    /// Out of it.
    pub(crate) normal: DVec3,
    pub(crate) velocity: DVec3,
    pub(crate) spin: DVec3,
    /// Infinite for what does not move.
    pub(crate) mass_kg: f64,
    /// Of its curvature, in m; 0 for what does not move.
    pub(crate) radius_m: f64,
}

/// What a contact gives a marble over a substep.
pub(crate) struct Push {
    pub(crate) impulse: DVec3,
    pub(crate) arm: DVec3,
    pub(crate) other_arm: DVec3,
    /// Angular, against rolling.
    pub(crate) rolling: DVec3,
}

impl Surface {
    pub(crate) fn sphere(center: DVec3, other: DVec3, radius_m: f64) -> Self {
        let between = center - other;
        Self {
            distance_m: between.length() - radius_m,
            radius_m,
            ..Self::still(0.0, between.normalize_or(DVec3::Z))
        }
    }

    pub(crate) fn still(distance_m: f64, normal: DVec3) -> Self {
        Self {
            distance_m,
            normal,
            velocity: DVec3::ZERO,
            spin: DVec3::ZERO,
            mass_kg: f64::INFINITY,
            radius_m: 0.0,
        }
    }

    pub(crate) fn moving(self, velocity: DVec3, spin: DVec3, mass_kg: f64) -> Self {
        Self {
            velocity,
            spin,
            mass_kg,
            ..self
        }
    }

    /// Spring and dashpot along the normal, a spring with Coulomb's bound along the surface; none if they are apart.
    pub(crate) fn push(
        &self,
        marble: &Marble,
        damping: f64,
        sphere: &MarbleState,
        stretch: &mut DVec3,
        dt: f64,
    ) -> Option<Push> {
        let depth_m = marble.radius_m - self.distance_m;
        if depth_m <= 0.0 {
            return None;
        }
        let normal = self.normal;
        let arm = -normal * (marble.radius_m - 0.5 * depth_m);
        let other_arm = normal * (self.radius_m - 0.5 * depth_m);
        let velocity = sphere.velocity + sphere.spin.cross(arm);
        let relative = velocity - self.velocity - self.spin.cross(other_arm);
        let approach = relative.dot(normal);
        let mass_kg = 1.0 / (1.0 / marble.mass_kg() + 1.0 / self.mass_kg);
        let stiffness = marble.stiffness_n_m;
        let dashpot = 2.0 * damping * (stiffness * mass_kg).sqrt();
        let force = (stiffness * depth_m - dashpot * approach).max(0.0);
        let slip = relative - approach * normal;
        let shear = stiffness * SHEAR_STIFFNESS;
        // Along the surface solid spheres resist with 2/7 of their mass, as they turn: 1/m + r²/I is 7/2
        // of 1/m.
        let shear_dashpot = 2.0 * damping * (shear * mass_kg * SHEAR_STIFFNESS).sqrt();
        // The spring turns with the contact.
        let turned = *stretch - stretch.dot(normal) * normal + slip * dt;
        let drag = -shear * turned - shear_dashpot * slip;
        let bound = marble.friction * force;
        let bounded = drag.clamp_length_max(bound);
        // A spring that slips keeps the stretch of Coulomb's bound, not what it would have without.
        *stretch = match drag.length() > bound {
            true => -bounded / shear,
            false => turned,
        };
        // At most what stops it within a substep.
        let rolling = sphere.spin - self.spin;
        let stop = 0.5 * marble.moment_of_inertia() * rolling.length();
        let resistance = (marble.rolling_friction * marble.radius_m * force * dt).min(stop);
        Some(Push {
            impulse: (force * normal + bounded) * dt,
            arm,
            other_arm,
            rolling: -rolling.normalize_or_zero() * resistance,
        })
    }
}

/// The share of critical damping with which a spring and dashpot that never pull give a restitution: equation 20 of Schwager
/// and Pöschel 2007, "Coefficient of restitution and linear–dashpot model revisited", solved by bisection.
pub(crate) fn damping_of(restitution: f64) -> f64 {
    let gives = |share: f64| {
        let swing = (1.0 - share * share).sqrt();
        let angle = (2.0 * share * swing).atan2(share * share - swing * swing);
        (-share / swing * angle).exp()
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        match gives(middle) > restitution {
            true => low = middle,
            false => high = middle,
        }
    }
    low
}

/// Of the spring along the surface over that along the normal: both then swing alike (Schäfer et al. 1996).
const SHEAR_STIFFNESS: f64 = 2.0 / 7.0;
