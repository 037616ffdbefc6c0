//! The rules and limits of scenes, checked once before anything is traced.

mod layers;
mod material;
mod mesh;
mod particles;
mod shape;
#[cfg(test)]
mod tests;
mod texture;

use std::ops::RangeInclusive;

use glam::{Quat, Vec3};

pub use self::layers::{CUTOFF_MAX, NORMAL_SCALE_MAX};
use self::material::check_material;
pub use self::mesh::{TRIANGLES_MAX, VERTICES_MAX};
use self::mesh::{check_closed, check_mesh, check_triangles};
use self::shape::{check_area_light, check_punctual_light, check_shape, check_solid};
pub(crate) use self::texture::map_fault;
pub use self::texture::{TEXTURE_BYTES_MAX, TEXTURES_MAX, UV_MAX};
use crate::scene::{Camera, Material, Object, ObjectPose, Opacity, Scene, Shape};
use crate::{Error, SceneError};

/// Maximum number of objects in a scene.
pub const OBJECTS_MAX: usize = 1 << 17;
/// Maximum number of particles in an update: 393 kB.
pub const PARTICLES_MAX: usize = 1 << 16;
/// Maximum number of clouds of particles in an update.
pub const CLOUDS_MAX: usize = 32;
/// Maximum ratio of a cloud's longest box edge to the smoothing radius of its surface.
pub const SMOOTHING_RADII_MAX: f32 = 16_384.0;
/// Maximum number of area lights in a scene.
pub const AREA_LIGHTS_MAX: usize = 64;
/// Maximum number of punctual lights in a scene; each shading point evaluates all of them.
pub const PUNCTUAL_LIGHTS_MAX: usize = 64;
/// Maximum number of materials in a scene.
pub const MATERIALS_MAX: usize = 1024;
/// Maximum length of a name in bytes.
pub const NAME_BYTES_MAX: usize = 64;
/// Largest absolute coordinate in metres, ten thousand kilometres.
pub const COORDINATE_M_MAX: f32 = 1e7;
/// Range of radii and half edges in metres.
pub const EXTENT_M: RangeInclusive<f32> = 1e-6..=1e7;
/// Highest radiance in W·sr⁻¹·m⁻²: sums of 65,536 samples stay finite in f32.
pub const RADIANCE_MAX: f32 = 1e30;
/// The range of indices of refraction.
pub const IOR: RangeInclusive<f32> = 1.0..=1e3;
/// Largest given `F_dr,int`: near 1 the base would become brighter without bound.
pub const INTERNAL_REFLECTANCE_MAX: f32 = 0.99;
/// GGX widths below this are rendered as perfectly smooth: the peak of the distribution, 1/(πα²),
/// would overflow, and the difference is invisible.
pub const ALPHA_SMOOTH_MAX: f32 = 1e-3;
/// Highest extinction coefficient in m⁻¹: a mean free path of a micrometre.
pub const EXTINCTION_PER_M_MAX: f32 = 1e6;
/// Maximum ratio of two channels' extinction in a scattering medium: distances are sampled for the
/// clearest channel, and the weights of the others would vary too much.
pub const EXTINCTION_RATIO_MAX: f32 = 8.0;
/// Maximum number of subtractions of one CSG box; each ray that comes near the box is tested
/// against all of them.
pub const SUBTRACTIONS_MAX: usize = 16;
/// Maximum number of subtractions in a scene.
pub const SUBTRACTIONS_TOTAL_MAX: usize = 1024;
/// Maximum slope of a subtracted cone's surface against its axis.
pub const TAPER_MAX: f32 = 1.0;
/// Range of the slope of a truncated cone's lateral surface against its axis: below it, the apex
/// would be too far away for f32.
pub const CONE_SLOPE: RangeInclusive<f32> = 1e-4..=1.0;
/// Surfaces closer than this to a subtraction, in metres, count as inside it: rounding must not put
/// the origin of a ray that leaves a subtraction's surface back into the body.
pub const CSG_MARGIN_M: f32 = 1e-5;
/// Range of a procedural texture's scale.
pub const TEXTURE_SCALE: RangeInclusive<f32> = 1e-3..=1e3;
/// Range of the width of a sheen.
pub const SHEEN_ROUGHNESS: RangeInclusive<f32> = 0.1..=1.0;
/// Range of the full horizontal field of view in degrees.
pub const FOV_X_DEG: RangeInclusive<f32> = 0.01..=179.0;
/// Range of the distance of a camera's near plane in metres.
pub const NEAR_M: RangeInclusive<f32> = 0.0..=COORDINATE_M_MAX;
/// Range of the radius of a lens's aperture in metres.
pub const APERTURE_RADIUS_M: RangeInclusive<f32> = 0.0..=1e3;
/// Range of a lens's focus distance in metres.
pub const FOCUS_DISTANCE_M: RangeInclusive<f32> = 1e-3..=1e7;

/// Range of fractions.
const SHARE: RangeInclusive<f32> = 0.0..=1.0;

