//! Wait of a bench for its nodes: a message after three seconds, an error at the timeout.

use std::time::{Duration, Instant};

use anyhow::bail;
use carom_farm::{Farm, Frame, NodeStatus};

/// How long a bench waits.
#[derive(Clone, Copy, clap::Args)]
pub(crate) struct WaitArgs {
    /// Give up when nodes have been waited for, or a frame, for this many seconds.
    #[arg(long, default_value_t = 60, value_parser = clap::value_parser!(u64).range(1..=3600))]
    timeout_secs: u64,
}

/// A wait in progress.
pub(crate) struct Wait {
    begun: Instant,
    timeout: Duration,
    reported: bool,
}

impl WaitArgs {
    pub(crate) fn begin(self) -> Wait {
        Wait {
            begun: Instant::now(),
            timeout: Duration::from_secs(self.timeout_secs),
            reported: false,
        }
    }

    /// The next frame of a farm.
    ///
    /// # Errors
    /// A sentence with the state of each node, if no frame comes in time.
    pub(crate) fn frame(self, farm: &mut Farm) -> anyhow::Result<Frame> {
        let mut wait = self.begin();
        loop {
            if let Some(frame) = farm.wait_frame(wait.left()) {
                return Ok(frame);
            }
            wait.check_farm("a frame", farm)?;
        }
    }
}

impl Wait {
    /// Time left until there is something to report.
    pub(crate) fn left(&self) -> Duration {
        let next = match self.reported {
            true => self.timeout,
            false => self.timeout.min(REPORT_AFTER),
        };
        next.saturating_sub(self.begun.elapsed())
    }

    /// Reports once that the wait takes long.
    ///
    /// # Errors
    /// A sentence, after the timeout.
    pub(crate) fn check(&mut self, what: &str, states: impl Fn() -> String) -> anyhow::Result<()> {
        let (waited, most) = (self.begun.elapsed(), self.timeout.as_secs());
        if waited >= self.timeout {
            bail!(
                "{what} did not come within {most} s (--timeout-secs): {}",
                states()
            );
        }
        if waited >= REPORT_AFTER && !self.reported {
            self.reported = true;
            let secs = waited.as_secs();
            eprintln!(
                "carom-bench: waiting for {what} for {secs} s, of at most {most}: {}",
                states()
            );
        }
        Ok(())
    }

    /// As [`Wait::check`], with the states of a farm's nodes.
    ///
    /// # Errors
    /// As [`Wait::check`].
    pub(crate) fn check_farm(&mut self, what: &str, farm: &Farm) -> anyhow::Result<()> {
        let begun = self.begun;
        self.check(what, || states(farm, begun))
    }
}

fn states(farm: &Farm, begun: Instant) -> String {
    let waited = begun.elapsed();
    let state = |node: &NodeStatus| format!("{} {}", node.address, node.sentence_after(waited));
    let states: Vec<String> = farm.nodes().iter().map(state).collect();
    states.join("; ")
}

/// Time without a message, the same as that of a render.
const REPORT_AFTER: Duration = Duration::from_secs(3);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_speaks_once_and_ends() {
        let mut wait = WaitArgs { timeout_secs: 5 }.begin();
        assert!(wait.left() <= REPORT_AFTER);
        wait.check("a frame", String::new).unwrap();
        assert!(!wait.reported);
        wait.begun -= REPORT_AFTER;
        wait.check("a frame", String::new).unwrap();
        assert!(wait.reported && wait.left() <= Duration::from_secs(2));
        wait.begun -= Duration::from_secs(2);
        let why = wait.check("a frame", || "oak is lost".to_owned());
        let why = why.unwrap_err().to_string();
        assert_eq!(
            why,
            "a frame did not come within 5 s (--timeout-secs): oak is lost"
        );
    }
}
