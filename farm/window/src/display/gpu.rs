//! Presentation through wgpu: one pass with the picture as a texture and egui's triangles over it.

use std::sync::Arc;

use carom_text::text;
use carom_tracer::ImageSize;
use egui_wgpu::{Renderer, RendererOptions, ScreenDescriptor};
use wgpu::CurrentSurfaceTexture as Current;
use winit::event_loop::OwnedDisplayHandle;
use winit::window::Window;

use super::{DisplayFault, DisplayFrame, UiFrame};

/// Display of a window through a GPU.
pub struct GpuDisplay {
    window: Arc<Window>,
    instance: wgpu::Instance,
    surface: wgpu::Surface<'static>,
    device: wgpu::Device,
    queue: wgpu::Queue,
    config: wgpu::SurfaceConfiguration,
    egui: Renderer,
    picture: PicturePass,
    name: String,
    failures: u32,
}

impl GpuDisplay {
    /// Opens the window's surface on the first adapter of `backends` that can show it.
    ///
    /// # Errors
    /// The first step that failed.
    pub fn open(
        window: Arc<Window>,
        display: &OwnedDisplayHandle,
        backends: wgpu::Backends,
    ) -> Result<Self, DisplayFault> {
        let mut descriptor =
            wgpu::InstanceDescriptor::new_with_display_handle(Box::new(display.clone()));
        descriptor.backends = backends;
        let instance = wgpu::Instance::new(descriptor);
        let surface = instance
            .create_surface(window.clone())
            .map_err(DisplayFault::NoSurface)?;
        let (adapter, device, queue) = pollster::block_on(request_device(&instance, &surface))?;
        let config = configuration(&surface, &adapter)?;
        let info = adapter.get_info();
        Ok(Self {
            egui: Renderer::new(&device, config.format, RendererOptions::default()),
            picture: PicturePass::new(&device, config.format),
            name: format!("{} ({})", info.name, info.backend),
            window,
            instance,
            surface,
            device,
            queue,
            config,
            failures: 0,
        })
    }

    /// Reconfigures the surface for the window's new size.
    pub fn resize(&mut self, size: ImageSize) {
        let edge_max = self.device.limits().max_texture_dimension_2d;
        self.config.width = size.width.min(edge_max);
        self.config.height = size.height.min(edge_max);
        self.configure();
    }

    /// Draws and presents a frame.
    ///
    /// # Errors
    /// If the surface has refused more than `FAILURES_MAX` frames in a row.
    pub fn show(
        &mut self,
        picture: Option<&DisplayFrame>,
        ui: &UiFrame,
    ) -> Result<(), DisplayFault> {
        // Applied even if the frame is skipped: egui sends each change of a texture once.
        for (id, images) in &ui.textures.set {
            for image in images {
                self.egui
                    .update_texture(&self.device, &self.queue, *id, image);
            }
        }
        let shown = self.draw(picture, ui);
        for id in &ui.textures.free {
            self.egui.free_texture(id);
        }
        shown
    }

    /// Name of the adapter and graphics interface.
    pub fn name(&self) -> &str {
        &self.name
    }

    fn draw(&mut self, picture: Option<&DisplayFrame>, ui: &UiFrame) -> Result<(), DisplayFault> {
        if self.config.width == 0 || self.config.height == 0 {
            return Ok(());
        }
        let Some(frame) = self.acquire()? else {
            return Ok(());
        };
        if let Some(picture) = picture {
            self.picture.upload(&self.device, &self.queue, picture);
        }
        let screen = ScreenDescriptor {
            size_in_pixels: [self.config.width, self.config.height],
            pixels_per_point: ui.pixels_per_point,
        };
        let mut encoder = self
            .device
            .create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut commands = self.egui.update_buffers(
            &self.device,
            &self.queue,
            &mut encoder,
            &ui.primitives,
            &screen,
        );
        let view = frame
            .texture
            .create_view(&wgpu::TextureViewDescriptor::default());
        self.encode(&mut encoder, &view, ui, &screen);
        commands.push(encoder.finish());
        self.queue.submit(commands);
        self.window.pre_present_notify();
        self.queue.present(frame);
        Ok(())
    }

    fn encode(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        view: &wgpu::TextureView,
        ui: &UiFrame,
        screen: &ScreenDescriptor,
    ) {
        let attachment = wgpu::RenderPassColorAttachment {
            view,
            depth_slice: None,
            resolve_target: None,
            ops: wgpu::Operations {
                load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                store: wgpu::StoreOp::Store,
            },
        };
        let mut pass = encoder
            .begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("window"),
                color_attachments: &[Some(attachment)],
                ..Default::default()
            })
            .forget_lifetime();
        self.picture.draw(&mut pass);
        self.egui.render(&mut pass, &ui.primitives, screen);
    }

    /// The surface's next texture; `None` if it has none at the moment.
    fn acquire(&mut self) -> Result<Option<wgpu::SurfaceTexture>, DisplayFault> {
        let reason = match self.surface.get_current_texture() {
            Current::Success(frame) | Current::Suboptimal(frame) => {
                self.failures = 0;
                return Ok(Some(frame));
            }
            // The window is hidden or busy, which is no failure however long it lasts.
            Current::Timeout | Current::Occluded => return Ok(None),
            Current::Outdated => text!("surface-outdated"),
            Current::Lost => {
                self.surface = self
                    .instance
                    .create_surface(self.window.clone())
                    .map_err(DisplayFault::SurfaceLost)?;
                text!("surface-lost")
            }
            Current::Validation => text!("surface-invalid"),
        };
        self.failures += 1;
        if self.failures > FAILURES_MAX {
            return Err(DisplayFault::Refused(reason));
        }
        self.configure();
        Ok(None)
    }

    fn configure(&self) {
        if self.config.width > 0 && self.config.height > 0 {
            self.surface.configure(&self.device, &self.config);
        }
    }
}

