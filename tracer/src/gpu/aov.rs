//! First-hit AOVs (arbitrary output variables), as another output of the kernel.

use super::GpuTracer;
use super::features::KernelOutput;
use crate::{Aovs, CompiledScene, Error, TileAovs, TraceJob};

impl GpuTracer {
    /// Traces the AOVs of the job's tiles.
    pub(super) fn trace_aovs(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileAovs) + Sync),
    ) -> Result<(), Error> {
        self.trace_output(scene, job, KernelOutput::Aovs, &|chunk, _, film| {
            let floats = KernelOutput::Aovs.floats();
            for (entry, index) in chunk.entries.iter().zip(chunk.tiles.clone()) {
                let begin = entry.first_pixel as usize * floats;
                let count = (entry.width * entry.height) as usize * floats;
                let pixels = film[begin..begin + count].chunks_exact(floats);
                let pixels = pixels.map(aovs).collect();
                sink(TileAovs { index, pixels });
            }
        })?;
        Ok(())
    }
}

/// One pixel's AOVs, in the order in which `shaders/aov.wgsl` writes them.
fn aovs(numbers: &[f32]) -> Aovs {
    let triple = |first: usize| [numbers[first], numbers[first + 1], numbers[first + 2]];
    Aovs {
        albedo: triple(0),
        normal: triple(3),
        inverse_depth: numbers[6],
        emission: triple(7),
    }
}
