//! The buffers of one frame in flight.

use std::sync::{Mutex, PoisonError};

use bytemuck::{Pod, bytes_of, cast_slice, pod_read_unaligned};

use crate::Error;
use crate::gpu::device::Device;
use crate::gpu::layout::{DispatchData, SceneHeader, TileEntry};
use crate::gpu::pipeline::Kernel;
use crate::gpu::schedule::Chunk;

/// Two 64-bit timestamps: before and after the dispatch.
const TIMESTAMPS_BYTES: u64 = 16;
/// Words of the counters before those of the tiles: rays, low and high.
const RAY_WORDS: u64 = 2;
/// Bytes of a pixel: red, green and blue.
pub(crate) const PIXEL_BYTES: u64 = 12;
/// Workgroups along the x axis of a dispatch; any number below Vulkan's 65,535.
const GROUPS_X_MAX: u32 = 32_768;

/// Buffers that grow to what has been asked of them.
pub(crate) struct FrameBuffers {
    scene: wgpu::Buffer,
    dispatch: wgpu::Buffer,
    tiles: wgpu::Buffer,
    film: wgpu::Buffer,
    /// A copy of the film that can be mapped, where the film itself cannot.
    picture: Option<wgpu::Buffer>,
    film_lost: wgpu::Buffer,
    counters: wgpu::Buffer,
    readback: wgpu::Buffer,
    timer: Option<Timer>,
}