/// Render pass that stretches the picture, a texture, over the window.
struct PicturePass {
    pipeline: wgpu::RenderPipeline,
    sampler: wgpu::Sampler,
    texture: Option<Uploaded>,
}

struct Uploaded {
    texture: wgpu::Texture,
    bind_group: wgpu::BindGroup,
    serial: u64,
}

impl PicturePass {
    fn new(device: &wgpu::Device, format: wgpu::TextureFormat) -> Self {
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("picture"),
            source: wgpu::ShaderSource::Wgsl(include_str!("picture.wgsl").into()),
        });
        // An sRGB format encodes on writing, so the shader has to decode the picture's bytes.
        let entry = if format.is_srgb() {
            "show_decoded"
        } else {
            "show"
        };
        let pipeline = device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some("picture"),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("cover"),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState::default(),
            depth_stencil: None,
            multisample: wgpu::MultisampleState::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        });
        let sampler = device.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: wgpu::FilterMode::Linear,
            min_filter: wgpu::FilterMode::Linear,
            ..Default::default()
        });
        Self {
            pipeline,
            sampler,
            texture: None,
        }
    }

    fn upload(&mut self, device: &wgpu::Device, queue: &wgpu::Queue, picture: &DisplayFrame) {
        let extent = wgpu::Extent3d {
            width: picture.size.width,
            height: picture.size.height,
            depth_or_array_layers: 1,
        };
        if self
            .texture
            .as_ref()
            .is_none_or(|uploaded| uploaded.texture.size() != extent)
        {
            self.texture = Some(self.allocate(device, extent));
        }
        let Some(uploaded) = &mut self.texture else {
            return;
        };
        if uploaded.serial == picture.serial {
            return;
        }
        uploaded.serial = picture.serial;
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(4 * extent.width),
            rows_per_image: None,
        };
        let bytes = bytemuck::cast_slice(&picture.rgba);
        queue.write_texture(uploaded.texture.as_image_copy(), bytes, layout, extent);
    }

    fn allocate(&self, device: &wgpu::Device, size: wgpu::Extent3d) -> Uploaded {
        let texture = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("picture"),
            size,
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
            view_formats: &[],
        });
        let view = texture.create_view(&wgpu::TextureViewDescriptor::default());
        let entry = |binding, resource| wgpu::BindGroupEntry { binding, resource };
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("picture"),
            layout: &self.pipeline.get_bind_group_layout(0),
            entries: &[
                entry(0, wgpu::BindingResource::TextureView(&view)),
                entry(1, wgpu::BindingResource::Sampler(&self.sampler)),
            ],
        });
        Uploaded {
            texture,
            bind_group,
            serial: 0,
        }
    }

    fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        let Some(uploaded) = &self.texture else {
            return;
        };
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, &uploaded.bind_group, &[]);
        pass.draw(0..3, 0..1);
    }
}

async fn request_device(
    instance: &wgpu::Instance,
    surface: &wgpu::Surface<'_>,
) -> Result<(wgpu::Adapter, wgpu::Device, wgpu::Queue), DisplayFault> {
    let options = wgpu::RequestAdapterOptions {
        power_preference: wgpu::PowerPreference::LowPower,
        compatible_surface: Some(surface),
        ..Default::default()
    };
    let adapter = instance
        .request_adapter(&options)
        .await
        .map_err(DisplayFault::NoAdapter)?;
    let (device, queue) = adapter
        .request_device(&wgpu::DeviceDescriptor {
            label: Some("window"),
            // The limits of WebGL 2 suffice, so that old GPUs work; only the texture size is the adapter's.
            required_limits: wgpu::Limits::downlevel_webgl2_defaults()
                .using_resolution(adapter.limits()),
            memory_hints: wgpu::MemoryHints::MemoryUsage,
            ..Default::default()
        })
        .await
        .map_err(DisplayFault::NoDevice)?;
    device.on_uncaptured_error(Arc::new(|error| {
        tracing::error!("the window's GPU: {error}")
    }));
    Ok((adapter, device, queue))
}

fn configuration(
    surface: &wgpu::Surface<'_>,
    adapter: &wgpu::Adapter,
) -> Result<wgpu::SurfaceConfiguration, DisplayFault> {
    let mut config = surface
        .get_default_config(adapter, 1, 1)
        .ok_or(DisplayFault::NoFormat)?;
    // egui blends sRGB-encoded values, for which a format that does not encode on writing suits best.
    let formats = surface.get_capabilities(adapter).formats;
    if let Some(format) = formats.into_iter().find(|format| {
        matches!(
            format,
            wgpu::TextureFormat::Bgra8Unorm | wgpu::TextureFormat::Rgba8Unorm
        )
    }) {
        config.format = format;
    }
    config.present_mode = wgpu::PresentMode::AutoVsync;
    Ok(config)
}

/// Frames in a row that a surface may refuse before another presentation is tried.
const FAILURES_MAX: u32 = 30;

#[cfg(test)]
mod tests {
    #[test]
    fn the_shader_is_valid() {
        let module = wgpu::naga::front::wgsl::parse_str(include_str!("picture.wgsl")).unwrap();
        let mut validator = wgpu::naga::valid::Validator::new(
            wgpu::naga::valid::ValidationFlags::all(),
            wgpu::naga::valid::Capabilities::empty(),
        );
        validator.validate(&module).unwrap();
    }
}
