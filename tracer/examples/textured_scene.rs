//! A scene of image textures, normal maps and an environment map, all made here: as a scene file and as a picture; and one
//! of matte and of metal textures alone, which other renderers have, too.
//!
//! `cargo run --release -p carom-tracer --example textured_scene -- FOLDER [SAMPLES]`

use std::f32::consts::{PI, TAU};
use std::path::PathBuf;

use carom_tracer::environment_file::encode_exr;
use carom_tracer::film::trace_image;
use carom_tracer::texture_file::{Texels, encode_png};
use carom_tracer::{
    Camera, CompiledScene, CpuTracer, EnvironmentMap, ImageSize, ImageTexture, Layers, Material,
    MaterialTextures, Mesh, Opacity, RadianceImage, RenderSettings, Scene,
};
use glam::{Quat, Vec2, Vec3};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("which folder?")?);
    let samples = arguments.next().map_or(Ok(64), |text| text.parse())?;
    let scene = scene()?;
    scene.save(folder.join("textured_scene.json"))?;
    matte_and_metal()?.save(folder.join("matte_and_metal.json"))?;
    let settings = RenderSettings {
        samples,
        denoise: true,
        ..RenderSettings::default()
    };
    let size = ImageSize::new(960, 540);
    let film = trace_image(
        &CpuTracer::new()?,
        &CompiledScene::new(&scene)?,
        size,
        settings,
    )?;
    film.image()
        .write_png(folder.join("textured_scene.png"), 1.0)?;
    Ok(())
}

fn scene() -> Result<Scene, String> {
    let camera = Camera::looking_at([0.0, -5.2, 1.5], [0.0, 0.0, 0.5]).fov_deg(38.0);
    let mut scene = Scene::new().camera(camera).surroundings(sky(256)?);
    let tiles = scene.add_texture(texture("tiles", 512, tile_color)?);
    let joints = scene.add_texture(texture("joints", 512, tile_normal)?.linear());
    let planet = scene.add_texture(texture("planet", 512, planet_color)?);
    let bumps = scene.add_texture(texture("bumps", 512, bump_normal)?.linear());
    let wear = scene.add_texture(texture("wear", 512, wear)?.linear());
    let maps = |base_color, metallic_roughness, normal| MaterialTextures {
        base_color,
        metallic_roughness,
        normal,
        ..MaterialTextures::NONE
    };
    let metal = |roughness, textures| Material::MetallicRoughness {
        base_color: Vec3::new(0.95, 0.75, 0.45),
        metallic: 1.0,
        roughness,
        ior: 1.5,
        emission: Vec3::ZERO,
        textures,
        opacity: Opacity::Opaque,
        layers: Layers::NONE,
    };
    let floor = Material::rough([1.0; 3], 0.45).textured(maps(Some(tiles), None, Some(joints)));
    scene.add(floor_mesh(), floor);
    for (x, material) in [
        (-1.15, metal(0.3, maps(None, None, Some(bumps)))),
        (
            0.0,
            Material::rough([1.0; 3], 0.35).textured(maps(Some(planet), None, None)),
        ),
        (1.15, metal(1.0, maps(None, Some(wear), None))),
    ] {
        let tilt = Quat::from_rotation_y(0.4) * Quat::from_rotation_z(x);
        scene.add(globe().at([x, 0.0, 0.5]).rotated(tilt), material);
    }
    Ok(scene)
}

