//! The reason why a command ends early, and its exit code.

use std::fmt;
use std::process::ExitCode;

/// A failure; the party at fault decides the exit code.
#[derive(Debug)]
pub(crate) enum Failure {
    /// The arguments or files that they name are invalid: 2.
    Input(String),
    /// The machine, the network or a device failed: 1.
    Run(anyhow::Error),
    /// Ctrl-C or SIGTERM: 130, as shells have it for SIGINT.
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
            Self::Run(why) => f.write_str(&sentence(why)),
            Self::Interrupted => f.write_str("interrupted"),
        }
    }
}

/// The sentences of an error and its causes, none twice: many end with that of their cause.
fn sentence(error: &anyhow::Error) -> String {
    let mut sentence = String::new();
    for cause in error.chain().map(ToString::to_string) {
        if sentence.is_empty() {
            sentence = cause;
        } else if !sentence.ends_with(&cause) {
            sentence = format!("{sentence}: {cause}");
        }
    }
    sentence
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
            // Its sentence holds that of its source.
            false => Self::Run(anyhow::Error::msg(error.to_string())),
        }
    }
}

impl From<anyhow::Error> for Failure {
    fn from(error: anyhow::Error) -> Self {
        Self::Run(error)
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use anyhow::Context as _;

    use super::*;

    #[test]
    fn no_cause_is_told_twice() {
        let full = || io::Error::from(io::ErrorKind::StorageFull);
        let refused: Result<(), _> = Err(carom_tracer::Error::Io {
            path: "a.exr".into(),
            source: full(),
        });
        let why = Failure::Run(refused.context("back end cpu").unwrap_err());
        assert_eq!(why.to_string(), format!("back end cpu: a.exr: {}", full()));
    }
}
