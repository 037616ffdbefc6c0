//! Simulation on a GPU, where the particles stay between batches of substeps.

use glam::IVec3;

use crate::body::Bodies;
use crate::error::{Error, Result, check_range};
use crate::gpu::batch::Batch;
use crate::gpu::bodies::{Frame, move_balls};
use crate::gpu::buffers::{
    Buffers, GPU_BALLS_MAX, GPU_MATERIALS_MAX, GPU_OBSTACLES_MAX, Grid, READBACK_BYTES, blocks_max,
    check_limit, check_particles,
};
use crate::gpu::device::Gpu;
use crate::gpu::kernels::Kernels;
use crate::gpu::layout::{
    BallRow, Chunk, Control, Counters, DRIFTED, MaterialRow, NOT_FINITE, Params, TOO_HEAVY,
};
use crate::gpu::particle_copy::{ParticleCopy, fullest_cell_kg};
use crate::gpu::shader::{DRIFT_MAX, Features};
use crate::simulation::{Simulation, StepReport, TRAVEL_CELLS_MAX};
use crate::storage::{Particle, Storage};

/// Particles of a chunk and threads of its workgroup. With 128 an H100 takes 4 to 11 % longer for a
/// million particles, with 64 55 to 75 %.
const CHUNK: u32 = 256;

/// Largest number of substeps between two sortings.
const GROUP_MAX: u32 = 32;

/// Largest number of substeps of one submission: its read-back then takes a hundredth of its time.
const BATCH_SUBSTEPS_MAX: u32 = 256;

/// Margin of the grid's region around the particles' blocks, in blocks: the distance they may travel in a
/// batch.
const MARGIN_BLOCKS: i32 = 4;

/// Largest mass of a node over the nominal mass.
const HEADROOM: u32 = 8;

/// Simulation on a GPU with the model and constants of [`Simulation`]. Runs on one GPU give the same bits,
/// and up to 256 substeps run without the CPU. Particles never sleep.
pub struct GpuSimulation {
    gpu: Gpu,
    /// The initial simulation, for its settings and materials; its particles are those of the start.
    start: Simulation,
    features: Features,
    kernels: Kernels,
    buffers: Buffers,
    grid: Option<Grid>,
    /// Index of the particle buffer, 0 or 1, that holds the present state.
    turn: usize,
    /// Ids by the particles' GPU indices.
    ids: Vec<u32>,
    chunks: u32,
    control: Control,
    /// Least and greatest coordinates of blocks with particles at the last sorting.
    bounds: [IVec3; 2],
    /// Fixed-point quanta of mass in a kilogram.
    mass_scale: f32,
}

impl GpuSimulation {
    /// A simulation that continues from the state of another.
    ///
    /// # Errors
    ///
    /// If there are no particles, if there are more particles, materials or cells than the device takes, or
    /// if the device fails.
    pub fn new(gpu: &Gpu, start: Simulation) -> Result<Self> {
        let materials = start.materials();
        check_range("number of particles", start.len() as f64, 1.0, f64::MAX)?;
        check_particles(gpu, start.len())?;
        check_limit(gpu, "materials", materials.len(), GPU_MATERIALS_MAX)?;
        let features = Features::new(materials, CHUNK);
        let rows: Vec<_> = materials.iter().map(MaterialRow::new).collect();
        let copy = ParticleCopy::of_storage(start.storage(), start.len(), CHUNK as usize);
        let kernels = Kernels::compile(gpu, &features)?;
        let buffers = Buffers::new(gpu, &copy, &rows, &features)?;
        let (speed, sound) = start.speeds();
        // An i32 holds 16 times the nominal mass; half of it is the bound for faults, so that sums do not
        // wrap before they are checked.
        let scale = f64::from(1_u32 << 31) / (2.0 * f64::from(HEADROOM) * nominal_mass_kg(&start));
        let mut simulation = Self {
            gpu: gpu.clone(),
            features,
            kernels,
            buffers,
            grid: None,
            turn: 0,
            ids: copy.ids,
            chunks: copy.chunks.len() as u32,
            control: Control {
                speed,
                sound,
                ..Control::default()
            },
            bounds: bounds(&copy.chunks),
            // A power of two, so that scaling is exact.
            mass_scale: scale.log2().floor().exp2() as f32,
            start,
        };
        simulation.fit()?;
        Ok(simulation)
    }

