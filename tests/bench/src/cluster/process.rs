//! A node in a process of its own, behind an emulated link of its own.

use std::io::{BufRead, BufReader, Write as _};
use std::net::{Ipv4Addr, SocketAddr};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::str::FromStr;
use std::time::Duration;

use anyhow::{Context, bail};
use carom_farm::net::{add_node, create_farm};
use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};
use tempfile::TempDir;

use crate::{BenchError, ValueError};

/// Specification of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct NodeSpec {
    /// Share of one thread of this machine, above 0 and at most 1.
    pub(crate) share: f64,
    /// Round trip without jitter, in seconds.
    pub(crate) round_trip_secs: f64,
}

/// Reads `SHARE@MS`.
impl FromStr for NodeSpec {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let parts = text.split_once('@');
        let numbers = parts.map(|(share, millis)| (share.parse(), millis.parse::<f64>()));
        let Some((Ok(share), Ok(millis))) = numbers else {
            return Err(ValueError::Form("SHARE@MS, as in 0.25@46"));
        };
        if !(0.0..=10_000.0).contains(&millis) {
            return Err(ValueError::RoundTrip { millis });
        }
        Ok(Self {
            share: checked_share(share)?,
            round_trip_secs: 1e-3 * millis,
        })
    }
}

/// A change of a node.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum NodeAction {
    /// Its process ends at once, without a message.
    Kill,
    /// Its process is stopped, and its connection stays.
    Stop,
    /// Its process continues.
    Go,
    /// It traces in another share of its thread's time.
    Throttle(f64),
    /// The client calls it for the first time.
    Join,
}

/// A change of a node at the submission of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ScheduledAction {
    pub(crate) frame: u64,
    pub(crate) node: usize,
    pub(crate) action: NodeAction,
}

/// Reads `FRAME:NODE:ACTION`.
impl FromStr for ScheduledAction {
    type Err = ValueError;

    fn from_str(text: &str) -> Result<Self, ValueError> {
        let wrong = || {
            ValueError::Form(
                "FRAME:NODE:ACTION, of which ACTION is kill, stop, go, join or throttle=SHARE, as in \
                 200:0:throttle=0.1",
            )
        };
        let parts: Vec<&str> = text.split(':').collect();
        let [frame, node, action] = parts[..] else {
            return Err(wrong());
        };
        let action = match action {
            "kill" => NodeAction::Kill,
            "stop" => NodeAction::Stop,
            "go" => NodeAction::Go,
            "join" => NodeAction::Join,
            action => {
                let share = action.strip_prefix("throttle=").ok_or_else(wrong)?;
                let share = share.parse().map_err(|_| wrong())?;
                NodeAction::Throttle(checked_share(share)?)
            }
        };
        Ok(Self {
            frame: frame.parse().map_err(|_| wrong())?,
            node: node.parse().map_err(|_| wrong())?,
            action,
        })
    }
}

fn checked_share(share: f64) -> Result<f64, ValueError> {
    let fits = share > 0.0 && share <= 1.0;
    fits.then_some(share).ok_or(ValueError::Share { share })
}

/// Folder with a farm's certificates; deleted when dropped.
pub(crate) fn farm_folder() -> Result<TempDir, BenchError> {
    let folder = tempfile::tempdir().context("a folder for certificates")?;
    create_farm(folder.path())?;
    Ok(folder)
}

/// A node as a process of this machine; killed when dropped.
pub(crate) struct RunningProcess {
    process: Child,
    pub(crate) address: SocketAddr,
}

impl RunningProcess {
    /// Starts the node `index` with this many threads and a share of their time, with certificates of
    /// the farm in `folder`.
    pub(crate) fn start(
        folder: &Path,
        index: usize,
        threads: u16,
        share: f64,
    ) -> anyhow::Result<Self> {
        let credentials = add_node(folder, &format!("node{index}"), None, true)?;
        let program = std::env::current_exe().context("where this program is")?;
        let process = Command::new(program)
            .args(["node", "--listen", "127.0.0.1:0", "--stdin-control"])
            .args(["--backend", "cpu", "--threads", &threads.to_string()])
            .args(["--throttle", &share.to_string()])
            .arg("--credentials")
            .arg(credentials)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("a node's process")?;
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let mut started = Self {
            process,
            address: any,
        };
        started.address = listening(&mut started.process)?;
        Ok(started)
    }
}

