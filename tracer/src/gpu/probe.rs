//! The start-up probe: a GPU is only used if it traces two small scenes as the scalar tracer does.
//!
//! Drivers compile, fuse and round differently, and some miscompile. The first scene has plain
//! balls and boxes under area lights; the second has rarer features: a wooden CSG box, a number,
//! napped cloth, rough metal, a mesh, and a rough dielectric with a scattering medium.

use std::collections::BTreeMap;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use glam::{Quat, Vec3};

use crate::{
    AreaLight, Axis, Camera, ClothMarks, CompiledScene, CsgSolid, Environment, Error, ImageSize,
    Lens, Material, Medium, Mesh, Object, ProceduralTexture, RenderSettings, ScalarTracer, Scene,
    Shape, Stripe, Subtraction, Tile, TraceJob, Tracer,
};

/// Image size and sampling of the probe: 32 × 24 pixels of 4 samples, 10 ms of the scalar tracer.
const SIZE: ImageSize = ImageSize::new(32, 24);
const SETTINGS: RenderSettings = RenderSettings {
    samples: 4,
    first_sample: 0,
    max_depth: 4,
    seed: 1,
    denoise: false,
};
/// Tolerance of a pixel, absolute plus relative. Rounding changes a pixel by about 1e-6; where it
/// makes a path miss an edge, the change is as large as the light itself. Fewer than 1 in 1000
/// paths are affected.
const ERROR_MAX: f32 = 1e-3;
const PIXELS_OFF_MAX: usize = SIZE.pixels() / 50;

/// Compares `tracer` with the scalar tracer on both scenes.
///
/// # Errors
/// [`Error::Device`] if it fails or too many pixels differ.
pub(crate) fn prove(tracer: &dyn Tracer) -> Result<(), Error> {
    prove_with(tracer, &scene())?;
    prove_with(tracer, &dressed_scene())
}

fn prove_with(tracer: &dyn Tracer, scene: &Scene) -> Result<(), Error> {
    let scene = CompiledScene::new(scene)?;
    let picture = trace(tracer, &scene)?;
    let truth = trace(&ScalarTracer, &scene)?;
    let off = (picture.iter().zip(&truth)).filter(|(a, b)| is_off(**a, **b));
    let off = off.count();
    if picture.len() == truth.len() && off <= PIXELS_OFF_MAX {
        return Ok(());
    }
    Err(Error::Device {
        device: tracer.info().name,
        message: format!(
            "it traces {off} of {} pixels of the start-up probe wrongly; install another version \
             of its driver",
            truth.len()
        ),
    })
}

fn is_off(a: [f32; 3], b: [f32; 3]) -> bool {
    let error = (Vec3::from(a) - Vec3::from(b)).abs();
    // In this form a NaN counts as off.
    !error.cmple(ERROR_MAX * (1.0 + Vec3::from(b))).all()
}

fn trace(tracer: &dyn Tracer, scene: &CompiledScene) -> Result<Vec<[f32; 3]>, Error> {
    let tile = Tile {
        x: 0,
        y: 0,
        width: SIZE.width,
        height: SIZE.height,
    };
    let job = TraceJob {
        size: SIZE,
        tiles: &[tile],
        settings: SETTINGS,
        cancelled: &AtomicBool::new(false),
    };
    let picture = Mutex::new(Vec::new());
    tracer.trace(scene, &job, &|tile| {
        picture
            .lock()
            .expect("no sink panics")
            .extend(tile.radiance);
    })?;
    Ok(picture.into_inner().expect("no sink panics"))
}

/// A ball, a box, a disc and a rectangle under two area lights.
pub(crate) fn scene() -> Scene {
    let materials = [
        (
            "ball",
            Material::SmoothPlastic {
                albedo: Vec3::new(0.8, 0.78, 0.7),
                ior: 1.5,
                internal_reflectance: None,
                stripe: Some(Stripe {
                    albedo: Vec3::new(0.6, 0.02, 0.02),
                    half_width: 0.5,
                }),
            },
        ),
        (
            "cloth",
            Material::Diffuse {
                albedo: Vec3::new(0.04, 0.4, 0.2),
            },
        ),
    ];
    let sphere = Shape::Sphere {
        center: Vec3::new(0.0, 0.0, 0.5),
        radius: 0.5,
        rotation: Quat::from_rotation_x(0.7),
    };
    let solid = Shape::Box {
        min: Vec3::new(-1.5, 0.6, -0.1),
        max: Vec3::new(-0.4, 1.2, 0.9),
    };
    let disc = Shape::Disc {
        center: Vec3::new(0.9, -0.3, 0.4),
        normal: Vec3::new(-0.5, -0.6, 0.6),
        radius: 0.4,
    };
    let floor = Shape::Rectangle {
        center: Vec3::ZERO,
        half_u: Vec3::new(3.0, 0.0, 0.0),
        half_v: Vec3::new(0.0, 3.0, 0.0),
    };
    let shapes = [
        (sphere, "ball"),
        (solid, "cloth"),
        (disc, "ball"),
        (floor, "cloth"),
    ];
    Scene {
        camera: Camera {
            eye: Vec3::new(0.2, -3.5, 1.6),
            target: Vec3::new(0.0, 0.0, 0.5),
            up: Vec3::Z,
            fov_x_deg: 50.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::new(0.1, 0.12, 0.15),
        },
        materials: BTreeMap::from(materials.map(|(name, material)| (name.to_owned(), material))),
        objects: shapes.map(object).into(),
        area_lights: vec![light(-0.8, 6.0), light(1.4, 9.0)],
        ..Scene::new()
    }
}

