//! The rules and limits that every scene keeps, checked once before anything is traced.

mod layers;
mod mesh;
#[cfg(test)]
mod tests;
mod texture;

use std::ops::RangeInclusive;

use glam::{Quat, Vec3};

pub use self::layers::{CUTOFF_MAX, NORMAL_SCALE_MAX};
use self::layers::{check_layers, check_normal_scales, check_opacity};
pub use self::mesh::{TRIANGLES_MAX, VERTICES_MAX};
use self::mesh::{check_closed, check_mesh, check_triangles};
pub use self::texture::{TEXTURE_BYTES_MAX, TEXTURES_MAX, UV_MAX};
use crate::scene::{
    AreaLight, Camera, ClothMarks, CsgSolid, Material, Medium, Object, ObjectPose, Opacity,
    ParticleCloud, ParticleForm, ProceduralTexture, PunctualEmitter, PunctualLight, Scene,
    SceneUpdate, Shape, Stripe,
};
use crate::{Error, SceneError};

/// The most objects in a scene. Rays find many of a shape by a BVH.
pub const OBJECTS_MAX: usize = 1 << 17;
/// The most particles of an update: 393 kB.
pub const PARTICLES_MAX: usize = 1 << 16;
/// The most clouds of particles in an update.
pub const CLOUDS_MAX: usize = 32;
/// The longest edge of a cloud's box, over the smoothing radius of its surface.
pub const SMOOTHING_RADII_MAX: f32 = 16_384.0;
/// The most area lights in a scene.
pub const AREA_LIGHTS_MAX: usize = 64;
/// The most lights without extent in a scene: each hit weighs all of them.
pub const PUNCTUAL_LIGHTS_MAX: usize = 64;
/// The most materials in a scene.
pub const MATERIALS_MAX: usize = 1024;
/// The longest name in bytes.
pub const NAME_BYTES_MAX: usize = 64;
/// The largest coordinate in metres, ten thousand kilometres.
pub const COORDINATE_M_MAX: f32 = 1e7;
/// The smallest and largest radius or half edge in metres.
pub const EXTENT_M: RangeInclusive<f32> = 1e-6..=1e7;
/// The highest radiance in W·sr⁻¹·m⁻²: sums of 65,536 samples stay finite in f32.
pub const RADIANCE_MAX: f32 = 1e30;
/// The range of indices of refraction.
pub const IOR: RangeInclusive<f32> = 1.0..=1e3;
/// The largest given `F_dr,int`: near 1 the base would be brightened without bound.
pub const INTERNAL_REFLECTANCE_MAX: f32 = 0.99;
/// GGX widths below this are drawn as perfectly smooth: the peak of the distribution, 1/(πα²),
/// would overflow and no picture shows the difference.
pub const ALPHA_SMOOTH_MAX: f32 = 1e-3;
/// The highest extinction coefficient in m⁻¹: a mean free path of a micrometre.
pub const EXTINCTION_PER_M_MAX: f32 = 1e6;
/// In a medium that scatters no channel's extinction is more than this many times another's:
/// distances are drawn for the clearest channel, and the others' weights would spread too far.
pub const EXTINCTION_RATIO_MAX: f32 = 8.0;
/// The most subtractions of one CSG box: each ray that comes near it meets each of them.
pub const SUBTRACTIONS_MAX: usize = 16;
/// The most subtractions of a scene.
pub const SUBTRACTIONS_TOTAL_MAX: usize = 1024;
/// The steepest that a cone's surface leans from upright.
pub const TAPER_MAX: f32 = 1.0;
/// Slope of a truncated cone's side against its axis: below, its apex lies too far off for f32.
pub const CONE_SLOPE: RangeInclusive<f32> = 1e-4..=1.0;
/// Surfaces closer than this to a subtraction count as within it, in m: rounding must not put a ray that
/// leaves a subtraction's surface back into the body.
pub const CSG_MARGIN_M: f32 = 1e-5;
/// The range of a texture's scale.
pub const TEXTURE_SCALE: RangeInclusive<f32> = 1e-3..=1e3;
/// The range of the width of a sheen.
pub const SHEEN_ROUGHNESS: RangeInclusive<f32> = 0.1..=1.0;
/// The range of a full horizontal field of view in degrees.
pub const FOV_X_DEG: RangeInclusive<f32> = 0.01..=179.0;
/// The range of the radius of a lens's aperture in metres.
pub const APERTURE_RADIUS_M: RangeInclusive<f32> = 0.0..=1e3;
/// The range of the distance at which a lens is sharp, in metres: before the eye.
pub const FOCUS_DISTANCE_M: RangeInclusive<f32> = 1e-3..=1e7;