    /// Advances particles and balls by a time in s.
    ///
    /// # Errors
    ///
    /// If the time or a body is out of range or not finite, or there are too many bodies; nothing has changed
    /// then. After any other error the simulation cannot be continued.
    pub fn step(&mut self, duration_secs: f64, bodies: &mut Bodies) -> Result<StepReport> {
        check_range("duration of a step in s", duration_secs, 0.0, 3600.0)?;
        bodies.validate()?;
        check_limit(&self.gpu, "balls", bodies.balls.len(), GPU_BALLS_MAX)?;
        check_limit(
            &self.gpu,
            "obstacles",
            bodies.obstacles.len(),
            GPU_OBSTACLES_MAX,
        )?;
        bodies.clear_impulses();
        let mut report = StepReport::default();
        let mut left_secs = duration_secs;
        // The device counts time in f32; a remainder that rounds to 0 there is dropped.
        while left_secs as f32 > 0.0 {
            let longest_secs = self.substep_secs_max(bodies);
            let count = (left_secs / longest_secs).ceil().max(1.0);
            let substeps = count + f64::from(report.substeps);
            self.start
                .check_substeps(duration_secs, longest_secs, substeps)?;
            let rows = self.run_batch(left_secs, count, bodies)?;
            // The device subtracted from the rounded time, so the difference is taken from that.
            let before = f64::from(left_secs as f32);
            let spent_secs = if self.control.left > 0.0 {
                before - f64::from(self.control.left)
            } else {
                left_secs
            };
            let cell_size_m = f64::from(self.start.settings().cell_size_m);
            move_balls(bodies, &rows, spent_secs, cell_size_m);
            report.substeps += self.control.substeps;
            report.orderings += self.control.orderings;
            left_secs -= spent_secs;
        }
        Ok(report)
    }

    /// Runs a batch of about `count` substeps, or as many as fit, and returns the balls after it.
    fn run_batch(&mut self, left_secs: f64, count: f64, bodies: &Bodies) -> Result<Vec<BallRow>> {
        let origin = self.fit()?;
        let batch = self.plan(left_secs, count, origin);
        let settings = *self.start.settings();
        let frame = Frame {
            origin: origin[0],
            cell_size_m: settings.cell_size_m.into(),
        };
        let params = Params {
            origin: origin[0].into(),
            particles: self.start.len() as u32,
            blocks: (origin[1] - origin[0] + 1).as_uvec3().into(),
            balls: bodies.balls.len() as u32,
            gravity: settings.gravity.into(),
            cell_size: settings.cell_size_m,
            courant: settings.courant,
            mass_scale: self.mass_scale,
            margin: (4 * MARGIN_BLOCKS) as f32,
            group: batch.group,
            obstacles: bodies.obstacles.len() as u32,
            padding: [0; 3],
        };
        let control = Control {
            left: left_secs as f32,
            speed: self.control.speed,
            sound: self.control.sound,
            ..Control::default()
        };
        let balls: Vec<_> = bodies.balls.iter().map(|ball| frame.ball(ball)).collect();
        let obstacles: Vec<_> = bodies.obstacles.iter().map(|o| frame.obstacle(o)).collect();
        let Some(grid) = &self.grid else {
            return Err(self.gpu.error("has no grid".to_owned()));
        };
        let (turn, commands) = self.gpu.guarded(|device| {
            let write = |buffer, bytes: &[u8]| self.gpu.queue.write_buffer(buffer, 0, bytes);
            write(&self.buffers.params, bytemuck::bytes_of(&params));
            write(&self.buffers.control, bytemuck::bytes_of(&control));
            write(&self.buffers.balls, bytemuck::cast_slice(&balls));
            write(&self.buffers.obstacles, bytemuck::cast_slice(&obstacles));
            let mut encoder =
                device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
            let turn = batch.encode(&mut pass, &self.kernels, &self.buffers, grid, self.turn);
            drop(pass);
            let mut offset = 0;
            for buffer in [
                &self.buffers.control,
                &self.buffers.counters,
                &self.buffers.balls,
            ] {
                let size = buffer.size();
                encoder.copy_buffer_to_buffer(buffer, 0, &self.buffers.readback, offset, size);
                offset += size;
            }
            (turn, encoder.finish())
        })?;
        let bytes = self.gpu.submit_and_read(commands, &self.buffers.readback)?;
        self.turn = turn;
        self.take_note(&bytes, bodies.balls.len())
    }

