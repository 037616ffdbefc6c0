//! Rasteriser of textured triangles on the CPU, which draws the user interface without a GPU.
//!
//! Colours are sRGB bytes with premultiplied alpha and are blended without decoding, as egui expects.
//! Triangles that share an edge cover each pixel on it once (top-left rule), so that semi-transparent
//! shapes have no seams.

use std::collections::HashMap;

use egui::epaint::{ClippedPrimitive, ImageData, ImageDelta, Mesh, Primitive, Vertex};
use egui::{Color32, Pos2, Rect, TextureFilter, TextureId, TexturesDelta};

/// Image of 0RGB words, row-major from the top left.
#[derive(Debug)]
pub struct Canvas<'a> {
    /// Width in pixels.
    pub width: usize,
    /// The pixels; their number is a multiple of `width`.
    pub pixels: &'a mut [u32],
}

impl Canvas<'_> {
    fn height(&self) -> usize {
        self.pixels.len().checked_div(self.width).unwrap_or(0)
    }
}

/// Rasteriser of egui's output, with its textures.
#[derive(Debug, Default)]
pub struct Rasterizer {
    textures: HashMap<TextureId, RasterTexture>,
}

impl Rasterizer {
    /// Creates and updates textures.
    pub fn set_textures(&mut self, delta: &TexturesDelta) {
        for (id, images) in &delta.set {
            for image in images {
                self.set_texture(*id, image);
            }
        }
    }

    /// Frees the textures that egui does not need after this frame.
    pub fn free_textures(&mut self, delta: &TexturesDelta) {
        for id in &delta.free {
            self.textures.remove(id);
        }
    }

    /// Draws `primitives`, whose positions are in points of `pixels_per_point` pixels.
    pub fn draw(
        &self,
        canvas: &mut Canvas<'_>,
        primitives: &[ClippedPrimitive],
        pixels_per_point: f32,
    ) {
        for ClippedPrimitive {
            clip_rect,
            primitive,
        } in primitives
        {
            // Callbacks draw with a GPU; this program's user interface has none.
            let Primitive::Mesh(mesh) = primitive else {
                continue;
            };
            let Some(texture) = self.textures.get(&mesh.texture_id) else {
                continue;
            };
            let clip = ClipRect::new(*clip_rect, pixels_per_point, canvas);
            draw_mesh(canvas, mesh, texture, clip, pixels_per_point);
        }
    }

    fn set_texture(&mut self, id: TextureId, delta: &ImageDelta) {
        let ImageData::Color(image) = &delta.image;
        let [width, height] = image.size;
        let Some([left, top]) = delta.pos else {
            let texture = RasterTexture {
                width,
                height,
                texels: image.pixels.clone(),
                filter: delta.options.magnification,
            };
            self.textures.insert(id, texture);
            return;
        };
        // With a position, part of an existing texture is updated.
        let Some(texture) = self.textures.get_mut(&id) else {
            return;
        };
        for (row, texels) in image.pixels.chunks_exact(width).enumerate() {
            let start = (top + row) * texture.width + left;
            texture.texels[start..start + width].copy_from_slice(texels);
        }
    }
}

#[derive(Debug)]
struct RasterTexture {
    width: usize,
    height: usize,
    texels: Vec<Color32>,
    filter: TextureFilter,
}

impl RasterTexture {
    fn sample(&self, uv: Pos2) -> [f32; 4] {
        let (x, y) = (uv.x * self.width as f32, uv.y * self.height as f32);
        if self.filter == TextureFilter::Nearest {
            return self.texel(x.floor() as isize, y.floor() as isize);
        }
        let (x, y) = (x - 0.5, y - 0.5);
        let (left, top) = (x.floor(), y.floor());
        let (fx, fy) = (x - left, y - top);
        let (left, top) = (left as isize, top as isize);
        let mix = |a: [f32; 4], b: [f32; 4], t: f32| -> [f32; 4] {
            std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t)
        };
        if fx == 0.0 && fy == 0.0 {
            return self.texel(left, top);
        }
        let upper = mix(self.texel(left, top), self.texel(left + 1, top), fx);
        let lower = mix(self.texel(left, top + 1), self.texel(left + 1, top + 1), fx);
        mix(upper, lower, fy)
    }

    fn texel(&self, x: isize, y: isize) -> [f32; 4] {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.texels[y * self.width + x].to_array().map(f32::from)
    }
}