type Check = Result<(), SceneError>;

impl Scene {
    /// Checks every number, name and limit.
    ///
    /// # Errors
    /// [`Error::InvalidScene`] with the place, the value and the rule.
    pub fn validate(&self) -> Result<(), Error> {
        self.check().map_err(Error::InvalidScene)
    }

    fn check(&self) -> Check {
        count("objects", self.objects.len(), OBJECTS_MAX)?;
        count("area lights", self.area_lights.len(), AREA_LIGHTS_MAX)?;
        count(
            "punctual lights",
            self.punctual_lights.len(),
            PUNCTUAL_LIGHTS_MAX,
        )?;
        count("materials", self.materials.len(), MATERIALS_MAX)?;
        let subtractions = self.objects.iter().map(|object| match &object.shape {
            Shape::CsgBox { subtractions, .. } => subtractions.len(),
            // Its outside, and what lies beyond its ends.
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
            let place = |fault| SceneError::Material {
                name: key.clone(),
                fault: Box::new(fault),
            };
            check_material(material).map_err(place)?;
            self.check_material_textures(material).map_err(place)?;
        }
        for (index, object) in self.objects.iter().enumerate() {
            name(&object.name)?;
            name(&object.material)?;
            self.check_object(object)
                .map_err(|fault| SceneError::Object {
                    index,
                    name: object.name.clone(),
                    fault: Box::new(fault),
                })?;
        }
        self.check_lights()
    }

    fn check_object(&self, object: &Object) -> Check {
        check_shape(&object.shape)?;
        self.check_subtractions(&object.shape)?;
        let name = &object.material;
        let Some(material) = self.materials.get(name) else {
            return Err(SceneError::UnknownMaterial(name.clone()));
        };
        self.check_textured(object)?;
        if material.opacity() != Opacity::Opaque && !matches!(object.shape, Shape::Mesh(_)) {
            return Err(SceneError::TransparentShape(name.clone()));
        }
        let is_solid = !matches!(
            object.shape,
            Shape::Mesh(_) | Shape::Disc { .. } | Shape::Rectangle { .. }
        );
        if material.is_thin_wall() && is_solid {
            return Err(SceneError::ThinWallShape(name.clone()));
        }
        if !matches!(material, Material::Dielectric { .. }) {
            return Ok(());
        }
        match object.shape {
            Shape::Disc { .. } | Shape::Rectangle { .. } => {
                Err(SceneError::DielectricFlat(name.clone()))
            }
            Shape::TruncatedCone { .. } => Err(SceneError::DielectricSurface(name.clone())),
            Shape::Mesh(ref mesh) => check_closed(mesh),
            Shape::Sphere { .. } | Shape::Box { .. } | Shape::CsgBox { .. } => Ok(()),
        }
    }

    fn check_lights(&self) -> Check {
        for (index, light) in self.punctual_lights.iter().enumerate() {
            name(&light.name)?;
            check_punctual_light(light).map_err(|fault| SceneError::PunctualLight {
                index,
                name: light.name.clone(),
                fault: Box::new(fault),
            })?;
        }
        for (index, light) in self.area_lights.iter().enumerate() {
            name(&light.name)?;
            check_area_light(light).map_err(|fault| SceneError::AreaLight {
                index,
                name: light.name.clone(),
                fault: Box::new(fault),
            })?;
        }
        Ok(())
    }
}

impl Scene {
    fn check_subtractions(&self, shape: &Shape) -> Check {
        let Shape::CsgBox { subtractions, .. } = shape else {
            return Ok(());
        };
        if subtractions.len() > SUBTRACTIONS_MAX {
            return Err(SceneError::TooMany {
                what: "subtractions",
                count: subtractions.len(),
                max: SUBTRACTIONS_MAX,
            });
        }
        for (index, subtraction) in subtractions.iter().enumerate() {
            let place = |fault| SceneError::Subtraction {
                index,
                fault: Box::new(fault),
            };
            check_solid(&subtraction.solid).map_err(place)?;
            let Some(material) = &subtraction.material else {
                continue;
            };
            match self.materials.get(material) {
                Some(Material::Dielectric { .. }) => {
                    return Err(place(SceneError::DielectricSurface(material.clone())));
                }
                Some(found) if found.is_thin_wall() => {
                    return Err(place(SceneError::ThinWallShape(material.clone())));
                }
                Some(found) if found.textures().indices().next().is_some() => {
                    return Err(place(SceneError::TexturedShape(material.clone())));
                }
                Some(_) => {}
                None => {
                    return Err(place(SceneError::UnknownMaterial(material.clone())));
                }
            }
        }
        Ok(())
    }
}

impl Camera {
    /// Checks that the camera sees something.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate(&self) -> Check {
        position("the camera's eye", self.eye)?;
        position("the camera's target", self.target)?;
        finite("the camera's up", self.up)?;
        if !FOV_X_DEG.contains(&self.fov_x_deg) {
            return Err(SceneError::OutOfRange {
                what: "the camera's fov_x_deg",
                value: self.fov_x_deg,
                min: *FOV_X_DEG.start(),
                max: *FOV_X_DEG.end(),
                unit: " degrees",
            });
        }
        let lens = &self.lens;
        for (what, value, range) in [
            (
                "the camera's aperture_radius_m",
                lens.aperture_radius_m,
                APERTURE_RADIUS_M,
            ),
            (
                "the camera's focus_distance_m",
                lens.focus_distance_m,
                FOCUS_DISTANCE_M,
            ),
        ] {
            in_range(what, value, &range)?;
        }
        let view = self.target.as_dvec3() - self.eye.as_dvec3();
        if view.length() < 1e-6 {
            return Err(SceneError::CameraTarget(self.eye));
        }
        let up = self.up.as_dvec3();
        let sine = view.cross(up).length() / (view.length() * up.length());
        if sine.is_nan() || sine < 1e-4 {
            return Err(SceneError::CameraUp {
                up: self.up,
                view: view.as_vec3(),
            });
        }
        Ok(())
    }
}

