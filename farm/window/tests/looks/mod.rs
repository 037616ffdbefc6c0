//! Comparison of interface pictures, drawn in software and by a GPU (which may be software Vulkan), with
//! reference pictures that people have checked. `CAROM_REWRITE_PICTURES=1` rewrites the references in
//! software; a picture that differs is written beside its reference as `*.actual.png`. Without a GPU its
//! comparison is skipped with a message, unless `CAROM_REQUIRE_GPU` is set.

use std::fs::File;
use std::path::Path;

use carom_window::display::UiFrame;
use carom_window::display::raster::{Canvas, Rasterizer};
use carom_window::theme;
use egui::{Context, RawInput, Rect, Ui, Vec2};
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};

/// Share of pixels that may differ by more than [`STEP`]. Text is laid out in floats, whose last bits differ
/// between processors, so that the edge of a letter may fall on the next pixel.
const SHARE: f64 = 0.002;
/// The same for a GPU, whose edges and filtering of letters differ.
const GPU_SHARE: f64 = 0.01;
/// Tolerance of a channel in steps of 255.
const STEP: u8 = 24;
const GREEN: [u8; 3] = [0x24, 0x66, 0x4A];

/// A test picture of an interface.
pub(crate) struct Look {
    size: (u32, u32),
    /// egui determines the sizes of its areas in the first pass; the last pass is compared.
    frames: Vec<UiFrame>,
}

impl Look {
    /// The interface drawn by `draw`, which gets the number of the pass, over plain green.
    pub(crate) fn new(
        size: (u32, u32),
        text_scale: f32,
        mut draw: impl FnMut(&mut Ui, u32),
    ) -> Self {
        let ctx = Context::default();
        theme::apply(&ctx, text_scale, true);
        let screen = Vec2::new(size.0 as f32, size.1 as f32) / text_scale;
        let frame = |pass: u32| {
            let input = RawInput {
                screen_rect: Some(Rect::from_min_size(egui::Pos2::ZERO, screen)),
                time: Some(f64::from(pass)),
                ..RawInput::default()
            };
            let mut output = ctx.run_ui(input, |ui| draw(ui, pass));
            UiFrame {
                primitives: ctx.tessellate(std::mem::take(&mut output.shapes), text_scale),
                textures: output.textures_delta,
                pixels_per_point: text_scale,
            }
        };
        Self {
            size,
            frames: (0..PASSES).map(frame).collect(),
        }
    }

    /// The difference to the reference picture at `path`, for a renderer.
    pub(crate) fn differences(&self, path: &Path, gpu: Option<&Gpu>) -> Vec<String> {
        let processor = compare(path, self.size, &self.by_processor(), SHARE, "actual");
        let gpu = gpu.map(|gpu| compare(path, self.size, &gpu.draw(self), GPU_SHARE, "gpu.actual"));
        processor
            .err()
            .into_iter()
            .chain(gpu.and_then(Result::err))
            .collect()
    }

    fn by_processor(&self) -> Vec<u8> {
        let mut rasterizer = Rasterizer::default();
        let [r, g, b] = GREEN.map(u32::from);
        let mut pixels = vec![r << 16 | g << 8 | b; (self.size.0 * self.size.1) as usize];
        for (index, frame) in self.frames.iter().enumerate() {
            rasterizer.set_textures(&frame.textures);
            if index + 1 == self.frames.len() {
                let mut canvas = Canvas {
                    width: self.size.0 as usize,
                    pixels: &mut pixels,
                };
                rasterizer.draw(&mut canvas, &frame.primitives, frame.pixels_per_point);
            }
            rasterizer.free_textures(&frame.textures);
        }
        let bytes = |pixel: u32| [16, 8, 0].map(|shift| (pixel >> shift) as u8);
        pixels.into_iter().flat_map(bytes).collect()
    }
}

/// A GPU for drawing without a window.
pub(crate) struct Gpu {
    device: wgpu::Device,
    queue: wgpu::Queue,
}

impl Gpu {
    /// The first adapter found.
    pub(crate) fn open() -> Option<Self> {
        let opened = pollster::block_on(Self::request());
        match opened {
            Ok(gpu) => Some(gpu),
            Err(why) if std::env::var_os("CAROM_REQUIRE_GPU").is_some() => panic!("{why}"),
            Err(why) => {
                eprintln!("drawn by the processor alone: {why}");
                None
            }
        }
    }

