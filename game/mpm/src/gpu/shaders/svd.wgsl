// Singular value decomposition by one-sided Jacobi rotations (Hestenes 1958), which orthogonalise the
// columns of F·V. Singular values are in descending order, U and V are rotations, and the last value has
// the sign of det F.

struct Svd {
    u: mat3x3<f32>,
    sigma: vec3<f32>,
    v: mat3x3<f32>,
}

// Two columns of F·V and of V.
struct Columns {
    b: vec3<f32>,
    c: vec3<f32>,
    v: vec3<f32>,
    w: vec3<f32>,
    // Whether they were nearly orthogonal before the rotation; of `sorted`, whether it swapped them.
    is_small: bool,
}

const SWEEPS_MAX: u32 = 6u;

// Squared cosine of the angle between two columns below which the sweep that rotates them is the last.
const COSINE_LAST_SQUARED: f32 = 1e-8;

fn jacobi(b: vec3<f32>, c: vec3<f32>, v: vec3<f32>, w: vec3<f32>) -> Columns {
    let bb = dot(b, b);
    let cc = dot(c, c);
    let bc = dot(b, c);
    let twice = 2.0 * bc;
    let difference = cc - bb;
    let root = sqrt(fma(difference, difference, twice * twice));
    var tangent = twice / (abs(difference) + root + 1.17549435e-38);
    tangent = select(tangent, -tangent, difference < 0.0);
    let cosine = 1.0 / sqrt(fma(tangent, tangent, 1.0));
    let sine = tangent * cosine;
    return Columns(
        cosine * b - sine * c,
        sine * b + cosine * c,
        cosine * v - sine * w,
        sine * v + cosine * w,
        bc * bc <= bb * cc * COSINE_LAST_SQUARED,
    );
}

// Sorts two columns by length, the longer first. A swap negates one, which keeps V a rotation.
fn sorted(b: vec3<f32>, c: vec3<f32>, v: vec3<f32>, w: vec3<f32>) -> Columns {
    let swap = dot(b, b) < dot(c, c);
    return Columns(
        select(b, c, swap),
        select(c, -b, swap),
        select(v, w, swap),
        select(w, -v, swap),
        swap,
    );
}

// A unit vector orthogonal to a unit vector.
fn across(u: vec3<f32>) -> vec3<f32> {
    let axis = select(vec3(1.0, 0.0, 0.0), vec3(0.0, 1.0, 0.0), abs(u.x) > 0.6);
    return normalize(cross(u, axis));
}

fn svd(f: mat3x3<f32>) -> Svd {
    var b0 = f[0];
    var b1 = f[1];
    var b2 = f[2];
    var v0 = vec3(1.0, 0.0, 0.0);
    var v1 = vec3(0.0, 1.0, 0.0);
    var v2 = vec3(0.0, 0.0, 1.0);
    for (var sweep = 0u; sweep < SWEEPS_MAX; sweep++) {
        let x = jacobi(b0, b1, v0, v1);
        let y = jacobi(x.b, b2, x.v, v2);
        let z = jacobi(x.c, y.c, x.w, y.w);
        b0 = y.b;
        v0 = y.v;
        b1 = z.b;
        v1 = z.v;
        b2 = z.c;
        v2 = z.w;
        if (x.is_small && y.is_small && z.is_small) {
            break;
        }
    }
    let x = sorted(b0, b1, v0, v1);
    let y = sorted(x.b, b2, x.v, v2);
    let z = sorted(x.c, y.c, x.w, y.w);
    let s0 = length(y.b);
    let is_zero = s0 < 1e-18;
    let u0 = select(y.b / s0, vec3(1.0, 0.0, 0.0), is_zero);
    // Orthogonalised again: the rounding error along the first direction matters where the second stretch
    // is far smaller.
    let rest = z.b - u0 * dot(u0, z.b);
    let s1 = length(rest);
    let is_line = s1 < 1e-18;
    let u1 = select(rest / s1, across(u0), is_line);
    let u2 = cross(u0, u1);
    // U and V are rotations, so that the last stretch has the sign of the determinant.
    let sigma = vec3(select(s0, 0.0, is_zero), select(s1, 0.0, is_line), dot(u2, z.c));
    return Svd(mat3x3(u0, u1, u2), sigma, mat3x3(y.v, z.v, z.w));
}