impl ObjectPose {
    /// Checks that the pose is a place and a turn.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate(&self) -> Check {
        let place = |fault| SceneError::Pose {
            object: self.object,
            fault: Box::new(fault),
        };
        position("its position", self.position).map_err(place)?;
        rotation(self.rotation).map_err(place)
    }
}

impl SceneUpdate {
    /// Checks the particles: that they are not too many, and each cloud.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate_particles(&self) -> Check {
        count("clouds of particles", self.particles.len(), CLOUDS_MAX)?;
        let particles = self.particles.iter().map(|cloud| cloud.places.len());
        count("particles", particles.sum(), PARTICLES_MAX)?;
        for (index, cloud) in self.particles.iter().enumerate() {
            cloud.validate().map_err(|fault| SceneError::Cloud {
                index,
                fault: Box::new(fault),
            })?;
        }
        Ok(())
    }
}

impl ParticleCloud {
    /// Checks material, radius, box and form.
    ///
    /// # Errors
    /// The rule that is broken, with the value.
    pub fn validate(&self) -> Check {
        check_material(&self.material)?;
        let is_patterned = matches!(
            self.material,
            Material::Coated { .. } | Material::Cloth { marks: Some(_), .. }
        );
        if is_patterned || self.material.textures().indices().next().is_some() {
            return Err(SceneError::PatternedParticles);
        }
        extent("its radius", self.radius_m)?;
        corners(self.min, self.max)?;
        let ParticleForm::Surface {
            smoothing_m,
            floor_m,
        } = self.form
        else {
            return match self.material.is_thin_wall() {
                true => Err(SceneError::ThinWallParticles),
                false => Ok(()),
            };
        };
        extent("its smoothing radius", smoothing_m)?;
        position("its floor", Vec3::Z * floor_m)?;
        let edge_m = (self.max - self.min).max_element();
        match edge_m <= SMOOTHING_RADII_MAX * smoothing_m {
            true => Ok(()),
            false => Err(SceneError::SurfaceBox {
                edge_m,
                smoothing_m,
                max: SMOOTHING_RADII_MAX,
            }),
        }
    }
}

