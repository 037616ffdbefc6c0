//! The buffers and passes of one frame in flight.

use std::sync::{Mutex, PoisonError};

use bytemuck::{Pod, cast_slice, pod_read_unaligned};

use crate::Error;
use crate::gpu::denoise::FilterBuffers;
use crate::gpu::device::Device;
use crate::gpu::features::KernelOutput;
use crate::gpu::layout::{COUNTERS_BEFORE_TILES, DispatchData, SceneHeader, TileEntry};
use crate::gpu::mesh_buffer::{OptionalBuffers, SceneUpload};
use crate::gpu::pipeline::Kernel;
use crate::gpu::schedule::Chunk;

/// Maximum number of passes per submission: the samples, two sets of first hits, seven of the
/// filter, and two to spare for samples that are divided.
pub(crate) const PASSES_MAX: usize = 12;
/// Two 64-bit timestamps of each pass: before and after it.
const TIMESTAMPS_BYTES: u64 = 16 * PASSES_MAX as u64;
/// Bytes from the uniforms of one pass to those of the next: a multiple of the uniform-buffer
/// offset alignment of every device.
pub(crate) const SLOT_BYTES: u64 = 256;
/// Bytes per pixel of the film: red, green and blue.
pub(crate) const PIXEL_BYTES: u64 = KernelOutput::Radiance.pixel_bytes();
/// Bytes per pixel of the sum of its samples and the sum's rounding error (compensated summation).
/// The sums stay on the device, while the film may lie in host memory.
pub(crate) const SUM_BYTES: u64 = 2 * PIXEL_BYTES;
/// Largest number of workgroups along a dispatch's x axis; anything below Vulkan's guaranteed
/// 65,535.
const GROUPS_X_MAX: u32 = 32_768;

/// Buffers of one frame in flight, which grow as needed.
pub(crate) struct FrameBuffers {
    scene: wgpu::Buffer,
    /// Bytes of the current scene in `scene`.
    scene_bytes: u64,
    optional: OptionalBuffers,
    /// One slot of [`SLOT_BYTES`] for each pass of a submission.
    uniforms: wgpu::Buffer,
    pub(super) tiles: wgpu::Buffer,
    pub(super) film: wgpu::Buffer,
    /// A mappable copy of the film, where the film itself cannot be mapped.
    picture: Option<wgpu::Buffer>,
    film_sums: wgpu::Buffer,
    pub(super) counters: wgpu::Buffer,
    readback: wgpu::Buffer,
    timer: Option<Timer>,
    pub(super) filter: Option<FilterBuffers>,
}

/// One dispatch of a kernel over blocks of pixels.
pub(crate) struct Pass<'a> {
    pub(crate) pipeline: &'a wgpu::ComputePipeline,
    pub(crate) bindings: wgpu::BindGroup,
    /// Number of workgroups along x and y.
    pub(crate) groups: [u32; 2],
    /// Contents of the pass's [`FrameBuffers::slot`].
    pub(crate) uniforms: Vec<u8>,
}

/// Workgroups of a pass over `blocks` blocks of pixels, `workgroup_blocks` per workgroup.
pub(crate) fn groups(blocks: u32, workgroup_blocks: u32) -> [u32; 2] {
    let groups = blocks.div_ceil(workgroup_blocks);
    let columns = groups.min(GROUPS_X_MAX);
    // The last row may extend beyond the blocks: kernels skip blocks from `block_count` on.
    [columns, groups.div_ceil(columns.max(1))]
}

/// Timestamp queries, which measure passes by the device's clock.
struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
}

/// Sets of buffers that no frame is using.
#[derive(Default)]
pub(crate) struct BufferPool {
    idle: Mutex<Vec<FrameBuffers>>,
}

impl BufferPool {
    /// Number of sets kept for reuse: as many as there are frames in flight.
    const IDLE_MAX: usize = 4;

    /// A set of buffers for exclusive use.
    pub(crate) fn take(&self, device: &Device) -> Result<FrameBuffers, Error> {
        let idle = self
            .idle
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop();
        idle.map_or_else(|| device.guarded(|_| FrameBuffers::new(device)), Ok)
    }

    /// Returns a set whose work has ended without errors; after an error, the set is dropped
    /// instead.
    pub(crate) fn put(&self, buffers: FrameBuffers) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        if idle.len() < Self::IDLE_MAX {
            idle.push(buffers);
        }
    }
}

