//! Errors of a bench, with the exit code of each.

use std::process::ExitCode;

/// Whose fault it is decides the exit code.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BenchError {
    /// The arguments or the files that they name: 2.
    #[error("{0}")]
    Input(String),
    /// The machine, the network or a device, after the arguments were found right: 1.
    #[error("{0:#}")]
    Run(anyhow::Error),
    /// Ctrl-C or SIGTERM: 130, as shells have it for SIGINT.
    #[error("interrupted")]
    Interrupted,
}

/// A value of the command line that is not what it must be.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ValueError {
    /// It is written in another way.
    #[error("it must be {0}")]
    Form(&'static str),
    /// No such share of a thread.
    #[error("the share is {share}: it must be above 0 and at most 1")]
    Share { share: f64 },
    /// No such round trip.
    #[error("the round trip is {millis} ms: it must be from 0 to 10000")]
    RoundTrip { millis: f64 },
}

impl BenchError {
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Run(_) => 1,
            Self::Input(_) => 2,
            Self::Interrupted => 130,
        })
    }
}

impl From<carom_tracer::Error> for BenchError {
    fn from(error: carom_tracer::Error) -> Self {
        match error {
            carom_tracer::Error::Device { .. } => Self::Run(error.into()),
            error => Self::Input(error.to_string()),
        }
    }
}

impl From<carom_farm::Error> for BenchError {
    fn from(error: carom_farm::Error) -> Self {
        match error.is_invalid_input() {
            true => Self::Input(error.to_string()),
            // Its sentence holds that of its source.
            false => Self::Run(anyhow::Error::msg(error.to_string())),
        }
    }
}

impl From<anyhow::Error> for BenchError {
    fn from(error: anyhow::Error) -> Self {
        Self::Run(error)
    }
}
