//! Validation of shapes and lights.

use glam::Vec3;

use super::{
    CONE_SLOPE, Check, TAPER_MAX, check_mesh, extent, finite, in_range, is_within, position,
    radiance, require, rotation,
};
use crate::SceneError;
use crate::scene::{AreaLight, CsgSolid, PunctualEmitter, PunctualLight, Shape};

pub(super) fn check_shape(shape: &Shape) -> Check {
    match *shape {
        Shape::Sphere {
            center,
            radius,
            rotation: turn,
        } => {
            position("its center", center)?;
            extent("its radius", radius)?;
            rotation(turn)
        }
        Shape::Box { min, max } | Shape::CsgBox { min, max, .. } => corners(min, max),
        Shape::TruncatedCone {
            center,
            rotation: turn,
            length,
            radii: [narrow, wide],
        } => {
            position("its center", center)?;
            rotation(turn)?;
            extent("its length", length)?;
            extent("its narrow radius", narrow)?;
            extent("its wide radius", wide)?;
            let slope = (wide - narrow) / length;
            in_range("the slope of its side", slope, CONE_SLOPE)
        }
        Shape::Disc {
            center,
            normal,
            radius,
        } => {
            position("its center", center)?;
            finite("its normal", normal)?;
            extent("its radius", radius)?;
            not_zero(normal)
        }
        Shape::Rectangle {
            center,
            half_u,
            half_v,
        } => rectangle(center, half_u, half_v),
        Shape::Mesh(ref mesh) => check_mesh(mesh),
    }
}

pub(super) fn check_solid(solid: &CsgSolid) -> Check {
    match *solid {
        CsgSolid::HalfSpace { point, normal } => {
            position("its point", point)?;
            finite("its normal", normal)?;
            not_zero(normal)
        }
        CsgSolid::Cylinder { center, radius } => {
            position("its center", center)?;
            extent("its radius", radius)
        }
        CsgSolid::Box { min, max } => corners(min, max),
        CsgSolid::ConeExterior {
            axis: _,
            center,
            radius,
            taper,
            beyond,
        } => {
            position("its center", center)?;
            extent("its radius", radius)?;
            position("its beyond", beyond)?;
            in_range("its taper", taper, -TAPER_MAX..=TAPER_MAX)
        }
    }
}

pub(super) fn check_area_light(light: &AreaLight) -> Check {
    rectangle(light.center, light.half_u, light.half_v)?;
    radiance("area light", light.radiance)?;
    require(is_within(light.gradient, -1.0, 1.0), || {
        SceneError::value(
            "its gradient",
            light.gradient,
            "each channel must be from -1 to 1",
        )
    })
}

pub(super) fn check_punctual_light(light: &PunctualLight) -> Check {
    let axis = |direction: Vec3| {
        finite("its direction", direction)?;
        not_zero(direction)
    };
    match light.emitter {
        PunctualEmitter::Point { center, .. } => position("its center", center)?,
        PunctualEmitter::Spot {
            center,
            direction,
            inner_deg,
            outer_deg,
            ..
        } => {
            position("its center", center)?;
            axis(direction)?;
            in_range("its outer_deg", outer_deg, 0.0..=90.0)?;
            in_range("its inner_deg", inner_deg, 0.0..=outer_deg)?;
        }
        PunctualEmitter::Distant { direction, .. } => axis(direction)?,
    }
    radiance("punctual light", light.strength())
}

pub(super) fn corners(min: Vec3, max: Vec3) -> Check {
    position("its min", min)?;
    position("its max", max)?;
    require(min.cmplt(max).all(), || {
        SceneError::rule(format!(
            "its min {min} must be below its max {max} on each axis"
        ))
    })
}

fn rectangle(center: Vec3, half_u: Vec3, half_v: Vec3) -> Check {
    position("its center", center)?;
    finite("its half_u", half_u)?;
    finite("its half_v", half_v)?;
    let (u, v) = (half_u.as_dvec3(), half_v.as_dvec3());
    extent("the length of its half_u", u.length() as f32)?;
    extent("the length of its half_v", v.length() as f32)?;
    require(u.dot(v).abs() <= 1e-4 * u.length() * v.length(), || {
        SceneError::rule(format!(
            "its half_u {half_u} and half_v {half_v} must be at right angles"
        ))
    })
}

fn not_zero(normal: Vec3) -> Check {
    require(normal != Vec3::ZERO, || {
        SceneError::rule(format!("its normal {normal} must not be 0"))
    })
}
