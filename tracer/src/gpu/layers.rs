//! First hits, as another output of the kernel.

use super::GpuTracer;
use super::features::Output;
use crate::{CompiledScene, Error, Layers, TileLayers, TraceJob};

impl GpuTracer {
    /// First hits of the job's tiles.
    pub(super) fn find_layers(
        &self,
        scene: &CompiledScene,
        job: &TraceJob<'_>,
        sink: &(dyn Fn(TileLayers) + Sync),
    ) -> Result<(), Error> {
        self.trace_output(scene, job, Output::Layers, &|chunk, _, film| {
            let floats = Output::Layers.floats();
            for (entry, index) in chunk.entries.iter().zip(chunk.tiles.clone()) {
                let begin = entry.first_pixel as usize * floats;
                let count = (entry.width * entry.height) as usize * floats;
                let pixels = film[begin..begin + count].chunks_exact(floats);
                let pixels = pixels.map(layers).collect();
                sink(TileLayers { index, pixels });
            }
        })?;
        Ok(())
    }
}

/// As `shaders/layers.wgsl` writes them.
fn layers(numbers: &[f32]) -> Layers {
    let triple = |first: usize| [numbers[first], numbers[first + 1], numbers[first + 2]];
    Layers {
        albedo: triple(0),
        normal: triple(3),
        inverse_depth: numbers[6],
        emission: triple(7),
    }
}
