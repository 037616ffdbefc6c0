//! Laws of image textures and of the material that they are for.

use carom_tracer::film::trace_image;
use carom_tracer::texture_file::{Texels, encode_png};
use carom_tracer::{
    CompiledScene, ImageSize, ImageSource, ImageTexture, Layers, Material, MaterialTextures, Mesh,
    Opacity, RenderSettings, Scene, Tracer, Wrap,
};
use glam::{Vec2, Vec3};

use crate::meshes::facetted_ball;
use crate::scenes::{diffuse, empty, floor, light, still_life, with};
use crate::tracers::tracers;

const SIZE: ImageSize = ImageSize::new(16, 16);

/// A picture of `edge` texels a side.
pub(crate) fn texture(edge: u32, texel: impl Fn(u32, u32) -> [u8; 3]) -> ImageTexture {
    let places = (0..edge).flat_map(|y| (0..edge).map(move |x| (x, y)));
    let texels = places.map(|(x, y)| {
        let [r, g, b] = texel(x, y);
        [r, g, b, 255]
    });
    let picture = Texels {
        size: [edge; 2],
        texels: texels.collect(),
    };
    ImageTexture::new("test", encode_png(&picture).unwrap())
}

/// A square of 2 m across the view of [`empty`]'s camera, whose picture it just fills; texture coordinates are 0 at its top
/// left corner.
pub(crate) fn screen() -> Mesh {
    let corners = [[-1.0, 1.0], [1.0, 1.0], [1.0, -1.0], [-1.0, -1.0]];
    let positions = corners.map(|[x, z]| Vec3::new(x, 0.0, z));
    let uvs = corners.map(|[x, z]| Vec2::new(0.5 + 0.5 * x, 0.5 - 0.5 * z));
    Mesh::new(positions.into(), vec![[0, 3, 2], [0, 2, 1]]).uvs(uvs.into())
}

pub(crate) fn on_screen(material: Material, textures: Vec<ImageTexture>, mesh: Mesh) -> Scene {
    let mut scene = with(empty(0.0), material, mesh.into());
    scene.camera.fov_x_deg = 2.0 * (1.0f32 / 3.0).atan().to_degrees();
    scene.textures = textures;
    scene
}

/// What emits and reflects nothing.
pub(crate) fn lamp(textures: MaterialTextures) -> Material {
    Material::MetallicRoughness {
        base_color: Vec3::ZERO,
        metallic: 0.0,
        roughness: 1.0,
        ior: 1.0,
        emission: Vec3::ONE,
        textures,
        opacity: Opacity::Opaque,
        layers: Layers::NONE,
    }
}

const EMISSION: MaterialTextures = MaterialTextures {
    emission: Some(0),
    ..MaterialTextures::NONE
};

/// A floor with a picture, a ball of a rough and partly metallic one, a bumpy ball, one that glows.
pub(crate) fn image_textured_still_life() -> Scene {
    let tiles = texture(4, |x, y| [40 + 60 * x as u8, 200 - 50 * y as u8, 120]);
    let wear = texture(3, |x, y| [0, 90 + 60 * x as u8, 120 * y as u8]).linear();
    let bumps = texture(4, |x, y| [98 + 20 * x as u8, 158 - 20 * y as u8, 240]).linear();
    let glow = texture(2, |x, y| [200 * ((x + y) % 2) as u8, 30, 10]).wrapped(Wrap::Mirror);
    let material = |metallic, roughness, emission, textures| Material::MetallicRoughness {
        base_color: Vec3::new(0.9, 0.8, 0.7),
        metallic,
        roughness,
        ior: 1.5,
        emission: Vec3::splat(emission),
        textures,
        opacity: Opacity::Opaque,
        layers: Layers::NONE,
    };
    let with_uvs = |mesh: Mesh| {
        let uvs = mesh.positions.iter();
        let uvs = uvs.map(|p| Vec2::new(1.3 * p.x + 0.2 * p.z, 0.9 * p.y - 0.7 * p.z));
        let uvs = uvs.collect();
        mesh.uvs(uvs)
    };
    let ball = |halvings, x: f32| {
        let ball = with_uvs(facetted_ball(halvings));
        ball.scaled(Vec3::splat(0.3)).at([x, -0.2, 0.3])
    };
    let smooth = ball(2, 0.0);
    let normals = smooth.positions.clone();
    let maps = |base_color, metallic_roughness, normal, emission| MaterialTextures {
        base_color,
        metallic_roughness,
        normal,
        emission,
        ..MaterialTextures::NONE
    };
    let square = [[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]];
    let square = square.map(|[x, y]| Vec3::new(x, y, 0.0));
    let ground = Mesh::new(square.into(), vec![[0, 1, 2], [0, 2, 3]]);
    let mut scene = empty(0.05);
    let floor = material(0.0, 0.6, 0.0, maps(Some(0), None, None, None));
    scene = with(scene, floor, with_uvs(ground).into());
    let worn = material(1.0, 1.0, 0.0, maps(Some(0), Some(1), None, None));
    scene = with(scene, worn, smooth.normals(normals).into());
    let bumpy = material(0.2, 0.3, 0.0, maps(None, None, Some(2), None));
    scene = with(scene, bumpy, ball(1, 0.7).into());
    // Little of it: it is found by chance.
    let glowing = material(0.0, 0.5, 0.2, maps(None, None, None, Some(3)));
    scene = with(scene, glowing, ball(1, -0.7).into());
    scene.textures = vec![tiles, wear, bumps, glow];
    let others = still_life();
    scene.area_lights = others.area_lights;
    scene.camera = others.camera;
    scene
}