impl Drop for RunningProcess {
    fn drop(&mut self) {
        let _ = self.process.kill(); // it may have ended already
        let _ = self.process.wait();
    }
}

/// A node and the emulated link to it.
pub(crate) struct NodeProcess {
    node: RunningProcess,
    proxy: UdpProxy,
}

impl NodeProcess {
    /// Starts the node `index` with one thread, with certificates of the farm in `folder`, over a link
    /// as in `path` except for the delay.
    pub(crate) fn start(
        folder: &Path,
        index: usize,
        spec: &NodeSpec,
        path: LinkConfig,
        seed: u64,
    ) -> anyhow::Result<Self> {
        let node = RunningProcess::start(folder, index, 1, spec.share)?;
        let path = LinkConfig {
            delay: Duration::from_secs_f64(0.5 * spec.round_trip_secs),
            ..path
        };
        let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        let proxy = UdpProxy::start(
            any,
            node.address,
            path,
            seed.wrapping_add(1000 * index as u64),
        );
        Ok(Self {
            node,
            proxy: proxy.context("a node's proxy")?,
        })
    }

    /// Address at which it is called.
    pub(crate) fn address(&self) -> String {
        self.proxy.local_addr().to_string()
    }

    /// Applies a change to the process; [`NodeAction::Join`] is up to the client.
    pub(crate) fn act(&mut self, action: NodeAction) -> anyhow::Result<()> {
        match action {
            NodeAction::Kill => self.node.process.kill().context("ending a node"),
            NodeAction::Stop => self.signal("STOP"),
            NodeAction::Go => self.signal("CONT"),
            NodeAction::Throttle(share) => {
                let commands = self
                    .node
                    .process
                    .stdin
                    .as_mut()
                    .context("a node's commands")?;
                writeln!(commands, "throttle {share}").context("a command to a node")
            }
            NodeAction::Join => Ok(()),
        }
    }

    fn signal(&self, name: &str) -> anyhow::Result<()> {
        let id = self.node.process.id().to_string();
        let sent = Command::new("kill").args(["-s", name, &id]).status();
        if !sent.context("the program `kill`")?.success() {
            bail!("node process {id} cannot be sent {name}");
        }
        Ok(())
    }
}

/// The address that a node prints when it listens.
fn listening(process: &mut Child) -> anyhow::Result<SocketAddr> {
    let stdout = process.stdout.take().context("a node's output")?;
    for line in BufReader::new(stdout).lines() {
        let line = line.context("a node's output")?;
        if line.starts_with("listening") {
            let address = line.rsplit(' ').next().unwrap_or_default();
            return address
                .parse()
                .with_context(|| format!("an address in `{line}`"));
        }
    }
    bail!("a node ended before it listened")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_and_events_are_parsed_or_refused() {
        let node: NodeSpec = "0.25@46".parse().unwrap();
        assert_eq!((node.share, node.round_trip_secs), (0.25, 0.046));
        for wrong in ["", "1", "0@1", "1.5@1", "0.5@-1", "a@b", "0.5@NaN", "NaN@1"] {
            assert!(wrong.parse::<NodeSpec>().is_err(), "{wrong}");
        }
        let change: ScheduledAction = "20:3:throttle=0.5".parse().unwrap();
        assert_eq!((change.frame, change.node), (20, 3));
        assert_eq!(change.action, NodeAction::Throttle(0.5));
        for wrong in [
            "",
            "1:2",
            "1:2:burn",
            "1:2:throttle=0",
            "-1:2:kill",
            "1:2:kill:3",
        ] {
            assert!(wrong.parse::<ScheduledAction>().is_err(), "{wrong}");
        }
    }
}