/// [`scene`] with other materials, its box a CSG box, and further objects: a ball of rough wax, a
/// cue and a mesh.
pub(crate) fn dressed_scene() -> Scene {
    let mut scene = scene();
    for (name, material) in dressed_materials() {
        scene.materials.insert(name.to_owned(), material);
    }
    let block = Shape::CsgBox {
        min: Vec3::new(-1.5, 0.6, -0.1),
        max: Vec3::new(-0.4, 1.2, 0.9),
        subtractions: vec![Subtraction {
            solid: CsgSolid::Cylinder {
                center: Vec3::new(-1.0, 0.9, 0.0),
                radius: 0.2,
            },
            material: None,
        }],
    };
    let [_, solid, disc, _] = &mut scene.objects[..] else {
        return scene; // as it was made above, it has four
    };
    *solid = object((block, "wood"));
    *disc = object((disc.shape.clone(), "gold"));
    let wax = Shape::Sphere {
        center: Vec3::new(-0.9, -0.6, 0.35),
        radius: 0.35,
        rotation: Quat::IDENTITY,
    };
    let rod = Shape::TruncatedCone {
        center: Vec3::new(-0.2, 0.2, 0.3),
        rotation: Quat::from_rotation_y(1.2),
        length: 0.9,
        radii: [0.03, 0.07],
    };
    scene.objects.push(object((wax, "wax")));
    scene.objects.push(object((rod, "cue")));
    scene.objects.push(object((pyramid().into(), "gold")));
    scene
}

#[expect(clippy::too_many_lines, reason = "materials as data")]
fn dressed_materials() -> [(&'static str, Material); 6] {
    let tone = Vec3::new(0.6, 0.4, 0.2);
    let wood = ProceduralTexture::Wood {
        light: tone,
        dark: 0.4 * tone,
        grain: Axis::X,
        sights: None,
        scale: 0.7,
    };
    let ball = ProceduralTexture::Ball {
        albedo: tone,
        stripe: Some(Stripe {
            albedo: Vec3::splat(0.8),
            half_width: 0.5,
        }),
        number: 9,
    };
    [
        (
            "ball",
            Material::Coated {
                ior: 1.5,
                alpha: 0.0,
                texture: ball,
            },
        ),
        (
            "wood",
            Material::Coated {
                ior: 1.5,
                alpha: 0.0,
                texture: wood,
            },
        ),
        (
            "cloth",
            Material::Cloth {
                albedo: Vec3::new(0.1, 0.5, 0.3),
                sheen: Vec3::splat(0.3),
                sheen_roughness: 0.3,
                marks: Some(ClothMarks {
                    line_x: 0.3,
                    d_radius: 0.2,
                    spots_x: [0.1, 0.3, 0.3],
                }),
            },
        ),
        (
            "cue",
            Material::Coated {
                ior: 1.5,
                alpha: 0.0,
                texture: ProceduralTexture::Cue {
                    shaft: tone,
                    butt: 0.1 * tone,
                },
            },
        ),
        (
            "gold",
            Material::Conductor {
                eta: Vec3::new(0.143, 0.375, 1.442),
                k: Vec3::new(3.983, 2.386, 1.603),
                alpha: 0.3,
                number: 0,
            },
        ),
        (
            "wax",
            Material::Dielectric {
                ior: 1.4,
                alpha: 0.2,
                medium: Some(Medium {
                    extinction: Vec3::new(4.0, 5.0, 6.0),
                    albedo: Vec3::new(0.9, 0.8, 0.7),
                }),
                number: 0,
            },
        ),
    ]
}

/// A pyramid with the vertex normals of a round shape.
fn pyramid() -> Mesh {
    let corners = [
        Vec3::new(0.2, 0.0, 0.0),
        Vec3::new(-0.1, 0.2, 0.0),
        Vec3::new(-0.1, -0.2, 0.0),
        Vec3::new(0.0, 0.0, 0.5),
    ];
    let normals = corners.map(|corner| corner - Vec3::new(0.0, 0.0, 0.1));
    let faces = [[0, 1, 3], [1, 2, 3], [2, 0, 3], [0, 2, 1]];
    let mesh = Mesh::new(corners.into(), faces.into()).normals(normals.into());
    mesh.at([0.9, -0.9, 0.05])
}

fn object((shape, material): (Shape, &str)) -> Object {
    Object {
        name: material.to_owned(),
        material: material.to_owned(),
        shape,
    }
}

/// An area light that shines down from a height of 2 m.
fn light(x: f32, radiance: f32) -> AreaLight {
    AreaLight {
        name: "lamp".to_owned(),
        center: Vec3::new(x, 0.0, 2.0),
        half_u: Vec3::new(0.0, 0.3, 0.0),
        half_v: Vec3::new(0.3, 0.0, 0.0),
        radiance: Vec3::new(radiance, radiance, 0.9 * radiance),
        ..AreaLight::new(1.0, 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compiled::ShapeKind;

    #[test]
    fn the_scenes_have_every_shape_and_every_material() {
        let features = |scene: Scene| {
            crate::gpu::layout::features(&CompiledScene::new(&scene).unwrap(), u64::MAX)
        };
        let (plain, dressed) = (features(scene()), features(dressed_scene()));
        for shape in ShapeKind::ALL {
            assert!(plain.count(shape) + dressed.count(shape) > 0, "{shape:?}");
        }
        assert!(dressed.smooth_triangles > 0);
        assert!(plain.area_lights > 0 && plain.has_coat && plain.has_stripe && dressed.has_stripe);
        assert!(dressed.has_number && dressed.has_wood && dressed.has_sheen);
        assert!(dressed.has_microfacet && dressed.has_dielectric);
    }
}