pub(crate) fn picture(tracer: &dyn Tracer, scene: &Scene, samples: u32) -> Vec<[f32; 3]> {
    let settings = RenderSettings {
        samples,
        ..RenderSettings::default()
    };
    let scene = CompiledScene::new(scene).unwrap();
    let film = trace_image(tracer, &scene, SIZE, settings).unwrap();
    assert_eq!(film.dropped_samples(), 0, "{}", tracer.info().name);
    film.image().pixels
}

#[test]
fn a_picture_lies_where_its_coordinates_say() {
    // Each texel is seen by four pixels a side; those in its middle see it alone.
    let colors = texture(4, |x, y| [85 * x as u8, 85 * y as u8, 255]).linear();
    let scene = on_screen(lamp(EMISSION), vec![colors], screen());
    for tracer in tracers() {
        let pixels = picture(tracer.as_ref(), &scene, 256);
        for (place, pixel) in pixels.iter().enumerate() {
            let centre = |place: usize| (place as f32 + 0.5) / 16.0 * 4.0 - 0.5;
            let (x, y) = (centre(place % 16), centre(place / 16));
            let is_edge = |at: f32| !(0.2..2.8).contains(&at);
            if is_edge(x) || is_edge(y) {
                continue;
            }
            let expected = [x / 3.0, y / 3.0, 1.0];
            for channel in 0..3 {
                let off = (pixel[channel] - expected[channel]).abs();
                let name = tracer.info().name;
                assert!(off < 0.012, "{name}, {x} {y}: {pixel:?} {expected:?}");
            }
        }
    }
}

#[test]
fn pictures_finer_than_pixels_are_smooth_at_one_sample() {
    let checks = texture(512, |x, y| [255 * ((x + y) % 2) as u8; 3]).linear();
    let scene = on_screen(lamp(EMISSION), vec![checks], screen());
    for tracer in tracers() {
        for pixel in picture(tracer.as_ref(), &scene, 1).as_flattened() {
            let name = tracer.info().name;
            assert!((pixel - 0.5).abs() < 0.01, "{name}: {pixel}");
        }
    }
}

#[test]
fn pictures_of_one_colour_are_that_number() {
    let uniform = |byte: [u8; 3]| texture(2, move |_, _| byte).linear();
    let base = Vec3::new(0.2, 0.6, 1.0);
    let plain = Material::MetallicRoughness {
        base_color: base,
        metallic: 0.4,
        roughness: 0.6,
        ior: 1.5,
        emission: Vec3::new(0.0, 0.2, 0.0),
        textures: MaterialTextures::default(),
        opacity: Opacity::Opaque,
        layers: Layers::NONE,
    };
    let textured = Material::MetallicRoughness {
        base_color: Vec3::ONE,
        metallic: 1.0,
        roughness: 1.0,
        ior: 1.5,
        emission: Vec3::splat(0.2),
        textures: MaterialTextures {
            base_color: Some(0),
            metallic_roughness: Some(1),
            emission: Some(2),
            ..MaterialTextures::NONE
        },
        opacity: Opacity::Opaque,
        layers: Layers::NONE,
    };
    let textures = vec![
        uniform([51, 153, 255]),
        uniform([9, 153, 102]),
        uniform([0, 255, 0]),
    ];
    let lit = |material, textures| {
        let mut scene = on_screen(material, textures, screen());
        scene.area_lights.push(light(2.0, true, 10.0));
        scene.area_lights[0].center.y = -2.0;
        scene.environment.radiance = Vec3::splat(0.3);
        scene
    };
    for tracer in tracers() {
        let plain = picture(tracer.as_ref(), &lit(plain, Vec::new()), 4);
        let textured = picture(tracer.as_ref(), &lit(textured, textures.clone()), 4);
        let pairs = plain.as_flattened().iter().zip(textured.as_flattened());
        for (plain, textured) in pairs {
            let name = tracer.info().name;
            let off = (plain - textured).abs();
            assert!(off < 1e-4 * (1.0 + plain), "{name}: {plain} {textured}");
        }
    }
}