/// Measures a dispatch by the device's own clock.
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
    /// Sets kept for later: as many as frames are in flight at once.
    const IDLE_MAX: usize = 4;

    /// A set that nobody else uses.
    pub(crate) fn take(&self, device: &Device) -> Result<FrameBuffers, Error> {
        let idle = self
            .idle
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .pop();
        idle.map_or_else(|| device.guarded(|_| FrameBuffers::new(device)), Ok)
    }

    /// Gives a set back whose work has ended well; others are better dropped.
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
                count: 2,
            }),
            resolved: buffer(
                wgpu,
                TIMESTAMPS_BYTES,
                Usage::QUERY_RESOLVE | Usage::COPY_SRC,
            ),
        });
        Self {
            scene: buffer(wgpu, size_of::<SceneHeader>() as u64, SCENE_USAGE),
            dispatch: buffer(
                wgpu,
                size_of::<DispatchData>() as u64,
                Usage::UNIFORM | Usage::COPY_DST,
            ),
            tiles: buffer(wgpu, size_of::<TileEntry>() as u64, TILES_USAGE),
            film: buffer(wgpu, PIXEL_BYTES, film_usage(device)),
            picture: (!device.maps_storage).then(|| buffer(wgpu, PIXEL_BYTES, READBACK_USAGE)),
            film_lost: buffer(wgpu, PIXEL_BYTES, wgpu::BufferUsages::STORAGE),
            counters: buffer(wgpu, 4 * RAY_WORDS, COUNTERS_USAGE),
            readback: buffer(wgpu, TIMESTAMPS_BYTES, READBACK_USAGE),
            timer,
        }
    }

    /// Uploads the scene and the chunk's tiles and binds all buffers.
    ///
    /// # Errors
    /// [`Error::Device`] if there is not enough memory.
    pub(crate) fn prepare(
        &mut self,
        device: &Device,
        kernel: &Kernel,
        scene: &[u8],
        chunk: &Chunk,
    ) -> Result<wgpu::BindGroup, Error> {
        let layout = ReadbackLayout::of(chunk);
        let entries: &[u8] = cast_slice(&chunk.entries);
        device.guarded(|wgpu| {
            reserve(wgpu, &mut self.scene, scene.len() as u64, SCENE_USAGE);
            reserve(wgpu, &mut self.tiles, entries.len() as u64, TILES_USAGE);
            let film_usage = film_usage(device);
            reserve(wgpu, &mut self.film, layout.film_bytes, film_usage);
            reserve(
                wgpu,
                &mut self.film_lost,
                layout.film_bytes,
                wgpu::BufferUsages::STORAGE,
            );
            if let Some(picture) = &mut self.picture {
                reserve(wgpu, picture, layout.film_bytes, READBACK_USAGE);
            }
            reserve(
                wgpu,
                &mut self.counters,
                layout.counters_bytes,
                COUNTERS_USAGE,
            );
            reserve(
                wgpu,
                &mut self.readback,
                layout.counters_end(),
                READBACK_USAGE,
            );
            device.queue.write_buffer(&self.scene, 0, scene);
            device.queue.write_buffer(&self.tiles, 0, entries);
            self.bind(wgpu, kernel, scene.len() as u64, &layout)
        })
    }

    fn bind(
        &self,
        wgpu: &wgpu::Device,
        kernel: &Kernel,
        scene_bytes: u64,
        layout: &ReadbackLayout,
    ) -> wgpu::BindGroup {
        let entry = |binding, buffer, bytes| wgpu::BindGroupEntry {
            binding,
            resource: wgpu::BindingResource::Buffer(wgpu::BufferBinding {
                buffer,
                offset: 0,
                size: wgpu::BufferSize::new(bytes),
            }),
        };
        wgpu.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("trace"),
            layout: &kernel.layout,
            entries: &[
                entry(0, &self.scene, scene_bytes),
                entry(1, &self.dispatch, size_of::<DispatchData>() as u64),
                entry(2, &self.tiles, layout.tiles * size_of::<TileEntry>() as u64),
                entry(3, &self.film, layout.film_bytes),
                entry(4, &self.counters, layout.counters_bytes),
                entry(5, &self.film_lost, layout.film_bytes),
            ],
        })
    }

    /// Traces some samples of every pixel of the chunk and waits for them. Returns the device's
    /// time in nanoseconds, 0 where it has no clock.
    ///
    /// # Errors
    /// [`Error::Device`] if the device fails.
    pub(crate) fn dispatch(
        &self,
        device: &Device,
        kernel: &Kernel,
        bindings: &wgpu::BindGroup,
        chunk: &Chunk,
        data: &DispatchData,
    ) -> Result<f64, Error> {
        let layout = ReadbackLayout::of(chunk);
        let is_last = data.sample_end == data.samples;
        let commands = device.guarded(|wgpu| {
            device.queue.write_buffer(&self.dispatch, 0, bytes_of(data));
            let mut encoder = wgpu.create_command_encoder(&Default::default());
            if data.sample_begin == 0 {
                encoder.clear_buffer(&self.counters, 0, Some(layout.counters_bytes));
            }
            self.encode_pass(&mut encoder, kernel, bindings, chunk.blocks);
            self.encode_readback(&mut encoder, &layout, is_last);
            encoder.finish()
        })?;
        let timestamps = self.readback.slice(..TIMESTAMPS_BYTES);
        let results = [
            self.readback.slice(..layout.counters_end()),
            self.picture().slice(..layout.film_bytes),
        ];
        let mapped = if is_last { &results[..] } else { &[timestamps] };
        device.submit_and_map(commands, mapped)?;
        let nanos = device.tick_nanos.map_or(Ok(0.0), |tick_nanos| {
            let [begin, end]: [u64; 2] = self.read(device, 0)?;
            Ok(end.saturating_sub(begin) as f64 * tick_nanos)
        });
        if !is_last {
            self.readback.unmap();
        }
        nanos
    }

    /// Hands the chunk's rays, its tiles' dropped samples and its pixels to `take` once the last
    /// dispatch is done.
    ///
    /// # Errors
    /// [`Error::Device`] if the results are not there.
    pub(crate) fn results<T>(
        &self,
        device: &Device,
        chunk: &Chunk,
        take: impl FnOnce(u64, &[u32], &[[f32; 3]]) -> T,
    ) -> Result<T, Error> {
        let layout = ReadbackLayout::of(chunk);
        let mapped = |slice: wgpu::BufferSlice<'_>| {
            slice
                .get_mapped_range()
                .map_err(|error| device.error(error.to_string()))
        };
        let counters = mapped(self.readback.slice(TIMESTAMPS_BYTES..layout.counters_end()))?;
        let film = mapped(self.picture().slice(..layout.film_bytes))?;
        let (rays, dropped) = counters.split_at(4 * RAY_WORDS as usize);
        let [low, high]: [u32; 2] = pod_read_unaligned(rays);
        let rays = u64::from(high) << 32 | u64::from(low);
        let taken = take(rays, cast_slice(dropped), cast_slice(&film));
        drop((counters, film));
        self.readback.unmap();
        self.picture().unmap();
        Ok(taken)
    }

    /// What is mapped to read the film.
    fn picture(&self) -> &wgpu::Buffer {
        self.picture.as_ref().unwrap_or(&self.film)
    }

    fn encode_pass(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        kernel: &Kernel,
        bindings: &wgpu::BindGroup,
        blocks: u32,
    ) {
        let timestamps = self
            .timer
            .as_ref()
            .map(|timer| wgpu::ComputePassTimestampWrites {
                query_set: &timer.queries,
                beginning_of_pass_write_index: Some(0),
                end_of_pass_write_index: Some(1),
            });
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("trace"),
            timestamp_writes: timestamps,
        });
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, bindings, &[]);
        let columns = blocks.min(GROUPS_X_MAX);
        pass.dispatch_workgroups(columns, blocks.div_ceil(columns), 1);
    }

    fn encode_readback(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        layout: &ReadbackLayout,
        is_last: bool,
    ) {
        if let Some(timer) = &self.timer {
            encoder.resolve_query_set(&timer.queries, 0..2, &timer.resolved, 0);
            encoder.copy_buffer_to_buffer(&timer.resolved, 0, &self.readback, 0, TIMESTAMPS_BYTES);
        }
        if is_last {
            encoder.copy_buffer_to_buffer(
                &self.counters,
                0,
                &self.readback,
                TIMESTAMPS_BYTES,
                layout.counters_bytes,
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

/// How much of a chunk's results is read back: timestamps and counters, then the film.
struct ReadbackLayout {
    tiles: u64,
    counters_bytes: u64,
    film_bytes: u64,
}

impl ReadbackLayout {
    fn of(chunk: &Chunk) -> Self {
        let tiles = chunk.entries.len() as u64;
        Self {
            tiles,
            counters_bytes: 4 * (RAY_WORDS + tiles),
            film_bytes: PIXEL_BYTES * chunk.pixels,
        }
    }

    const fn counters_end(&self) -> u64 {
        TIMESTAMPS_BYTES + self.counters_bytes
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

/// A film in memory that this process can map needs no copy: the kernel's writes cross the bus
/// while it still traces.
fn film_usage(device: &Device) -> wgpu::BufferUsages {
    let read = match device.maps_storage {
        true => wgpu::BufferUsages::MAP_READ,
        false => wgpu::BufferUsages::COPY_SRC,
    };
    wgpu::BufferUsages::STORAGE | read
}

/// Replaces a buffer that is too small.
fn reserve(
    device: &wgpu::Device,
    current: &mut wgpu::Buffer,
    bytes: u64,
    usage: wgpu::BufferUsages,
) {
    if current.size() < bytes {
        *current = buffer(device, bytes, usage);
    }
}

fn buffer(device: &wgpu::Device, size: u64, usage: wgpu::BufferUsages) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("trace"),
        size: size.next_multiple_of(16),
        usage,
        mapped_at_creation: false,
    })
}
