//! Cameras: orthonormal basis, and rays of an image.

use bytemuck::Zeroable as _;
use glam::DVec3;

use super::CameraFrame;
use crate::ImageSize;
use crate::scene::Camera;

/// Orthonormal basis of a camera in f64; the one place where the angle of view is converted to a length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraBasis {
    /// Position, metres.
    pub eye: DVec3,
    /// Unit viewing direction.
    pub forward: DVec3,
    /// Unit vector to the right in the image.
    pub right: DVec3,
    /// Unit vector upwards in the image.
    pub up: DVec3,
    /// Half the width of the image plane at distance 1.
    pub half_width: f64,
}

impl CameraBasis {
    /// Basis of a valid camera.
    pub fn new(camera: &Camera) -> Self {
        let eye = camera.eye.as_dvec3();
        let forward = (camera.target.as_dvec3() - eye).normalize();
        let right = forward.cross(camera.up.as_dvec3()).normalize();
        Self {
            eye,
            forward,
            right,
            up: right.cross(forward),
            half_width: (f64::from(camera.fov_x_deg).to_radians() * 0.5).tan(),
        }
    }
}

/// Rays of a camera for an image of `size`, computed in f64 and rounded once.
pub fn camera_frame(camera: &Camera, size: ImageSize) -> CameraFrame {
    let CameraBasis {
        forward,
        right,
        up,
        half_width,
        ..
    } = CameraBasis::new(camera);
    // Pixels are square; the width of the image determines their size.
    let pixel = 2.0 * half_width / f64::from(size.width);
    let corner = forward - right * half_width + up * (0.5 * pixel * f64::from(size.height));
    let array = |v: DVec3| v.as_vec3().to_array();
    let lens_steps = f64::from(camera.lens.aperture_radius_m) / pixel;
    CameraFrame {
        eye: camera.eye.to_array(),
        lens_steps: lens_steps as f32,
        corner: array(corner),
        lens_film: (lens_steps / f64::from(camera.lens.focus_distance_m)) as f32,
        dx: array(right * pixel),
        near_m: camera.near_m,
        dy: array(-up * pixel),
        ..CameraFrame::zeroed()
    }
}
