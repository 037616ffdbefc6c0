//! The scene schema of the script that traced the reference pictures with Mitsuba, and its conversion.
//!
//! The schema: `camera` (`eye`, `target`, `up`,
//! `fov_x_deg`), `environment` (constant `radiance`), `lights` (one-sided rectangles with edges
//! along x and y: `center`, `half_x`, `half_y`, `normal` (0, 0, ±1), `radiance`), `boxes`, `discs`
//! and `spheres` (with a `name`, a `material` and, for balls with a band, the world's
//! `stripe_axis`), and `materials` (`type` `diffuse` or `smooth_plastic`, `albedo`, `ior`,
//! `stripe_albedo` where `|n · stripe_axis| < 0.5`). Purely descriptive fields are skipped.
//!
//! Spheres become the first objects, then boxes, then discs, each list in its order.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use carom_tracer::{AreaLight, Camera, Environment, Lens, Material, Object, Scene, Shape, Stripe};
use glam::{DQuat, DVec3, Quat, Vec3};
use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::BenchError;

/// Convert a scene of the script for Mitsuba into a scene file of Carom's own.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The scene of the script, as tests/references/pool_scene.json.
    input: PathBuf,
    /// The scene file to write.
    output: PathBuf,
}

pub(crate) fn run(args: &Args) -> Result<(), BenchError> {
    let scene = load(&args.input).map_err(|why| BenchError::Input(format!("{why:#}")))?;
    Ok(scene.save(&args.output)?)
}

/// Sine of half the band of every striped ball in this schema.
pub const STRIPE_HALF_WIDTH: f32 = 0.5;

/// Reads, converts and checks a scene file in this schema.
///
/// # Errors
/// A sentence with the path, and with the position or the object that is wrong.
pub fn load(path: &Path) -> anyhow::Result<Scene> {
    let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
    from_json(&text).with_context(|| path.display().to_string())
}

/// Converts and checks a scene in this schema.
///
/// # Errors
/// A sentence with line and column if the text does not follow the schema, or with the object that
/// breaks a rule of [`carom_tracer::scene::validate`].
pub fn from_json(text: &str) -> anyhow::Result<Scene> {
    let file: SceneFile = serde_json::from_str(text)?;
    let scene = file.into_scene()?;
    scene.validate()?;
    Ok(scene)
}

/// Egan and Hilgeman's fit of the internal diffuse reflectance of a dielectric of index `eta`
/// ("Spectral reflectance of particulate materials", Applied Optics 1973), which renderers use in
/// place of the integral: 0.596811 at 1.5, where the integral is 0.596346.
pub fn internal_reflectance_fit(eta: f64) -> f64 {
    -1.4399 / (eta * eta) + 0.7099 / eta + 0.6681 + 0.0636 * eta
}

#[derive(Deserialize)]
struct SceneFile {
    camera: CameraJson,
    environment: EnvironmentJson,
    lights: Vec<LightJson>,
    #[serde(default)]
    boxes: Vec<BoxJson>,
    #[serde(default)]
    discs: Vec<DiscJson>,
    #[serde(default)]
    spheres: Vec<SphereJson>,
    materials: BTreeMap<String, MaterialJson>,
}