    /// Updates the state from the bytes that a batch read back, and returns its balls.
    fn take_note(&mut self, bytes: &[u8], balls: usize) -> Result<Vec<BallRow>> {
        debug_assert_eq!(bytes.len() as u64, READBACK_BYTES);
        let (control, rest) = bytes.split_at(size_of::<Control>());
        let (counters, rows) = rest.split_at(size_of::<Counters>());
        self.control = bytemuck::pod_read_unaligned(control);
        let counters: Counters = bytemuck::pod_read_unaligned(counters);
        let courant = self.start.settings().courant;
        if counters.faults & (NOT_FINITE | DRIFTED) != 0 || !self.control.speed.is_finite() {
            return Err(Error::Diverged { courant });
        }
        if counters.faults & TOO_HEAVY != 0 {
            let times = HEADROOM;
            return Err(Error::NodeTooHeavy { times, courant });
        }
        if counters.faults != 0 || self.control.substeps == 0 {
            return Err(self.gpu.error(format!("a batch went wrong: {counters:?}")));
        }
        self.chunks = counters.chunks;
        let block = |[x, y, z, _]: [i32; 4]| IVec3::new(x, y, z);
        self.bounds = [block(counters.low), block(counters.high)];
        let size = size_of::<BallRow>();
        let rows = rows.chunks_exact(size).take(balls);
        Ok(rows.map(bytemuck::pod_read_unaligned).collect())
    }

    /// The coordinates of the first and last block of the grid's region around all particles. Allocates
    /// larger grid buffers if necessary.
    fn fit(&mut self) -> Result<[IVec3; 2]> {
        // One block for the drift since the last sorting, the margin, and one for the nodes of kernels.
        let around = IVec3::splat(MARGIN_BLOCKS + 2);
        let region = [self.bounds[0] - around, self.bounds[1] + around];
        let size = (region[1] - region[0] + 1).as_dvec3();
        let wanted = size.element_product();
        let max = blocks_max(&self.gpu);
        check_limit(
            &self.gpu,
            "blocks of 4x4x4 cells around all particles",
            wanted as usize,
            max,
        )?;
        let blocks = wanted as usize;
        if self.grid.as_ref().is_none_or(|grid| grid.blocks() < blocks) {
            let roomy = (blocks + blocks / 2).min(max);
            // Frees the old buffers before the new ones are allocated.
            self.grid = None;
            let grid = Grid::new(
                &self.gpu,
                roomy,
                &self.buffers,
                &self.kernels,
                &self.features,
            )?;
            self.grid = Some(grid);
        }
        Ok(region)
    }

    /// Plans a batch with as many substeps between sortings as the particles' speed allows.
    fn plan(&self, left_secs: f64, count: f64, region: [IVec3; 2]) -> Batch {
        // One more, as substeps become shorter if the speed of sound rises.
        let count = (count + 1.0).min(BATCH_SUBSTEPS_MAX.into()) as u32;
        let cell_size_m = f64::from(self.start.settings().cell_size_m);
        let travel = f64::from(self.control.speed) * (left_secs / f64::from(count)) / cell_size_m;
        // A fifth of the drift is reserved for particles that accelerate before the next sorting.
        let group = (0.8 * f64::from(DRIFT_MAX) / travel.max(1e-9)).floor();
        let group = (group.min(GROUP_MAX.into()) as u32).clamp(1, count);
        Batch {
            group,
            groups: count.div_ceil(group),
            blocks: (region[1] - region[0] + 1).element_product() as u32,
        }
    }

