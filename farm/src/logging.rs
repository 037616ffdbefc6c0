//! Log output of the programs on standard error.

use std::io::IsTerminal as _;
use std::str::FromStr;

use tracing_subscriber::filter::Targets;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::layer;
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;

use crate::Error;

/// Format of log lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LogFormat {
    /// Plain text, for terminals.
    #[default]
    Plain,
    /// Each line begins with the time (RFC 3339, UTC).
    Time,
    /// Each line is a JSON object with `timestamp`.
    Json,
}

/// `plain`, `time` or `json`, for command lines.
impl FromStr for LogFormat {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        match text {
            "plain" => Ok(Self::Plain),
            "time" => Ok(Self::Time),
            "json" => Ok(Self::Json),
            _ => Err(Error::Choice("plain, time or json")),
        }
    }
}

/// The current time in RFC 3339 format.
pub fn timestamp() -> String {
    let mut text = String::new();
    // Writing to memory does not fail.
    let _ = SystemTime.format_time(&mut Writer::new(&mut text));
    text
}

/// Starts logging to standard error as [`init_with_format`] with [`LogFormat::Plain`].
pub fn init(default: &str) {
    init_with_format(default, LogFormat::Plain);
}

/// Starts logging to standard error: what the variable `RUST_LOG` selects, in the syntax of [`Targets`]
/// (`info`; `carom_farm=debug,warn`), or else what `default` selects. An invalid variable is reported and
/// ignored.
pub fn init_with_format(default: &str, format: LogFormat) {
    let parsed = |text: String| {
        let filter = text.parse::<Targets>();
        let report = |why| eprintln!("RUST_LOG is ignored: `{}`: {why}", text.escape_debug());
        filter.map_err(report).ok()
    };
    let asked = std::env::var("RUST_LOG")
        .ok()
        .filter(|text| !text.is_empty());
    let filter = asked.and_then(parsed).or_else(|| default.parse().ok());
    let filter = filter.unwrap_or_default();
    let lines = layer()
        .with_writer(std::io::stderr)
        .with_ansi(shows_colour())
        .with_target(false);
    let registry = tracing_subscriber::registry();
    match format {
        LogFormat::Json => registry.with(lines.json()).with(filter).init(),
        _ => registry.with(lines).with(filter).init(),
    }
}

/// Whether to use colour: only on terminals, and not if `NO_COLOR` is set. <https://no-color.org>
fn shows_colour() -> bool {
    std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none_or(|set| set.is_empty())
}
