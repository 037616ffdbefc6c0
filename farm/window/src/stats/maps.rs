//! Maps over the picture of each tile's owner or cost: a small texture, drawn as one quad.

use carom_text::text;
use carom_tracer::{ImageSize, TileGrid};
use egui::{
    Align2, Color32, ColorImage, Context, FontId, Painter, Pos2, Rect, TextureHandle,
    TextureOptions, Vec2,
};

use super::frame_record::{Detail, FrameRecord};
use super::palette;
use crate::theme::INK;

/// Kind of map over the picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum MapKind {
    /// No map.
    #[default]
    None,
    /// The node that traced each tile.
    Owner,
    /// The predicted cost of each tile.
    Cost,
}

/// Map over the picture, with its texture.
#[derive(Default)]
pub struct Maps {
    /// The kind of map to draw.
    pub kind: MapKind,
    texture: Option<TextureHandle>,
    /// The picture and kind for which the texture was made.
    shown: Option<(u64, MapKind)>,
    owners: Vec<u16>,
}

impl std::fmt::Debug for Maps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct(stringify!(Maps))
            .field("kind", &self.kind)
            .finish_non_exhaustive()
    }
}

impl Maps {
    /// Draws the map of a picture over `screen`, which the picture fills.
    pub fn draw(&mut self, ctx: &Context, painter: &Painter, screen: Rect, record: &FrameRecord) {
        if self.kind == MapKind::None {
            return;
        }
        let Some(detail) = &record.detail else {
            return;
        };
        let grid = grid_of(record, detail);
        if self.shown != Some((record.frame, self.kind)) {
            self.shown = Some((record.frame, self.kind));
            self.owners = owners(detail, grid.len() as usize);
            let image = match self.kind {
                MapKind::Cost => costs(detail, grid),
                _ => ownership(&self.owners, grid),
            };
            match &mut self.texture {
                Some(texture) => texture.set(image, TextureOptions::NEAREST),
                None => {
                    self.texture = Some(ctx.load_texture("tiles", image, TextureOptions::NEAREST))
                }
            }
        }
        let Some(texture) = &self.texture else {
            return;
        };
        let tile = tile_size(screen, grid);
        // Whole tiles: the last column and row, and thus the quad, may extend beyond the picture.
        let whole = Vec2::new(tile.x * grid.columns() as f32, tile.y * grid.rows() as f32);
        let uv = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        painter.image(
            texture.id(),
            Rect::from_min_size(screen.min, whole),
            uv,
            Color32::WHITE,
        );
        if self.kind == MapKind::Owner {
            self.numbers(painter, screen, grid, record.nodes.len());
        }
    }

    /// Describes the tile under the pointer.
    pub(super) fn tell(&self, pointer: Pos2, screen: Rect, record: &FrameRecord) -> Option<String> {
        let detail = record.detail.as_ref()?;
        let grid = grid_of(record, detail);
        if self.kind == MapKind::None || self.shown?.0 != record.frame || !screen.contains(pointer)
        {
            return None;
        }
        let at = (pointer - screen.min) / tile_size(screen, grid);
        let column = (at.x as u32).min(grid.columns() - 1);
        let row = (at.y as u32).min(grid.rows() - 1);
        let tile = (row * grid.columns() + column) as usize;
        let owner = usize::from(*self.owners.get(tile)?);
        let name = record
            .nodes
            .get(owner)
            .map_or(text!("stats-map-nobody"), |node| &*node.name);
        let times = detail.tile_work.get(tile)? / mean(&detail.tile_work);
        Some(text!(
            "stats-map-tile",
            tile = tile,
            node = owner,
            name = name,
            times = format!("{times:.2}")
        ))
    }

    /// Draws each node's number at the centroid of its tiles, so that colour is not the only distinction.
    fn numbers(&self, painter: &Painter, screen: Rect, grid: TileGrid, nodes: usize) {
        let tile = tile_size(screen, grid);
        let mut middles = vec![(Vec2::ZERO, 0u32); nodes];
        for (index, owner) in self.owners.iter().enumerate() {
            let index = index as u32;
            let at = Vec2::new(
                (index % grid.columns()) as f32,
                (index / grid.columns()) as f32,
            );
            if let Some((sum, count)) = middles.get_mut(usize::from(*owner)) {
                *sum += at + Vec2::splat(0.5);
                *count += 1;
            }
        }
        for (node, (sum, count)) in middles
            .iter()
            .enumerate()
            .filter(|(_, (_, count))| *count > 0)
        {
            // Each number is drawn twice, first in black as a shadow, for contrast on any colour.
            let at = screen.min + *sum / *count as f32 * tile;
            painter.text(
                at + Vec2::splat(1.0),
                Align2::CENTER_CENTER,
                node,
                FontId::monospace(12.0),
                Color32::BLACK,
            );
            painter.text(
                at,
                Align2::CENTER_CENTER,
                node,
                FontId::monospace(12.0),
                INK,
            );
        }
    }
}

/// The node of each tile: the first that delivered it.
fn owners(detail: &Detail, tiles: usize) -> Vec<u16> {
    let mut owners = vec![NOBODY; tiles];
    for delivery in &detail.deliveries {
        let end = (delivery.tiles.end() as usize).min(tiles);
        for owner in &mut owners[(delivery.tiles.first as usize).min(end)..end] {
            if *owner == NOBODY {
                *owner = delivery.node.0 as u16;
            }
        }
    }
    owners
}

fn ownership(owners: &[u16], grid: TileGrid) -> ColorImage {
    let color = |owner: &u16| match *owner {
        NOBODY => Color32::TRANSPARENT,
        owner => palette::node(usize::from(owner)).gamma_multiply(OPACITY),
    };
    image(grid, owners.iter().map(color))
}

fn costs(detail: &Detail, grid: TileGrid) -> ColorImage {
    let mean = mean(&detail.tile_work);
    let color = |work: &f32| palette::cost(work / mean).gamma_multiply(OPACITY);
    image(grid, detail.tile_work.iter().map(color))
}

fn image(grid: TileGrid, colors: impl Iterator<Item = Color32>) -> ColorImage {
    let mut pixels: Vec<Color32> = colors.collect();
    pixels.resize(grid.len() as usize, Color32::TRANSPARENT);
    ColorImage::new([grid.columns() as usize, grid.rows() as usize], pixels)
}

fn grid_of(record: &FrameRecord, detail: &Detail) -> TileGrid {
    TileGrid::new(
        ImageSize::new(record.width, record.height),
        detail.tile_edge.max(1),
    )
}

/// Size of a tile on the screen; tiles of the last column and row may extend beyond it.
fn tile_size(screen: Rect, grid: TileGrid) -> Vec2 {
    let edge = f32::from(grid.edge);
    let of_picture = Vec2::new(
        grid.size.width.max(1) as f32,
        grid.size.height.max(1) as f32,
    );
    screen.size() * edge / of_picture
}

fn mean(work: &[f32]) -> f32 {
    let sum: f64 = work.iter().copied().map(f64::from).sum();
    (sum / work.len().max(1) as f64).max(1e-9) as f32
}

const NOBODY: u16 = u16::MAX;
const OPACITY: f32 = 0.5;
