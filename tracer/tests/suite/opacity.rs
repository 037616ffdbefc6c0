//! Laws of surfaces through which rays pass.

use carom_tracer::compiled::BvhUse;
use carom_tracer::film::trace_image;
use carom_tracer::texture_file::{Texels, encode_png};
use carom_tracer::{
    CompiledScene, ImageSize, ImageTexture, Material, MaterialTextures, Mesh, Opacity,
    PunctualEmitter, PunctualLight, RenderSettings, Scene, Tracer, Wrap,
};
use glam::{Vec2, Vec3};

use crate::scenes::{diffuse, empty, floor, light, with};
use crate::textures::{image_textured_still_life, lamp, on_screen, screen};
use crate::tracers::{assert_agreement_in_the_mean, tracers};

const SIZE: ImageSize = ImageSize::new(32, 32);

/// A white texture of squares whose alpha is one of two.
pub(crate) fn checked_alpha(edge: u32, alphas: [u8; 2]) -> ImageTexture {
    let places = (0..edge).flat_map(|y| (0..edge).map(move |x| (x + y) % 2));
    let texels = places.map(|square| [255, 255, 255, alphas[square as usize]]);
    let picture = Texels {
        size: [edge; 2],
        texels: texels.collect(),
    };
    ImageTexture::new("alphas", encode_png(&picture).unwrap())
}

/// What reflects and emits nothing.
fn black() -> Material {
    let mut material = lamp(MaterialTextures::NONE);
    if let Material::MetallicRoughness { emission, .. } = &mut material {
        *emission = Vec3::ZERO;
    }
    material
}

fn veil(alpha: f32) -> Material {
    black().with_opacity(Opacity::Blend { alpha })
}

/// The square of [`screen`], of 2·`edge`² triangles.
fn grid(edge: u16) -> Mesh {
    let step = |i: u16| 2.0 * f32::from(i) / f32::from(edge) - 1.0;
    let places = (0..=edge).flat_map(|z| (0..=edge).map(move |x| (x, z)));
    let positions: Vec<Vec3> = places
        .map(|(x, z)| Vec3::new(step(x), 0.0, step(z)))
        .collect();
    let uvs = positions.iter();
    let uvs = uvs
        .map(|p| Vec2::new(0.5 + 0.5 * p.x, 0.5 - 0.5 * p.z))
        .collect();
    let row = u32::from(edge) + 1;
    let corners = (0..u32::from(edge)).flat_map(|z| (0..u32::from(edge)).map(move |x| z * row + x));
    let triangles =
        corners.flat_map(|at| [[at, at + 1, at + row + 1], [at, at + row + 1, at + row]]);
    Mesh::new(positions, triangles.collect()).uvs(uvs)
}

/// A wall that glows behind veils.
fn veiled(veils: &[(Material, Mesh)]) -> Scene {
    let wall = screen().scaled(Vec3::splat(4.0)).at([0.0, 2.0, 0.0]);
    let mut scene = on_screen(lamp(MaterialTextures::NONE), Vec::new(), wall);
    for (place, (material, mesh)) in veils.iter().enumerate() {
        let mesh = mesh.clone().at([0.0, 0.3 * place as f32, 0.0]);
        scene = with(scene, *material, mesh.scaled(Vec3::splat(2.0)).into());
    }
    scene
}

fn mean(tracer: &dyn Tracer, scene: &Scene, samples: u32, bvh_use: BvhUse) -> f32 {
    let settings = RenderSettings {
        samples,
        ..RenderSettings::default()
    };
    let mut scene = CompiledScene::new(scene).unwrap();
    scene.bvh_use = bvh_use;
    let film = trace_image(tracer, &scene, SIZE, settings).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    let pixels = film.image().pixels;
    let pixels = pixels.as_flattened();
    pixels.iter().sum::<f32>() / pixels.len() as f32
}

/// Closed form: n veils of alpha a let (1 − a)ⁿ pass, with a BVH or without. A mean of 65,536 samples has a standard error of at
/// most 0.002.
#[test]
fn veils_let_pass_what_their_alphas_say() {
    let (sheet, many) = (grid(1), grid(8));
    let cases: [(Vec<f32>, f32); 5] = [
        (vec![0.5], 0.5),
        (vec![0.5, 0.5], 0.25),
        (vec![0.25, 0.5, 0.75], 0.75 * 0.5 * 0.25),
        (vec![0.0], 1.0),
        (vec![1.0], 0.0),
    ];
    for tracer in tracers() {
        for (mesh, bvh_use) in [(&sheet, BvhUse::Never), (&many, BvhUse::Always)] {
            for (alphas, expected) in &cases {
                let veils = alphas.iter().map(|alpha| (veil(*alpha), mesh.clone()));
                let scene = veiled(&veils.collect::<Vec<_>>());
                let passed = mean(tracer.as_ref(), &scene, 64, bvh_use);
                let name = tracer.info().name;
                let off = (passed - expected).abs();
                assert!(
                    off < 0.008,
                    "{name} {alphas:?} {bvh_use:?}: {passed} {expected}"
                );
            }
        }
    }
}

