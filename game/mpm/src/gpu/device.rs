//! Opening of GPUs, and calls that return the device's failures as errors.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use crate::error::{Error, Result};

/// Handle to a compute device of Vulkan, Metal or Direct3D 12. Clones share the device.
#[derive(Clone)]
pub struct Gpu {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    name: String,
    /// The first failure reported outside of error scopes.
    failure: Arc<Mutex<Option<String>>>,
    pipelines: Arc<Mutex<Pipelines>>,
}

/// Compiled pipelines by entry point and shader source.
type Pipelines = HashMap<(&'static str, String), wgpu::ComputePipeline>;

/// Capacity of the pipeline cache, which simulations on one device share.
const PIPELINES_MAX: usize = 64;

/// Time after which a submission counts as hung: a batch takes a few seconds on loaded software Vulkan.
const SUBMISSION_TIMEOUT: Duration = Duration::from_secs(120);

/// Range of pauses between two polls of the device.
const PAUSE_MIN: Duration = Duration::from_micros(20);
const PAUSE_MAX: Duration = Duration::from_millis(2);

impl Gpu {
    /// Opens a GPU: discrete ones are preferred to integrated and virtual ones.
    ///
    /// # Errors
    ///
    /// If there is none, or its driver refuses a device.
    pub fn open() -> Result<Self> {
        Self::open_first(|info| info.device_type != wgpu::DeviceType::Cpu)
    }

    /// Opens a GPU as [`Self::open`], or a software implementation where there is none, which is correct
    /// but slower than [`crate::Simulation`].
    ///
    /// # Errors
    ///
    /// If there is none, or its driver refuses a device.
    pub fn open_any() -> Result<Self> {
        Self::open_first(|_| true)
    }

    fn open_first(is_wanted: impl Fn(&wgpu::AdapterInfo) -> bool) -> Result<Self> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        // Validation of indirect dispatches would add a dispatch to each; these sizes are right by
        // construction.
        descriptor.flags = wgpu::InstanceFlags::empty();
        descriptor.backends = wgpu::Backends::PRIMARY;
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        let rank = |adapter: &wgpu::Adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        };
        let has_compute = |adapter: &wgpu::Adapter| {
            let flags = adapter.get_downlevel_capabilities().flags;
            flags.contains(
                wgpu::DownlevelFlags::COMPUTE_SHADERS | wgpu::DownlevelFlags::INDIRECT_EXECUTION,
            )
        };
        let adapter = adapters
            .into_iter()
            .filter(|adapter| has_compute(adapter) && is_wanted(&adapter.get_info()))
            .min_by_key(rank)
            .ok_or(Error::NoGpu)?;
        Self::open_adapter(&adapter)
    }

    fn open_adapter(adapter: &wgpu::Adapter) -> Result<Self> {
        let info = adapter.get_info();
        let name = format!("{} ({} {})", info.name, info.driver, info.driver_info);
        let request = adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("carom-mpm"),
            required_limits: adapter.limits(),
            ..Default::default()
        });
        let (device, queue) = pollster::block_on(request).map_err(|error| Error::Gpu {
            device: name.clone(),
            message: format!("the driver refuses a device: {error}"),
        })?;
        let failure = Arc::new(Mutex::new(None));
        watch(&device, &failure);
        Ok(Self {
            device,
            queue,
            name,
            failure,
            pipelines: Arc::default(),
        })
    }

    /// Its name and driver.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Runs `work` in error scopes, and returns the first failure of its calls as an error.
    pub(super) fn guarded<T>(&self, work: impl FnOnce(&wgpu::Device) -> T) -> Result<T> {
        let scopes = [
            wgpu::ErrorFilter::Internal,
            wgpu::ErrorFilter::OutOfMemory,
            wgpu::ErrorFilter::Validation,
        ]
        .map(|filter| self.device.push_error_scope(filter));
        let value = work(&self.device);
        let mut first = None;
        for scope in scopes.into_iter().rev() {
            let error = pollster::block_on(scope.pop());
            first = first.or(error);
        }
        match first {
            Some(error) => Err(self.error(error.to_string())),
            None => self.check().map(|()| value),
        }
    }

    /// The pipeline of a shader's entry point, from the cache or compiled.
    pub(super) fn pipeline(
        &self,
        entry_point: &'static str,
        text: &str,
    ) -> Result<wgpu::ComputePipeline> {
        let key = (entry_point, text.to_owned());
        let lock = || {
            self.pipelines
                .lock()
                .unwrap_or_else(PoisonError::into_inner)
        };
        if let Some(pipeline) = lock().get(&key) {
            return Ok(pipeline.clone());
        }
        let pipeline = self.guarded(|device| {
            let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
                label: None,
                source: wgpu::ShaderSource::Wgsl(text.into()),
            });
            device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry_point),
                layout: None,
                module: &module,
                entry_point: Some(entry_point),
                compilation_options: wgpu::PipelineCompilationOptions {
                    // Kernels write workgroup memory before they read it.
                    zero_initialize_workgroup_memory: false,
                    ..Default::default()
                },
                cache: None,
            })
        })?;
        let mut pipelines = lock();
        if pipelines.len() >= PIPELINES_MAX {
            pipelines.clear();
        }
        pipelines.insert(key, pipeline.clone());
        Ok(pipeline)
    }

    /// Submits commands, waits for them, and returns the contents of a mappable buffer.
    pub(super) fn submit_and_read(
        &self,
        commands: wgpu::CommandBuffer,
        buffer: &wgpu::Buffer,
    ) -> Result<Vec<u8>> {
        let (sender, receiver) = channel();
        self.guarded(|_| {
            self.queue.submit([commands]);
            buffer
                .slice(..)
                .map_async(wgpu::MapMode::Read, move |result| {
                    // The receiver is gone only if this call has already failed.
                    _ = sender.send(result);
                });
        })?;
        self.wait(&receiver)?;
        let bytes = match buffer.slice(..).get_mapped_range() {
            Ok(view) => view.to_vec(),
            Err(error) => return Err(self.error(error.to_string())),
        };
        buffer.unmap();
        Ok(bytes)
    }

    /// Waits for a mapping by polling, as the driver's own wait wakes late. Pauses are a sixteenth of the
    /// time waited so far, so that they delay the result by little more than that share.
    fn wait(&self, mapping: &Receiver<Result<(), wgpu::BufferAsyncError>>) -> Result<()> {
        let mut waited = Duration::ZERO;
        while waited < SUBMISSION_TIMEOUT {
            // wgpu 30 panics when the device is lost, which is not a programming error.
            let polled = catch_unwind(AssertUnwindSafe(|| self.device.poll(wgpu::PollType::Poll)));
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

    pub(super) fn error(&self, message: String) -> Error {
        let device = self.name.clone();
        Error::Gpu { device, message }
    }

    fn check(&self) -> Result<()> {
        let failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure
            .as_ref()
            .map_or(Ok(()), |message| Err(self.error(message.clone())))
    }
}

/// Records the first failure that the device reports outside of error scopes.
fn watch(device: &wgpu::Device, failure: &Arc<Mutex<Option<String>>>) {
    let keep = |failure: &Mutex<Option<String>>, message: String| {
        let mut failure = failure.lock().unwrap_or_else(PoisonError::into_inner);
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
