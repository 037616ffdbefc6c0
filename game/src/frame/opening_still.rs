//! Stored picture of the free table before its first stroke, which the window shows until the farm has
//! traced one.
//!
//! It is reprojected to the present balls and camera as any other frame. `assets/README.md` says how it was
//! made.

use anyhow::Context as _;
use carom_tracer::{ImageSize, SceneUpdate};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::play::free_table;
use crate::scene::export::{SceneView, opening_update};
use crate::scene::table_scene::TableScene;

/// Stored picture with the scene that it shows.
pub struct OpeningStill {
    /// Width and height in pixels.
    pub size: ImageSize,
    /// sRGB with an alpha of 255, row-major from the top left.
    pub rgba: Vec<[u8; 4]>,
    /// Camera and poses of the picture, as an update of the present room.
    pub update: SceneUpdate,
}

impl OpeningStill {
    /// The picture for a room; none if the table has another size.
    ///
    /// # Errors
    /// If the built-in picture cannot be decoded, which a test excludes.
    pub fn of(room: &TableScene) -> anyhow::Result<Option<Self>> {
        let table = TableScene::table();
        let is_same = |size: fn(&carom_billiards::physics::Table) -> f64| {
            size(room.table_inside()) == size(&table)
        };
        if !is_same(|table| table.length_m()) || !is_same(|table| table.width_m()) {
            return Ok(None);
        }
        let options = DecoderOptions::default().jpeg_set_out_colorspace(ColorSpace::RGB);
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(JPEG), options);
        let rgb = decoder.decode().context("opening still")?;
        let info = decoder.info().context("opening still without a size")?;
        let (pixels, _) = rgb.as_chunks::<3>();
        let opening = free_table(table, SEED)?;
        Ok(Some(Self {
            size: ImageSize::new(u32::from(info.width), u32::from(info.height)),
            rgba: pixels.iter().map(|&[r, g, b]| [r, g, b, 255]).collect(),
            update: opening_update(room, &opening, SceneView::Cue),
        }))
    }
}

const JPEG: &[u8] = include_bytes!("../../../assets/pictures/opening_still.jpg");
/// Seed of the rack in the picture.
const SEED: u32 = 1;

#[cfg(test)]
mod tests {
    use carom_billiards::physics::Table;

    use super::*;
    use crate::scene::ball_materials::BallSet;

    #[test]
    fn the_still_shows_cloth_and_balls_and_only_on_its_own_table() {
        let room = TableScene::room(BallSet::Classic);
        let still = OpeningStill::of(&room).unwrap().unwrap();
        assert_eq!(still.rgba.len() as u64, still.size.pixels() as u64);
        let mean = |channel: usize| {
            let sum: u64 = still.rgba.iter().map(|p| u64::from(p[channel])).sum();
            sum as f64 / still.rgba.len() as f64
        };
        let [red, green, blue] = [0, 1, 2].map(mean);
        assert!(
            blue > red && blue > green,
            "tournament blue: {red} {green} {blue}"
        );
        assert!(
            still
                .update
                .poses
                .iter()
                .filter(|pose| pose.visible)
                .count()
                >= 16
        );
        let snooker = Table::built_in("snooker").unwrap();
        let room = TableScene::around(&snooker, BallSet::Classic);
        assert!(OpeningStill::of(&room).unwrap().is_none());
    }
}
