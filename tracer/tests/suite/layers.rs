//! Laws of clear coats, sheens, tinted reflections and vertex colours.

use carom_tracer::texture_file::{Texels, encode_png};
use carom_tracer::{ImageTexture, Layers, Material, MaterialTextures, Mesh, Opacity, Scene, Shape};
use glam::{Vec2, Vec3, Vec4};

use crate::meshes::{facetted_ball, smooth_ball};
use crate::opacity::checked_alpha;
use crate::scenes::{diffuse, empty, light, still_life, with};
use crate::textures::{on_screen, picture, screen, texture};
use crate::tracers::tracers;

/// A floor of vertex colours, a ball with holes, a bumpy one under a flat clear coat, one of worn velvet, a metal one under a worn and
/// bumpy coat.
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
    let dents = texture(3, |x, y| [168 - 30 * x as u8, 98 + 30 * y as u8, 235]).linear();
    scene.textures = vec![holes, wear, bumps, varied_alpha(), dents];
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
    let coated = coated.textured(MaterialTextures {
        normal: Some(2),
        ..MaterialTextures::NONE
    });
    scene = with(scene, coated, ball(smooth_ball(2), 0.0));
    scene = with(scene, worn_velvet(), ball(smooth_ball(2), 0.7));
    with(scene, worn_metal(), ball(smooth_ball(1), 1.4))
}

/// Velvet, of whose sheen and reflection texture 3 is.
fn worn_velvet() -> Material {
    let velvet = Material::rough([0.1, 0.1, 0.3], 0.9).layered(Layers {
        sheen: Vec3::new(0.9, 0.7, 0.8),
        sheen_roughness: 0.6,
        specular: 0.3,
        specular_color: Vec3::new(1.0, 0.5, 2.0),
        ..Layers::NONE
    });
    velvet.textured(MaterialTextures {
        sheen: Some(3),
        sheen_roughness: Some(3),
        specular: Some(3),
        specular_color: Some(3),
        ..MaterialTextures::NONE
    })
}

/// A metal under a coat that textures 1 and 4 have worn and dented.
fn worn_metal() -> Material {
    let mut worn = Material::rough([0.9, 0.7, 0.3], 0.5).textured(MaterialTextures {
        normal: Some(2),
        normal_scale: 0.7,
        clearcoat: Some(1),
        clearcoat_roughness: Some(1),
        clearcoat_normal: Some(4),
        clearcoat_normal_scale: 0.8,
        ..MaterialTextures::NONE
    });
    if let Material::MetallicRoughness { metallic, .. } = &mut worn {
        *metallic = 0.8;
    }
    worn.layered(Layers {
        clearcoat: 0.9,
        clearcoat_roughness: 0.8,
        sheen: Vec3::splat(0.3),
        sheen_roughness: 0.9,
        ..Layers::NONE
    })
}

/// A picture with alpha, whose channels all differ.
fn varied_alpha() -> ImageTexture {
    let places = (0..3u8).flat_map(|y| (0..3u8).map(move |x| (x, y)));
    picture_of(
        3,
        places.map(|(x, y)| [250 - 40 * x, 160 + 40 * y, 120 + 20 * x, 255 - 60 * y]),
    )
}

fn picture_of(edge: u32, texels: impl Iterator<Item = [u8; 4]>) -> ImageTexture {
    let picture = Texels {
        size: [edge; 2],
        texels: texels.collect(),
    };
    ImageTexture::new("test", encode_png(&picture).unwrap())
}

/// A screen under a light and in even light.
fn lit(material: Material, textures: Vec<ImageTexture>, mesh: Mesh) -> Scene {
    let mut scene = on_screen(material, textures, mesh);
    scene.area_lights.push(light(2.0, true, 10.0));
    scene.area_lights[0].center.y = -2.0;
    scene.environment.radiance = Vec3::splat(0.3);
    scene
}