/// Whether a mesh that keeps all rules can be of a dielectric.
#[cfg(feature = "gltf")]
pub(crate) fn bounds_body(mesh: &super::Mesh) -> bool {
    check_mesh(mesh).and_then(|()| check_closed(mesh)).is_ok()
}

fn check_shape(shape: &Shape) -> Check {
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
            in_range("the slope of its side", slope, &CONE_SLOPE)
        }
        Shape::Disc {
            center,
            normal,
            radius,
        } => {
            position("its center", center)?;
            finite("its normal", normal)?;
            extent("its radius", radius)?;
            if normal == Vec3::ZERO {
                return Err(SceneError::ZeroNormal(normal));
            }
            Ok(())
        }
        Shape::Rectangle {
            center,
            half_u,
            half_v,
        } => rectangle(center, half_u, half_v),
        Shape::Mesh(ref mesh) => check_mesh(mesh),
    }
}

fn check_solid(solid: &CsgSolid) -> Check {
    match *solid {
        CsgSolid::HalfSpace { point, normal } => {
            position("its point", point)?;
            finite("its normal", normal)?;
            if normal == Vec3::ZERO {
                return Err(SceneError::ZeroNormal(normal));
            }
            Ok(())
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
            in_range("its taper", taper, &(-TAPER_MAX..=TAPER_MAX))
        }
    }
}

fn check_number(number: u8) -> Check {
    match number {
        0..=99 => Ok(()),
        _ => Err(SceneError::BallNumber(number)),
    }
}

fn in_range(what: &'static str, value: f32, range: &RangeInclusive<f32>) -> Check {
    if range.contains(&value) {
        return Ok(());
    }
    Err(SceneError::OutOfRange {
        what,
        value,
        min: *range.start(),
        max: *range.end(),
        unit: "",
    })
}

fn corners(min: Vec3, max: Vec3) -> Check {
    position("its min", min)?;
    position("its max", max)?;
    if min.cmplt(max).all() {
        return Ok(());
    }
    Err(SceneError::Corners { min, max })
}

fn check_area_light(light: &AreaLight) -> Check {
    rectangle(light.center, light.half_u, light.half_v)?;
    radiance("area light", light.radiance)
}

fn check_punctual_light(light: &PunctualLight) -> Check {
    let axis = |direction: Vec3| {
        finite("its direction", direction)?;
        match direction == Vec3::ZERO {
            true => Err(SceneError::ZeroNormal(direction)),
            false => Ok(()),
        }
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
            in_range("its outer_deg", outer_deg, &(0.0..=90.0))?;
            in_range("its inner_deg", inner_deg, &(0.0..=outer_deg))?;
        }
        PunctualEmitter::Distant { direction, .. } => axis(direction)?,
    }
    radiance("punctual light", light.strength())
}

fn rectangle(center: Vec3, half_u: Vec3, half_v: Vec3) -> Check {
    position("its center", center)?;
    finite("its half_u", half_u)?;
    finite("its half_v", half_v)?;
    let (u, v) = (half_u.as_dvec3(), half_v.as_dvec3());
    extent("the length of its half_u", u.length() as f32)?;
    extent("the length of its half_v", v.length() as f32)?;
    if u.dot(v).abs() > 1e-4 * u.length() * v.length() {
        return Err(SceneError::Skew { half_u, half_v });
    }
    Ok(())
}

