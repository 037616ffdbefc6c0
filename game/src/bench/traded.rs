//! What the settings of the physics cost and lose, for the player: `trade.json` beside this file, which
//!
//! ```text
//! carom bench physics --part trade --json > game/src/bench/trade.json
//! ```
//! wrote on one quiet core of an Intel Xeon of 16 (it takes minutes).

use std::fmt::Write as _;
use std::sync::LazyLock;

use carom_billiards::physics::Engine;
use serde::Deserialize;

use super::trade::Trade;

/// The file: a bench's report with the trade alone.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Traded {
    trade: Vec<Trade>,
}

static TRADED: LazyLock<Vec<Trade>> = LazyLock::new(|| {
    let read = serde_json::from_str::<Traded>(include_str!("trade.json"));
    read.expect("the file is the bench's: a test reads it")
        .trade
});

/// An engine's trade in a sentence.
pub fn in_words(engine: &Engine) -> String {
    let name = engine.to_string();
    let what = match engine {
        Engine::Exact => "Billiards laws from contact to contact".to_owned(),
        Engine::Rapier(rapier) => format!("Plain rapier, {} steps a second", rapier.steps_per_sec),
    };
    match TRADED.iter().find(|trade| trade.engine == name) {
        Some(trade) => format!(
            "{what}: a 30° cut is off by {}°, a usual shot by {} mm; {} ms of CPU for a break",
            figure(trade.cut_error_deg),
            figure(trade.median_max_mm),
            figure(trade.break_ms),
        ),
        None => format!("{what}: `carom --help` says what others cost and lose"),
    }
}

/// The trade of the exact engine and of plain rapier at its usual knobs, a line each.
pub fn in_a_table() -> String {
    let mut table = String::from(
        "             30° cut at  reference   energy kept  CPU ms per  CPU ms for  dearest\n\
         \x20            3 m/s, off  shots, off  in a break   simulated   a whole     10 ms,\n\
         \x20            by          (median)    (real: 76 %) second      break       CPU ms\n",
    );
    for trade in TRADED.iter().filter(|trade| !trade.engine.contains(',')) {
        let _ = writeln!(
            table,
            "{:<12} {:<11} {:<11} {:<12} {:<11} {:<11} {}",
            trade.engine,
            format!("{}°", figure(trade.cut_error_deg)),
            format!("{} mm", figure(trade.median_max_mm)),
            format!("{:.0} %", 100.0 * trade.energy_kept),
            figure(trade.ms_per_second),
            figure(trade.break_ms),
            figure(trade.worst_frame_ms),
        );
    }
    table.trim_end().to_owned()
}

/// With two digits that count at least, and no exponent.
fn figure(value: f64) -> String {
    let small = value < 0.01;
    let digits = (f64::from(u8::from(!small)) - value.log10().floor()).max(0.0);
    format!("{value:.*}", digits as usize)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bench::trade::{STEPS_PER_SEC, engines};

    #[test]
    fn the_file_has_what_the_bench_measures() {
        let names: Vec<String> = engines().iter().map(ToString::to_string).collect();
        let found: Vec<&str> = TRADED.iter().map(|trade| &*trade.engine).collect();
        assert_eq!(found, names);
        let text = serde_json::to_value(super::super::Report {
            trade: Some(TRADED.clone()),
            ..Default::default()
        });
        let file: serde_json::Value = serde_json::from_str(include_str!("trade.json")).unwrap();
        assert_eq!(text.unwrap(), file, "as the bench writes it");
        for trade in &*TRADED {
            let figures = [
                trade.cut_error_deg,
                trade.median_max_mm,
                trade.energy_kept,
                trade.break_ms,
                trade.ms_per_second,
                trade.worst_frame_ms,
            ];
            assert!(figures.iter().all(|&f| f > 0.0 && f.is_finite()), "{trade}");
        }
    }

    #[test]
    fn the_exact_engine_costs_less_and_errs_less_than_any_other() {
        let (exact, others) = TRADED.split_first().unwrap();
        assert_eq!(exact.engine, "exact");
        for other in others {
            assert!(other.cut_error_deg > 1e3 * exact.cut_error_deg, "{other}");
            assert!(other.median_max_mm > 1e3 * exact.median_max_mm, "{other}");
            assert!(other.ms_per_second > exact.ms_per_second, "{other}");
        }
    }

    #[test]
    fn the_texts_hold_the_figures() {
        let table = in_a_table();
        assert_eq!(table.lines().count(), 3 + 1 + STEPS_PER_SEC.len());
        assert!(!table.ends_with('\n'));
        assert!(
            table.lines().all(|line| line.chars().count() < 90),
            "{table}"
        );
        for trade in TRADED.iter().filter(|trade| !trade.engine.contains(',')) {
            let words = in_words(&trade.engine.parse().unwrap());
            let line = table
                .lines()
                .find(|line| line.starts_with(&format!("{} ", trade.engine)));
            let line = line.unwrap();
            for value in [trade.cut_error_deg, trade.median_max_mm, trade.break_ms] {
                assert!(words.contains(&figure(value)), "{words}");
                assert!(line.contains(&figure(value)), "{line}");
            }
        }
        assert!(in_words(&"rapier-77".parse().unwrap()).contains("--help"));
    }

    #[test]
    fn figures_are_short_and_plain() {
        let texts = [1.2e-6, 0.00104, 0.388, 1.67, 7.69, 32.2, 222.7, 478.7].map(figure);
        assert_eq!(
            texts,
            [
                "0.000001", "0.001", "0.39", "1.7", "7.7", "32", "223", "479"
            ]
        );
    }
}
