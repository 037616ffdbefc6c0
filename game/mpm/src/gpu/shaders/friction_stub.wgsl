fn scatter_friction(kernel: Kernel, load: Load) {}
fn clear_friction(lane: u32) {}
fn flush_friction(index: u32, node: u32) {}