impl FrameBuffers {
    fn new(device: &Device) -> Self {
        use wgpu::BufferUsages as Usage;
        let wgpu = &device.device;
        let timer = device.tick_nanos.map(|_| Timer {
            queries: wgpu.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timer"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * PASSES_MAX as u32,
            }),
            resolved: buffer(
                wgpu,
                TIMESTAMPS_BYTES,
                Usage::QUERY_RESOLVE | Usage::COPY_SRC,
            ),
        });
        Self {
            scene: buffer(wgpu, size_of::<SceneHeader>() as u64, SCENE_USAGE),
            scene_bytes: 0,
            optional: OptionalBuffers::default(),
            uniforms: buffer(
                wgpu,
                SLOT_BYTES * PASSES_MAX as u64,
                Usage::UNIFORM | Usage::COPY_DST,
            ),
            tiles: buffer(wgpu, size_of::<TileEntry>() as u64, TILES_USAGE),
            film: buffer(wgpu, PIXEL_BYTES, film_usage(device)),
            picture: (!device.maps_storage).then(|| buffer(wgpu, PIXEL_BYTES, READBACK_USAGE)),
            film_sums: buffer(wgpu, SUM_BYTES, wgpu::BufferUsages::STORAGE),
            counters: buffer(wgpu, 4 * COUNTERS_BEFORE_TILES, COUNTERS_USAGE),
            readback: buffer(wgpu, TIMESTAMPS_BYTES, READBACK_USAGE),
            timer,
            filter: None,
        }
    }

    /// Uploads the scene and the chunk's tiles and makes the buffers large enough for the results.
    ///
    /// # Errors
    /// [`Error::Device`] if there is not enough memory.
    pub(crate) fn prepare(
        &mut self,
        device: &Device,
        scene: &SceneUpload,
        chunk: &Chunk,
        layout: &ReadbackLayout,
    ) -> Result<(), Error> {
        use wgpu::BufferUsages as Usage;
        let entries: &[u8] = cast_slice(&chunk.entries);
        let sums_bytes = SUM_BYTES * chunk.pixels;
        let SceneUpload {
            bytes: scene,
            optional,
        } = scene;
        self.optional.clone_from(optional);
        self.scene_bytes = scene.len() as u64;
        device.guarded(|wgpu| {
            reserve(wgpu, &mut self.scene, scene.len() as u64, SCENE_USAGE);
            reserve(wgpu, &mut self.tiles, entries.len() as u64, TILES_USAGE);
            let film_usage = film_usage(device);
            reserve(wgpu, &mut self.film, layout.film_bytes, film_usage);
            reserve(wgpu, &mut self.film_sums, sums_bytes, Usage::STORAGE);
            if let Some(picture) = &mut self.picture {
                reserve(wgpu, picture, layout.film_bytes, READBACK_USAGE);
            }
            let counters_bytes = layout.counters_bytes();
            reserve(wgpu, &mut self.counters, counters_bytes, COUNTERS_USAGE);
            let readback_bytes = layout.counters_end();
            reserve(wgpu, &mut self.readback, readback_bytes, READBACK_USAGE);
            device.queue.write_buffer(&self.scene, 0, scene);
            device.queue.write_buffer(&self.tiles, 0, entries);
        })
    }

    /// The bind group of a tracing kernel, with the uniforms of a slot, the tiles to trace, and
    /// `film` for its results.
    pub(crate) fn bind(
        &self,
        wgpu: &wgpu::Device,
        kernel: &Kernel,
        slot: usize,
        tiles: &wgpu::Buffer,
        film: &wgpu::Buffer,
    ) -> wgpu::BindGroup {
        let mut entries = vec![
            part(0, &self.scene, 0, self.scene_bytes),
            self.slot(1, slot, size_of::<DispatchData>()),
            whole(2, tiles),
            whole(3, film),
            whole(4, &self.counters),
            whole(5, &self.film_sums),
            // The same buffer again, always as storage: for reads whose address differs between
            // threads.
            part(6, &self.scene, 0, self.scene_bytes),
        ];
        let optional = self.optional.iter();
        let optional = optional.filter(|(binding, _)| kernel.optional_bindings.contains(binding));
        entries.extend(
            optional.filter_map(|(binding, buffer)| Some(whole(*binding, buffer.as_ref()?))),
        );
        wgpu.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("trace"),
            layout: &kernel.layout,
            entries: &entries,
        })
    }

    /// A binding of the `bytes` bytes of uniforms of a submission's pass.
    pub(crate) fn slot(&self, binding: u32, slot: usize, bytes: usize) -> wgpu::BindGroupEntry<'_> {
        part(
            binding,
            &self.uniforms,
            SLOT_BYTES * slot as u64,
            bytes as u64,
        )
    }

    /// Clears the buffers of `cleared`, runs `passes` one after the other and waits for them;
    /// results can be read after the last submission (`is_last`). Returns the device time of each
    /// pass in nanoseconds, 0 where there are no timestamps.
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails.
    pub(crate) fn run(
        &self,
        device: &Device,
        passes: &[Pass<'_>],
        layout: &ReadbackLayout,
        cleared: &[&wgpu::Buffer],
        is_last: bool,
    ) -> Result<Vec<f64>, Error> {
        let mut uniforms = Vec::with_capacity(passes.len() * SLOT_BYTES as usize);
        for (slot, pass) in (1..).zip(passes) {
            uniforms.extend(&pass.uniforms);
            uniforms.resize(slot * SLOT_BYTES as usize, 0);
        }
        let commands = device.guarded(|wgpu| {
            device.queue.write_buffer(&self.uniforms, 0, &uniforms);
            let mut encoder = wgpu.create_command_encoder(&Default::default());
            for buffer in cleared {
                encoder.clear_buffer(buffer, 0, None);
            }
            for (index, pass) in (0..).zip(passes) {
                self.encode_pass(&mut encoder, pass, index);
            }
            self.encode_readback(&mut encoder, passes.len(), layout, is_last);
            encoder.finish()
        })?;
        let timestamps = self.readback.slice(..TIMESTAMPS_BYTES);
        let results = [
            self.readback.slice(..layout.counters_end()),
            self.picture().slice(..layout.film_bytes),
        ];
        // Waiting works by mapping a buffer, so the timestamps are mapped even where no times are
        // measured. A submission must not use a mapped buffer: those before the last leave the film
        // alone, and the timestamps are unmapped below.
        let mapped = if is_last { &results[..] } else { &[timestamps] };
        device.submit_and_map(commands, mapped)?;
        let nanos = (0..passes.len()).map(|pass| self.nanos(device, pass));
        let nanos = nanos.collect::<Result<Vec<f64>, Error>>()?;
        if !is_last {
            self.readback.unmap();
        }
        Ok(nanos)
    }

    /// Device time of a pass in nanoseconds.
    fn nanos(&self, device: &Device, pass: usize) -> Result<f64, Error> {
        device.tick_nanos.map_or(Ok(0.0), |tick_nanos| {
            let [begin, end]: [u64; 2] = self.read(device, 16 * pass as u64)?;
            Ok(end.saturating_sub(begin) as f64 * tick_nanos)
        })
    }

    /// Calls `take` with the chunk's number of rays, the dropped samples of each tile and the film,
    /// once the last submission is done.
    ///
    /// # Errors
    /// [`Error::Device`] if the results are not mapped.
    pub(crate) fn results<T>(
        &self,
        device: &Device,
        layout: &ReadbackLayout,
        take: impl FnOnce(u64, &[u32], &[f32]) -> T,
    ) -> Result<T, Error> {
        let mapped = |slice: wgpu::BufferSlice<'_>| {
            slice
                .get_mapped_range()
                .map_err(|error| device.error(error.to_string()))
        };
        let counters = mapped(self.readback.slice(TIMESTAMPS_BYTES..layout.counters_end()))?;
        let film = mapped(self.picture().slice(..layout.film_bytes))?;
        let (before_tiles, dropped) = counters.split_at(4 * COUNTERS_BEFORE_TILES as usize);
        let [low, high]: [u32; 2] = pod_read_unaligned(&before_tiles[..8]);
        let rays = u64::from(high) << 32 | u64::from(low);
        let taken = take(rays, cast_slice(dropped), cast_slice(&film));
        drop((counters, film));
        self.readback.unmap();
        self.picture().unmap();
        Ok(taken)
    }

    /// The buffer that is mapped in order to read the film.
    fn picture(&self) -> &wgpu::Buffer {
        self.picture.as_ref().unwrap_or(&self.film)
    }

    fn encode_pass(&self, encoder: &mut wgpu::CommandEncoder, pass: &Pass<'_>, index: u32) {
        let timestamps = self
            .timer
            .as_ref()
            .map(|timer| wgpu::ComputePassTimestampWrites {
                query_set: &timer.queries,
                beginning_of_pass_write_index: Some(2 * index),
                end_of_pass_write_index: Some(2 * index + 1),
            });
        let mut compute = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("trace"),
            timestamp_writes: timestamps,
        });
        compute.set_pipeline(pass.pipeline);
        compute.set_bind_group(0, &pass.bindings, &[]);
        let [columns, rows] = pass.groups;
        compute.dispatch_workgroups(columns, rows, 1);
    }

    fn encode_readback(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        passes: usize,
        layout: &ReadbackLayout,
        is_last: bool,
    ) {
        if let Some(timer) = &self.timer {
            let queries = 0..2 * passes as u32;
            let bytes = 16 * passes as u64;
            encoder.resolve_query_set(&timer.queries, queries, &timer.resolved, 0);
            encoder.copy_buffer_to_buffer(&timer.resolved, 0, &self.readback, 0, bytes);
        }
        if is_last {
            encoder.copy_buffer_to_buffer(
                &self.counters,
                0,
                &self.readback,
                TIMESTAMPS_BYTES,
                layout.counters_bytes(),
            );
            if let Some(picture) = &self.picture {
                encoder.copy_buffer_to_buffer(&self.film, 0, picture, 0, layout.film_bytes);
            }
        }
    }

    fn read<T: Pod>(&self, device: &Device, place: u64) -> Result<T, Error> {
        let slice = self.readback.slice(place..place + size_of::<T>() as u64);
        let view = slice
            .get_mapped_range()
            .map_err(|error| device.error(error.to_string()))?;
        Ok(pod_read_unaligned(&view))
    }
}