/// A tiled floor and a globe that are matte, a globe of stained metal and one of gold, under the same sky in
/// finer pixels: renderers place those of environment maps half a pixel apart.
fn matte_and_metal() -> Result<Scene, String> {
    let camera = Camera::looking_at([0.0, -5.2, 1.5], [0.0, 0.0, 0.5]).fov_deg(38.0);
    let mut scene = Scene::new().camera(camera).surroundings(sky(1024)?);
    let tiles = scene.add_texture(texture("tiles", 512, tile_color)?);
    let planet = scene.add_texture(texture("planet", 512, planet_color)?);
    let textured = |texture, metallic, roughness, specular| Material::MetallicRoughness {
        base_color: Vec3::ONE,
        metallic,
        roughness,
        ior: 1.5,
        emission: Vec3::ZERO,
        textures: MaterialTextures {
            base_color: Some(texture),
            ..MaterialTextures::NONE
        },
        opacity: Opacity::Opaque,
        layers: Layers {
            specular,
            ..Layers::NONE
        },
    };
    let gold = Material::Conductor {
        eta: Vec3::new(0.143, 0.375, 1.442),
        k: Vec3::new(3.983, 2.386, 1.603),
        alpha: 0.2,
        number: 0,
    };
    scene.add(floor_mesh(), textured(tiles, 0.0, 1.0, 0.0));
    for (x, material) in [
        (-1.15, textured(planet, 1.0, 0.5, 1.0)),
        (0.0, textured(planet, 0.0, 1.0, 0.0)),
        (1.15, gold),
    ] {
        let tilt = Quat::from_rotation_y(0.4) * Quat::from_rotation_z(x);
        scene.add(globe().at([x, 0.0, 0.5]).rotated(tilt), material);
    }
    Ok(scene)
}

/// A picture from a function of the unit square.
fn texture(name: &str, edge: u32, color: fn(Vec2) -> Vec3) -> Result<ImageTexture, String> {
    let places = (0..edge * edge).map(|i| Vec2::new((i % edge) as f32, (i / edge) as f32));
    let texels = places.map(|place| {
        let color = color((place + 0.5) / edge as f32).clamp(Vec3::ZERO, Vec3::ONE);
        let [r, g, b] = (color * 255.0 + 0.5)
            .to_array()
            .map(|channel| channel as u8);
        [r, g, b, 255]
    });
    let size = [edge; 2];
    let texels = texels.collect();
    Ok(ImageTexture::new(
        name,
        encode_png(&Texels { size, texels })?,
    ))
}

/// Distance from the nearest joint of a grid of four by four tiles, from 0 to 0.5.
fn from_joint(uv: Vec2) -> Vec2 {
    let within = (4.0 * uv).fract();
    within.min(Vec2::ONE - within)
}

fn noise(uv: Vec2, scale: f32) -> f32 {
    let wave = |x: f32, y: f32| (TAU * (x * uv.x + y * uv.y)).sin();
    let [a, b, c] = [1.0f32, 2.0, 3.0].map(|octave| (scale * octave).round());
    (wave(a, -b) + wave(b, a) * wave(-c, b) + 0.5 * wave(c, c + a)) / 2.5
}

fn tile_color(uv: Vec2) -> Vec3 {
    if from_joint(uv).min_element() < 0.025 {
        return Vec3::splat(0.45);
    }
    let tile = (4.0 * uv).floor();
    let is_dark = (tile.x + tile.y) % 2.0 == 0.0;
    let tone = 1.0 + 0.08 * noise(uv, 7.0);
    tone * if is_dark {
        Vec3::new(0.30, 0.42, 0.44)
    } else {
        Vec3::new(0.86, 0.80, 0.70)
    }
}

fn tile_normal(uv: Vec2) -> Vec3 {
    let within = (4.0 * uv).fract() - 0.5;
    let slope = |at: f32| {
        if at.abs() > 0.45 {
            0.5 * at.signum()
        } else {
            0.0
        }
    };
    let normal = Vec3::new(slope(within.x), -slope(within.y), 1.0).normalize();
    0.5 * normal + 0.5
}

fn planet_color(uv: Vec2) -> Vec3 {
    let height = noise(uv, 2.0) + 0.35 * noise(uv, 5.0) + 0.15 * noise(uv, 11.0);
    let polar = (uv.y - 0.5).abs() + 0.03 * noise(uv, 6.0);
    match height {
        _ if polar > 0.40 => Vec3::splat(0.93),
        0.12.. => Vec3::new(0.30, 0.52, 0.22).lerp(Vec3::new(0.62, 0.52, 0.36), height.min(1.0)),
        _ => Vec3::new(0.08, 0.25, 0.50) * (1.2 + height),
    }
}

