//! The denoiser on the device: the filter of [`crate::denoise`] as compute kernels.
//!
//! ```text
//! halves, first hits ─▶ take_in ─▶ list_edges ─▶ estimate_variance ─▶ smooth_light × 3 ─▶ resolve ─▶ film
//!                                       └─▶ first hits of more rays ────────────────────────┘
//! ```

use std::fmt::Write as _;

use bytemuck::{Pod, Zeroable, bytes_of, cast_slice};

use crate::aov::further_share;
use crate::denoise::weights::{
    ALBEDO_MIN, BRIGHTNESS_SHARE, EDGE_MIN, MIXED_MIN, NEIGHBOURS, PASSES, half_ratio, variances,
};
use crate::gpu::device::Device;
use crate::gpu::features::KernelOutput;
use crate::gpu::frame::{FrameBuffers, Pass, SLOT_BYTES, buffer, groups, reserve, whole};
use crate::gpu::layout::TileEntry;
use crate::gpu::schedule::Chunk;
use crate::gpu::shader::{BLOCK_EDGE, dispatch_constants};
use crate::tonemap::{self, DESATURATION, FIRST_BUCKET, SHOULDER, X_MAX, X_MIN};
use crate::{Error, Tile};

/// The kernels, which are the same for all scenes.
pub(crate) struct FilterKernels {
    take_in: wgpu::ComputePipeline,
    list_edges: wgpu::ComputePipeline,
    estimate_variance: wgpu::ComputePipeline,
    smooth_light: wgpu::ComputePipeline,
    resolve: wgpu::ComputePipeline,
    resolve_srgb8: wgpu::ComputePipeline,
    /// The table [`STEPS`](crate::tonemap::STEPS) of the sRGB transfer function.
    srgb_steps: wgpu::Buffer,
}

/// The filter's input, and the intermediate results of its passes. It never leaves the device.
pub(crate) struct FilterBuffers {
    /// Means of the second half of each pixel's samples, then of the first.
    pub(in crate::gpu) halves: wgpu::Buffer,
    /// First hits of the same samples, and of the further rays at edges.
    pub(in crate::gpu) hits: [wgpu::Buffer; 2],
    /// [`TileEntry`] of each pixel at an edge.
    pub(in crate::gpu) edges: wgpu::Buffer,
    /// Albedo, inverse depth, normal and emission of each pixel; cleared before each frame.
    pub(in crate::gpu) guides: wgpu::Buffer,
    light: [wgpu::Buffer; 2],
}

/// Uniform data of one filter pass.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
struct FilterData {
    x: u32,
    y: u32,
    width: u32,
    height: u32,
    tile_count: u32,
    block_count: u32,
    samples: u32,
    step: i32,
    variances: f32,
    normal_factor: f32,
    albedo_factor: f32,
    depth_factor: f32,
    side_weight: f32,
    corner_weight: f32,
    half_share: f32,
    half_ratio: f32,
    further_share: f32,
    pixels: u32,
    exposure: f32,
}

/// What is filtered: all tiles of `traced`, the first of which are those of `wanted`.
#[derive(Clone, Copy)]
pub(crate) struct FilterJob<'a> {
    pub(crate) bounds: Tile,
    pub(crate) samples: u32,
    /// Exposure of frames that are tone mapped on the device; `None` for linear radiance.
    pub(crate) exposure: Option<f32>,
    pub(crate) traced: &'a Chunk,
    pub(crate) wanted: &'a Chunk,
}

