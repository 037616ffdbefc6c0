//! Truncated cones as CSG boxes: an enclosing box, from which the cone's exterior and the half spaces
//! beyond its ends are subtracted. The box itself is never visible, so that the cone can be rotated while
//! its box stays axis-aligned.

use glam::{DQuat, DVec3};

use super::data::{
    CSG_FACE_APEX_CONE, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, CsgBoxData, CsgFaceData,
};
use crate::scene::ObjectPose;
use crate::scene::validate::CSG_MARGIN_M;

/// Number of faces of a cone's CSG box: the box, the cone's side, and both ends.
pub(super) const FACES: u32 = 4;

/// A truncated cone of a compiled scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// Index of its CSG box.
    pub(super) csg_box: u32,
    pub(super) first_face: u32,
    /// Length along the axis, metres.
    pub(super) length: f32,
    /// Radii of the narrow and the wide end, metres.
    pub(super) radii: [f32; 2],
}

impl Cone {
    /// CSG box and faces of the cone at `pose`; if it is hidden, the box has no extent, so that no ray hits
    /// it.
    pub(super) fn at(&self, pose: &ObjectPose, material: u32) -> (CsgBoxData, [CsgFaceData; 4]) {
        let [narrow, wide] = self.radii.map(f64::from);
        let slope = (wide - narrow) / f64::from(self.length);
        let turn: DQuat = pose.rotation.as_dquat().normalize();
        let axis = turn * DVec3::Z;
        let from = pose.position.as_dvec3();
        let to = from + axis * f64::from(self.length);
        // Where the radius extrapolates to 0, before the narrow end.
        let apex = from - axis * (narrow / slope);
        // A disc of radius r orthogonal to the unit axis a extends r·√(1 − aᵢ²) along coordinate axis i.
        // Rounding may make 1 − aᵢ² negative.
        let across = (1.0 - axis * axis).max(DVec3::ZERO).map(f64::sqrt);
        // The box must enclose the cone by more than the margin of subtractions and the rounding to f32.
        let margin = 4.0 * f64::from(CSG_MARGIN_M)
            + 4.0 * f64::from(f32::EPSILON) * from.abs().max(to.abs()).max_element();
        let mut min = (from - across * narrow).min(to - across * wide) - margin;
        let mut max = (from + across * narrow).max(to + across * wide) + margin;
        if !pose.visible {
            (min, max) = (from, from);
        }
        let array = |v: DVec3| v.as_vec3().to_array();
        let plane = |normal: DVec3, point: DVec3| CsgFaceData {
            a: array(normal),
            kind: CSG_FACE_PLANE,
            b: [normal.dot(point) as f32, 0.0, 0.0],
            material,
        };
        let csg_box = CsgBoxData {
            min: array(min),
            first_face: self.first_face,
            max: array(max),
            face_count: FACES,
        };
        let outer = CsgFaceData {
            a: csg_box.min,
            kind: CSG_FACE_OUTER_BOX,
            b: csg_box.max,
            material,
        };
        let side = CsgFaceData {
            a: array(apex),
            kind: CSG_FACE_APEX_CONE,
            b: array(axis * slope),
            material,
        };
        (csg_box, [outer, side, plane(-axis, from), plane(axis, to)])
    }
}