/// Whatever way the triangles go round.
#[test]
fn a_normal_map_is_the_normals_that_it_holds() {
    let bytes = [166, 90, 241];
    let [x, y, z] = bytes.map(|byte: u8| 2.0 * f32::from(byte) / 255.0 - 1.0);
    // On the screen x is to the right, y up and the viewer at −y.
    let tilted = Vec3::new(x, -z, y);
    let map = texture(2, |_, _| bytes).linear();
    let surface = |normal| {
        Material::rough([0.7; 3], 0.3).textured(MaterialTextures {
            normal,
            ..MaterialTextures::default()
        })
    };
    let lit = |material, mesh| {
        let mut scene = on_screen(material, vec![map.clone()], mesh);
        scene.area_lights.push(light(2.0, true, 10.0));
        scene.area_lights[0].center.y = -2.0;
        scene
    };
    let expected = lit(surface(None), screen().normals(vec![tilted; 4]));
    let flat = lit(surface(Some(0)), screen());
    let smooth = lit(surface(Some(0)), screen().normals(vec![Vec3::NEG_Y; 4]));
    let mut turned = screen().normals(vec![Vec3::NEG_Y; 4]);
    turned.triangles = vec![[0, 2, 3], [0, 1, 2]];
    let turned = lit(surface(Some(0)), turned);
    for tracer in tracers() {
        let expected = picture(tracer.as_ref(), &expected, 4);
        for mapped in [&flat, &smooth, &turned] {
            let mapped = picture(tracer.as_ref(), mapped, 4);
            let pairs = expected.as_flattened().iter().zip(mapped.as_flattened());
            let off = pairs.map(|(a, b)| (a - b).abs() / (0.1 + a));
            let worst = off.fold(0.0, f32::max);
            assert!(worst < 2e-3, "{}: {worst}", tracer.info().name);
        }
    }
}

/// Twice the map's x and y are the normals that it would hold if they were.
#[test]
fn the_scale_of_a_normal_map_multiplies_its_slopes() {
    let bytes = [150, 110, 250];
    let [x, y, z] = bytes.map(|byte: u8| 2.0 * f32::from(byte) / 255.0 - 1.0);
    let map = texture(2, |_, _| bytes).linear();
    let lit = |material, mesh| {
        let mut scene = on_screen(material, vec![map.clone()], mesh);
        scene.area_lights.push(light(2.0, true, 10.0));
        scene.area_lights[0].center.y = -2.0;
        scene
    };
    for normal_scale in [0.0, 2.0, -1.0] {
        let tilted = Vec3::new(normal_scale * x, -z, normal_scale * y);
        let plain = Material::rough([0.7; 3], 0.3);
        let mapped = plain.textured(MaterialTextures {
            normal: Some(0),
            normal_scale,
            ..MaterialTextures::NONE
        });
        let expected = lit(plain, screen().normals(vec![tilted; 4]));
        let mapped = lit(mapped, screen());
        for tracer in tracers() {
            let [expected, mapped] =
                [&expected, &mapped].map(|scene| picture(tracer.as_ref(), scene, 4));
            let pairs = expected.as_flattened().iter().zip(mapped.as_flattened());
            let off = pairs.map(|(a, b)| (a - b).abs() / (0.1 + a));
            let worst = off.fold(0.0, f32::max);
            let name = tracer.info().name;
            assert!(worst < 2e-3, "{name}, {normal_scale}: {worst}");
        }
    }
}

