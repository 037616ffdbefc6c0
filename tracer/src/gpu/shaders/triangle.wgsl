// Triangles: see `scalar/triangle.rs` for intersection and shading.

// Layout as in Rust.
struct TriangleData {
    a: vec3f,
    material: u32,
    b: vec3f,
    normals: u32,
    c: vec3f,
    uvs: u32,
}

// A triangle in the coordinates of a ray.
struct SeenTriangle {
    // Unnormalised barycentric weights of the corners at the intersection.
    weights: vec3f,
    // Coordinates of the corners across the ray, and along it.
    x: vec3f,
    y: vec3f,
    along: vec3f,
}

// Two axes perpendicular to the current ray.
var<private> ray_axes: Basis;
// The triangle through which the current ray entered its body; not a triangle's number if it did
// not.
var<private> came_in_by: u32;
// A point as far behind the most recent triangle as the surface's position is in front of it.
var<private> beyond: vec3f;

fn dot_fused(a: vec3f, b: vec3f) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// Watertight: each corner is projected in the same way and each product is rounded separately, so
// both triangles of an edge compute the same two products for it.
fn see_triangle(ray: Ray, axes: Basis, index: u32) -> SeenTriangle {
    let a = mesh.triangles[index].a - ray.origin;
    let b = mesh.triangles[index].b - ray.origin;
    let c = mesh.triangles[index].c - ray.origin;
    let x = vec3f(dot_fused(axes.t, a), dot_fused(axes.t, b), dot_fused(axes.t, c));
    let y = vec3f(dot_fused(axes.b, a), dot_fused(axes.b, b), dot_fused(axes.b, c));
    let z = vec3f(dot_fused(ray.direction, a), dot_fused(ray.direction, b), dot_fused(ray.direction, c));
    return SeenTriangle(rounded(x.yzx * y.zxy) - rounded(y.yzx * x.zxy), x, y, z);
}

fn triangle_t(prepared: PreparedRay, index: u32) -> f32 {
    let seen = see_triangle(prepared.ray, ray_axes, index);
    let sum = seen.weights.x + seen.weights.y + seen.weights.z;
    let is_inside = all(seen.weights >= vec3f(0.0)) || all(seen.weights <= vec3f(0.0));
    if (!is_inside || !(abs(sum) > 0.0)) {
        return T_MISS;
    }
    // A ray that enters the body leads away from the triangle that it starts on.
    if (HAS_DIELECTRIC_MESH && index == came_in_by && sum < 0.0) {
        return T_MISS;
    }
    // Equal products only mean that the ray meets the line through an edge.
    if (any(seen.weights == vec3f(0.0))) {
        let is_beside_x = smallest(seen.x) > 0.0 || largest(seen.x) < 0.0;
        let is_beside_y = smallest(seen.y) > 0.0 || largest(seen.y) < 0.0;
        if (is_beside_x || is_beside_y) {
            return T_MISS;
        }
    }
    let t = dot(seen.weights, seen.along) / sum;
    return select(T_MISS, t, t > 0.0);
}

// A ray inside a body may hit any of its triangles on leaving.
fn own_triangle(prepared: PreparedRay, start: u32, hit: ptr<function, Hit>) -> u32 {
    ray_axes = basis(prepared.ray.direction);
    if (HAS_DIELECTRIC_MESH) {
        came_in_by = (start ^ INSIDE) - TRIANGLE_FIRST;
    }
    return start;
}

fn triangle_surface(ray: Ray, t: f32, index: u32, is_within: bool) -> Surface {
    let seen = see_triangle(ray, basis(ray.direction), index);
    let weights = seen.weights / (seen.weights.x + seen.weights.y + seen.weights.z);
    let a = mesh.triangles[index].a;
    let b = mesh.triangles[index].b;
    let c = mesh.triangles[index].c;
    var normal = normalize(cross(b - a, c - a));
    let is_left = dot(normal, ray.direction) > 0.0;
    normal = select(normal, -normal, is_left);
    // Offset along the normal by the largest rounding error, so that the point is not below the
    // surface.
    let magnitude = abs(weights.x * a) + abs(weights.y * b) + abs(weights.z * c);
    let above = dot(magnitude, abs(normal)) * POINT_ROUNDING;
    let material = mesh.triangles[index].material;
    if (HAS_DIELECTRIC_MESH) {
        beyond = fma(vec3f(-above), normal, weights.x * a + weights.y * b + weights.z * c);
    }
    return Surface(
        fma(vec3f(above), normal, weights.x * a + weights.y * b + weights.z * c),
        triangle_shading_normal(index, weights, normal, -ray.direction, t),
        scene_storage.materials[material].albedo,
        material,
        HAS_DIELECTRIC_MESH && is_left,
    );
}