impl FilterKernels {
    /// # Errors
    /// [`Error::Device`] if the driver does not compile them.
    pub(crate) fn new(device: &Device) -> Result<Self, Error> {
        device.guarded(|wgpu| {
            let module = wgpu.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some("filter"),
                source: wgpu::ShaderSource::Wgsl(source().into()),
            });
            let pipeline = |entry_point| {
                wgpu.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry_point),
                    layout: None,
                    module: &module,
                    entry_point: Some(entry_point),
                    compilation_options: Default::default(),
                    cache: None,
                })
            };
            Self {
                take_in: pipeline("take_in"),
                list_edges: pipeline("list_edges"),
                estimate_variance: pipeline("estimate_variance"),
                smooth_light: pipeline("smooth_light"),
                resolve: pipeline("resolve"),
                resolve_srgb8: pipeline("resolve_srgb8"),
                srgb_steps: srgb_steps(device, wgpu),
            }
        })
    }

    /// The pass of a step in the submission's slot `slot`.
    pub(crate) fn pass<'a>(
        &self,
        wgpu: &wgpu::Device,
        buffers: &FrameBuffers,
        filter: &FilterBuffers,
        step: &Step<'a>,
        slot: usize,
    ) -> Pass<'a> {
        let entries = filter.bindings(buffers, &self.srgb_steps, slot, step);
        let bindings = wgpu.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("filter"),
            layout: &step.pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        Pass {
            pipeline: step.pipeline,
            bindings,
            groups: step.groups,
            uniforms: bytes_of(&step.data).to_vec(),
        }
    }
}

/// A filter pass without its bind group.
pub(crate) struct Step<'a> {
    pipeline: &'a wgpu::ComputePipeline,
    data: FilterData,
    groups: [u32; 2],
    uses: &'static [u32],
    /// Index in [`FilterBuffers::light`] of the buffer that it reads; it writes the other one.
    light_from: usize,
}

impl FilterJob<'_> {
    /// Passes before the further rays are traced: import of the samples, and the list of pixels
    /// that need further rays.
    pub(crate) fn input_steps<'a>(&self, kernels: &'a FilterKernels) -> Vec<Step<'a>> {
        let data = self.data();
        let take_in = Step {
            pipeline: &kernels.take_in,
            data,
            groups: groups(data.block_count, 1),
            uses: &[TILES, HALVES, HITS, GUIDES, LIGHT_TO],
            light_from: 1,
        };
        let data = self.wanted_data();
        let list_edges = Step {
            pipeline: &kernels.list_edges,
            data,
            groups: groups(data.block_count, 1),
            uses: &[TILES, COUNTERS, GUIDES, EDGES],
            light_from: 1,
        };
        let has_further = data.further_share > 0.0;
        let steps = [Some(take_in), has_further.then_some(list_edges)];
        steps.into_iter().flatten().collect()
    }

    /// The remaining passes, up to the tiles that are handed over.
    pub(crate) fn filter_steps<'a>(&self, kernels: &'a FilterKernels) -> Vec<Step<'a>> {
        let data = self.data();
        let by_pixel = [data.width, data.height].map(|edge| edge.div_ceil(BLOCK_EDGE));
        let mut steps = vec![Step {
            pipeline: &kernels.estimate_variance,
            data,
            groups: by_pixel,
            uses: &[GUIDES, LIGHT_FROM, LIGHT_TO],
            light_from: 0,
        }];
        for (pass, weights) in PASSES.into_iter().enumerate() {
            steps.push(Step {
                pipeline: &kernels.smooth_light,
                data: FilterData {
                    step: weights.step,
                    variances: variances(self.samples, pass),
                    normal_factor: weights.normal,
                    albedo_factor: weights.albedo,
                    depth_factor: weights.depth,
                    side_weight: weights.side,
                    corner_weight: weights.corner,
                    ..data
                },
                groups: by_pixel,
                uses: &[GUIDES, LIGHT_FROM, LIGHT_TO],
                // Ping-pong: `take_in` writes buffer 0 and `estimate_variance` buffer 1, which the
                // first pass reads.
                light_from: (pass + 1) % 2,
            });
        }
        let data = self.wanted_data();
        let (pipeline, uses): (_, &[u32]) = match self.exposure {
            None => (
                &kernels.resolve,
                &[TILES, HITS, FURTHER_HITS, GUIDES, LIGHT_FROM, FILM],
            ),
            Some(_) => (
                &kernels.resolve_srgb8,
                &[
                    TILES,
                    HITS,
                    FURTHER_HITS,
                    GUIDES,
                    LIGHT_FROM,
                    SHOWN,
                    SRGB_STEPS,
                ],
            ),
        };
        steps.push(Step {
            pipeline,
            data,
            groups: groups(data.block_count, 1),
            uses,
            light_from: (PASSES.len() + 1) % 2,
        });
        steps
    }

    /// Data of a pass over the tiles that are handed over only.
    fn wanted_data(&self) -> FilterData {
        FilterData {
            tile_count: self.wanted.entries.len() as u32,
            block_count: self.wanted.blocks,
            ..self.data()
        }
    }

    /// Data of a pass over all traced pixels.
    fn data(&self) -> FilterData {
        FilterData {
            x: self.bounds.x,
            y: self.bounds.y,
            width: self.bounds.width,
            height: self.bounds.height,
            tile_count: self.traced.entries.len() as u32,
            block_count: self.traced.blocks,
            samples: self.samples,
            half_share: (self.samples / 2) as f32 / self.samples as f32,
            half_ratio: half_ratio(self.samples),
            further_share: further_share(self.samples),
            pixels: self.traced.pixels as u32,
            exposure: self.exposure.unwrap_or(1.0),
            ..FilterData::zeroed()
        }
    }
}

