//! Random faults. `carom-farm bench faults` runs ten thousand.

use carom_farm::sim::{fault_plan, run_faults};

#[test]
fn whatever_goes_wrong_every_frame_comes_whole_and_right() {
    for seed in 0..300 {
        for hedged in [false, true] {
            let plan = fault_plan(seed, hedged);
            let run = run_faults(&plan);
            assert!(
                run.wrong.is_empty(),
                "seed {seed}, hedged {hedged}: {:?}",
                run.wrong
            );
        }
    }
}
