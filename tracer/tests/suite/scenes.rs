//! Scenes of the laws of light.

use std::collections::BTreeMap;

use carom_tracer::{
    AreaLight, Axis, Camera, ClothMarks, CsgSolid, Environment, Lens, Material, Medium, Object,
    ProceduralTexture, Scene, Shape, Sights, Stripe, Subtraction,
};
use glam::{Quat, Vec3};

use crate::dielectric_meshes::{MAX_DEPTH, glass_meshes};
use crate::emissive_surfaces::glowing_still_life;
use crate::environments::surrounded_still_life;
use crate::layers::layered_still_life;
use crate::meshes::mesh_still_life;
use crate::punctual_lights::punctual_still_life;
use crate::textures::image_textured_still_life;
use crate::thin_walls::{thin_wall_still_life, thin_walls_among_lamps};

pub(crate) fn diffuse(albedo: f32) -> Material {
    Material::Diffuse {
        albedo: Vec3::splat(albedo),
    }
}

pub(crate) fn plastic(albedo: f32, ior: f32) -> Material {
    Material::SmoothPlastic {
        albedo: Vec3::splat(albedo),
        ior,
        internal_reflectance: None,
        stripe: None,
    }
}

/// Nothing but a camera at (0, −3, 0) that looks along +y.
pub(crate) fn empty(environment: f32) -> Scene {
    Scene {
        camera: Camera {
            eye: Vec3::new(0.0, -3.0, 0.0),
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 20.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::splat(environment),
        },
        materials: BTreeMap::new(),
        objects: Vec::new(),
        area_lights: Vec::new(),
        ..Scene::new()
    }
}

pub(crate) fn with(mut scene: Scene, material: Material, shape: Shape) -> Scene {
    let name = format!("object {}", scene.objects.len());
    scene.materials.insert(name.clone(), material);
    scene.objects.push(Object {
        material: name.clone(),
        name,
        shape,
    });
    scene
}

/// A sphere that fills the whole picture of [`empty`]'s camera.
pub(crate) fn ball() -> Shape {
    Shape::Sphere {
        center: Vec3::ZERO,
        radius: 1.0,
        rotation: Quat::IDENTITY,
    }
}

/// An area light of 2 m × 1 m at `z`, facing down or up.
pub(crate) fn light(z: f32, facing_down: bool, radiance: f32) -> AreaLight {
    AreaLight {
        name: "lamp".to_owned(),
        center: Vec3::new(0.0, 0.0, z),
        half_u: Vec3::new(1.0, 0.0, 0.0),
        half_v: Vec3::new(0.0, if facing_down { -0.5 } else { 0.5 }, 0.0),
        radiance: Vec3::splat(radiance),
        ..AreaLight::new(1.0, 1.0)
    }
}

pub(crate) fn floor() -> Shape {
    Shape::Rectangle {
        center: Vec3::ZERO,
        half_u: Vec3::new(5.0, 0.0, 0.0),
        half_v: Vec3::new(0.0, 5.0, 0.0),
    }
}

/// A floor seen from aside, so near that the picture is of one point, and an area light above it.
pub(crate) fn lit_floor(point: Vec3, facing_down: bool) -> Scene {
    let mut scene = with(empty(0.0), diffuse(0.5), floor());
    scene.area_lights.push(light(1.5, facing_down, 10.0));
    scene.camera.eye = point + Vec3::new(0.0, -0.1, 0.05);
    scene.camera.target = point;
    scene.camera.fov_x_deg = 0.5;
    scene
}

/// A little of everything: balls, a box, a disc, an area light that is seen, and one that is not.
pub(crate) fn still_life() -> Scene {
    let striped = Material::SmoothPlastic {
        albedo: Vec3::new(0.8, 0.7, 0.6),
        ior: 1.5,
        internal_reflectance: None,
        stripe: Some(Stripe {
            albedo: Vec3::new(0.1, 0.2, 0.7),
            half_width: 0.5,
        }),
    };
    let ball = |x: f32, radius: f32| Shape::Sphere {
        center: Vec3::new(x, 0.0, radius),
        radius,
        rotation: Quat::from_rotation_x(0.7 + x),
    };
    let disc = Shape::Disc {
        center: Vec3::new(0.3, -0.6, 0.01),
        normal: Vec3::Z,
        radius: 0.2,
    };
    let block = Shape::Box {
        min: Vec3::new(-0.9, 0.2, 0.0),
        max: Vec3::new(-0.5, 0.5, 0.6),
    };
    let mut scene = with(empty(0.05), diffuse(0.6), floor());
    scene = with(scene, striped, ball(0.0, 0.3));
    scene = with(scene, plastic(0.4, 1.5), ball(0.55, 0.25));
    scene = with(scene, diffuse(0.2), block);
    scene = with(scene, plastic(0.0, 1.4), disc);
    scene.area_lights = vec![light(1.2, true, 8.0), light(3.0, true, 20.0)];
    scene.camera.eye = Vec3::new(0.2, -3.0, 1.2);
    scene.camera.target = Vec3::new(0.0, 0.0, 0.4);
    scene.camera.fov_x_deg = 45.0;
    scene
}