    async fn request() -> Result<Self, String> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let adapter = instance.request_adapter(&wgpu::RequestAdapterOptions::default());
        let adapter = adapter.await.map_err(|why| format!("no adapter: {why}"))?;
        let wanted = wgpu::DeviceDescriptor {
            required_limits: wgpu::Limits::downlevel_webgl2_defaults()
                .using_resolution(adapter.limits()),
            ..Default::default()
        };
        let device = adapter.request_device(&wanted).await;
        let (device, queue) = device.map_err(|why| format!("no device: {why}"))?;
        Ok(Self { device, queue })
    }

    /// A target like the window's: sRGB-encoded values, blended without decoding.
    fn draw(&self, look: &Look) -> Vec<u8> {
        let mut renderer = Renderer::new(&self.device, FORMAT, RendererOptions::default());
        for frame in &look.frames {
            for (id, images) in &frame.textures.set {
                for image in images {
                    renderer.update_texture(&self.device, &self.queue, *id, image);
                }
            }
        }
        let last = &look.frames[look.frames.len() - 1];
        let screen = ScreenDescriptor {
            size_in_pixels: [look.size.0, look.size.1],
            pixels_per_point: last.pixels_per_point,
        };
        let mut encoder = self.device.create_command_encoder(&Default::default());
        let mut commands = renderer.update_buffers(
            &self.device,
            &self.queue,
            &mut encoder,
            &last.primitives,
            &screen,
        );
        let target = self.target(look.size);
        {
            let view = target.create_view(&wgpu::TextureViewDescriptor::default());
            let mut pass = begin(&mut encoder, &view).forget_lifetime();
            renderer.render(&mut pass, &last.primitives, &screen);
        }
        commands.push(encoder.finish());
        self.queue.submit(commands);
        self.read(&target)
    }

    fn target(&self, (width, height): (u32, u32)) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d {
                width,
                height,
                depth_or_array_layers: 1,
            },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: FORMAT,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        })
    }

    /// Red, green and blue of each pixel.
    fn read(&self, texture: &wgpu::Texture) -> Vec<u8> {
        let row_bytes = (texture.width() * 4).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: u64::from(row_bytes * texture.height()),
            usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(row_bytes),
            rows_per_image: None,
        };
        let target = wgpu::TexelCopyBufferInfo {
            buffer: &buffer,
            layout,
        };
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_texture_to_buffer(texture.as_image_copy(), target, texture.size());
        self.queue.submit([encoder.finish()]);
        buffer.map_async(wgpu::MapMode::Read, .., |mapped| mapped.unwrap());
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .unwrap();
        let mapped = buffer.get_mapped_range(..).unwrap();
        let rows = mapped.chunks(row_bytes as usize);
        let pixels = rows.flat_map(|row| row[..4 * texture.width() as usize].chunks(4));
        pixels
            .flat_map(|pixel| [pixel[0], pixel[1], pixel[2]])
            .collect()
    }
}

fn begin<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    view: &wgpu::TextureView,
) -> wgpu::RenderPass<'a> {
    let [r, g, b] = GREEN.map(|channel| f64::from(channel) / 255.0);
    let clear = wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a: 1.0 });
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        color_attachments: &[Some(wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: clear,
                store: wgpu::StoreOp::Store,
            },
        })],
        ..Default::default()
    })
}

fn compare(
    path: &Path,
    size: (u32, u32),
    drawn: &[u8],
    share_max: f64,
    name: &str,
) -> Result<(), String> {
    if std::env::var_os("CAROM_REWRITE_PICTURES").is_some() {
        if name == "actual" {
            write(path, size, drawn);
        }
        return Ok(());
    }
    let known = read(path, size)?;
    let differs = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > STEP);
    let pairs = known.chunks(3).zip(drawn.chunks(3));
    let count = pairs.filter(|pair| differs(*pair)).count();
    let share = count as f64 * 3.0 / drawn.len() as f64;
    if share <= share_max {
        return Ok(());
    }
    let actual = path.with_extension(format!("{name}.png"));
    write(&actual, size, drawn);
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

const PASSES: u32 = 5;
const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
