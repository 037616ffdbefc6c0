//! Wrapper of the AWS command line: JSON in, JSON out, faults as sentences.

use std::io::{ErrorKind, Write as _};
use std::process::{Command, Stdio};

use anyhow::{Context as _, anyhow};
use serde_json::Value;
use tempfile::NamedTempFile;

use crate::commands::Failure;

/// The program `aws` of this machine, for one region.
pub(super) struct AwsCli {
    region: Option<String>,
}

impl AwsCli {
    pub(super) const fn new(region: Option<String>) -> Self {
        Self { region }
    }

    /// Runs a command and returns its output; null if there is none.
    pub(super) fn json(&self, args: &[&str]) -> Result<Value, Failure> {
        parsed(&self.run(args, None)?)
    }

    /// Runs a command with its arguments in a private file, so that secrets do not appear in the list of
    /// processes.
    pub(super) fn json_from(&self, args: &[&str], input: &Value) -> Result<Value, Failure> {
        let mut file = NamedTempFile::new().context("a file for the program aws")?;
        write!(file, "{input}").context("a file for the program aws")?;
        let path = format!("file://{}", file.path().display());
        let args = [args, &["--cli-input-json", &path]].concat();
        parsed(&self.run(&args, None)?)
    }

    /// Runs a command to its end.
    pub(super) fn done(&self, args: &[&str]) -> Result<(), Failure> {
        self.run(args, None).map(drop)
    }

    /// Runs a command to its end, with text on its standard input.
    pub(super) fn done_with(&self, args: &[&str], input: &str) -> Result<(), Failure> {
        self.run(args, Some(input)).map(drop)
    }

    fn run(&self, args: &[&str], input: Option<&str>) -> Result<String, Failure> {
        let mut command = Command::new("aws");
        command.args(["--output", "json"]);
        if let Some(region) = &self.region {
            command.args(["--region", region]);
        }
        let stdin = input.map_or_else(Stdio::null, |_| Stdio::piped());
        let child = command
            .args(args)
            .env("AWS_PAGER", "")
            .stdin(stdin)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn();
        let mut child = child.map_err(|why| match why.kind() {
            ErrorKind::NotFound => Failure::Input(NO_PROGRAM.into()),
            _ => Failure::Run(anyhow!(why).context("the program aws")),
        })?;
        if let (Some(mut stdin), Some(input)) = (child.stdin.take(), input) {
            // A command that ends before it has read everything states the reason itself.
            let _ = stdin.write_all(input.as_bytes());
        }
        let output = child.wait_with_output().context("the program aws")?;
        match output.status.success() {
            true => Ok(String::from_utf8_lossy(&output.stdout).into_owned()),
            false => Err(failure(args, &String::from_utf8_lossy(&output.stderr))),
        }
    }
}

fn parsed(text: &str) -> Result<Value, Failure> {
    if text.trim().is_empty() {
        return Ok(Value::Null);
    }
    Ok(serde_json::from_str(text).context("what the program aws prints")?)
}

/// The failure of a command from its standard error, with advice if the machine is not set up.
fn failure(args: &[&str], said: &str) -> Failure {
    let advice = [
        ("Unable to locate credentials", NO_CREDENTIALS),
        ("must specify a region", NO_REGION),
    ];
    if let Some((_, advice)) = advice.iter().find(|(words, _)| said.contains(words)) {
        return Failure::Input((*advice).into());
    }
    let said = said.trim();
    let command = args.iter().take(2).copied().collect::<Vec<_>>().join(" ");
    Failure::Run(anyhow!("aws {command}: {said}"))
}

const NO_PROGRAM: &str = "the program aws is not on PATH: install the AWS command line (apt install awscli, or \
     https://aws.amazon.com/cli/), then run `aws configure`";
const NO_CREDENTIALS: &str = "the program aws has no credentials: run `aws configure`, or set AWS_PROFILE to a \
     profile that has some";
const NO_REGION: &str =
    "no region is set: name one with --region, as in us-east-1, or run `aws configure`";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_set_up_is_said_with_what_to_do() {
        let sentence = |said| failure(&["sts", "get-caller-identity"], said).to_string();
        let credentials = sentence("Unable to locate credentials. You can configure …");
        assert!(credentials.contains("aws configure"), "{credentials}");
        let region = sentence("\nYou must specify a region. You can also …");
        assert!(region.contains("--region"), "{region}");
        let other = sentence("\nAn error occurred (AccessDenied)\n");
        assert_eq!(
            other,
            "aws sts get-caller-identity: An error occurred (AccessDenied)"
        );
    }
}
