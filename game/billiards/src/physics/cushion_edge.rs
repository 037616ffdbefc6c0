//! The straight edge of a cushion's top: level over a nose, slanted over the facing of a pocket.

use glam::DVec3;

use super::table::{JOINT_SLACK_M, Nose};

/// An edge with an orthonormal frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CushionEdge {
    pub(crate) from: DVec3,
    pub(crate) to: DVec3,
    /// From `from` to `to`.
    pub(crate) along: DVec3,
    /// Horizontal, towards the balls.
    pub(crate) across: DVec3,
    /// Upwards, perpendicular to both.
    pub(crate) up: DVec3,
}

impl CushionEdge {
    /// The edge above a nose or facing, for noses at `nose_height_m` above the cloth.
    pub(crate) fn over(nose: &Nose, nose_height_m: f64) -> Self {
        let [first, last] = nose.rises_m();
        let from = nose.from().extend(nose_height_m + first);
        let to = nose.to().extend(nose_height_m + last);
        let along = (to - from).normalize();
        let across = nose.normal().extend(0.0);
        let up = if first == last {
            DVec3::Z
        } else {
            along.cross(across)
        };
        Self {
            from,
            to,
            along,
            across,
            up,
        }
    }

    /// Signed distance along `up` from the plane of `along` and `across`, in m.
    pub(crate) fn height_over(&self, place: DVec3) -> f64 {
        self.up.dot(place - self.from)
    }

    /// Signed distance in front of the vertical plane through the edge, in m.
    pub(crate) fn distance_before(&self, place: DVec3) -> f64 {
        self.across.dot(place - self.from)
    }

    /// Whether the nearest point of the edge's line lies between its ends.
    pub(crate) fn spans(&self, place: DVec3) -> bool {
        let t = self.along.dot(place - self.from);
        let length = self.from.distance(self.to);
        (-JOINT_SLACK_M..=length + JOINT_SLACK_M).contains(&t)
    }

    /// Unit vector from the edge's line to a place above it; none for a place below, in front of the
    /// face.
    pub(crate) fn out_to(&self, place: DVec3) -> Option<DVec3> {
        let height = self.height_over(place);
        let out = self.distance_before(place) * self.across + height * self.up;
        (height >= 0.0).then(|| out.try_normalize().unwrap_or(DVec3::Z))
    }
}