fn worst_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let off = pairs.map(|(a, b)| (a - b).abs() / (0.1 + a));
    off.fold(0.0, f32::max)
}

/// Textures of a colour and an alpha, each alone, and what it makes of layers.
fn multiplied(whole: Layers, color: Vec3, alpha: f32) -> [(MaterialTextures, Layers); 4] {
    let none = MaterialTextures::NONE;
    [
        (
            MaterialTextures {
                sheen: Some(0),
                ..none
            },
            Layers {
                sheen: whole.sheen * color,
                ..whole
            },
        ),
        (
            MaterialTextures {
                sheen_roughness: Some(0),
                ..none
            },
            Layers {
                sheen_roughness: whole.sheen_roughness * alpha,
                ..whole
            },
        ),
        (
            MaterialTextures {
                specular: Some(0),
                ..none
            },
            Layers {
                specular: whole.specular * alpha,
                ..whole
            },
        ),
        (
            MaterialTextures {
                specular_color: Some(0),
                ..none
            },
            Layers {
                specular_color: whole.specular_color * color,
                ..whole
            },
        ),
    ]
}

/// Each channel of each texture multiplies its number, and no other does.
#[test]
fn layer_textures_of_one_colour_are_that_number() {
    let texel = [200u8, 120, 230, 150];
    let linear = |byte: u8| ((f32::from(byte) / 255.0 + 0.055) / 1.055).powf(2.4);
    let [r, g, b] = [texel[0], texel[1], texel[2]].map(linear);
    let (color, alpha) = (Vec3::new(r, g, b), f32::from(texel[3]) / 255.0);
    // Above 1 what a colour reflects is limited after the texture has multiplied it.
    let whole = Layers {
        sheen: Vec3::new(0.9, 0.6, 1.0),
        sheen_roughness: 0.9,
        specular: 0.8,
        specular_color: Vec3::new(20.0, 40.0, 10.0),
        ..Layers::NONE
    };
    let map = picture_of(2, std::iter::repeat_n(texel, 4));
    let base = Material::rough([0.4, 0.3, 0.2], 0.5);
    for (textures, expected) in multiplied(whole, color, alpha) {
        let scenes = [
            lit(base.layered(expected), Vec::new(), screen()),
            lit(
                base.layered(whole).textured(textures),
                vec![map.clone()],
                screen(),
            ),
            lit(base.layered(whole), Vec::new(), screen()),
        ];
        for tracer in tracers() {
            let [expected, textured, ignored] = scenes
                .each_ref()
                .map(|scene| picture(tracer.as_ref(), scene, 4));
            let name = tracer.info().name;
            let off = worst_difference(&expected, &textured);
            assert!(off < 5e-4, "{name}, {textures:?}: {off}");
            let off = worst_difference(&expected, &ignored);
            assert!(off > 0.01, "{name}, {textures:?}: it may be ignored: {off}");
        }
    }
}

/// A clear coat over what reflects nothing.
fn black_under_coat(textures: MaterialTextures) -> Material {
    let coat = Layers {
        clearcoat: 1.0,
        clearcoat_roughness: 0.5,
        specular: 0.0,
        ..Layers::NONE
    };
    Material::rough([0.0; 3], 0.5)
        .layered(coat)
        .textured(textures)
}

