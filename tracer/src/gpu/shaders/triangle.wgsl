// Triangles: `scalar/triangle.rs` says how they are met and shaded.

// Data that Rust writes.
struct TriangleData {
    a: vec3f,
    material: u32,
    b: vec3f,
    normals: u32,
    c: vec3f,
    uvs: u32,
}

// A triangle as its ray sees it.
struct SeenTriangle {
    // What the corners weigh where the ray goes through, times their sum.
    weights: vec3f,
    // Where the corners are across the ray, and how far along it.
    x: vec3f,
    y: vec3f,
    along: vec3f,
}

// Two axes across the ray that is being traced.
var<private> ray_axes: Basis;
// The triangle by which the ray that is being traced came inside its body, or no number of one.
var<private> came_in_by: u32;
// As far on the other side of the triangle that was met last as the position is on this one.
var<private> beyond: vec3f;

fn dot_fused(a: vec3f, b: vec3f) -> f32 {
    return fma(a.x, b.x, fma(a.y, b.y, a.z * b.z));
}

// Each corner is projected alike, and each product is rounded by itself: an edge then has the same two products
// for both its triangles.
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
    // On the surface a ray that goes inside leads away from it.
    if (HAS_DIELECTRIC_MESH && index == came_in_by && sum < 0.0) {
        return T_MISS;
    }
    // Equal products tell only that the ray meets the line of an edge.
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

// A ray inside a body meets any triangle of it where it leaves.
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
    // Moved above by the most that rounding can have put it below.
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
