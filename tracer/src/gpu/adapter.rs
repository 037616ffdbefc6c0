//! Enumeration of this machine's GPUs, and selection of one.

use std::fmt;

use crate::Error;

/// A compute-capable device that wgpu reports.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterDescription {
    /// Its name.
    pub name: String,
    /// The driver and its version.
    pub driver: String,
    /// The graphics API through which it is accessed.
    pub backend: String,
    /// Whether it is a software implementation on the CPU (such as Mesa's llvmpipe): correct, but
    /// slower than [`crate::CpuTracer`].
    pub software: bool,
}

/// Which adapter to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The most capable real GPU: a discrete one before an integrated one.
    #[default]
    Gpu,
    /// The same, but a software implementation if there is no real GPU.
    Any,
    /// The one at this index of [`adapters`].
    Index(usize),
    /// The first whose name contains this string, ignoring case.
    Name(String),
}

impl fmt::Display for AdapterChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Gpu => f.write_str("a real GPU"),
            Self::Any => f.write_str("any GPU, software included"),
            Self::Index(index) => write!(f, "GPU {index}"),
            Self::Name(name) => write!(f, "a GPU named `{name}`"),
        }
    }
}

/// The adapters of this machine; none if Vulkan is not installed. Takes up to a second or two.
pub fn adapters() -> Vec<AdapterDescription> {
    let adapters = enumerate();
    adapters.iter().map(describe).collect()
}

/// The adapter that `choice` names.
///
/// # Errors
/// [`Error::Device`] with what was looked for, what there is, and what to install.
pub(crate) fn find(choice: &AdapterChoice) -> Result<wgpu::Adapter, Error> {
    let mut adapters = enumerate();
    let described: Vec<_> = adapters.iter().map(describe).collect();
    let real = |&index: &usize| !described[index].software;
    let indices = 0..adapters.len();
    let rank = |&index: &usize| rank(adapters[index].get_info().device_type);
    let found = match choice {
        AdapterChoice::Gpu => indices.filter(real).min_by_key(rank),
        AdapterChoice::Any => indices.min_by_key(rank),
        AdapterChoice::Index(index) => indices.into_iter().find(|i| i == index),
        AdapterChoice::Name(name) => {
            let name = name.to_lowercase();
            indices
                .into_iter()
                .find(|&i| described[i].name.to_lowercase().contains(&name))
        }
    };
    found
        .map(|index| adapters.swap_remove(index))
        .ok_or_else(|| not_found(choice, &described))
}

/// All adapters that are not software implementations, the most capable first.
pub(crate) fn real() -> Vec<wgpu::Adapter> {
    let mut adapters = enumerate();
    adapters.retain(|adapter| !describe(adapter).software);
    adapters.sort_by_key(|adapter| rank(adapter.get_info().device_type));
    adapters
}

/// The name and driver of an adapter in one line.
pub(crate) fn label(info: &wgpu::AdapterInfo) -> String {
    format!("{} ({} {})", info.name, info.driver, info.driver_info)
}

fn enumerate() -> Vec<wgpu::Adapter> {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    // Validation layers, the default of debug builds, cost speed and need a package of their own.
    descriptor.flags = wgpu::InstanceFlags::empty();
    // The OpenGL backend has no timestamps and needs a display connection.
    descriptor.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(descriptor);
    let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
    let has_compute = |adapter: &wgpu::Adapter| {
        let flags = adapter.get_downlevel_capabilities().flags;
        flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS)
    };
    adapters.into_iter().filter(has_compute).collect()
}

fn describe(adapter: &wgpu::Adapter) -> AdapterDescription {
    let info = adapter.get_info();
    AdapterDescription {
        driver: format!("{} {}", info.driver, info.driver_info),
        backend: info.backend.to_string(),
        software: is_software(&info),
        name: info.name,
    }
}

pub(crate) fn is_software(info: &wgpu::AdapterInfo) -> bool {
    info.device_type == wgpu::DeviceType::Cpu
}

/// Lower is preferred.
fn rank(device_type: wgpu::DeviceType) -> u32 {
    match device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::VirtualGpu => 1,
        wgpu::DeviceType::IntegratedGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

fn not_found(choice: &AdapterChoice, described: &[AdapterDescription]) -> Error {
    let names: Vec<_> = described.iter().map(|adapter| &*adapter.name).collect();
    let message = if names.is_empty() {
        "Vulkan offers no device; install the GPU's driver with its Vulkan part and the loader \
         (libvulkan.so.1, package libvulkan1), or mesa-vulkan-drivers for software"
            .to_owned()
    } else {
        format!(
            "not among the devices that Vulkan offers ({}); install the GPU's Vulkan driver or \
             choose one of these",
            names.join(", ")
        )
    };
    Error::Device {
        device: choice.to_string(),
        message,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn absent_adapter_error_names_the_choice() {
        let Err(error) = find(&AdapterChoice::Name("no such device".into())) else {
            panic!("an adapter that nobody makes was found");
        };
        let text = error.to_string();
        assert!(text.contains("a GPU named `no such device`"), "{text}");
        assert!(text.contains("install"), "{text}");
    }
}