/// Clip rectangle in pixels: columns and rows, the ends excluded.
#[derive(Clone, Copy)]
struct ClipRect {
    x: [i32; 2],
    y: [i32; 2],
}

impl ClipRect {
    fn new(rect: Rect, pixels_per_point: f32, canvas: &Canvas<'_>) -> Self {
        let range = |from: f32, to: f32, end: usize| {
            [from, to].map(|v| ((v * pixels_per_point).round() as i32).clamp(0, end as i32))
        };
        Self {
            x: range(rect.min.x, rect.max.x, canvas.width),
            y: range(rect.min.y, rect.max.y, canvas.height()),
        }
    }
}

fn draw_mesh(
    canvas: &mut Canvas<'_>,
    mesh: &Mesh,
    texture: &RasterTexture,
    clip: ClipRect,
    pixels_per_point: f32,
) {
    for corners in mesh.indices.chunks_exact(3) {
        let [a, b, c] = [0, 1, 2].map(|i| {
            let mut vertex = mesh.vertices[corners[i] as usize];
            vertex.pos = (vertex.pos.to_vec2() * pixels_per_point).to_pos2();
            vertex
        });
        // Both windings are drawn; the edge functions below assume the clockwise one.
        let area = cross(a.pos, b.pos, c.pos);
        if area > 0.0 {
            draw_triangle(canvas, [a, b, c], area, texture, clip);
        } else if area < 0.0 {
            draw_triangle(canvas, [a, c, b], -area, texture, clip);
        }
    }
}

fn draw_triangle(
    canvas: &mut Canvas<'_>,
    corners: [Vertex; 3],
    area: f32,
    texture: &RasterTexture,
    clip: ClipRect,
) {
    let positions = corners.map(|corner| corner.pos);
    let bounds = |axis: fn(Pos2) -> f32, clip: [i32; 2]| {
        let values = positions.map(axis);
        let low = values.into_iter().fold(f32::INFINITY, f32::min);
        let high = values.into_iter().fold(f32::NEG_INFINITY, f32::max);
        (low.floor() as i32).max(clip[0])..(high.ceil() as i32).min(clip[1])
    };
    let edges = [(1, 2), (2, 0), (0, 1)].map(|(i, j)| (positions[i], positions[j]));
    let paint = RasterPaint::new(corners, texture);
    for y in bounds(|p| p.y, clip.y) {
        for x in bounds(|p| p.x, clip.x) {
            let center = Pos2::new(x as f32 + 0.5, y as f32 + 0.5);
            // Edge functions (Pineda, SIGGRAPH 1988): all are positive inside, and divided by `area`, which
            // is twice the triangle's, they are the barycentric coordinates.
            let weights = edges.map(|(from, to)| cross(from, to, center));
            let inside = |i: usize| weights[i] > 0.0 || (weights[i] == 0.0 && owns(edges[i]));
            if inside(0) && inside(1) && inside(2) {
                let source = paint.at(weights.map(|weight| weight / area));
                let pixel = &mut canvas.pixels[y as usize * canvas.width + x as usize];
                *pixel = over(*pixel, source);
            }
        }
    }
}

/// Whether a triangle owns the pixel centres exactly on this edge, which is so for a top or left edge.
fn owns((from, to): (Pos2, Pos2)) -> bool {
    to.y < from.y || (to.y == from.y && to.x > from.x)
}

/// Twice the signed area of a triangle; positive if its corners are clockwise on the screen.
fn cross(a: Pos2, b: Pos2, c: Pos2) -> f32 {
    (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x)
}

/// Colours and texture of a triangle's pixels.
struct RasterPaint<'a> {
    colors: [[f32; 4]; 3],
    uvs: [Pos2; 3],
    texture: &'a RasterTexture,
    /// The texel of the whole triangle, if its corners share one: in all of egui's shapes but text.
    texel: Option<[f32; 4]>,
}