impl FilterBuffers {
    /// Bytes per traced pixel of the largest of these buffers.
    pub(crate) const PIXEL_BYTES_MAX: u64 = KernelOutput::Aovs.pixel_bytes();

    pub(crate) fn new(device: &wgpu::Device) -> Self {
        let empty = || buffer(device, VECTOR_BYTES, USAGE);
        Self {
            halves: empty(),
            hits: [empty(), empty()],
            edges: empty(),
            guides: empty(),
            light: [empty(), empty()],
        }
    }

    /// Makes the buffers large enough for `filter_job`.
    pub(crate) fn reserve(&mut self, device: &wgpu::Device, filter_job: FilterJob<'_>) {
        let samples = filter_job.samples;
        let traced = |output: KernelOutput| output.pixel_bytes() * filter_job.traced.pixels;
        let dense = VECTOR_BYTES * filter_job.bounds.pixels() as u64;
        // A single sample has no first half, as that is rounded down.
        let halves = traced(KernelOutput::Reflected) * u64::from(samples.min(2));
        let [hits, further] = &mut self.hits;
        reserve(device, &mut self.halves, halves, USAGE);
        reserve(device, hits, traced(KernelOutput::Aovs), USAGE);
        if further_share(samples) > 0.0 {
            reserve(device, further, traced(KernelOutput::Aovs), USAGE);
            let list = size_of::<TileEntry>() as u64 * filter_job.wanted.pixels;
            reserve(device, &mut self.edges, list, USAGE);
        }
        reserve(device, &mut self.guides, 2 * dense, USAGE);
        for light in &mut self.light {
            reserve(device, light, dense, USAGE);
        }
    }

    fn bindings<'a>(
        &'a self,
        frame: &'a FrameBuffers,
        srgb_steps: &'a wgpu::Buffer,
        slot: usize,
        step: &Step<'_>,
    ) -> Vec<wgpu::BindGroupEntry<'a>> {
        let has_further = step.data.further_share > 0.0;
        let entry = |&binding: &u32| {
            let buffer = match binding {
                TILES => &frame.tiles,
                HALVES => &self.halves,
                HITS => &self.hits[0],
                // Without further rays this buffer is not read, but every binding of the layout
                // must be filled.
                FURTHER_HITS => &self.hits[usize::from(has_further)],
                COUNTERS => &frame.counters,
                EDGES => &self.edges,
                GUIDES => &self.guides,
                LIGHT_FROM => &self.light[step.light_from],
                LIGHT_TO => &self.light[1 - step.light_from],
                SRGB_STEPS => srgb_steps,
                _ => &frame.film,
            };
            whole(binding, buffer)
        };
        let data = frame.slot(DATA, slot, size_of::<FilterData>());
        let buffers = step.uses.iter().map(entry);
        std::iter::once(data).chain(buffers).collect()
    }
}

