//! `carom-farm status`: how each node of a farm is.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context, anyhow};
use carom_farm::{Farm, FarmConfig, LocalNode, NodeState, NodeStatus};
use serde::Serialize;

use crate::commands::Failure;

/// Call each node of a farm, say how it is, and leave.
///
/// Exit code 0 if all nodes answer, 1 if one does not.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The farm's configuration.
    #[arg(long, default_value = "farm.toml", conflicts_with = "node")]
    farm: PathBuf,
    /// A node as host:port, instead of those of the configuration; may be repeated.
    #[arg(long)]
    node: Vec<String>,
    /// Folder with ca.pem, player.pem and player.key, for --node.
    #[arg(long, default_value = ".carom", requires = "node")]
    credentials: PathBuf,
    /// Seconds that a node may take to answer.
    #[arg(long, default_value_t = 3, value_parser = clap::value_parser!(u64).range(1..=600))]
    patience: u64,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Row {
    address: String,
    state: String,
    sentence: String,
    name: Option<String>,
    device: Option<String>,
    round_trip_ms: Option<f64>,
    protocol: u16,
}

pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let config = FarmConfig {
        local: LocalNode::None,
        ..config(args)?
    };
    if config.nodes.is_empty() {
        return Err(Failure::Input(format!(
            "{}: there are no nodes in it: add `nodes = [\"host:port\"]`, or name one with --node",
            args.farm.display()
        )));
    }
    let farm = Farm::new(config)?;
    let nodes = wait(&farm, Duration::from_secs(args.patience));
    let rows: Vec<Row> = nodes.iter().map(row).collect();
    if args.json {
        println!(
            "{}",
            serde_json::to_string(&rows).context("results as JSON")?
        );
    } else {
        rows.iter().for_each(print);
    }
    match nodes.iter().filter(|node| node.info.is_none()).count() {
        0 => Ok(()),
        absent => Err(anyhow!("{absent} of {} nodes do not answer", nodes.len()).into()),
    }
}

fn config(args: &Args) -> Result<FarmConfig, Failure> {
    if args.node.is_empty() {
        return Ok(FarmConfig::load(&args.farm)?);
    }
    Ok(FarmConfig {
        nodes: args.node.clone(),
        credentials: args.credentials.clone(),
        ..FarmConfig::default()
    })
}

/// The nodes when each has answered or is lost, or when the patience ends.
fn wait(farm: &Farm, patience: Duration) -> Vec<NodeStatus> {
    let deadline = Instant::now() + patience;
    loop {
        let nodes = farm.nodes();
        let settled = |node: &NodeStatus| {
            node.round_trip.is_some() || matches!(node.state, NodeState::Lost { .. })
        };
        if nodes.iter().all(settled) || Instant::now() >= deadline {
            return nodes;
        }
        std::thread::sleep(POLL);
    }
}

fn row(node: &NodeStatus) -> Row {
    let info = node.info.as_ref();
    Row {
        address: node.address.clone(),
        state: node.state.to_string(),
        sentence: node.state.sentence(),
        name: info.map(|info| info.name.clone()),
        device: info.map(|info| info.device.name.clone()),
        round_trip_ms: node.round_trip.map(|trip| 1e3 * trip.as_secs_f64()),
        protocol: carom_protocol::message::VERSION,
    }
}

fn print(row: &Row) {
    let Row {
        address,
        state,
        sentence,
        name,
        device,
        round_trip_ms,
        protocol,
    } = row;
    print!("{address} ({state}) {sentence}");
    if let (Some(name), Some(device)) = (name, device) {
        print!("; {name}, {device}, protocol {protocol}");
    }
    if let Some(trip) = round_trip_ms {
        print!(", round trip {trip:.1} ms");
    }
    println!();
}

/// Between two looks.
const POLL: Duration = Duration::from_millis(20);