/// Whatever the base's normals, which are its own.
#[test]
fn a_clear_coat_s_normal_map_is_the_normals_that_it_holds() {
    let bytes = [166, 90, 241];
    let [x, y, z] = bytes.map(|byte: u8| 2.0 * f32::from(byte) / 255.0 - 1.0);
    let maps = vec![
        texture(2, |_, _| bytes).linear(),
        texture(2, |_, _| [40, 140, 180]).linear(),
    ];
    for scale in [1.0, -0.5] {
        let tilted = Vec3::new(scale * x, -z, scale * y);
        let expected = screen().normals(vec![tilted; 4]);
        let expected = lit(
            black_under_coat(MaterialTextures::NONE),
            Vec::new(),
            expected,
        );
        let mapped = [None, Some(1)].map(|normal| {
            let textures = MaterialTextures {
                normal,
                clearcoat_normal: Some(0),
                clearcoat_normal_scale: scale,
                ..MaterialTextures::NONE
            };
            lit(black_under_coat(textures), maps.clone(), screen())
        });
        for tracer in tracers() {
            let expected = picture(tracer.as_ref(), &expected, 16);
            for mapped in &mapped {
                let mapped = picture(tracer.as_ref(), mapped, 16);
                let worst = worst_difference(&expected, &mapped);
                let name = tracer.info().name;
                assert!(worst < 2e-3, "{name}, {scale}: {worst}");
            }
        }
    }
}

/// It shows what lies behind the base's normals, too.
#[test]
fn a_clear_coat_without_normals_of_its_own_is_flat_over_a_bumpy_base() {
    let steep = texture(2, |_, _| [250, 128, 150]).linear();
    let bumpy = MaterialTextures {
        normal: Some(0),
        ..MaterialTextures::NONE
    };
    let both = MaterialTextures {
        clearcoat_normal: Some(0),
        ..bumpy
    };
    let [flat, bumpy, both] = [MaterialTextures::NONE, bumpy, both]
        .map(|textures| lit(black_under_coat(textures), vec![steep.clone()], screen()));
    for tracer in tracers() {
        let [flat, bumpy, both] =
            [&flat, &bumpy, &both].map(|scene| picture(tracer.as_ref(), scene, 16));
        let name = tracer.info().name;
        let worst = worst_difference(&flat, &bumpy);
        assert!(worst < 2e-3, "{name}: {worst}");
        assert!(worst_difference(&flat, &both) > 0.1, "{name}");
    }
}

/// White furnace of coats and bases with other normals each, and of textured sheens.
#[test]
fn layers_with_textures_make_no_light() {
    let maps = vec![
        texture(2, |x, y| [60 + 130 * x as u8, 200 - 150 * y as u8, 200]).linear(),
        texture(3, |x, y| [40 + 80 * x as u8, 60 + 60 * y as u8, 210]).linear(),
        varied_alpha(),
    ];
    let layers = Layers {
        clearcoat: 1.0,
        clearcoat_roughness: 0.1,
        ..Layers::NONE
    };
    let velvet = Layers {
        sheen: Vec3::ONE,
        sheen_roughness: 0.5,
        ..Layers::NONE
    };
    let bumps = MaterialTextures {
        normal: Some(0),
        clearcoat_normal: Some(1),
        ..MaterialTextures::NONE
    };
    let flat_coat = MaterialTextures {
        clearcoat_normal: None,
        ..bumps
    };
    let worn = MaterialTextures {
        sheen: Some(2),
        sheen_roughness: Some(2),
        ..MaterialTextures::NONE
    };
    for (layers, textures) in [(layers, bumps), (layers, flat_coat), (velvet, worn)] {
        for roughness in [0.2, 0.9] {
            let material = Material::rough([1.0; 3], roughness).layered(layers);
            let ball = facetted_ball(3);
            let normals = ball.positions.clone();
            let uvs = normals
                .iter()
                .map(|p| Vec2::new(p.x + 0.2 * p.z, p.y - 0.7 * p.z));
            let ball = ball.uvs(uvs.collect()).normals(normals);
            let mut scene = with(empty(1.0), material.textured(textures), ball.into());
            scene.textures.clone_from(&maps);
            for tracer in tracers() {
                let pixels = picture(tracer.as_ref(), &scene, 64);
                let pixels = pixels.as_flattened();
                let mean = pixels.iter().sum::<f32>() / pixels.len() as f32;
                let what = format!("{}, {textures:?} {roughness}: {mean}", tracer.info().name);
                assert!(mean < 1.01 && mean > 0.6, "{what}");
            }
        }
    }
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