/// What is read back for a chunk: timestamps and counters in one buffer, the film in another.
pub(crate) struct ReadbackLayout {
    pub(crate) tiles: u64,
    pub(crate) film_bytes: u64,
}

impl ReadbackLayout {
    pub(crate) fn new(chunk: &Chunk, output: KernelOutput) -> Self {
        Self {
            tiles: chunk.entries.len() as u64,
            film_bytes: output.pixel_bytes() * chunk.pixels,
        }
    }

    const fn counters_bytes(&self) -> u64 {
        4 * (COUNTERS_BEFORE_TILES + self.tiles)
    }

    const fn counters_end(&self) -> u64 {
        TIMESTAMPS_BYTES + self.counters_bytes()
    }
}

fn part(binding: u32, buffer: &wgpu::Buffer, offset: u64, bytes: u64) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer,
            offset,
            size: wgpu::BufferSize::new(bytes),
        }),
    }
}

/// A binding of a whole buffer.
pub(crate) fn whole(binding: u32, buffer: &wgpu::Buffer) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry {
        binding,
        resource: buffer.as_entire_binding(),
    }
}

const SCENE_USAGE: wgpu::BufferUsages = wgpu::BufferUsages::UNIFORM
    .union(wgpu::BufferUsages::STORAGE)
    .union(wgpu::BufferUsages::COPY_DST);
