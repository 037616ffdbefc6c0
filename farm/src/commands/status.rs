//! `carom-farm status`: prints the state of each node of a farm.

use std::io::IsTerminal as _;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use carom_farm::logging::timestamp;
use carom_farm::net;
use carom_farm::{Farm, FarmConfig, LocalNode, NodeState, NodeStatus};
use carom_protocol::NodeLoad;
use serde::Serialize;

use crate::commands::{Failure, inputs};

/// Connect to every node, print its status and exit
///
/// The exit code is 0 if all nodes answer and 1 otherwise.
#[derive(clap::Args)]
pub(crate) struct StatusArgs {
    /// Read the farm's configuration from this file
    #[arg(long, default_value = "farm.toml", conflicts_with = "node")]
    farm: PathBuf,
    /// Check this node instead of those in the configuration; repeat for several
    ///
    /// dns:HOST:PORT checks a node at each address of the host, file:PATH one in each line of a file.
    #[arg(long, value_name = "HOST:PORT", value_parser = inputs::node)]
    node: Vec<String>,
    /// Read ca.pem, player.pem and player.key from this folder, for --node
    #[arg(long, default_value = ".carom", requires = "node")]
    credentials: PathBuf,
    /// Wait this many seconds for an answer
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=600))]
    timeout_secs: u64,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Stay connected and print anew each second, until Ctrl-C
    #[arg(long)]
    watch: bool,
}

#[derive(Serialize)]
struct NodeRow {
    address: String,
    state: String,
    sentence: String,
    name: Option<String>,
    device: Option<String>,
    round_trip_ms: Option<f64>,
    /// Number of other players that the node has traced for within the last second, or that wait.
    other_players: Option<u16>,
    /// Share of that second that they occupied, in percent.
    busy_percent: Option<u8>,
    protocol: Option<u16>,
}

pub(crate) fn run(args: &StatusArgs) -> Result<(), Failure> {
    let config = FarmConfig {
        local: LocalNode::None,
        ..config(args)?
    };
    let farm = Farm::new(config)?;
    let timeout = Duration::from_secs(args.timeout_secs);
    let nodes = wait(&farm, timeout);
    if args.watch {
        return watch(args, &farm, timeout);
    }
    print_all(args, &nodes, timeout)?;
    match nodes.iter().filter(|node| node.info.is_none()).count() {
        0 if nodes.is_empty() => Err(anyhow!("no directory lists a node").into()),
        0 => Ok(()),
        absent => Err(anyhow!("{absent} of {} nodes do not answer", nodes.len()).into()),
    }
}

fn print_all(args: &StatusArgs, nodes: &[NodeStatus], timeout: Duration) -> Result<(), Failure> {
    let rows: Vec<NodeRow> = nodes.iter().map(|node| row(node, timeout)).collect();
    if args.json {
        let text = serde_json::to_string(&rows).context("results as JSON")?;
        println!("{text}");
    } else {
        rows.iter().for_each(print);
    }
    Ok(())
}

/// Prints the nodes each second, in place on a terminal and successively elsewhere.
fn watch(args: &StatusArgs, farm: &Farm, timeout: Duration) -> Result<(), Failure> {
    let interrupted = net::interruption().context("Ctrl-C")?;
    let mut looked = Instant::now();
    loop {
        if std::io::stdout().is_terminal() && !args.json {
            print!("\x1b[2J\x1b[H"); // clear, home (ECMA-48)
        }
        let nodes = farm.nodes();
        if !args.json {
            let answering = nodes.iter().filter(|node| node.info.is_some()).count();
            println!(
                "{}: {answering} of {} nodes answer",
                timestamp(),
                nodes.len()
            );
        }
        print_all(args, &nodes, timeout)?;
        while looked.elapsed() < WATCH_PERIOD {
            if interrupted.load(Ordering::Relaxed) {
                return Ok(());
            }
            std::thread::sleep(POLL);
        }
        looked = Instant::now();
    }
}

fn config(args: &StatusArgs) -> Result<FarmConfig, Failure> {
    if args.node.is_empty() {
        return inputs::farm_file(&args.farm);
    }
    Ok(FarmConfig {
        nodes: args.node.clone(),
        credentials: args.credentials.clone(),
        ..FarmConfig::default()
    })
}

/// Waits until each node has answered or is lost, at most for `timeout`, and returns them.
pub(crate) fn wait(farm: &Farm, timeout: Duration) -> Vec<NodeStatus> {
    let deadline = Instant::now() + timeout;
    loop {
        let nodes = farm.nodes();
        let settled = |node: &NodeStatus| {
            node.round_trip.is_some() || matches!(node.state, NodeState::Lost { .. })
        };
        // An empty list means that no directory has answered yet.
        let settled = !nodes.is_empty() && nodes.iter().all(settled);
        if settled || Instant::now() >= deadline {
            return nodes;
        }
        std::thread::sleep(POLL);
    }
}

/// The node's state after `timeout` as a sentence, with advice if it has not answered.
pub(crate) fn sentence(node: &NodeStatus, timeout: Duration) -> String {
    match node.state {
        NodeState::Paired if node.load.players > 0 => {
            let NodeLoad {
                players,
                busy_percent,
            } = node.load;
            let others = if players == 1 { "player" } else { "players" };
            format!(
                "is connected; {players} other {others} had {busy_percent} % of its last second"
            )
        }
        _ => node.sentence_after(timeout),
    }
}

fn row(node: &NodeStatus, timeout: Duration) -> NodeRow {
    let info = node.info.as_ref();
    NodeRow {
        address: node.address.clone(),
        state: node.state.word().to_owned(),
        sentence: sentence(node, timeout),
        name: info.map(|info| info.name.clone()),
        device: info.map(|info| info.device.name.clone()),
        round_trip_ms: node.round_trip.map(|trip| 1e3 * trip.as_secs_f64()),
        other_players: info.map(|_| node.load.players),
        busy_percent: info.map(|_| node.load.busy_percent),
        // A node of another version fails the handshake of sessions and has no description.
        protocol: info.map(|_| carom_protocol::message::VERSION),
    }
}

fn print(row: &NodeRow) {
    let NodeRow {
        address,
        state,
        sentence,
        name,
        device,
        round_trip_ms,
        protocol,
        ..
    } = row;
    print!("{address} ({state}) {sentence}");
    if let (Some(name), Some(device), Some(protocol)) = (name, device, protocol) {
        print!("; {name}, {device}, protocol {protocol}");
    }
    if let Some(trip) = round_trip_ms {
        print!(", round trip {trip:.1} ms");
    }
    println!();
}

/// Period of printing with `--watch`.
const WATCH_PERIOD: Duration = Duration::from_secs(1);
/// Period of polling the nodes.
const POLL: Duration = Duration::from_millis(20);