type Check = Result<(), SceneError>;

impl Scene {
    /// Checks all values, names and limits.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with the part, the value and the rule.
    pub fn validate(&self) -> Result<(), Error> {
        self.check().map_err(Error::InvalidScene)
    }

    fn check(&self) -> Check {
        let punctual_lights = self.punctual_lights.len();
        count("objects", self.objects.len(), OBJECTS_MAX)?;
        count("area lights", self.area_lights.len(), AREA_LIGHTS_MAX)?;
        count("punctual lights", punctual_lights, PUNCTUAL_LIGHTS_MAX)?;
        count("materials", self.materials.len(), MATERIALS_MAX)?;
        let subtractions = self.objects.iter().map(|object| match &object.shape {
            Shape::CsgBox { subtractions, .. } => subtractions.len(),
            // The exterior of the cone, and the half-spaces beyond both ends.
            Shape::TruncatedCone { .. } => 3,
            _ => 0,
        });
        count("subtractions", subtractions.sum(), SUBTRACTIONS_TOTAL_MAX)?;
        check_triangles(self)?;
        self.camera.validate()?;
        radiance("environment", self.environment.radiance)?;
        self.check_textures()?;
        self.check_environment_map()?;
        for (key, material) in &self.materials {
            name(key)?;
            let checked = check_material(material);
            let checked = checked.and_then(|()| self.check_material_textures(material));
            checked.map_err(|fault| fault.of(format!("material `{key}`")))?;
        }
        for (index, object) in self.objects.iter().enumerate() {
            name(&object.name)?;
            name(&object.material)?;
            let checked = self.check_object(object);
            checked.map_err(|fault| fault.of(format!("object {index} `{}`", object.name)))?;
        }
        self.check_lights()
    }

    fn check_object(&self, object: &Object) -> Check {
        check_shape(&object.shape)?;
        self.check_subtractions(&object.shape)?;
        let material = self.material(&object.material)?;
        self.check_textured(object)?;
        let is_mesh = matches!(object.shape, Shape::Mesh(_));
        let is_plate = matches!(object.shape, Shape::Disc { .. } | Shape::Rectangle { .. });
        let refuse = |why| refuse_material(&object.material, why);
        if material.opacity() != Opacity::Opaque && !is_mesh {
            return refuse("is not opaque, which only meshes can be of");
        }
        if material.is_thin_wall() && !is_mesh && !is_plate {
            return refuse(THIN_WALL);
        }
        if !matches!(material, Material::Dielectric { .. }) {
            return Ok(());
        }
        match &object.shape {
            // Rays meet a truncated cone and a CSG box from outside only.
            Shape::Disc { .. }
            | Shape::Rectangle { .. }
            | Shape::TruncatedCone { .. }
            | Shape::CsgBox { .. } => refuse(DIELECTRIC),
            Shape::Mesh(mesh) => check_closed(mesh),
            Shape::Sphere { .. } | Shape::Box { .. } => Ok(()),
        }
    }

    fn check_subtractions(&self, shape: &Shape) -> Check {
        let Shape::CsgBox { subtractions, .. } = shape else {
            return Ok(());
        };
        count("subtractions", subtractions.len(), SUBTRACTIONS_MAX)?;
        for (index, subtraction) in subtractions.iter().enumerate() {
            let material = subtraction.material.as_deref();
            let checked = check_solid(&subtraction.solid)
                .and_then(|()| material.map_or(Ok(()), |name| self.check_subtraction(name)));
            checked.map_err(|fault| fault.of(format!("subtraction {index}")))?;
        }
        Ok(())
    }

    fn check_subtraction(&self, material: &str) -> Check {
        match self.material(material)? {
            Material::Dielectric { .. } => refuse_material(material, DIELECTRIC),
            found if found.is_thin_wall() => refuse_material(material, THIN_WALL),
            found if found.has_textures() => refuse_material(material, TEXTURED),
            _ => Ok(()),
        }
    }

    fn material(&self, name: &str) -> Result<&Material, SceneError> {
        match self.materials.get(name) {
            Some(material) => Ok(material),
            None => refuse_material(name, "is not among the scene's materials"),
        }
    }

    fn check_lights(&self) -> Check {
        for (index, light) in self.punctual_lights.iter().enumerate() {
            name(&light.name)?;
            let part = || format!("punctual light {index} `{}`", light.name);
            check_punctual_light(light).map_err(|fault| fault.of(part()))?;
        }
        for (index, light) in self.area_lights.iter().enumerate() {
            name(&light.name)?;
            let part = || format!("area light {index} `{}`", light.name);
            check_area_light(light).map_err(|fault| fault.of(part()))?;
        }
        Ok(())
    }
}

const DIELECTRIC: &str =
    "is a dielectric, which needs an inside: give it to a sphere, a box or a closed mesh";
const THIN_WALL: &str = "has transmission, which makes it a thin wall: give it to a mesh, a disc or a rectangle, or \
                         make it a dielectric";
