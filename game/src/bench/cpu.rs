//! CPU time of this thread: on a machine that others use too, wall time says little.

use cpu_time::ThreadTime;

/// The least CPU time in ms of `runs` calls.
pub(super) fn best_ms(runs: u32, mut call: impl FnMut()) -> f64 {
    (0..runs)
        .map(|_| {
            let begun = ThreadTime::now();
            call();
            ms_since(begun)
        })
        .fold(f64::INFINITY, f64::min)
}

/// CPU time in ms since then.
pub(super) fn ms_since(begun: ThreadTime) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

/// The middle value; NaN of none.
pub(super) fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