/// The still life with balls of gold, glass and a medium that scatters, whose numbers stand on discs.
pub(crate) fn numbered_still_life() -> Scene {
    let mut scene = still_life();
    // Brighter, as caustics are found by chance.
    scene.environment.radiance = Vec3::splat(0.5);
    let medium = Medium {
        extinction: Vec3::splat(6.0),
        albedo: Vec3::new(0.9, 0.5, 0.3),
    };
    let materials = [
        gold(0.3),
        glass(1.5, 0.3, None),
        glass(1.4, 0.0, Some(medium)),
    ];
    for (index, mut material) in (0_u8..).zip(materials) {
        if let Material::Conductor { number, .. } | Material::Dielectric { number, .. } =
            &mut material
        {
            *number = 3 + 4 * index;
        }
        let ball = Shape::Sphere {
            center: Vec3::new(0.55 * f32::from(index) - 0.6, -0.6, 0.25),
            radius: 0.24,
            // Number and eye are on one side, or on others.
            rotation: Quat::from_rotation_z(-1.2 - 0.7 * f32::from(index)),
        };
        scene = with(scene, material, ball);
    }
    scene
}

/// A ball of `material` before a camera that sees nothing else, in uniform light of radiance 1.
pub(crate) fn furnace(material: Material) -> Scene {
    let ball = Object {
        name: "ball".to_owned(),
        material: "m".to_owned(),
        shape: Shape::Sphere {
            center: Vec3::ZERO,
            radius: 1.0,
            rotation: Quat::IDENTITY,
        },
    };
    Scene {
        camera: Camera {
            eye: Vec3::new(0.0, -3.0, 0.0),
            target: Vec3::ZERO,
            up: Vec3::Z,
            fov_x_deg: 20.0,
            lens: Lens::default(),
            near_m: 0.0,
        },
        environment: Environment {
            radiance: Vec3::ONE,
        },
        materials: BTreeMap::from([("m".to_owned(), material)]),
        objects: vec![ball],
        area_lights: Vec::new(),
        ..Scene::new()
    }
}

pub(crate) fn glass(ior: f32, alpha: f32, medium: Option<Medium>) -> Material {
    Material::Dielectric {
        ior,
        alpha,
        medium,
        number: 0,
    }
}

pub(crate) fn gold(alpha: f32) -> Material {
    Material::Conductor {
        eta: Vec3::new(0.143, 0.375, 1.442),
        k: Vec3::new(3.983, 2.386, 1.603),
        alpha,
        number: 0,
    }
}

pub(crate) fn object(name: &str, material: &str, shape: Shape) -> Object {
    Object {
        name: name.to_owned(),
        material: material.to_owned(),
        shape,
    }
}

pub(crate) fn subtraction(solid: CsgSolid, material: Option<&str>) -> Subtraction {
    Subtraction {
        solid,
        material: material.map(str::to_owned),
    }
}

/// A box with a bevel, a bore, a hollow and a rounded edge.
pub(crate) fn csg_block(bore_material: Option<&str>) -> Shape {
    Shape::CsgBox {
        min: Vec3::new(-0.5, -0.4, -0.3),
        max: Vec3::new(0.5, 0.4, 0.2),
        subtractions: vec![
            subtraction(
                CsgSolid::HalfSpace {
                    point: Vec3::new(0.0, -0.4, 0.1),
                    normal: Vec3::new(0.0, -1.0, 1.0),
                },
                None,
            ),
            subtraction(
                CsgSolid::Cylinder {
                    center: Vec3::new(-0.2, 0.0, 0.0),
                    radius: 0.15,
                },
                bore_material,
            ),
            subtraction(
                CsgSolid::Box {
                    min: Vec3::new(0.0, -0.2, -0.1),
                    max: Vec3::new(0.4, 0.25, 0.4),
                },
                None,
            ),
            subtraction(
                CsgSolid::ConeExterior {
                    axis: Axis::Z,
                    center: Vec3::new(0.4, -0.3, 0.0),
                    radius: 0.1,
                    taper: 0.0,
                    beyond: Vec3::new(0.05, -0.05, 0.0),
                },
                None,
            ),
            subtraction(
                CsgSolid::ConeExterior {
                    axis: Axis::X,
                    center: Vec3::new(0.0, 0.34, 0.24),
                    radius: 0.06,
                    taper: 0.0,
                    beyond: Vec3::new(0.0, 0.03, 0.03),
                },
                None,
            ),
        ],
    }
}

