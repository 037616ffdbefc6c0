//! Log lines of the programs on standard error.

use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::layer;
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

/// Writes log lines to standard error from now on: those that the variable `RUST_LOG` names, in the syntax
/// of [`Targets`] (`info`; `carom_farm=debug,warn`), or without it those of `default`. A variable that
/// cannot be read is reported there, and not followed.
pub fn init(default: &str) {
    let parsed = |text: String| {
        let filter = text.parse::<Targets>();
        let report = |why| eprintln!("RUST_LOG is ignored: `{}`: {why}", text.escape_debug());
        filter.map_err(report).ok()
    };
    let asked = std::env::var("RUST_LOG")
        .ok()
        .filter(|text| !text.is_empty());
    let filter = asked.and_then(parsed).or_else(|| default.parse().ok());
    tracing_subscriber::registry()
        .with(layer().with_writer(std::io::stderr).with_target(false))
        .with(filter.unwrap_or_default())
        .init();
}