impl<'a> RasterPaint<'a> {
    fn new(corners: [Vertex; 3], texture: &'a RasterTexture) -> Self {
        let uvs = corners.map(|corner| corner.uv);
        let flat = uvs[0] == uvs[1] && uvs[1] == uvs[2];
        Self {
            colors: corners.map(|corner| corner.color.to_array().map(f32::from)),
            uvs,
            texture,
            texel: flat.then(|| texture.sample(uvs[0])),
        }
    }

    /// Premultiplied colour, 0 to 255, at barycentric coordinates `weights`.
    fn at(&self, weights: [f32; 3]) -> [f32; 4] {
        let texel = self.texel.unwrap_or_else(|| {
            let mix = |axis: fn(Pos2) -> f32| (0..3).map(|i| axis(self.uvs[i]) * weights[i]).sum();
            self.texture.sample(Pos2::new(mix(|p| p.x), mix(|p| p.y)))
        });
        std::array::from_fn(|channel| {
            let color: f32 = (0..3).map(|i| self.colors[i][channel] * weights[i]).sum();
            color * texel[channel] / 255.0
        })
    }
}

fn over(below: u32, source: [f32; 4]) -> u32 {
    // Source-over compositing of premultiplied colours (Porter and Duff, SIGGRAPH 1984).
    let rest = 1.0 - source[3] / 255.0;
    let channel = |shift: u32, source: f32| {
        let below = (below >> shift & 0xFF) as f32;
        ((source + below * rest).round().clamp(0.0, 255.0) as u32) << shift
    };
    channel(16, source[0]) | channel(8, source[1]) | channel(0, source[2])
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use egui::epaint::WHITE_UV;
    use egui::{ColorImage, TextureOptions};

    use super::*;

    const TEXTURE: TextureId = TextureId::Managed(0);

    fn rasterizer(size: [usize; 2], texels: Vec<Color32>, options: TextureOptions) -> Rasterizer {
        let mut rasterizer = Rasterizer::default();
        let image = ImageData::Color(Arc::new(ColorImage::new(size, texels)));
        rasterizer.set_texture(TEXTURE, &ImageDelta::full(image, options));
        rasterizer
    }

    fn white() -> Rasterizer {
        rasterizer([1, 1], vec![Color32::WHITE], TextureOptions::LINEAR)
    }

    fn draw(rasterizer: &Rasterizer, mesh: Mesh, clip: Rect, scale: f32, below: u32) -> Vec<u32> {
        let mut pixels = vec![below; 64];
        let mut canvas = Canvas {
            width: 8,
            pixels: &mut pixels,
        };
        let primitive = ClippedPrimitive {
            clip_rect: clip,
            primitive: Primitive::Mesh(mesh),
        };
        rasterizer.draw(&mut canvas, &[primitive], scale);
        pixels
    }

    fn everywhere() -> Rect {
        Rect::from_min_max(Pos2::ZERO, Pos2::new(8.0, 8.0))
    }

    fn rect_mesh(min: [f32; 2], max: [f32; 2], color: Color32) -> Mesh {
        let mut mesh = Mesh::with_texture(TEXTURE);
        mesh.add_rect_with_uv(
            Rect::from_min_max(min.into(), max.into()),
            Rect::from_min_max(WHITE_UV, WHITE_UV),
            color,
        );
        mesh
    }

    #[test]
    fn a_rectangle_covers_its_pixels_and_no_others() {
        let mesh = rect_mesh([2.0, 1.0], [5.0, 4.0], Color32::from_rgb(10, 20, 30));
        let pixels = draw(&white(), mesh, everywhere(), 1.0, 0);
        for (i, pixel) in pixels.iter().enumerate() {
            let inside = (2..5).contains(&(i % 8)) && (1..4).contains(&(i / 8));
            assert_eq!(*pixel, if inside { 0x0A_14_1E } else { 0 }, "pixel {i}");
        }
    }

    #[test]
    fn a_half_transparent_rectangle_has_no_seam_along_its_diagonal() {
        let mesh = rect_mesh([0.0, 0.0], [8.0, 8.0], Color32::from_black_alpha(128));
        let pixels = draw(&white(), mesh, everywhere(), 1.0, 0xFF_FF_FF);
        assert!(
            pixels.iter().all(|pixel| *pixel == 0x7F_7F_7F),
            "{pixels:x?}"
        );
    }

    #[test]
    fn triangles_of_a_fan_touch_each_pixel_once() {
        // Corners and centre at fractional positions, so that some edges pass through pixel centres.
        let rim: [[f32; 2]; 6] = [
            [0.5, 0.5],
            [4.5, 0.5],
            [7.5, 2.5],
            [7.5, 7.5],
            [2.0, 7.5],
            [0.5, 4.5],
        ];
        let color = Color32::from_black_alpha(100);
        let mut mesh = Mesh::with_texture(TEXTURE);
        mesh.colored_vertex(Pos2::new(3.5, 3.5), color);
        rim.iter()
            .for_each(|p| mesh.colored_vertex((*p).into(), color));
        (0..6).for_each(|i| mesh.add_triangle(0, 1 + i, 1 + (i + 1) % 6));
        let pixels = draw(&white(), mesh, everywhere(), 1.0, 0xFF_FF_FF);
        let once = over(0xFF_FF_FF, [0.0, 0.0, 0.0, 100.0]);
        assert!(
            pixels
                .iter()
                .all(|pixel| *pixel == once || *pixel == 0xFF_FF_FF)
        );
        assert!(pixels.iter().filter(|pixel| **pixel == once).count() >= 36);
    }

    #[test]
    fn clip_and_scale_are_in_points() {
        let mesh = rect_mesh([0.0, 0.0], [4.0, 4.0], Color32::RED);
        let clip = Rect::from_min_max(Pos2::new(1.0, 0.0), Pos2::new(2.0, 3.0));
        let pixels = draw(&white(), mesh, clip, 2.0, 0);
        for (i, pixel) in pixels.iter().enumerate() {
            let inside = (2..4).contains(&(i % 8)) && i / 8 < 6;
            assert_eq!(*pixel == 0xFF_00_00, inside, "pixel {i}");
        }
    }

    #[test]
    fn texels_land_on_pixels_and_filter_between_them() {
        let texels = vec![Color32::BLACK, Color32::WHITE];
        let mut mesh = Mesh::with_texture(TEXTURE);
        let whole = Rect::from_min_max(Pos2::ZERO, Pos2::new(1.0, 1.0));
        mesh.add_rect_with_uv(everywhere(), whole, Color32::WHITE);
        let linear = rasterizer([2, 1], texels.clone(), TextureOptions::LINEAR);
        let row = draw(&linear, mesh.clone(), everywhere(), 1.0, 0);
        // Texel centres are at columns 2 and 6; column i has its centre at i + 0.5.
        assert_eq!(
            row[..8].iter().map(|p| p & 0xFF).collect::<Vec<_>>(),
            [0, 0, 32, 96, 159, 223, 255, 255]
        );
        let nearest = rasterizer([2, 1], texels, TextureOptions::NEAREST);
        let row = draw(&nearest, mesh, everywhere(), 1.0, 0);
        assert_eq!(
            row[..8].iter().map(|p| p & 0xFF).collect::<Vec<_>>(),
            [0, 0, 0, 0, 255, 255, 255, 255]
        );
    }

    #[test]
    fn a_patch_changes_a_part_of_a_texture() {
        let mut rasterizer = rasterizer([2, 2], vec![Color32::BLACK; 4], TextureOptions::NEAREST);
        let patch = ImageData::Color(Arc::new(ColorImage::new([1, 1], vec![Color32::GREEN])));
        rasterizer.set_texture(
            TEXTURE,
            &ImageDelta::partial([1, 0], patch, TextureOptions::NEAREST),
        );
        let texels = &rasterizer.textures[&TEXTURE].texels;
        assert_eq!(
            texels[..],
            [
                Color32::BLACK,
                Color32::GREEN,
                Color32::BLACK,
                Color32::BLACK
            ]
        );
    }
}