const TILES_USAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::STORAGE.union(wgpu::BufferUsages::COPY_DST);
const COUNTERS_USAGE: wgpu::BufferUsages = wgpu::BufferUsages::STORAGE
    .union(wgpu::BufferUsages::COPY_SRC)
    .union(wgpu::BufferUsages::COPY_DST);
const READBACK_USAGE: wgpu::BufferUsages =
    wgpu::BufferUsages::MAP_READ.union(wgpu::BufferUsages::COPY_DST);

/// A film in memory that the host can map needs no copy: the kernel's writes cross the bus while it
/// is still tracing.
fn film_usage(device: &Device) -> wgpu::BufferUsages {
    let read = match device.maps_storage {
        true => wgpu::BufferUsages::MAP_READ,
        false => wgpu::BufferUsages::COPY_SRC,
    };
    wgpu::BufferUsages::STORAGE | read
}

/// Replaces a buffer that is smaller than `bytes`, without keeping its contents.
pub(crate) fn reserve(
    device: &wgpu::Device,
    current: &mut wgpu::Buffer,
    bytes: u64,
    usage: wgpu::BufferUsages,
) {
    if current.size() < bytes {
        *current = buffer(device, bytes, usage);
    }
}

pub(crate) fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("trace"),
        size: size.next_multiple_of(16),
        usage,
        mapped_at_creation: false,
    })
}