/// A CSG block, numbered balls, wood, planks, bricks, a scoreboard, a print and cloth under an area light.
#[expect(clippy::too_many_lines, reason = "a scene as data")]
pub(crate) fn textured_still_life() -> Scene {
    let coated = |texture| Material::Coated {
        ior: 1.5,
        alpha: 0.0,
        texture,
    };
    let (light, dark) = (Vec3::new(0.5, 0.3, 0.15), Vec3::new(0.2, 0.08, 0.03));
    let wood = |grain, sights| {
        coated(ProceduralTexture::Wood {
            light,
            dark,
            grain,
            sights,
            scale: 0.8,
        })
    };
    let sights = Some(Sights {
        spacing: 0.2,
        end_x: 0.7,
        side_y: 0.45,
    });
    let stripe = Some(Stripe {
        albedo: Vec3::new(0.1, 0.1, 0.5),
        half_width: 0.5,
    });
    let ball = |number, stripe| {
        coated(ProceduralTexture::Ball {
            albedo: Vec3::splat(0.7),
            stripe,
            number,
        })
    };
    let sphere = |x: f32, y: f32, turn: f32| Shape::Sphere {
        center: Vec3::new(x, y, 0.3),
        radius: 0.1,
        rotation: Quat::from_rotation_z(turn),
    };
    let plate = |z: f32, half: f32| Shape::Rectangle {
        center: Vec3::new(0.0, 0.0, z),
        half_u: Vec3::new(half, 0.0, 0.0),
        half_v: Vec3::new(0.0, half, 0.0),
    };
    let cloth = Material::Cloth {
        albedo: Vec3::new(0.1, 0.5, 0.3),
        sheen: Vec3::splat(0.3),
        sheen_roughness: 0.3,
        marks: Some(ClothMarks {
            line_x: 0.3,
            d_radius: 0.2,
            spots_x: [0.1, 0.3, 0.3],
        }),
    };
    let mut scene = furnace(cloth);
    let materials = [
        ("wood", wood(Axis::Y, None)),
        ("rails", wood(Axis::X, sights)),
        ("upright", wood(Axis::Z, None)),
        (
            "planks",
            coated(ProceduralTexture::Planks {
                light,
                dark,
                grain: Axis::X,
            }),
        ),
        (
            "panels",
            coated(ProceduralTexture::Planks {
                light,
                dark,
                grain: Axis::Z,
            }),
        ),
        (
            "print",
            coated(ProceduralTexture::Print {
                sky: Vec3::new(0.3, 0.5, 0.6),
                hills: dark,
                center: Vec3::new(-0.9, 1.1, 0.35),
                half_height: 0.25,
            }),
        ),
        (
            "bricks",
            coated(ProceduralTexture::Bricks {
                light,
                dark,
                mortar: Vec3::splat(0.6),
            }),
        ),
        (
            "scoreboard",
            coated(ProceduralTexture::Scoreboard {
                face: Vec3::splat(0.8),
                ink: dark,
                center: [0.35, 0.35],
                radius: 0.1,
            }),
        ),
        (
            "cue",
            coated(ProceduralTexture::Cue {
                shaft: light,
                butt: dark,
            }),
        ),
        ("nine", ball(9, stripe)),
        ("twelve", ball(12, None)),
    ];
    let named = materials.map(|(name, material)| (name.to_owned(), material));
    scene.materials.extend(named);
    let rod = Shape::TruncatedCone {
        center: Vec3::new(-0.5, -0.5, 0.05),
        rotation: Quat::from_rotation_y(1.3) * Quat::from_rotation_x(0.4),
        length: 0.7,
        radii: [0.02, 0.05],
    };
    let post = Shape::CsgBox {
        min: Vec3::new(0.55, 0.15, -0.3),
        max: Vec3::new(0.75, 0.35, 0.5),
        subtractions: vec![subtraction(
            CsgSolid::ConeExterior {
                axis: Axis::Z,
                center: Vec3::new(0.65, 0.25, 0.1),
                radius: 0.06,
                taper: -0.08,
                beyond: Vec3::ZERO,
            },
            Some("nine"),
        )],
    };
    scene.objects = vec![
        object("block", "wood", csg_block(Some("m"))),
        object("nine", "nine", sphere(-0.4, -0.1, 2.0)),
        object("twelve", "twelve", sphere(0.25, -0.55, -1.4)),
        object("post", "upright", post),
        object("rod", "cue", rod),
        object("floor", "planks", plate(-0.3, 3.0)),
        object(
            "wall",
            "bricks",
            Shape::Box {
                min: Vec3::new(-1.5, 1.2, -0.3),
                max: Vec3::new(1.5, 1.3, 0.9),
            },
        ),
        object(
            "panels",
            "panels",
            Shape::Box {
                min: Vec3::new(-1.5, 1.15, -0.3),
                max: Vec3::new(1.5, 1.25, 0.0),
            },
        ),
        object(
            "print",
            "print",
            Shape::Box {
                min: Vec3::new(-1.275, 1.1, 0.1),
                max: Vec3::new(-0.525, 1.2, 0.6),
            },
        ),
        object(
            "scoreboard",
            "scoreboard",
            Shape::Box {
                min: Vec3::new(0.95, 0.1, 0.1),
                max: Vec3::new(1.0, 0.6, 0.6),
            },
        ),
        object(
            "rails",
            "rails",
            Shape::Box {
                min: Vec3::new(-1.0, -1.0, -0.3),
                max: Vec3::new(1.0, -0.45, -0.25),
            },
        ),
    ];
    scene.environment.radiance = Vec3::splat(0.1);
    scene.area_lights = vec![AreaLight {
        name: "lamp".to_owned(),
        center: Vec3::new(0.0, 0.0, 1.5),
        half_u: Vec3::new(0.5, 0.0, 0.0),
        half_v: Vec3::new(0.0, -0.3, 0.0),
        radiance: Vec3::splat(10.0),
        ..AreaLight::new(1.0, 1.0)
    }];
    scene.camera.eye = Vec3::new(0.4, -2.0, 1.4);
    scene.camera.fov_x_deg = 45.0;
    scene
}

