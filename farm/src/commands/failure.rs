//! Reason why a command ends early, and its exit code.

use std::fmt;
use std::process::ExitCode;

use carom_tracer::text::with_causes;

/// Failure of a command; the party at fault determines the exit code.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The arguments, or files named in them, are invalid: exit code 2.
    Input(String),
    /// The machine, the network or a device failed: exit code 1.
    Run(anyhow::Error),
    /// Ctrl-C or SIGTERM: exit code 130, as of shells after SIGINT.
    Interrupted,
}

impl Failure {
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Run(_) => 1,
            Self::Input(_) => 2,
            Self::Interrupted => 130,
        })
    }
}

impl fmt::Display for Failure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Input(why) => f.write_str(why),
            Self::Run(why) => f.write_str(&with_causes(why.as_ref())),
            Self::Interrupted => f.write_str("interrupted"),
        }
    }
}

impl From<carom_tracer::Error> for Failure {
    fn from(error: carom_tracer::Error) -> Self {
        match error {
            carom_tracer::Error::Device { .. } => Self::Run(error.into()),
            error => Self::Input(error.to_string()),
        }
    }
}

impl From<carom_farm::Error> for Failure {
    fn from(error: carom_farm::Error) -> Self {
        match error.is_invalid_input() {
            true => Self::Input(error.to_string()),
            // The message includes that of the source.
            false => Self::Run(anyhow::Error::msg(error.to_string())),
        }
    }
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Self::Run(error)
    }
}