#[derive(Deserialize)]
struct CameraJson {
    eye: Vec3,
    target: Vec3,
    up: Vec3,
    fov_x_deg: f32,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum EnvironmentJson {
    Constant { radiance: Vec3 },
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum LightJson {
    Rect {
        center: Vec3,
        half_x: f32,
        half_y: f32,
        normal: Vec3,
        radiance: Vec3,
        one_sided: bool,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct BoxJson {
    #[serde(rename = "type")]
    _type: IgnoredAny,
    name: String,
    material: String,
    min: Vec3,
    max: Vec3,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct DiscJson {
    #[serde(rename = "type")]
    _type: IgnoredAny,
    name: String,
    material: String,
    center: Vec3,
    normal: Vec3,
    radius: f32,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct SphereJson {
    #[serde(rename = "type")]
    _type: IgnoredAny,
    name: String,
    material: String,
    center: Vec3,
    radius: f32,
    stripe_axis: Option<DVec3>,
}

#[derive(Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
enum MaterialJson {
    Diffuse {
        albedo: Vec3,
    },
    SmoothPlastic {
        albedo: Vec3,
        ior: f32,
        stripe_albedo: Option<Vec3>,
        #[serde(rename = "stripe_rule")]
        _stripe_rule: Option<IgnoredAny>,
    },
}

impl SceneFile {
    fn into_scene(self) -> anyhow::Result<Scene> {
        let spheres = self.spheres.into_iter().map(SphereJson::into_object);
        let boxes = self.boxes.into_iter().map(BoxJson::into_object);
        let discs = self.discs.into_iter().map(DiscJson::into_object);
        let area_lights = self.lights.into_iter().enumerate();
        Ok(Scene {
            camera: Camera {
                eye: self.camera.eye,
                target: self.camera.target,
                up: self.camera.up,
                fov_x_deg: self.camera.fov_x_deg,
                lens: Lens::default(),
                near_m: 0.0,
            },
            environment: match self.environment {
                EnvironmentJson::Constant { radiance } => Environment { radiance },
            },
            materials: self
                .materials
                .into_iter()
                .map(|(name, surface)| (name, surface.into_material()))
                .collect(),
            objects: spheres.chain(boxes).chain(discs).collect(),
            area_lights: area_lights
                .map(|(i, light)| light.into_area_light(i))
                .collect::<anyhow::Result<_>>()?,
            ..Scene::new()
        })
    }
}

impl LightJson {
    fn into_area_light(self, index: usize) -> anyhow::Result<AreaLight> {
        let Self::Rect {
            center,
            half_x,
            half_y,
            normal,
            radiance,
            one_sided,
        } = self;
        ensure!(
            one_sided,
            "light {index} is not one_sided: give a second light for its back"
        );
        ensure!(
            normal == Vec3::Z || normal == Vec3::NEG_Z,
            "light {index}: its normal {normal} must be [0, 0, 1] or [0, 0, -1], since its edges are \
             along x and y"
        );
        Ok(AreaLight {
            name: format!("lamp{index}"),
            center,
            half_u: Vec3::new(half_x, 0.0, 0.0),
            half_v: Vec3::new(0.0, half_y * normal.z, 0.0),
            radiance,
            ..AreaLight::new(1.0, 1.0)
        })
    }
}

impl BoxJson {
    fn into_object(self) -> Object {
        Object {
            name: self.name,
            material: self.material,
            shape: Shape::Box {
                min: self.min,
                max: self.max,
            },
        }
    }
}

impl DiscJson {
    fn into_object(self) -> Object {
        Object {
            name: self.name,
            material: self.material,
            shape: Shape::Disc {
                center: self.center,
                normal: self.normal,
                radius: self.radius,
            },
        }
    }
}

impl SphereJson {
    fn into_object(self) -> Object {
        let rotation = self.stripe_axis.map_or(Quat::IDENTITY, |axis| {
            // An axis of length 0 gives NaN, which the scene's check then names.
            DQuat::from_rotation_arc(DVec3::Z, axis / axis.length()).as_quat()
        });
        Object {
            name: self.name,
            material: self.material,
            shape: Shape::Sphere {
                center: self.center,
                radius: self.radius,
                rotation,
            },
        }
    }
}

impl MaterialJson {
    fn into_material(self) -> Material {
        match self {
            Self::Diffuse { albedo } => Material::Diffuse { albedo },
            Self::SmoothPlastic {
                albedo,
                ior,
                stripe_albedo,
                ..
            } => Material::SmoothPlastic {
                albedo,
                ior,
                internal_reflectance: Some(internal_reflectance_fit(f64::from(ior)) as f32),
                stripe: stripe_albedo.map(|albedo| Stripe {
                    albedo,
                    half_width: STRIPE_HALF_WIDTH,
                }),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCENE: &str = r#"{
        "units": "metres",
        "camera": { "eye": [0, -2, 1], "target": [0, 0, 0], "up": [0, 0, 1], "fov_x_deg": 44,
                    "width": 8, "height": 8 },
        "environment": { "type": "constant", "radiance": [0, 0, 0] },
        "lights": [ { "type": "rect", "center": [0, 0, 1], "half_x": 0.4, "half_y": 0.2,
                      "normal": [0, 0, -1], "radiance": [1, 1, 1], "one_sided": true } ],
        "spheres": [ { "name": "a", "type": "sphere", "center": [0, 0, 0], "radius": 0.1,
                       "material": "m", "stripe_axis": [0, 2, 0] } ],
        "materials": { "m": { "type": "diffuse", "albedo": [0, 0, 0] } }
    }"#;

    #[test]
    fn the_fit_gives_the_references_value() {
        assert!((internal_reflectance_fit(1.5) - 0.596_811).abs() < 5e-7);
    }

    #[test]
    fn the_stripe_axis_becomes_the_balls_z() {
        let scene = from_json(SCENE).unwrap();
        let Shape::Sphere { rotation, .. } = scene.objects[0].shape else {
            panic!("the first object is the sphere");
        };
        assert!((rotation * Vec3::Z - Vec3::Y).length() < 1e-6);
    }

    #[test]
    fn what_has_no_counterpart_is_refused() {
        for (from, to, sentence) in [
            ("true", "false", "light 0 is not one_sided"),
            (
                "[0, 0, -1]",
                "[0, 1, 0]",
                "light 0: its normal [0, 1, 0] must be",
            ),
            (
                "[0, 2, 0]",
                "[0, 0, 0]",
                "object 0 `a`: its rotation is [NaN",
            ),
            ("\"diffuse\"", "\"glass\"", "unknown variant `glass`"),
            ("\"constant\"", "\"map\"", "unknown variant `map`"),
        ] {
            let error = from_json(&SCENE.replacen(from, to, 1))
                .unwrap_err()
                .to_string();
            assert!(error.contains(sentence), "`{sentence}` is not in `{error}`");
        }
    }
}
