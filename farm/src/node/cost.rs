//! Measured cost of scenes, and the requests that are refused for theirs.

use carom_protocol::SceneHash;

use super::guard_band::{BLOCK, first_block};
use super::job::NodeJob;

/// The measured cost of a scene.
pub(super) struct Cost {
    pub(super) scene: SceneHash,
    /// Whether it was denoised, which adds to the time.
    pub(super) is_denoised: bool,
    /// Path depth that it was measured with.
    pub(super) max_depth: u32,
    pub(super) secs_per_sample: f64,
    /// Maximum samples measured at once.
    pub(super) samples_max: f64,
    /// Number of probes since the last slice.
    pub(super) probes: u32,
}

impl Cost {
    /// Whether it applies to a job's scene.
    pub(super) fn is_of(&self, job: &NodeJob) -> bool {
        self.scene == job.request.scene && self.is_denoised == job.is_denoised()
    }
}

/// Advice for a request that is refused for its cost.
pub(super) const COST_ADVICE: &str = "ask for fewer samples, shallower paths or smaller tiles";

/// The explanation for a request that takes longer than allowed; `None` if it does not.
pub(super) fn too_costly(job: &NodeJob, secs_per_sample: f64) -> Option<String> {
    let (grid, tiles) = (job.request.grid, job.request.tiles);
    let all_secs = secs_per_sample * job.samples(tiles);
    let block_secs = secs_per_sample * job.samples_of_part(first_block(grid.tile(tiles.first)));
    if block_secs > UNDIVIDED_SECS_MAX && job.is_denoised() {
        return Some(format!(
            "{BLOCK}x{BLOCK} denoised pixels of it take some {block_secs:.0} s here, of at most \
             {UNDIVIDED_SECS_MAX:.0} s: {COST_ADVICE}"
        ));
    }
    (all_secs > REQUEST_SECS_MAX).then(|| {
        format!(
            "it takes some {all_secs:.0} s here, of at most {REQUEST_SECS_MAX:.0} s: {COST_ADVICE}"
        )
    })
}

/// Maximum device seconds of an indivisible piece: a block of a denoised tile, a pixel, or a probe.
pub(super) const UNDIVIDED_SECS_MAX: f64 = 10.0;
/// Maximum device seconds of a request. A 4K picture with 4,096 samples takes an H200 a minute and four
/// slow cores an hour, but is split into many requests.
const REQUEST_SECS_MAX: f64 = 3600.0;
