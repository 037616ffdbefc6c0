//! Laws of clear coats, sheens, tinted reflections and vertex colours.

use carom_tracer::{Layers, Material, MaterialTextures, Mesh, Opacity, Scene, Shape};
use glam::{Vec2, Vec3, Vec4};

use crate::meshes::{facetted_ball, smooth_ball};
use crate::opacity::checked_alpha;
use crate::scenes::{diffuse, empty, still_life, with};
use crate::textures::{on_screen, picture, screen, texture};
use crate::tracers::tracers;

/// A floor of vertex colours, a ball with holes, one with a clear coat, one of velvet, a metal one under a worn coat.
pub(crate) fn layered_still_life() -> Scene {
    let holes = checked_alpha(4, [0, 255]);
    let wear = texture(3, |x, y| [90 + 70 * x as u8, 40 + 90 * y as u8, 9]).linear();
    let bumps = texture(4, |x, y| [98 + 20 * x as u8, 158 - 20 * y as u8, 240]).linear();
    let with_uvs = |mesh: Mesh| {
        let uvs = mesh.positions.iter();
        let uvs = uvs.map(|p| Vec2::new(1.3 * p.x + 0.2 * p.z, 0.9 * p.y - 0.7 * p.z));
        let uvs = uvs.collect();
        mesh.uvs(uvs)
    };
    let ball = |mesh: Mesh, x: f32| -> Shape {
        let ball = with_uvs(mesh).scaled(Vec3::splat(0.28));
        ball.at([x, -0.2, 0.3]).into()
    };
    let others = still_life();
    let mut scene = empty(0.05);
    scene.area_lights = others.area_lights;
    scene.camera = others.camera;
    scene.textures = vec![holes, wear, bumps];
    let square = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]];
    let square = square.map(|[x, y]| Vec3::new(x, y, 0.0));
    let colors = [[0.9, 0.2, 0.2], [0.2, 0.9, 0.2], [0.2, 0.3, 0.9], [0.8; 3]];
    let colors = colors.map(|color| Vec3::from(color).extend(1.0));
    let ground = Mesh::new(square.into(), vec![[0, 1, 2], [0, 2, 3]]).colors(colors.into());
    scene = with(scene, diffuse(0.8), ground.into());
    let holed = Material::rough([0.9, 0.6, 0.3], 0.7).textured(MaterialTextures {
        base_color: Some(0),
        ..MaterialTextures::NONE
    });
    let holed = holed.with_opacity(Opacity::Mask {
        alpha: 1.0,
        cutoff: 0.5,
    });
    scene = with(scene, holed, ball(facetted_ball(2), -0.7));
    let coated = Material::rough([0.7, 0.1, 0.1], 0.8).layered(Layers {
        clearcoat: 1.0,
        clearcoat_roughness: 0.3,
        ..Layers::NONE
    });
    scene = with(scene, coated, ball(smooth_ball(2), 0.0));
    let velvet = Material::rough([0.1, 0.1, 0.3], 0.9).layered(Layers {
        sheen: Vec3::new(0.9, 0.7, 0.8),
        sheen_roughness: 0.6,
        specular: 0.3,
        specular_color: Vec3::new(1.0, 0.5, 2.0),
        ..Layers::NONE
    });
    scene = with(scene, velvet, ball(smooth_ball(2), 0.7));
    let mut worn = Material::rough([0.9, 0.7, 0.3], 0.5).textured(MaterialTextures {
        normal: Some(2),
        normal_scale: 0.7,
        clearcoat: Some(1),
        clearcoat_roughness: Some(1),
        ..MaterialTextures::NONE
    });
    if let Material::MetallicRoughness { metallic, .. } = &mut worn {
        *metallic = 0.8;
    }
    let worn = worn.layered(Layers {
        clearcoat: 0.9,
        clearcoat_roughness: 0.8,
        sheen: Vec3::splat(0.3),
        sheen_roughness: 0.9,
        ..Layers::NONE
    });
    with(scene, worn, ball(smooth_ball(1), 1.4))
}