/// The same under satin and matt varnish, and a lamp that is brighter at one end.
pub(crate) fn varnished_still_life() -> Scene {
    let mut scene = textured_still_life();
    let varnished = [
        ("wood", 0.15),
        ("rails", 0.3),
        ("planks", 0.1),
        ("bricks", 0.6),
        ("cue", 0.2),
        ("nine", 0.4),
    ];
    for (name, width) in varnished {
        if let Some(Material::Coated { alpha, .. }) = scene.materials.get_mut(name) {
            *alpha = width;
        }
    }
    scene.area_lights[0].gradient = Vec3::new(0.9, 0.3, -0.5);
    scene
}

/// An area light that shines down on a camera below it, and turns its back on one above.
pub(crate) fn area_light_seen_from(eye_z: f32) -> Scene {
    let mut scene = empty(1.0);
    scene.area_lights.push(light(0.0, true, 10.0));
    scene.camera.eye = Vec3::new(0.0, 0.0, eye_z);
    scene.camera.target = Vec3::ZERO;
    scene.camera.up = Vec3::Y;
    scene
}

/// A dielectric box whose edges make long paths.
pub(crate) fn glass_box() -> Scene {
    let mut scene = furnace(glass(1.5, 0.0, None));
    scene.objects[0].shape = Shape::Box {
        min: Vec3::new(-0.4, -0.3, -0.2),
        max: Vec3::new(0.4, 0.3, 0.2),
    };
    scene.camera.eye = Vec3::new(0.7, -3.0, 1.0);
    scene
}

/// A white concave body.
pub(crate) fn white_csg_block() -> Scene {
    let mut scene = furnace(Material::Diffuse { albedo: Vec3::ONE });
    scene.objects = vec![object("block", "m", csg_block(None))];
    scene.camera.eye = Vec3::new(0.3, -1.0, 3.0);
    scene
}

/// A scene that a law is tested on.
pub(crate) struct LawScene {
    pub(crate) name: &'static str,
    pub(crate) scene: Scene,
    pub(crate) max_depth: u32,
}