/// The alphas of material, texture and vertices are multiplied; opaque ones have none, and masks are all or nothing.
#[test]
fn alphas_of_material_texture_and_vertices_count() {
    let textured = |opacity| {
        let maps = MaterialTextures {
            base_color: Some(0),
            ..MaterialTextures::NONE
        };
        black().textured(maps).with_opacity(opacity)
    };
    // Half a veil from left to right.
    let mesh = grid(8);
    let colors = mesh
        .positions
        .iter()
        .map(|p| Vec3::ONE.extend(0.5 + 0.5 * p.x));
    let colors = colors.collect();
    let mesh = mesh.colors(colors);
    let mask = |cutoff| Opacity::Mask { alpha: 0.8, cutoff };
    let cases = [
        (Opacity::Opaque, 0.0),
        // Mean alpha: 0.8 · 0.5 · 153/255; the picture shows the middle half of the veil.
        (Opacity::Blend { alpha: 0.8 }, 1.0 - 0.8 * 0.5 * 0.6),
        // From 0.24 on where x is 0: the right half.
        (mask(0.8 * 0.6 * 0.5), 0.5),
        (mask(0.0), 0.0),
        (mask(1.0), 1.0),
    ];
    for tracer in tracers() {
        for (opacity, expected) in cases {
            let mut scene = veiled(&[(textured(opacity), mesh.clone())]);
            scene.textures = vec![checked_alpha(2, [153; 2]).wrapped(Wrap::Clamp)];
            let passed = mean(tracer.as_ref(), &scene, 64, BvhUse::WhereFaster);
            let name = tracer.info().name;
            let off = (passed - expected).abs();
            assert!(off < 0.008, "{name} {opacity:?}: {passed} {expected}");
        }
    }
}

/// Rays to lights pass as others do: half the light of each kind reaches a floor under half a veil.
#[test]
fn veils_halve_the_light_of_each_kind_of_lamp() {
    let roof = |scene: Scene, alpha| {
        let veil = veil(alpha);
        let square = [[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [-9.0, 9.0]];
        let square = square.map(|[x, y]| Vec3::new(x, y, 1.0));
        let roof = Mesh::new(square.into(), vec![[0, 1, 2], [0, 2, 3]]);
        with(scene, veil, roof.into())
    };
    let mut base = with(empty(0.0), diffuse(0.5), floor());
    base.camera.eye = Vec3::new(0.0, -0.1, 0.05);
    base.camera.fov_x_deg = 0.5;
    let mut by_area = base.clone();
    by_area.area_lights.push(light(1.5, true, 10.0));
    let mut by_point = base.clone();
    by_point
        .punctual_lights
        .push(PunctualLight::new(PunctualEmitter::Point {
            center: Vec3::new(0.2, 0.1, 2.0),
            intensity: Vec3::splat(4.0),
        }));
    let mut by_sky = base;
    by_sky.environment.radiance = Vec3::ONE;
    for scene in [by_area, by_point, by_sky] {
        for tracer in tracers() {
            let [open, half] = [0.0, 0.5].map(|alpha| {
                mean(
                    tracer.as_ref(),
                    &roof(scene.clone(), alpha),
                    64,
                    BvhUse::WhereFaster,
                )
            });
            let name = tracer.info().name;
            assert!(open > 0.05, "{name}: {open}");
            assert!((half / open - 0.5).abs() < 0.012, "{name}: {half} {open}");
        }
    }
}

/// Balls and a floor that are half there, with textures and lamps.
fn ghostly_still_life() -> Scene {
    let mut scene = image_textured_still_life();
    let alphas = [0.9, 0.5, 0.3, 0.7];
    for (material, alpha) in scene.materials.values_mut().zip(alphas) {
        *material = material.with_opacity(Opacity::Blend { alpha });
    }
    scene.environment.radiance = Vec3::splat(0.3);
    scene
}

/// Each back end draws numbers of its own, so that they agree in the mean alone: regions and the whole, to 4 standard errors.
#[test]
fn back_ends_agree_on_veils_in_the_mean() {
    const BATCHES: u32 = 8;
    let scene = CompiledScene::new(&ghostly_still_life()).unwrap();
    let size = ImageSize::new(24, 16);
    let settings = RenderSettings {
        samples: 64,
        max_depth: 8,
        ..RenderSettings::default()
    };
    assert_agreement_in_the_mean(&scene, size, settings, BATCHES);
}

#[test]
fn what_cannot_be_passed_is_refused() {
    let refusal = |scene: Scene| scene.validate().unwrap_err().to_string();
    let on_floor = with(empty(1.0), veil(0.5), floor());
    let sentence = "its material `object 0` is not opaque, which only meshes can be of";
    assert!(refusal(on_floor).contains(sentence));
    let mesh = screen().colors(vec![glam::Vec4::ONE; 3]);
    let three = with(empty(1.0), veil(0.5), mesh.into());
    assert!(refusal(three).contains("its mesh has 3 colours for 4 vertices"));
    let mesh = screen().colors(vec![glam::Vec4::new(0.0, 1.5, f32::NAN, 1.0); 4]);
    let bright = with(empty(1.0), veil(0.5), mesh.into());
    assert!(refusal(bright).contains("colour 0 of its mesh is [0, 1.5, NaN, 1]"));
    let thin = with(empty(1.0), veil(1.5), screen().into());
    assert!(refusal(thin).contains("the alpha of its opacity is 1.5"));
}