/// In even light a flat matt surface is as bright as its albedo, whatever its place: exactly that of each sample.
#[test]
fn vertex_colours_multiply_the_albedo() {
    let colors = [
        Vec4::new(0.0, 0.5, 1.0, 1.0),
        Vec4::new(1.0, 0.5, 1.0, 1.0),
        Vec4::new(1.0, 0.5, 0.0, 1.0),
        Vec4::new(0.0, 0.5, 0.0, 1.0),
    ];
    let mesh = screen().colors(colors.into());
    let mut scene = on_screen(diffuse(0.5), Vec::new(), mesh);
    scene.environment.radiance = Vec3::ONE;
    for tracer in tracers() {
        for (place, pixel) in picture(tracer.as_ref(), &scene, 256).iter().enumerate() {
            let centre = |place: usize| (place as f32 + 0.5) / 16.0;
            let (x, y) = (centre(place % 16), centre(place / 16));
            let expected = [0.5 * x, 0.25, 0.5 * (1.0 - y)];
            for channel in 0..3 {
                let off = (pixel[channel] - expected[channel]).abs();
                let name = tracer.info().name;
                assert!(off < 2e-3, "{name}: {pixel:?} {expected:?}");
            }
        }
    }
}

/// The base colour that it multiplies.
#[test]
fn vertex_colours_of_one_colour_are_that_base_colour() {
    let lit = |material, mesh| {
        let mut scene = on_screen(material, Vec::new(), mesh);
        scene.environment.radiance = Vec3::ONE;
        scene
    };
    let color = Vec3::new(0.2, 0.4, 0.8);
    let plain = lit(Material::rough(0.5 * color, 0.4), screen());
    let mesh = screen().colors(vec![color.extend(0.3); 4]);
    let colored = lit(Material::rough([0.5; 3], 0.4), mesh);
    for tracer in tracers() {
        let [plain, colored] = [&plain, &colored].map(|scene| picture(tracer.as_ref(), scene, 4));
        let pairs = plain.as_flattened().iter().zip(colored.as_flattened());
        for (plain, colored) in pairs {
            let name = tracer.info().name;
            assert!((plain - colored).abs() < 1e-4, "{name}: {plain} {colored}");
        }
    }
}

/// White furnace: a white base under a smooth coat reflects all, and neither coat nor sheen makes light.
#[test]
fn layers_over_white_surfaces_make_no_light() {
    let coat = |clearcoat, clearcoat_roughness| Layers {
        clearcoat,
        clearcoat_roughness,
        ..Layers::NONE
    };
    let velvet = Layers {
        sheen: Vec3::ONE,
        sheen_roughness: 0.5,
        ..Layers::NONE
    };
    let all = Layers {
        clearcoat: 1.0,
        ..velvet
    };
    for (layers, least) in [
        (coat(1.0, 0.0), 0.95),
        (coat(0.5, 0.0), 0.95),
        (coat(1.0, 1.0), 0.8),
        (velvet, 0.8),
        (all, 0.65),
    ] {
        for (roughness, least) in [(0.1, least), (0.8, 0.75 * least)] {
            let material = Material::rough([1.0; 3], roughness).layered(layers);
            let ball = facetted_ball(4);
            let normals = ball.positions.clone();
            let scene = with(empty(1.0), material, ball.normals(normals).into());
            for tracer in tracers() {
                let pixels = picture(tracer.as_ref(), &scene, 64);
                let pixels = pixels.as_flattened();
                let mean = pixels.iter().sum::<f32>() / pixels.len() as f32;
                let what = format!("{}, {layers:?} {roughness}: {mean}", tracer.info().name);
                assert!(mean < 1.01, "{what}");
                assert!(mean > least, "{what}");
            }
        }
    }
}