fn srgb_steps(device: &Device, wgpu: &wgpu::Device) -> wgpu::Buffer {
    let steps: &[u8] = cast_slice(&tonemap::STEPS);
    let steps_buffer = buffer(wgpu, steps.len() as u64, USAGE);
    device.queue.write_buffer(&steps_buffer, 0, steps);
    steps_buffer
}

/// WGSL source of all filter kernels.
fn source() -> String {
    let mut text = dispatch_constants(1);
    text += &format!(
        "const AOV_FLOATS: u32 = {}u;\n\
         const ALBEDO_MIN: f32 = {ALBEDO_MIN:?};\n\
         const FIRST_STEP: i32 = {};\n\
         const MIXED_MIN: f32 = {MIXED_MIN:?};\n\
         const EDGE_MIN: f32 = {EDGE_MIN:?};\n\
         const BRIGHTNESS_SHARE: f32 = {BRIGHTNESS_SHARE:?};\n\
         const SHOULDER: f32 = {SHOULDER:?};\n\
         const DESATURATION: f32 = {DESATURATION:?};\n\
         const STEP_MIN: f32 = {X_MIN:?};\n\
         const STEP_MAX: f32 = {X_MAX:?};\n\
         const FIRST_BUCKET: u32 = {FIRST_BUCKET}u;\n",
        KernelOutput::Aovs.floats(),
        PASSES[0].step
    );
    text += include_str!("../shaders/structs.wgsl");
    text += include_str!("../shaders/block.wgsl");
    text += include_str!("../shaders/tonemap.wgsl");
    text += include_str!("../shaders/denoise.wgsl");
    text += "fn add_taps(p: vec2i, here: ptr<function, Look>) {\n";
    for (dx, dy) in NEIGHBOURS {
        let weight = if dx * dy == 0 { "side" } else { "corner" };
        _ = writeln!(
            text,
            "    add_tap(p + job.step * vec2i({dx}, {dy}), job.{weight}_weight, here);"
        );
    }
    text + "}\n"
}

/// Binding numbers in `shaders/denoise.wgsl`.
const DATA: u32 = 0;
const TILES: u32 = 2;
const HALVES: u32 = 3;
const COUNTERS: u32 = 4;
const HITS: u32 = 5;
const FURTHER_HITS: u32 = 6;
const GUIDES: u32 = 7;
const LIGHT_FROM: u32 = 8;
const LIGHT_TO: u32 = 9;
const FILM: u32 = 10;
const SHOWN: u32 = 11;
const SRGB_STEPS: u32 = 12;
const EDGES: u32 = 13;

/// Bytes of a `vec4f`.
const VECTOR_BYTES: u64 = 16;
const USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);

const _: () = assert!(size_of::<FilterData>() as u64 <= SLOT_BYTES);

#[cfg(test)]
mod tests {
    use std::mem::offset_of;

    use naga::valid::{Capabilities, ValidationFlags, Validator};

    use super::*;

    #[test]
    fn the_kernels_are_valid_and_read_what_rust_writes() {
        let text = source();
        let module = naga::front::wgsl::parse_str(&text)
            .unwrap_or_else(|error| panic!("{}", error.emit_to_string(&text)));
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::empty());
        if let Err(error) = validator.validate(&module) {
            panic!("{}", error.emit_to_string(&text));
        }
        let mut types = module.types.iter().map(|(_, ty)| ty);
        let data = types.find(|ty| ty.name.as_deref() == Some("FilterData"));
        let Some(naga::TypeInner::Struct { members, span }) = data.map(|ty| &ty.inner) else {
            panic!("there is no struct FilterData");
        };
        let fields: Vec<_> = members
            .iter()
            .map(|member| (member.name.as_deref().unwrap(), member.offset as usize))
            .collect();
        macro_rules! offsets {
            ($($field:ident)*) => {
                vec![$((stringify!($field), offset_of!(FilterData, $field))),*]
            };
        }
        assert_eq!(*span as usize, size_of::<FilterData>());
        assert_eq!(
            fields,
            offsets!(x y width height tile_count block_count samples step variances normal_factor
                albedo_factor depth_factor side_weight corner_weight half_share half_ratio further_share
                pixels exposure)
        );
    }
}