/// Every scene of `laws`.
pub(crate) fn scenes_of_laws() -> Vec<LawScene> {
    let mut scenes = vec![
        ("empty", empty(0.25)),
        ("white diffuse ball", with(empty(1.0), diffuse(1.0), ball())),
        (
            "black plastic ball",
            with(empty(1.0), plastic(0.0, 1.5), ball()),
        ),
        ("floor below a light", lit_floor(Vec3::ZERO, true)),
        (
            "floor aside a light",
            lit_floor(Vec3::new(0.7, -0.3, 0.0), true),
        ),
        (
            "floor far from a light",
            lit_floor(Vec3::new(2.5, 1.0, 0.0), true),
        ),
        ("floor behind a light", lit_floor(Vec3::ZERO, false)),
        ("still life", still_life()),
    ];
    for ior in [1.0, 1.3, 1.5, 3.0] {
        scenes.push((
            "white plastic ball",
            with(empty(1.0), plastic(1.0, ior), ball()),
        ));
    }
    for material in [diffuse(0.6), plastic(0.6, 1.0)] {
        let mut scene = still_life();
        for other in scene.materials.values_mut() {
            *other = material;
        }
        scenes.push(("still life of one material", scene));
    }
    for eye_z in [-1.0, 1.0] {
        scenes.push(("one side of a light", area_light_seen_from(eye_z)));
    }
    let mut blurred = still_life();
    blurred.camera.lens = Lens {
        aperture_radius_m: 0.1,
        focus_distance_m: 2.0,
    };
    blurred.camera.near_m = 0.7;
    scenes.push(("still life through a lens, beyond a near plane", blurred));
    let mut hidden = still_life();
    hidden.objects.remove(1);
    scenes.push(("still life without a ball", hidden));
    scenes.push(("still life of numbered balls", numbered_still_life()));
    scenes.push(("varnished still life", varnished_still_life()));
    scenes.push(("still life of meshes", mesh_still_life()));
    scenes.push(("still life of image textures", image_textured_still_life()));
    scenes.push(("still life of masks and layers", layered_still_life()));
    scenes.push(("still life of thin walls", thin_wall_still_life()));
    scenes.push(("thin walls among lamps", thin_walls_among_lamps()));
    for has_area_lights in [true, false] {
        let scene = surrounded_still_life(has_area_lights);
        scenes.push(("still life among surroundings", scene));
        let scene = punctual_still_life(has_area_lights);
        scenes.push(("still life with lights without extent", scene));
        let scene = glowing_still_life(has_area_lights);
        scenes.push(("still life with surfaces that emit", scene));
    }
    scenes
        .into_iter()
        .map(|(name, scene)| LawScene {
            name,
            scene,
            max_depth: 5,
        })
        .collect()
}

/// Every scene of `materials` but the one of the independent renderer.
pub(crate) fn scenes_of_materials() -> Vec<LawScene> {
    let mirror = |alpha| Material::Conductor {
        eta: Vec3::splat(0.01),
        k: Vec3::splat(1000.0),
        alpha,
        number: 0,
    };
    let medium = |extinction, albedo| Some(Medium { extinction, albedo });
    let (clear, tinted) = (
        medium(Vec3::ONE, Vec3::ONE),
        medium(Vec3::new(0.1, 0.5, 2.0), Vec3::ZERO),
    );
    let cloth = Material::Cloth {
        albedo: Vec3::new(1.0, 0.5, 0.0),
        sheen: Vec3::splat(0.4),
        sheen_roughness: 0.3,
        marks: None,
    };
    let scenes = [
        ("dielectric ball of index 1", furnace(glass(1.0, 0.0, None))),
        (
            "dielectric ball of index 1.5",
            furnace(glass(1.5, 0.0, None)),
        ),
        (
            "dielectric ball of index 2.5",
            furnace(glass(2.5, 0.0, None)),
        ),
        ("frosted ball", furnace(glass(1.5, 0.3, None))),
        ("finely frosted ball", furnace(glass(1.5, 0.05, None))),
        ("rough mirror ball", furnace(mirror(0.3))),
        (
            "scattering ball of index 1",
            furnace(glass(1.0, 0.0, clear)),
        ),
        (
            "scattering ball of index 1.3",
            furnace(glass(1.3, 0.0, clear)),
        ),
        ("tinted ball", furnace(glass(1.0, 0.0, tinted))),
        ("polished ball of gold", furnace(gold(0.0))),
        ("ball of cloth", furnace(cloth)),
        ("glass box", glass_box()),
        ("glass meshes", glass_meshes()),
        ("CSG box", white_csg_block()),
        ("textured still life", textured_still_life()),
    ];
    scenes
        .into_iter()
        .map(|(name, scene)| LawScene {
            name,
            scene,
            max_depth: if name == "glass meshes" {
                MAX_DEPTH
            } else {
                63
            },
        })
        .collect()
}