/// White furnace: nothing is made, whatever the textures; a smooth white surface keeps almost all.
#[test]
fn white_surfaces_make_no_light() {
    for (metallic, roughness) in [(0.0, 0.1), (0.0, 0.7), (0.5, 0.4), (1.0, 0.2), (1.0, 1.0)] {
        let material = Material::MetallicRoughness {
            base_color: Vec3::ONE,
            metallic,
            roughness,
            ior: 1.5,
            emission: Vec3::ZERO,
            textures: MaterialTextures::default(),
            opacity: Opacity::Opaque,
            layers: Layers::NONE,
        };
        let ball = facetted_ball(4);
        let normals = ball.positions.clone();
        let scene = with(empty(1.0), material, ball.normals(normals).into());
        for tracer in tracers() {
            let pixels = picture(tracer.as_ref(), &scene, 64);
            let pixels = pixels.as_flattened();
            let mean = pixels.iter().sum::<f32>() / pixels.len() as f32;
            let what = format!("{}, {metallic} {roughness}: {mean}", tracer.info().name);
            assert!(mean < 1.01, "{what}");
            assert!(mean > if roughness < 0.3 { 0.95 } else { 0.25 }, "{what}");
        }
    }
}

/// What makes a right scene wrong.
type Spoil = fn(&mut Scene);

#[test]
#[expect(clippy::too_many_lines, reason = "faults as data")]
fn what_no_texture_can_be_made_of_is_refused() {
    let base = MaterialTextures {
        base_color: Some(0),
        ..MaterialTextures::default()
    };
    let right = || {
        let checks = texture(2, |x, _| [255 * x as u8; 3]);
        on_screen(
            Material::rough([1.0; 3], 0.5).textured(base),
            vec![checks],
            screen(),
        )
    };
    right().validate().unwrap();
    let refusal = |spoil: Spoil| {
        let mut scene = right();
        spoil(&mut scene);
        scene.validate().unwrap_err().to_string()
    };
    fn mesh(scene: &mut Scene) -> &mut Mesh {
        match &mut scene.objects[0].shape {
            carom_tracer::Shape::Mesh(mesh) => mesh,
            other => panic!("{other:?}"),
        }
    }
    let cases: [(Spoil, &str); 8] = [
        (
            |scene| scene.textures.clear(),
            "material `object 0`: its texture 0 is not among the scene's 0",
        ),
        (
            |scene| scene.objects[0].shape = floor(),
            "object 0 `object 0`: its material `object 0` has textures, which need a mesh",
        ),
        (
            |scene| mesh(scene).uvs.clear(),
            "has textures, which need a mesh with texture coordinates",
        ),
        (
            |scene| _ = mesh(scene).uvs.pop(),
            "its mesh has 3 texture coordinates for 4 vertices",
        ),
        (
            |scene| mesh(scene).uvs[2].y = f32::NAN,
            "texture coordinate 2 of its mesh is [1, NaN]: each must be within ±1000",
        ),
        (
            |scene| scene.textures[0].image = ImageSource::File("a.png".to_owned()),
            "texture 0 `test`: its file `a.png` is read only by `Scene::load`",
        ),
        (
            |scene| scene.textures[0] = ImageTexture::new("gif", b"GIF89a".to_vec()),
            "texture 0 `gif`: it begins with the bytes [47, 49, 46, 38]: it must be a PNG or JPEG",
        ),
        (
            |scene| scene.materials.values_mut().for_each(|m| *m = diffuse(2.0)),
            "its albedo is [2, 2, 2]",
        ),
    ];
    for (spoil, sentence) in cases {
        let refusal = refusal(spoil);
        assert!(
            refusal.contains(sentence),
            "`{sentence}` is not in `{refusal}`"
        );
    }
    // Its header tells a size, and nothing follows.
    let mut cut = right();
    let file = cut.textures[0].image.bytes().unwrap()[..50].to_vec();
    cut.textures[0] = ImageTexture::new("cut", file);
    let refusal = CompiledScene::new(&cut).unwrap_err().to_string();
    assert!(
        refusal.contains("texture 0 `cut`: its PNG cannot be read"),
        "{refusal}"
    );
}

#[test]
fn scene_files_name_texture_files_or_hold_them() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.json");
    let scene = image_textured_still_life();
    scene.save(&path).unwrap();
    assert_eq!(Scene::load(&path).unwrap(), scene);

    let file = scene.textures[0].image.bytes().unwrap();
    std::fs::write(folder.path().join("tiles.png"), file).unwrap();
    let mut json: serde_json::Value = serde_json::from_str(&scene.to_json().unwrap()).unwrap();
    json["textures"][0]["image"] = serde_json::json!({ "file": "tiles.png" });
    std::fs::write(&path, json.to_string()).unwrap();
    assert_eq!(Scene::load(&path).unwrap(), scene);
    assert!(Scene::from_json(&json.to_string()).is_err());

    json["textures"][0]["image"] = serde_json::json!({ "file": "absent.png" });
    std::fs::write(&path, json.to_string()).unwrap();
    let refusal = Scene::load(&path).unwrap_err().to_string();
    assert!(refusal.contains("absent.png"), "{refusal}");
}