#[expect(clippy::too_many_lines, reason = "one arm for each material")]
fn check_material(material: &Material) -> Check {
    match *material {
        Material::Diffuse { albedo } => check_albedo("its albedo", albedo),
        Material::SmoothPlastic {
            albedo,
            ior,
            internal_reflectance,
            stripe,
        } => {
            check_albedo("its albedo", albedo)?;
            check_ior(ior)?;
            let internal = internal_reflectance.unwrap_or(0.0);
            let range = 0.0..=INTERNAL_REFLECTANCE_MAX;
            in_range("its internal_reflectance", internal, &range)?;
            stripe.map_or(Ok(()), |stripe| check_stripe(&stripe))
        }
        Material::Coated { ior, texture } => {
            check_ior(ior)?;
            check_texture(&texture)
        }
        Material::Cloth {
            albedo,
            sheen,
            sheen_roughness,
            marks,
        } => {
            check_albedo("its albedo", albedo)?;
            check_albedo("its sheen", sheen)?;
            in_range("its sheen_roughness", sheen_roughness, &SHEEN_ROUGHNESS)?;
            marks.map_or(Ok(()), |marks| check_marks(&marks))
        }
        Material::Conductor {
            eta,
            k,
            alpha,
            number,
        } => {
            check_alpha(alpha)?;
            check_number(number)?;
            let most = Vec3::splat(*IOR.end());
            if !(eta.cmpgt(Vec3::ZERO).all() && eta.cmple(most).all()) {
                return Err(SceneError::Eta {
                    value: eta,
                    max: *IOR.end(),
                });
            }
            if !(k.cmpge(Vec3::ZERO).all() && k.cmple(most).all()) {
                return Err(SceneError::Channels {
                    what: "its k",
                    value: k,
                    max: *IOR.end(),
                });
            }
            Ok(())
        }
        Material::Dielectric {
            ior,
            alpha,
            medium,
            number,
        } => {
            check_ior(ior)?;
            check_alpha(alpha)?;
            check_number(number)?;
            medium.map_or(Ok(()), |medium| check_medium(&medium))
        }
        Material::MetallicRoughness {
            base_color,
            metallic,
            roughness,
            ior,
            emission,
            textures,
            opacity,
            layers,
        } => {
            check_albedo("its base_color", base_color)?;
            in_range("its metallic", metallic, &(0.0..=1.0))?;
            in_range("its roughness", roughness, &(0.0..=1.0))?;
            check_ior(ior)?;
            radiance("material", emission)?;
            check_normal_scales(&textures)?;
            check_opacity(opacity)?;
            check_layers(&layers)
        }
    }
}

fn check_stripe(stripe: &Stripe) -> Check {
    check_albedo("its stripe's albedo", stripe.albedo)?;
    if stripe.half_width > 0.0 && stripe.half_width <= 1.0 {
        return Ok(());
    }
    Err(SceneError::StripeWidth(stripe.half_width))
}

fn check_marks(marks: &ClothMarks) -> Check {
    let within = 0.0..=COORDINATE_M_MAX;
    in_range("the line_x of its marks", marks.line_x, &within)?;
    in_range("the d_radius of its marks", marks.d_radius, &within)?;
    let along = -COORDINATE_M_MAX..=COORDINATE_M_MAX;
    let mut spots = marks.spots_x.into_iter();
    spots.try_for_each(|x| in_range("a spot of its marks", x, &along))
}

fn check_texture(texture: &ProceduralTexture) -> Check {
    match *texture {
        ProceduralTexture::Ball {
            albedo,
            stripe,
            number,
        } => {
            check_albedo("its albedo", albedo)?;
            check_number(number)?;
            stripe.map_or(Ok(()), |stripe| check_stripe(&stripe))
        }
        ProceduralTexture::Wood {
            light,
            dark,
            sights,
            scale,
            ..
        } => {
            check_albedo("its light albedo", light)?;
            check_albedo("its dark albedo", dark)?;
            in_range("the scale of its texture", scale, &TEXTURE_SCALE)?;
            let Some(sights) = sights else { return Ok(()) };
            if sights.spacing != 0.0 {
                extent("the spacing of its sights", sights.spacing)?;
            }
            extent("the end_x of its sights", sights.end_x)?;
            extent("the side_y of its sights", sights.side_y)
        }
        ProceduralTexture::Cue { shaft, butt } => {
            check_albedo("the albedo of its shaft", shaft)?;
            check_albedo("the albedo of its butt", butt)
        }
        ProceduralTexture::Planks { light, dark } => {
            check_albedo("its light albedo", light)?;
            check_albedo("its dark albedo", dark)
        }
        ProceduralTexture::Bricks {
            light,
            dark,
            mortar,
        } => {
            check_albedo("its light albedo", light)?;
            check_albedo("its dark albedo", dark)?;
            check_albedo("the albedo of its mortar", mortar)
        }
        ProceduralTexture::Scoreboard {
            face,
            ink,
            center,
            radius,
        } => {
            check_albedo("the albedo of its dials", face)?;
            check_albedo("the albedo of its ink", ink)?;
            let along = -COORDINATE_M_MAX..=COORDINATE_M_MAX;
            let mut center = center.into_iter();
            center.try_for_each(|at| in_range("the centre of its dials", at, &along))?;
            extent("the radius of its dials", radius)
        }
    }
}

