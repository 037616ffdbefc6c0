//! A wgpu device, all of whose failures are reported as [`Error::Device`].

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::Error;
use crate::gpu::adapter;
use crate::gpu::shader::BLOCK_EDGE;

/// Blocks of pixels per workgroup of the path tracer: 16 on NVIDIA GPUs, where it was measured to
/// pay (H100, a room at 1920x1080 with 16 samples per pixel: 23.1 ms instead of 34.4 ms; example
/// `gpu_speed`).
fn workgroup_blocks(info: &wgpu::AdapterInfo, limits: &wgpu::Limits) -> u32 {
    const NVIDIA: u32 = 0x10de;
    const BLOCKS: u32 = 16;
    let threads = BLOCKS * BLOCK_EDGE * BLOCK_EDGE;
    let fits = limits.max_compute_invocations_per_workgroup >= threads
        && limits.max_compute_workgroup_size_x >= threads
        && limits.max_compute_workgroup_storage_size >= 32 << 10;
    if info.vendor == NVIDIA && fits {
        BLOCKS
    } else {
        1
    }
}

/// Time after which a submission counts as hung. A dispatch takes less than 0.1 s on a GPU and up
/// to a few seconds on loaded software Vulkan.
const SUBMISSION_TIMEOUT: Duration = Duration::from_secs(120);

/// Shortest and longest pause between two polls for completion.
const PAUSE_MIN: Duration = Duration::from_micros(20);
const PAUSE_MAX: Duration = Duration::from_millis(2);

/// A device, its queue, and the first failure that it reported asynchronously.
pub(crate) struct Device {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    pub(crate) name: String,
    /// Nanoseconds per timestamp tick; `None` if timestamps are not supported.
    pub(crate) tick_nanos: Option<f64>,
    /// Whether buffers that kernels write can be mapped directly (`MAPPABLE_PRIMARY_BUFFERS`).
    pub(crate) maps_storage: bool,
    /// Whether it is a software implementation on the CPU.
    pub(crate) is_software: bool,
    /// Blocks of pixels per workgroup of the path tracer; see [`workgroup_blocks`].
    pub(crate) workgroup_blocks: u32,
    /// The first failure that was reported by a callback rather than by a call.
    failure: Arc<Mutex<Option<String>>>,
}

impl Device {
    /// Opens an adapter with all of its limits and the optional features used here.
    ///
    /// # Errors
    /// [`Error::Device`] if it refuses.
    pub(crate) fn open(adapter: &wgpu::Adapter) -> Result<Self, Error> {
        let info = adapter.get_info();
        let name = adapter::label(&info);
        let timestamps = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
        let mappable = adapter.features() & wgpu::Features::MAPPABLE_PRIMARY_BUFFERS;
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("carom"),
            required_features: timestamps | mappable,
            required_limits: adapter.limits(),
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|error| Error::Device {
            device: name.clone(),
            message: format!("the driver refuses a device: {error}"),
        })?;
        let failure = Arc::new(Mutex::new(None));
        watch(&device, &failure);
        let tick_nanos = f64::from(queue.get_timestamp_period());
        Ok(Self {
            tick_nanos: (!timestamps.is_empty() && tick_nanos > 0.0).then_some(tick_nanos),
            maps_storage: !mappable.is_empty(),
            is_software: adapter::is_software(&info),
            workgroup_blocks: workgroup_blocks(&info, &device.limits()),
            device,
            queue,
            name,
            failure,
        })
    }

    /// Runs `work` and returns every failure of its calls on this thread as an error.
    ///
    /// # Errors
    /// [`Error::Device`] if a call was invalid, the device is lost or out of memory.
    pub(crate) fn guarded<T>(&self, work: impl FnOnce(&wgpu::Device) -> T) -> Result<T, Error> {
        let scopes = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ]
        .map(|filter| self.device.push_error_scope(filter));
        let value = work(&self.device);
        let mut first = None;
        // Scopes are a stack: the one pushed last is popped first.
        for scope in scopes.into_iter().rev() {
            let error = pollster::block_on(scope.pop());
            first = first.or(error);
        }
        if let Some(error) = first {
            return Err(self.error(error.to_string()));
        }
        self.check()?;
        Ok(value)
    }

    /// Submits commands and waits until all buffer slices of `mapped` are mapped.
    ///
    /// # Errors
    /// [`Error::Device`] if the device is lost, hangs or refuses.
    pub(crate) fn submit_and_map(
        &self,
        commands: wgpu::CommandBuffer,
        mapped: &[wgpu::BufferSlice<'_>],
    ) -> Result<(), Error> {
        let (sender, receiver) = channel();
        self.guarded(|_| {
            self.queue.submit([commands]);
            for slice in mapped {
                let sender = sender.clone();
                slice.map_async(wgpu::MapMode::Read, move |result| {
                    // The receiver is gone only if this call has already failed.
                    _ = sender.send(result);
                });
            }
        })?;
        mapped.iter().try_for_each(|_| self.wait(&receiver))
    }

    /// Waits for a mapping by polling, with pauses of a sixteenth of the time waited so far. The
    /// driver's blocking wait wakes up late when several threads are in it: on an H200, two frames
    /// in flight took as long as one after the other.
    fn wait(&self, mapping: &Receiver<Result<(), wgpu::BufferAsyncError>>) -> Result<(), Error> {
        let mut waited = Duration::ZERO;
        while waited < SUBMISSION_TIMEOUT {
            // wgpu 30 panics in `poll` when the device is lost, which is not a bug of this process.
            let polled = catch_unwind(AssertUnwindSafe(|| self.device.poll(wgpu::PollType::Poll)));
            // Before `polled` is looked at: the device-lost callback, which knows the reason, has
            // run within that poll.
            self.check()?;
            match polled {
                Ok(Ok(_)) => {}
                Ok(Err(error)) => return Err(self.error(format!("work has failed: {error}"))),
                Err(_) => return Err(self.error("lost while work was under way".to_owned())),
            }
            let pause = (waited / 16).clamp(PAUSE_MIN, PAUSE_MAX);
            match mapping.recv_timeout(pause) {
                Ok(Ok(())) => return self.check(),
                Ok(Err(error)) => return Err(self.error(error.to_string())),
                Err(_) => waited += pause,
            }
        }
        Err(self.error(format!("work was not finished in {SUBMISSION_TIMEOUT:?}")))
    }

    /// An error of this device.
    pub(crate) fn error(&self, message: String) -> Error {
        let device = self.name.clone();
        Error::Device { device, message }
    }

    /// # Errors
    /// [`Error::Device`] if the device has reported a failure asynchronously.
    fn check(&self) -> Result<(), Error> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure
            .as_ref()
            .map_or(Ok(()), |message| Err(self.error(message.clone())))
    }
}

/// Installs callbacks that keep the first failure that the device reports asynchronously.
fn watch(device: &wgpu::Device, failure: &Arc<Mutex<Option<String>>>) {
    let keep = |failure: &Mutex<Option<String>>, message: String| {
        let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
        // Later failures are mostly consequences of the first.
        failure.get_or_insert(message);
    };
    let uncaptured = Arc::clone(failure);
    device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
        keep(&uncaptured, error.to_string());
    }));
    let lost = Arc::clone(failure);
    device.set_device_lost_callback(move |reason, message| {
        keep(&lost, format!("the device is lost ({reason:?}): {message}"));
    });
}
