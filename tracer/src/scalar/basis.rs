//! Orthonormal basis around a normal.

use glam::DVec3;

/// Two unit vectors that complete the unit vector `n` to a right-handed basis `(t, b, n)`: Duff et
/// al., "Building an Orthonormal Basis, Revisited", JCGT 6(1), 2017. −0 counts as positive, as
/// the sign of a zero component depends on how the normal was computed.
pub fn basis(n: DVec3) -> (DVec3, DVec3) {
    let sign = if n.z < 0.0 { -1.0 } else { 1.0 };
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (
        DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
        DVec3::new(b, sign + n.y * n.y * a, -n.y),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sampling::uniforms;

    #[test]
    fn bases_are_orthonormal_and_right_handed() {
        let poles = [
            DVec3::Z,
            DVec3::NEG_Z,
            DVec3::new(1e-9, 0.0, -1.0).normalize(),
        ];
        let normals = (0..1000)
            .map(|i| uniforms(i, 0, 0, 7).map(f64::from))
            .map(|u| (DVec3::new(u[0], u[1], u[2]) - 0.5).normalize());
        for n in normals.chain(poles) {
            let (t, b) = basis(n);
            assert!((t.cross(b) - n).length() < 1e-12, "{n}");
            assert!(
                (t.length() - 1.0).abs() < 1e-12 && t.dot(b).abs() < 1e-12,
                "{n}"
            );
        }
    }
}
