//! Measured cost and error of each physics engine in the settings.

use std::fmt::Write as _;

use carom_billiards::physics::Engine;

use carom_text::text;

/// Figures of an engine, as they are shown.
struct EngineCost {
    /// Name of the engine, as in `--physics`.
    engine: &'static str,
    /// Error of the object ball's line in a 30° cut at 3 m/s, degrees.
    cut_error_deg: &'static str,
    /// Median over the reference shots of the largest distance, mm.
    shot_error_mm: &'static str,
    /// Share of the cue ball's energy that remains after a break, percent; 76 in reality.
    energy_kept_percent: u32,
    /// CPU time per simulated second of a break, ms.
    second_ms: &'static str,
    /// CPU time of a whole break, ms.
    break_ms: &'static str,
    /// CPU time of the most expensive 10 ms of a break, ms.
    dearest_frame_ms: &'static str,
}

impl EngineCost {
    const fn new(
        engine: &'static str,
        [cut_error_deg, shot_error_mm]: [&'static str; 2],
        energy_kept_percent: u32,
        [second_ms, break_ms, dearest_frame_ms]: [&'static str; 3],
    ) -> Self {
        Self {
            engine,
            cut_error_deg,
            shot_error_mm,
            energy_kept_percent,
            second_ms,
            break_ms,
            dearest_frame_ms,
        }
    }
}

// `carom-bench physics --part engine-tradeoff`, on 2026-11-21, one quiet core of an Intel Xeon of 16.
#[rustfmt::skip]
const COSTS: [EngineCost; 8] = [
    EngineCost::new("exact",       ["0.000001", "0.001"], 73, ["0.39", "3.3", "0.44"]),
    EngineCost::new("rapier-60",   ["7.7",      "223"],   41, ["2.5",  "12",  "0.17"]),
    EngineCost::new("rapier-120",  ["8.0",      "105"],   39, ["3.0",  "18",  "0.26"]),
    EngineCost::new("rapier-240",  ["6.1",      "50"],    36, ["5.5",  "32",  "0.33"]),
    EngineCost::new("rapier-480",  ["3.4",      "45"],    24, ["11",   "71",  "0.47"]),
    EngineCost::new("rapier-1000", ["1.7",      "37"],    26, ["23",   "121", "0.65"]),
    EngineCost::new("rapier-2000", ["0.78",     "50"],    25, ["43",   "245", "1.1"]),
    EngineCost::new("rapier-4000", ["0.43",     "50"],    24, ["78",   "479", "2.1"]),
];

/// Cost and error of an engine, in a sentence.
pub fn engine_cost(engine: &Engine) -> String {
    let name = engine.to_string();
    let steps_per_sec = match engine {
        Engine::Exact => 0,
        Engine::Rapier(rapier) => rapier.steps_per_sec,
    };
    match COSTS.iter().find(|cost| cost.engine == name) {
        Some(cost) => text!(
            "engine-cost",
            steps = steps_per_sec,
            cut = cost.cut_error_deg,
            shot = cost.shot_error_mm,
            time = cost.break_ms
        ),
        None => text!("engine-unmeasured", steps = steps_per_sec),
    }
}

/// Table of cost and error of all measured engines, a line each.
pub fn engine_cost_table() -> String {
    let mut table = format!("{}\n", text!("engine-table"));
    for cost in &COSTS {
        let _ = writeln!(
            table,
            "{:<12} {:<11} {:<11} {:<12} {:<11} {:<11} {}",
            cost.engine,
            format!("{}°", cost.cut_error_deg),
            format!("{} mm", cost.shot_error_mm),
            format!("{} %", cost.energy_kept_percent),
            cost.second_ms,
            cost.break_ms,
            cost.dearest_frame_ms,
        );
    }
    table.trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_engine_costs_and_errs_least() {
        let [exact, others @ ..] = &COSTS;
        assert_eq!(exact.engine, "exact");
        let number = |text: &str| text.parse::<f64>().unwrap();
        for other in others {
            let of = |figure: fn(&EngineCost) -> &'static str| {
                number(figure(other)) / number(figure(exact))
            };
            assert!(of(|cost| cost.cut_error_deg) > 1e3, "{}", other.engine);
            assert!(of(|cost| cost.shot_error_mm) > 1e3, "{}", other.engine);
            assert!(of(|cost| cost.second_ms) > 1.0, "{}", other.engine);
        }
    }

    #[test]
    fn sentence_and_table_hold_the_figures() {
        let table = engine_cost_table();
        assert_eq!(table.lines().count(), 3 + COSTS.len());
        assert!(
            table.lines().all(|line| line.chars().count() < 90),
            "{table}"
        );
        for (cost, line) in COSTS.iter().zip(table.lines().skip(3)) {
            let sentence = engine_cost(&cost.engine.parse().unwrap());
            for figure in [cost.cut_error_deg, cost.shot_error_mm, cost.break_ms] {
                assert!(sentence.contains(figure), "{sentence}");
                assert!(line.contains(figure), "{line}");
            }
        }
        assert!(engine_cost(&"rapier-77".parse().unwrap()).contains("--help"));
    }
}
