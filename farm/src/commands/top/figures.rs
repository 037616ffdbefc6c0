//! Rates of a farm's nodes, from the differences of their counters between two scrapes.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use carom_farm::health::http_get_all;
use carom_tracer::text::printable;

use super::FigureSources;
use crate::commands::Failure;

/// Rates of a node: a row of the table.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct NodeRates {
    pub(super) address: String,
    pub(super) name: String,
    pub(super) device: String,
    pub(super) state: NodeHealth,
    pub(super) players: f64,
    /// Share of the time in which its device was busy, 0 to 1.
    pub(super) busy: f64,
    /// Share of all samples of the farm, 0 to 1.
    pub(super) share: f64,
    pub(super) msamples_per_sec: f64,
    pub(super) tiles_per_sec: f64,
    /// Mean time from a request's arrival to its last tile; absent without a request.
    pub(super) response_ms: Option<f64>,
    pub(super) mbits_per_sec: f64,
}

/// State of a node.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum NodeHealth {
    #[default]
    Ready,
    Draining,
    /// It does not answer, for this reason.
    Silent(String),
}

/// Figures of all nodes at the last scrape and the one before.
pub(super) struct FarmFigures {
    sources: FigureSources,
    scrapes: BTreeMap<String, Scrape>,
    rows: Vec<NodeRates>,
}

/// Metrics of a node by name, and the time of their arrival.
#[derive(Clone, Debug)]
struct Scrape {
    at: Instant,
    metrics: BTreeMap<String, f64>,
}

impl NodeRates {
    /// The reason why it does not answer; `None` if it does.
    pub(super) fn silence(&self) -> Option<&str> {
        match &self.state {
            NodeHealth::Silent(why) => Some(why),
            NodeHealth::Ready | NodeHealth::Draining => None,
        }
    }
}

impl FarmFigures {
    pub(super) const fn new(sources: FigureSources) -> Self {
        Self {
            sources,
            scrapes: BTreeMap::new(),
            rows: Vec::new(),
        }
    }

    /// Scrapes all nodes.
    pub(super) fn look(&mut self) -> Result<(), Failure> {
        let (mut asked, mut rows) = (Vec::new(), Vec::new());
        for address in self.sources.addresses() {
            match address {
                Ok(address) => asked.push(address.to_string()),
                Err(why) => rows.push(silent("directory", &why.to_string())),
            }
        }
        asked.sort();
        asked.dedup();
        let url = |address: &String| format!("http://{address}/metrics");
        let urls: Vec<String> = asked.iter().map(url).collect();
        let answers = http_get_all(&urls, PATIENCE)?;
        for (address, answer) in asked.into_iter().zip(answers) {
            rows.push(match answer {
                Ok(text) => self.row(&address, &text, Instant::now()),
                Err(why) => {
                    self.scrapes.remove(&address);
                    silent(&address, &reason(&why))
                }
            });
        }
        set_shares(&mut rows);
        self.rows = rows;
        Ok(())
    }

    pub(super) fn rows(&self) -> Vec<NodeRates> {
        self.rows.clone()
    }

    /// The row of a node that has answered; rates are 0 at the first scrape.
    fn row(&mut self, address: &str, text: &str, at: Instant) -> NodeRates {
        let metrics = metrics(text);
        let now = Scrape { at, metrics };
        let before = self.scrapes.insert(address.to_owned(), now.clone());
        // At the first scrape all differences are 0.
        let before = before.unwrap_or_else(|| now.clone());
        let secs = (now.at - before.at).as_secs_f64().max(1e-3);
        // The counters of a restarted node begin at 0 again, and their difference may be negative.
        let grown = |name: &str| (now.value(name) - before.value(name)).max(0.0);
        let requests = grown("requests_total");
        let mean_ms = 1e3 * grown("response_seconds_total") / requests;
        let draining = now.value("draining") > 0.0;
        NodeRates {
            address: address.to_owned(),
            name: label(text, "name"),
            device: label(text, "device"),
            state: if draining {
                NodeHealth::Draining
            } else {
                NodeHealth::Ready
            },
            players: now.value("players"),
            busy: (grown("busy_seconds_total") / secs).min(1.0),
            share: 0.0,
            msamples_per_sec: 1e-6 * grown("samples_total") / secs,
            tiles_per_sec: grown("tiles_total") / secs,
            response_ms: (requests > 0.0).then_some(mean_ms),
            mbits_per_sec: 8e-6 * grown("payload_bytes_total") / secs,
        }
    }
}

