//! Truncated cones as CSG boxes: a box about the cone, without what lies outside of it and beyond its
//! ends. The box itself is never a surface, so that the cone can be turned with its box's axes left
//! where they are.

use glam::{DQuat, DVec3};

use super::data::{
    CSG_FACE_APEX_CONE, CSG_FACE_OUTER_BOX, CSG_FACE_PLANE, CsgBoxData, CsgFaceData,
};
use crate::scene::ObjectPose;
use crate::scene::validate::CSG_MARGIN_M;

/// Faces of a cone's CSG box: the box, the cone's side, and its two ends.
pub(super) const FACES: u32 = 4;

/// A truncated cone of a compiled scene.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// Index of its CSG box.
    pub(super) csg_box: u32,
    pub(super) first_face: u32,
    pub(super) length: f32,
    pub(super) radii: [f32; 2],
}

impl Cone {
    /// Its CSG box and faces where `pose` has it; a box without extent, which no ray meets, if it is
    /// hidden.
    pub(super) fn at(&self, pose: &ObjectPose, material: u32) -> (CsgBoxData, [CsgFaceData; 4]) {
        let [narrow, wide] = self.radii.map(f64::from);
        let slope = (wide - narrow) / f64::from(self.length);
        let turn: DQuat = pose.rotation.as_dquat().normalize();
        let axis = turn * DVec3::Z;
        let from = pose.position.as_dvec3();
        let to = from + axis * f64::from(self.length);
        let apex = from - axis * (narrow / slope);
        // A disc of radius r across the unit axis a reaches r·√(1 − aᵢ²) along axis i. Rounding may leave
        // 1 − aᵢ² below 0.
        let across = (1.0 - axis * axis).max(DVec3::ZERO).map(f64::sqrt);
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
