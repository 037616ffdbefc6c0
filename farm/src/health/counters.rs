//! Counters of a node since its start.

use std::fmt::Write as _;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use carom_protocol::{NodeInfo, RequestReport};

use crate::lock::lock;

/// Counters of a node, updated by all its parts.
#[derive(Debug, Default)]
pub struct NodeCounters {
    pub(super) tiles: AtomicU64,
    pub(super) samples: AtomicU64,
    pub(super) dropped_samples: AtomicU64,
    sent_bytes: AtomicU64,
    requests: AtomicU64,
    response_micros: AtomicU64,
    players: AtomicU64,
    draining: AtomicBool,
    device: Mutex<DeviceUse>,
}

/// Busy time of the device: calls that overlap are not counted twice.
#[derive(Debug)]
struct DeviceUse {
    calls: u32,
    /// When the number of calls last changed from or to zero.
    since: Instant,
    busy: Duration,
}

/// Snapshot of a node's counters; all but players, draining and idle only increase.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NodeFigures {
    /// Tiles traced.
    pub tiles: u64,
    /// Pixel samples traced.
    pub samples: u64,
    /// Samples that were not finite and count as black.
    pub dropped_samples: u64,
    /// Bytes passed to the network.
    pub sent_bytes: u64,
    /// Requests answered.
    pub requests: u64,
    /// Sum of the times from a request's arrival until its last tile was encoded.
    pub response: Duration,
    /// Time the device was busy.
    pub busy: Duration,
    /// Current connections of players.
    pub players: u64,
    /// Whether the node is shutting down.
    pub draining: bool,
    /// Time since the device was last busy, or since the start; zero while it is busy.
    pub idle: Duration,
}

impl Default for DeviceUse {
    fn default() -> Self {
        Self {
            calls: 0,
            since: Instant::now(),
            busy: Duration::ZERO,
        }
    }
}

impl NodeCounters {
    /// Counts bytes passed to the network.
    pub fn count_sent(&self, bytes: usize) {
        self.sent_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Counts an answered request by its report.
    pub fn count_request(&self, report: &RequestReport) {
        let stages = [
            report.queue_micros,
            report.trace_micros,
            report.encode_micros,
        ];
        let micros = stages.into_iter().map(u64::from).sum();
        self.requests.fetch_add(1, Ordering::Relaxed);
        self.response_micros.fetch_add(micros, Ordering::Relaxed);
    }

    /// Counts a player's connection.
    pub fn player_came(&self) {
        self.players.fetch_add(1, Ordering::Relaxed);
    }

    /// Counts the end of a player's connection.
    pub fn player_left(&self) {
        self.players.fetch_sub(1, Ordering::Relaxed);
    }

    /// Marks the node as shutting down.
    pub fn drain(&self) {
        self.draining.store(true, Ordering::Relaxed);
    }

    /// The current values.
    pub fn figures(&self) -> NodeFigures {
        let (busy, idle) = {
            let device = lock(&self.device);
            let since = device.since.elapsed();
            match device.calls {
                0 => (device.busy, since),
                _ => (device.busy + since, Duration::ZERO),
            }
        };
        let of = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        NodeFigures {
            tiles: of(&self.tiles),
            samples: of(&self.samples),
            dropped_samples: of(&self.dropped_samples),
            sent_bytes: of(&self.sent_bytes),
            requests: of(&self.requests),
            response: Duration::from_micros(of(&self.response_micros)),
            busy,
            players: of(&self.players),
            draining: self.draining.load(Ordering::Relaxed),
            idle,
        }
    }

    pub(super) fn device_begins(&self) {
        let mut device = lock(&self.device);
        if device.calls == 0 {
            device.since = Instant::now();
        }
        device.calls += 1;
    }

    pub(super) fn device_ends(&self) {
        let mut device = lock(&self.device);
        device.calls -= 1;
        if device.calls == 0 {
            let now = Instant::now();
            let since = device.since;
            device.busy += now.saturating_duration_since(since);
            device.since = now;
        }
    }
}

impl NodeFigures {
    /// The busy share of the device over `period`, 0 to 1; `before` are the values at its start.
    pub fn load_since(&self, before: &Self, period: Duration) -> f64 {
        let busy = self.busy.saturating_sub(before.busy);
        (busy.as_secs_f64() / period.as_secs_f64().max(1e-9)).min(1.0)
    }

