//! How each level looks, drawn by the processor and held against pictures that people have looked at.
//! `CAROM_REWRITE_PICTURES=1` draws those anew; a difference is left beside them as `*.actual.png`.

use std::fs::File;
use std::path::{Path, PathBuf};

use carom::display::raster::{Canvas, Rasterizer};
use carom::ui::stats::Level;
use carom::ui::stats::maps::Kind;
use carom::ui::theme;
use egui::{Context, RawInput, Rect, Vec2};

use crate::fixture::{facts, nodes, overlay};

/// Share of pixels that may differ by more than [`STEP`]. Text is laid out in floats, whose last
/// bits differ between processors: an edge of a letter may fall on the next pixel.
const SHARE: f64 = 0.002;
/// Steps of 255 by which a channel may differ.
const STEP: u8 = 24;

#[test]
fn each_level_looks_as_it_did() {
    let sizes = [(1280, 720), (640, 360)];
    let levels = [
        (Level::Line, "line"),
        (Level::Card, "card"),
        (Level::Full, "full"),
    ];
    let mut differing = Vec::new();
    for (size, text_scale) in sizes.into_iter().flat_map(|size| [(size, 1), (size, 2)]) {
        for (level, name) in levels {
            let drawn = draw(level, size, text_scale as f32);
            let name = format!("{name}_{}x{}_text_{text_scale}.png", size.0, size.1);
            differing.extend(compare(&folder().join(name), size, &drawn).err());
        }
    }
    assert!(differing.is_empty(), "{}", differing.join("\n"));
}

#[test]
fn the_maps_look_as_they_did() {
    let size = (1280, 720);
    for (kind, name) in [(Kind::Owner, "owner"), (Kind::Cost, "cost")] {
        let drawn = draw_with(Level::Full, size, 1.0, kind);
        let path = folder().join(format!("map_{name}.png"));
        compare(&path, size, &drawn).unwrap();
    }
}

fn folder() -> PathBuf {
    PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/tests/overlay/pictures"
    ))
}

/// 0RGB words over a plain green.
fn draw(level: Level, size: (u32, u32), text_scale: f32) -> Vec<u32> {
    draw_with(level, size, text_scale, Kind::None)
}

fn draw_with(level: Level, (width, height): (u32, u32), text_scale: f32, map: Kind) -> Vec<u32> {
    let ctx = Context::default();
    theme::apply(&ctx, text_scale, true);
    let screen = Vec2::new(width as f32, height as f32) / text_scale;
    let temporary = tempfile::tempdir().unwrap();
    let mut stats = overlay(level, temporary.path());
    stats.show_map(map);
    let (mut rasterizer, mut pixels) = (Rasterizer::default(), Vec::new());
    let nodes = nodes();
    // egui sizes its areas in the first passes.
    for pass in 0..5 {
        let input = RawInput {
            screen_rect: Some(Rect::from_min_size(egui::Pos2::ZERO, screen)),
            time: Some(f64::from(pass)),
            ..RawInput::default()
        };
        let mut output = ctx.run_ui(input, |ui| {
            stats.draw(ui.ctx(), 0.3 * f64::from(pass), &facts(&nodes))
        });
        let primitives = ctx.tessellate(std::mem::take(&mut output.shapes), text_scale);
        rasterizer.set_textures(&output.textures_delta);
        pixels = vec![0x24_66_4A; (width * height) as usize];
        let mut canvas = Canvas {
            width: width as usize,
            pixels: &mut pixels,
        };
        rasterizer.draw(&mut canvas, &primitives, text_scale);
        rasterizer.free_textures(&output.textures_delta);
        output.textures_delta.clear();
    }
    pixels
}

fn compare(path: &Path, size: (u32, u32), drawn: &[u32]) -> Result<(), String> {
    let bytes: Vec<u8> = drawn
        .iter()
        .flat_map(|pixel| [16, 8, 0].map(|shift| (pixel >> shift) as u8))
        .collect();
    if std::env::var_os("CAROM_REWRITE_PICTURES").is_some() {
        write(path, size, &bytes);
        return Ok(());
    }
    let actual = path.with_extension("actual.png");
    let known = read(path, size)?;
    let differs = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > STEP);
    let count = known
        .chunks(3)
        .zip(bytes.chunks(3))
        .filter(|pair| differs(*pair))
        .count();
    let share = count as f64 / drawn.len() as f64;
    if share <= SHARE {
        return Ok(());
    }
    write(&actual, size, &bytes);
    Err(format!(
        "{:.2} % of {} differ: see {}",
        share * 1e2,
        path.display(),
        actual.display()
    ))
}

fn write(path: &Path, (width, height): (u32, u32), bytes: &[u8]) {
    let mut encoder = png::Encoder::new(File::create(path).unwrap(), width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::High);
    encoder
        .write_header()
        .unwrap()
        .write_image_data(bytes)
        .unwrap();
}

fn read(path: &Path, (width, height): (u32, u32)) -> Result<Vec<u8>, String> {
    let file = File::open(path).map_err(|why| {
        format!(
            "{}: {why}; CAROM_REWRITE_PICTURES=1 draws it",
            path.display()
        )
    })?;
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .map_err(|why| why.to_string())?;
    let mut bytes = vec![0; (width * height * 3) as usize];
    let info = reader
        .next_frame(&mut bytes)
        .map_err(|why| format!("{}: {why}", path.display()))?;
    if (info.width, info.height) != (width, height) {
        return Err(format!(
            "{} is {}x{}",
            path.display(),
            info.width,
            info.height
        ));
    }
    Ok(bytes)
}