    /// The longest stable substep, in s, by the same rule as `control.wgsl`.
    fn substep_secs_max(&self, bodies: &Bodies) -> f64 {
        let settings = self.start.settings();
        let cell_size_m = f64::from(settings.cell_size_m);
        let by_sound = f64::from(settings.courant) * cell_size_m / f64::from(self.control.sound);
        let balls = bodies.balls.iter().map(|ball| ball.velocity.length());
        let fastest = balls.fold(f64::from(self.control.speed), f64::max);
        by_sound.min(TRAVEL_CELLS_MAX * cell_size_m / fastest)
    }

    /// Number of particles.
    pub fn len(&self) -> usize {
        self.start.len()
    }

    /// Whether there are no particles: always false.
    pub fn is_empty(&self) -> bool {
        self.start.is_empty()
    }

    /// The present state of every particle, in the order of ids.
    ///
    /// # Errors
    ///
    /// If the device fails.
    pub fn particles(&self) -> Result<Vec<Particle>> {
        let mut particles: Vec<_> = self.read_storage()?.particles().collect();
        particles.sort_unstable_by_key(|particle| particle.id);
        Ok(particles)
    }

    /// A simulation on the CPU that continues from the present state.
    ///
    /// # Errors
    ///
    /// If the device fails.
    pub fn download(&self) -> Result<Simulation> {
        let speeds = (self.control.speed, self.control.sound);
        Ok(self.start.with_storage(self.read_storage()?, speeds))
    }

    fn read_storage(&self) -> Result<Storage> {
        let chunk_bytes = u64::from(self.chunks) * size_of::<Chunk>() as u64;
        let chunks = self.read(&self.buffers.chunks[self.turn], chunk_bytes)?;
        let particles = &self.buffers.particles[self.turn];
        let copy = ParticleCopy {
            ids: self.ids.clone(),
            chunks: bytemuck::pod_collect_to_vec(&chunks),
            parts: bytemuck::pod_collect_to_vec(&self.read(particles, particles.size())?),
        };
        let cell_size_m = self.start.settings().cell_size_m;
        Ok(copy.into_storage(cell_size_m, self.start.materials()))
    }

    /// Reads back the first `size` bytes of a buffer.
    fn read(&self, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>> {
        let (commands, readback) = self.gpu.guarded(|device| {
            let readback = device.create_buffer(&wgpu::BufferDescriptor {
                label: None,
                size,
                usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            });
            let mut encoder =
                device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
            encoder.copy_buffer_to_buffer(buffer, 0, &readback, 0, size);
            (encoder.finish(), readback)
        })?;
        self.gpu.submit_and_read(commands, &readback)
    }
}

/// Least and greatest coordinates of the chunks' blocks, along each axis.
fn bounds(chunks: &[Chunk]) -> [IVec3; 2] {
    let blocks = || chunks.iter().map(|chunk| IVec3::from(chunk.block));
    [
        blocks().fold(IVec3::MAX, IVec3::min),
        blocks().fold(IVec3::MIN, IVec3::max),
    ]
}

/// Nominal mass of a node in kg: the greater of that of a cell full of the densest material and that in the
/// fullest cell.
fn nominal_mass_kg(simulation: &Simulation) -> f64 {
    let cell_m3 = f64::from(simulation.settings().cell_size_m).powi(3);
    let densities = simulation
        .materials()
        .iter()
        .map(|m| f64::from(m.density_kg_m3()) * cell_m3);
    densities.fold(fullest_cell_kg(simulation.storage()), f64::max)
}