fn check_ior(ior: f32) -> Check {
    in_range("its ior", ior, &IOR)
}

fn check_alpha(alpha: f32) -> Check {
    in_range("its alpha", alpha, &(0.0..=1.0))
}

fn check_medium(medium: &Medium) -> Check {
    check_albedo("its medium's albedo", medium.albedo)?;
    let extinction = medium.extinction;
    let most = Vec3::splat(EXTINCTION_PER_M_MAX);
    if !(extinction.cmpge(Vec3::ZERO).all() && extinction.cmple(most).all()) {
        return Err(SceneError::Extinction {
            value: extinction,
            max: EXTINCTION_PER_M_MAX,
        });
    }
    let (least, largest) = (extinction.min_element(), extinction.max_element());
    let is_even = least > 0.0 && largest <= EXTINCTION_RATIO_MAX * least;
    if medium.albedo != Vec3::ZERO && !is_even {
        return Err(SceneError::ExtinctionRatio {
            value: extinction,
            ratio_max: EXTINCTION_RATIO_MAX,
        });
    }
    Ok(())
}

fn check_albedo(what: &'static str, albedo: Vec3) -> Check {
    if albedo.cmpge(Vec3::ZERO).all() && albedo.cmple(Vec3::ONE).all() {
        return Ok(());
    }
    Err(SceneError::Channels {
        what,
        value: albedo,
        max: 1.0,
    })
}

fn radiance(what: &'static str, radiance: Vec3) -> Check {
    if radiance.cmpge(Vec3::ZERO).all() && radiance.cmple(Vec3::splat(RADIANCE_MAX)).all() {
        return Ok(());
    }
    Err(SceneError::Radiance {
        what,
        value: radiance,
        max: RADIANCE_MAX,
    })
}

fn position(what: &'static str, p: Vec3) -> Check {
    if p.abs().cmple(Vec3::splat(COORDINATE_M_MAX)).all() {
        return Ok(());
    }
    Err(SceneError::Position {
        what,
        value: p,
        max: COORDINATE_M_MAX,
    })
}

fn finite(what: &'static str, v: Vec3) -> Check {
    if v.is_finite() {
        Ok(())
    } else {
        Err(SceneError::NotFinite { what, value: v })
    }
}

fn extent(what: &'static str, metres: f32) -> Check {
    if EXTENT_M.contains(&metres) {
        return Ok(());
    }
    Err(SceneError::Length {
        what,
        metres,
        min: *EXTENT_M.start(),
        max: *EXTENT_M.end(),
    })
}

fn rotation(q: Quat) -> Check {
    if (q.length_squared() - 1.0).abs() <= 1e-3 {
        return Ok(());
    }
    Err(SceneError::Rotation(q))
}

fn name(name: &str) -> Check {
    if name.len() <= NAME_BYTES_MAX {
        return Ok(());
    }
    let start: String = name.chars().take(16).collect();
    Err(SceneError::LongName {
        start,
        bytes: name.len(),
        max: NAME_BYTES_MAX,
    })
}

pub(super) fn count(what: &'static str, count: usize, max: usize) -> Check {
    if count <= max {
        return Ok(());
    }
    Err(SceneError::TooMany { what, count, max })
}