    /// Speed over the device's busy time since `before`, in millions of pixel samples per second; `None` if
    /// it was not busy.
    pub fn msamples_per_sec_since(&self, before: &Self) -> Option<f64> {
        let busy = self.busy.saturating_sub(before.busy).as_secs_f64();
        let samples = self.samples.saturating_sub(before.samples) as f64;
        (busy > 0.0 && samples > 0.0).then(|| 1e-6 * samples / busy)
    }

    /// The values in Prometheus' text format, named as in the game's statistics.
    pub fn prometheus(&self, info: &NodeInfo) -> String {
        let mut text = String::new();
        let version = env!("CARGO_PKG_VERSION");
        let (name, device) = (label(&info.name), label(&info.device.name));
        let _ = writeln!(
            text,
            "# HELP carom_node_info The node's name, device and version.\n\
             # TYPE carom_node_info gauge\n\
             carom_node_info{{name=\"{name}\",device=\"{device}\",version=\"{version}\"}} 1"
        );
        for (name, help, value) in self.metrics() {
            // Prometheus' convention: names of counters end in `_total`.
            let kind = if name.ends_with("_total") {
                "counter"
            } else {
                "gauge"
            };
            let _ = writeln!(
                text,
                "# HELP carom_node_{name} {help}\n# TYPE carom_node_{name} {kind}\n\
                 carom_node_{name} {value}"
            );
        }
        text
    }

    /// Name, description and value of each metric.
    #[rustfmt::skip]
    fn metrics(&self) -> [(&'static str, &'static str, f64); 10] {
        let (busy, idle) = (self.busy.as_secs_f64(), self.idle.as_secs_f64());
        [
            ("tiles_total", "Tiles traced.", self.tiles as f64),
            ("samples_total", "Pixel samples traced.", self.samples as f64),
            ("dropped_samples_total", "Samples that were not finite.", self.dropped_samples as f64),
            ("payload_bytes_total", "Bytes handed to the network.", self.sent_bytes as f64),
            ("requests_total", "Requests answered.", self.requests as f64),
            ("response_seconds_total", "From requests' arrival to their last tile.", self.response.as_secs_f64()),
            ("busy_seconds_total", "Time the device was busy.", busy),
            ("idle_seconds", "Time since the device was busy.", idle),
            ("players", "Connections of players.", self.players as f64),
            ("draining", "1 once the node is about to end.", f64::from(u8::from(self.draining))),
        ]
    }
}

/// A label's value (Prometheus' exposition format: `\`, `"` and line feeds are escaped).
fn label(text: &str) -> String {
    text.replace('\\', "\\\\")
        .replace('"', "\\\"")
        .replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use carom_tracer::{DeviceInfo, DeviceKind};

    use super::*;

    #[test]
    fn calls_that_overlap_are_busy_once() {
        let counters = NodeCounters::default();
        counters.device_begins();
        counters.device_begins();
        std::thread::sleep(Duration::from_millis(20));
        assert_eq!(counters.figures().idle, Duration::ZERO);
        counters.device_ends();
        counters.device_ends();
        let begun = Instant::now();
        let busy = counters.figures().busy;
        std::thread::sleep(Duration::from_millis(5));
        let after = counters.figures();
        assert_eq!(after.busy, busy);
        assert!(busy >= Duration::from_millis(20), "{busy:?}");
        assert!(after.idle >= Duration::from_millis(5) && after.idle <= begun.elapsed() * 2);
    }

    #[test]
    fn figures_are_in_prometheus_text_format() {
        let counters = NodeCounters::default();
        counters.count_sent(1500);
        counters.player_came();
        counters.drain();
        counters.count_request(&RequestReport {
            queue_micros: 100,
            trace_micros: 2000,
            encode_micros: 400,
            ..RequestReport::default()
        });
        let device = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "a \"fast\" one".into(),
            width: 1,
            threads: 1,
        };
        let name = "oak".into();
        let text = counters.figures().prometheus(&NodeInfo {
            name,
            instance: 0,
            device,
        });
        for line in [
            "carom_node_payload_bytes_total 1500",
            "carom_node_players 1",
            "carom_node_requests_total 1",
            "carom_node_response_seconds_total 0.0025",
            "carom_node_draining 1",
            "# TYPE carom_node_tiles_total counter",
        ] {
            assert!(text.lines().any(|found| found == line), "{line}: {text}");
        }
        assert!(text.contains("device=\"a \\\"fast\\\" one\""), "{text}");
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            let (_, value) = line.rsplit_once(' ').unwrap();
            value.parse::<f64>().unwrap();
        }
    }
}