const TEXTURED: &str = "has textures, which need a mesh with texture coordinates";

fn refuse_material<T>(name: &str, why: &str) -> Result<T, SceneError> {
    Err(SceneError::rule(format!("its material `{name}` {why}")))
}

impl Camera {
    /// Checks the camera's values and that it has a view direction.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate(&self) -> Check {
        position("the camera's eye", self.eye)?;
        position("the camera's target", self.target)?;
        finite("the camera's up", self.up)?;
        let (fov, range) = (self.fov_x_deg, FOV_X_DEG);
        require(range.contains(&fov), || {
            let range = format!(
                "it must be from {} to {} degrees",
                range.start(),
                range.end()
            );
            SceneError::value("the camera's fov_x_deg", fov, range)
        })?;
        let (aperture, focus) = (self.lens.aperture_radius_m, self.lens.focus_distance_m);
        in_range(
            "the camera's aperture_radius_m",
            aperture,
            APERTURE_RADIUS_M,
        )?;
        in_range("the camera's focus_distance_m", focus, FOCUS_DISTANCE_M)?;
        in_range("the camera's near_m", self.near_m, NEAR_M)?;
        let view = self.target.as_dvec3() - self.eye.as_dvec3();
        require(view.length() >= 1e-6, || {
            SceneError::rule(format!("the camera's eye and target are both {}", self.eye))
        })?;
        let up = self.up.as_dvec3();
        let sine = view.cross(up).length() / (view.length() * up.length());
        // In this form the comparison fails for NaN.
        require(sine >= 1e-4, || {
            SceneError::rule(format!(
                "the camera's up {} must not be 0 or parallel to its view {}",
                self.up,
                view.as_vec3()
            ))
        })
    }
}

impl ObjectPose {
    /// Checks position and rotation.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate(&self) -> Check {
        let checked = position("its position", self.position);
        let checked = checked.and_then(|()| rotation(self.rotation));
        checked.map_err(|fault| fault.of(format!("pose of object {}", self.object)))
    }
}

/// Whether a valid mesh can have a dielectric material.
#[cfg(feature = "gltf")]
pub(crate) fn bounds_body(mesh: &super::Mesh) -> bool {
    check_mesh(mesh).and_then(|()| check_closed(mesh)).is_ok()
}

fn require(is_kept: bool, fault: impl FnOnce() -> SceneError) -> Check {
    is_kept.then_some(()).ok_or_else(fault)
}

fn in_range(what: &str, value: f32, range: RangeInclusive<f32>) -> Check {
    require(range.contains(&value), || {
        let range = format!("it must be from {} to {}", range.start(), range.end());
        SceneError::value(what, value, range)
    })
}

/// Whether all components are from `min` to `max`; false for NaN.
fn is_within(v: Vec3, min: f32, max: f32) -> bool {
    v.cmpge(Vec3::splat(min)).all() && v.cmple(Vec3::splat(max)).all()
}

fn channels(what: &str, value: Vec3, max: f32) -> Check {
    require(is_within(value, 0.0, max), || {
        SceneError::value(what, value, format!("each channel must be from 0 to {max}"))
    })
}

fn check_albedo(what: &str, albedo: Vec3) -> Check {
    channels(what, albedo, 1.0)
}

fn radiance(of: &str, radiance: Vec3) -> Check {
    require(is_within(radiance, 0.0, RADIANCE_MAX), || {
        let range = format!("each channel must be from 0 to {RADIANCE_MAX:e}");
        SceneError::value(format!("the {of}'s radiance"), radiance, range)
    })
}

fn position(what: &str, p: Vec3) -> Check {
    require(is_within(p, -COORDINATE_M_MAX, COORDINATE_M_MAX), || {
        let range = format!("each coordinate must be within ±{COORDINATE_M_MAX:e} m");
        SceneError::value(what, p, range)
    })
}

fn finite(what: &str, v: Vec3) -> Check {
    require(v.is_finite(), || {
        SceneError::value(what, v, "it must be finite")
    })
}

fn extent(what: &str, metres: f32) -> Check {
    let (min, max) = (EXTENT_M.start(), EXTENT_M.end());
    require(EXTENT_M.contains(&metres), || {
        let range = format!("it must be from {min:e} to {max:e} m");
        SceneError::value(what, format_args!("{metres} m"), range)
    })
}

fn rotation(q: Quat) -> Check {
    require((q.length_squared() - 1.0).abs() <= 1e-3, || {
        let range = "it must be a quaternion of length 1";
        SceneError::value("its rotation", q, range)
    })
}

fn name(name: &str) -> Check {
    require(name.len() <= NAME_BYTES_MAX, || {
        let start: String = name.chars().take(16).collect();
        SceneError::rule(format!(
            "a name that begins `{start}` has {} bytes: at most {NAME_BYTES_MAX} are allowed",
            name.len()
        ))
    })
}

pub(super) fn count(what: &'static str, count: usize, max: usize) -> Check {
    require(count <= max, || SceneError::TooMany { what, count, max })
}
