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
            false => Self::Run(error.into()),
        }
    }
}

impl From<anyhow::Error> for BenchError {
    fn from(error: anyhow::Error) -> Self {
        Self::Run(error)
    }
}
