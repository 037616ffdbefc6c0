//! `carom-farm top`: a terminal table of a farm's nodes, from the metrics that they expose to their operator.
//!
//! ```text
//! directories ──hosts──▶ http://HOST:8433/metrics of each ──▶ rates since the last look ──▶ table
//! ```
//!
//! The metrics of a node cover all its players together, require no player's key and occupy no player's
//! place; `carom-farm status --watch` shows the nodes from one player's view.

mod figures;
mod view;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use carom_farm::directory::{Directory, NodeSource};
use carom_farm::net::NodeAddress;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};

use self::figures::FarmFigures;
use crate::commands::{Failure, inputs};

/// Show nodes, shares, response times and bytes in the terminal; q ends it
///
/// Asks each node that runs with --health for its figures: all its players' together, without a key.
#[derive(clap::Args)]
pub(crate) struct TopArgs {
    /// Read the farm's configuration from this file
    #[arg(long, default_value = "farm.toml", conflicts_with_all = ["node", "health"])]
    farm: PathBuf,
    /// Show this node, or those of this directory, instead; repeat for several
    #[arg(long, value_name = "HOST:PORT", value_parser = inputs::node)]
    node: Vec<String>,
    /// Ask them at this port
    #[arg(long, default_value_t = 8433, value_parser = clap::value_parser!(u16).range(1..))]
    health_port: u16,
    /// Ask at this address; repeat for several
    #[arg(long, value_name = "HOST:PORT")]
    health: Vec<NodeAddress>,
    /// Ask every this many seconds
    #[arg(long, default_value_t = 1, value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..=3600))]
    interval_secs: u64,
    /// Print the figures of one interval as text, and end: with exit code 0 if all nodes answer, 1 otherwise
    #[arg(long)]
    once: bool,
}

pub(crate) fn run(args: &TopArgs) -> Result<(), Failure> {
    let mut farm = FarmFigures::new(args.sources()?);
    let interval = Duration::from_secs(args.interval_secs);
    farm.look()?;
    if args.once {
        std::thread::sleep(interval);
        farm.look()?;
        let rows = farm.rows();
        print!("{}", view::text(&rows));
        return match rows.iter().filter(|row| row.silence().is_some()).count() {
            0 if rows.is_empty() => Err(anyhow!("no directory lists a node").into()),
            0 => Ok(()),
            silent => Err(anyhow!(
                "{silent} of {} nodes do not answer: check that they run with --health, at the port of \
                 --health-port, and that firewalls let it through",
                rows.len()
            )
            .into()),
        };
    }
    let mut terminal = ratatui::try_init().context("the terminal")?;
    let shown = show(&mut terminal, &mut farm, interval);
    ratatui::restore();
    shown
}

fn show(
    terminal: &mut ratatui::DefaultTerminal,
    farm: &mut FarmFigures,
    interval: Duration,
) -> Result<(), Failure> {
    let mut first_row = 0;
    loop {
        let looked = Instant::now();
        let rows = farm.rows();
        first_row = first_row.min(rows.len().saturating_sub(1));
        loop {
            let drawn = terminal.draw(|frame| view::draw(frame, &rows, first_row));
            drawn.context("the terminal")?;
            let left = interval.saturating_sub(looked.elapsed());
            if !event::poll(left).context("the terminal")? {
                break;
            }
            match event::read().context("the terminal")? {
                Event::Key(key) if key.kind == KeyEventKind::Press => match key.code {
                    KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                    KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => {
                        return Ok(());
                    }
                    KeyCode::Down => first_row = (first_row + 1).min(rows.len().saturating_sub(1)),
                    KeyCode::Up => first_row = first_row.saturating_sub(1),
                    _ => {}
                },
                _ => {}
            }
        }
        farm.look()?;
    }
}

/// Sources of figures: addresses, and directories whose hosts are queried at a common port.
struct FigureSources {
    addresses: Vec<NodeAddress>,
    directories: Vec<Box<dyn Directory>>,
    port: u16,
}

impl TopArgs {
    fn sources(&self) -> Result<FigureSources, Failure> {
        let configured = match (&self.node[..], &self.health[..]) {
            ([], []) => inputs::farm_file(&self.farm)?.nodes,
            (nodes, _) => nodes.to_vec(),
        };
        let open = |text: &String| text.parse::<NodeSource>()?.open();
        let directories: Result<_, carom_farm::Error> = configured.iter().map(open).collect();
        Ok(FigureSources {
            addresses: self.health.clone(),
            directories: directories?,
            port: self.health_port,
        })
    }
}

impl FigureSources {
    /// The addresses to query now; an error for each directory that does not answer.
    fn addresses(&mut self) -> Vec<Result<NodeAddress, carom_farm::Error>> {
        let mut addresses: Vec<_> = self.addresses.iter().cloned().map(Ok).collect();
        for directory in &mut self.directories {
            match directory.nodes() {
                Ok(nodes) => {
                    let hosts = nodes.into_iter().map(|node| node.address);
                    addresses.extend(hosts.map(|host| Ok(host.with_port(self.port))));
                }
                Err(why) => addresses.push(Err(why)),
            }
        }
        addresses
    }
}
