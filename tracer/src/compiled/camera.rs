//! The camera of a scene as a basis, and as the rays of a picture.

use bytemuck::Zeroable as _;
use glam::DVec3;

use super::CameraFrame;
use crate::ImageSize;
use crate::scene::Camera;

/// A camera's orthonormal basis in f64: the one place where its angle of view becomes a length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CameraBasis {
    /// Position, m.
    pub eye: DVec3,
    /// Direction of view.
    pub forward: DVec3,
    /// To the right on the image.
    pub right: DVec3,
    /// Upwards on the image.
    pub up: DVec3,
    /// Half the width of the image at distance 1.
    pub half_width: f64,
}

impl CameraBasis {
    /// The basis of a valid camera.
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

/// The camera's rays for an image of `size`, computed in f64 and rounded once.
pub fn camera_frame(camera: &Camera, size: ImageSize) -> CameraFrame {
    let CameraBasis {
        forward,
        right,
        up,
        half_width,
        ..
    } = CameraBasis::new(camera);
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