fn bump_normal(uv: Vec2) -> Vec3 {
    let within = (Vec2::new(24.0, 12.0) * uv).fract() - 0.5;
    let falloff = (1.0 - 4.0 * within.length_squared()).max(0.0);
    let normal = Vec3::new(within.x * falloff, -within.y * falloff, 0.45).normalize();
    0.5 * normal + 0.5
}

/// Roughness in green, metal in blue: bands of polish and of paint.
fn wear(uv: Vec2) -> Vec3 {
    let band = (10.0 * uv.y + 0.15 * noise(uv, 3.0)).fract();
    let is_painted = band > 0.75;
    let roughness = if is_painted { 0.6 } else { 0.15 + 0.35 * band };
    Vec3::new(0.0, roughness, if is_painted { 0.0 } else { 1.0 })
}

/// A blue sky with a sun, and dull ground.
/// A blue sky with a sun, of twice as many columns as rows.
fn sky(rows: u32) -> Result<EnvironmentMap, String> {
    let size = ImageSize::new(2 * rows, rows);
    let mut picture = RadianceImage::black(size);
    let sun = Vec3::new(-0.55, -0.5, 0.62).normalize();
    for (i, pixel) in (0..).zip(&mut picture.pixels) {
        let place = Vec2::new((i % size.width) as f32, (i / size.width) as f32) + 0.5;
        let Vec2 { x, y } = place / rows as f32;
        let (azimuth, colatitude) = (PI * (x - 1.0), PI * y);
        let sine = colatitude.sin();
        let direction = Vec3::new(sine * azimuth.sin(), sine * azimuth.cos(), colatitude.cos());
        let horizon = (1.0 - direction.z.abs()).powi(4);
        let mut radiance = match direction.z > 0.0 {
            true => Vec3::new(0.18, 0.34, 0.75).lerp(Vec3::new(0.9, 0.92, 0.95), horizon),
            false => Vec3::new(0.22, 0.20, 0.18),
        };
        if direction.dot(sun) > 0.9985 {
            radiance = Vec3::new(480.0, 430.0, 360.0);
        }
        *pixel = radiance.to_array();
    }
    Ok(EnvironmentMap::new(encode_exr(&picture)?))
}

fn floor_mesh() -> Mesh {
    let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(Vec2::from);
    let positions = corners.map(|corner| (600.0 * corner).extend(0.0));
    let uvs = corners.map(|corner| 300.0 * Vec2::new(corner.x, -corner.y));
    Mesh::new(positions.into(), vec![[0, 1, 2], [0, 2, 3]]).uvs(uvs.into())
}

/// A ball of radius 0.5 whose map is an equirectangular picture.
fn globe() -> Mesh {
    const COLUMNS: u32 = 96;
    const ROWS: u32 = 48;
    let vertices = (0..=ROWS).flat_map(|row| (0..=COLUMNS).map(move |column| (column, row)));
    let uvs: Vec<Vec2> = vertices
        .map(|(column, row)| Vec2::new(column as f32 / COLUMNS as f32, row as f32 / ROWS as f32))
        .collect();
    let normals: Vec<Vec3> = uvs
        .iter()
        .map(|uv| {
            let (azimuth, colatitude) = (TAU * uv.x, PI * uv.y);
            let sine = colatitude.sin();
            Vec3::new(sine * azimuth.cos(), sine * azimuth.sin(), colatitude.cos())
        })
        .collect();
    let corner = |column: u32, row: u32| row * (COLUMNS + 1) + column;
    let cells = (0..ROWS).flat_map(|row| (0..COLUMNS).map(move |column| (column, row)));
    let triangles = cells.flat_map(|(column, row)| {
        let [a, b] = [corner(column, row), corner(column + 1, row)];
        let [c, d] = [corner(column, row + 1), corner(column + 1, row + 1)];
        [[a, c, b], [b, c, d]]
    });
    let positions = normals.iter().map(|normal| 0.5 * *normal).collect();
    Mesh::new(positions, triangles.collect())
        .normals(normals)
        .uvs(uvs)
}
