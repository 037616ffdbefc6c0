//! Errors of a bench, with the exit code of each.

use std::process::ExitCode;

/// A failed bench. The party at fault decides the exit code.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BenchError {
    /// The arguments or the files that they name: 2.
    #[error("{0}")]
    Input(String),
    /// The machine, the network or a device, after the arguments were accepted: 1.
    #[error("{0:#}")]
    Run(anyhow::Error),
    /// Ctrl-C or SIGTERM: 130, the convention of shells for SIGINT.
    #[error("interrupted")]
    Interrupted,
}

/// An invalid value of the command line.
#[derive(Debug, thiserror::Error)]
pub(crate) enum ValueError {
    /// It has another form.
    #[error("it must be {0}")]
    Form(&'static str),
    /// The share of a thread is out of range.
    #[error("the share is {share}: it must be above 0 and at most 1")]
    Share { share: f64 },
    /// The round trip is out of range.
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