impl Scrape {
    fn value(&self, name: &str) -> f64 {
        self.metrics.get(name).copied().unwrap_or(0.0)
    }
}

/// The reason of an error, without the address.
fn reason(why: &carom_farm::Error) -> String {
    match why {
        carom_farm::Error::Directory { reason, .. } => reason.clone(),
        why => why.to_string(),
    }
}

fn silent(address: &str, why: &str) -> NodeRates {
    NodeRates {
        address: address.to_owned(),
        state: NodeHealth::Silent(printable(why, REASON_BYTES_MAX)),
        ..NodeRates::default()
    }
}

fn set_shares(rows: &mut [NodeRates]) {
    let all: f64 = rows.iter().map(|row| row.msamples_per_sec).sum();
    for row in rows {
        row.share = row.msamples_per_sec / all.max(1e-12);
    }
}

/// The metrics without labels in a text in Prometheus' exposition format, by their names after `carom_node_`.
fn metrics(text: &str) -> BTreeMap<String, f64> {
    let metric = |line: &str| {
        let (name, value) = line.strip_prefix("carom_node_")?.split_once(' ')?;
        if name.contains('{') {
            return None;
        }
        let value = value.parse().ok().filter(|value: &f64| value.is_finite())?;
        Some((name.to_owned(), value))
    };
    text.lines().filter_map(metric).collect()
}

/// A label of `carom_node_info`, made printable.
fn label(text: &str, name: &str) -> String {
    let info = text
        .lines()
        .find_map(|line| line.strip_prefix("carom_node_info{"));
    let begin = format!("{name}=\"");
    let value = info.and_then(|info| info.split_once(&begin));
    let value = value.map(|(_, rest)| rest.split("\",").next().unwrap_or_default());
    let value = value
        .unwrap_or_default()
        .replace("\\\"", "\"")
        .replace("\\\\", "\\");
    printable(&value, NAME_BYTES_MAX)
}

/// Maximum wait for nodes, which answer within milliseconds.
const PATIENCE: Duration = Duration::from_secs(1);
const NAME_BYTES_MAX: usize = 64;
const REASON_BYTES_MAX: usize = 200;

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "# TYPE carom_node_tiles_total counter\n\
        carom_node_info{name=\"oak\",device=\"a \\\"fast\\\" one\",version=\"1\"} 1\n\
        carom_node_samples_total 1000000\ncarom_node_requests_total 4\ncarom_node_response_seconds_total 0.1\n\
        carom_node_busy_seconds_total 3\ncarom_node_payload_bytes_total 500000\ncarom_node_players 2\n";

    fn farm() -> FarmFigures {
        FarmFigures::new(FigureSources {
            addresses: Vec::new(),
            directories: Vec::new(),
            port: 1,
        })
    }

    #[test]
    fn rates_are_between_two_looks() {
        let mut farm = farm();
        let begun = Instant::now();
        let first = farm.row("oak:1", TEXT, begun);
        assert_eq!((first.msamples_per_sec, first.response_ms), (0.0, None));
        assert_eq!((&*first.name, &*first.device), ("oak", "a \"fast\" one"));
        let later = TEXT
            .replace("1000000", "5000000")
            .replace("total 4", "total 6")
            .replace("0.1", "0.15")
            .replace("seconds_total 3", "seconds_total 4")
            .replace("500000\n", "1000000\n");
        let row = farm.row("oak:1", &later, begun + Duration::from_secs(2));
        assert_eq!(
            (
                row.msamples_per_sec,
                row.busy,
                row.mbits_per_sec,
                row.players
            ),
            (2.0, 0.5, 2.0, 2.0)
        );
        assert!((row.response_ms.unwrap() - 25.0).abs() < 1e-6);
        // The node has restarted, with its counters at 0.
        let row = farm.row("oak:1", TEXT, begun + Duration::from_secs(3));
        assert_eq!(row.msamples_per_sec, 0.0);
    }

    #[test]
    fn shares_are_of_all_samples() {
        let row = |msamples_per_sec| NodeRates {
            msamples_per_sec,
            ..NodeRates::default()
        };
        let mut rows = [row(3.0), row(1.0), silent("elm:1", "no answer")];
        set_shares(&mut rows);
        assert_eq!(rows.map(|row| row.share), [0.75, 0.25, 0.0]);
    }

    #[test]
    fn strangers_text_is_made_printable() {
        let text =
            "carom_node_info{name=\"\x1b[2Joak\",device=\"\"} 1\ncarom_node_tiles_total NaN\n";
        assert!(!label(text, "name").contains('\x1b'));
        assert!(metrics(text).is_empty());
    }
}
