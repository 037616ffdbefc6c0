//! Monitor of a node: prints its figures each minute, ends it when idle, and keeps its directory entry up to
//! date.

use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use carom_farm::directory::{NodeRecord, Registry};
use carom_farm::health::{NodeCounters, NodeFigures};
use carom_farm::logging::LogFormat;
use carom_farm::net::StopHandle;

use crate::commands::{Failure, log_line};

/// Configuration and state of a node's monitor.
pub(crate) struct NodeMonitor {
    pub(crate) counters: Arc<NodeCounters>,
    pub(crate) stop: StopHandle,
    /// Time without work after which the node ends.
    pub(crate) idle_exit: Option<Duration>,
    pub(crate) registry: Option<Box<dyn Registry>>,
    /// The record of the node; its variable fields are updated with each registration.
    pub(crate) record: NodeRecord,
    pub(crate) log: LogFormat,
}

/// Handle of the monitor's thread.
pub(crate) struct RunningMonitor {
    wake: mpsc::Sender<()>,
    thread: JoinHandle<()>,
}

impl RunningMonitor {
    /// Wakes the monitor, so that it tells the directory that the node is about to end; does not block.
    pub(crate) fn draining(wake: &mpsc::Sender<()>) {
        let _ = wake.send(()); // it has ended by itself
    }

    pub(crate) fn wake(&self) -> mpsc::Sender<()> {
        self.wake.clone()
    }

    /// Ends the thread, which removes the node from the directory.
    pub(crate) fn end(self) {
        drop(self.wake);
        let _ = self.thread.join(); // a panic has been reported where it happened
    }
}

impl NodeMonitor {
    pub(crate) fn start(mut self) -> Result<RunningMonitor, Failure> {
        let (wake, woken) = mpsc::channel();
        let thread = std::thread::Builder::new()
            .name("carom-monitor".into())
            .spawn(move || self.run(&woken))
            .context("a thread for the node's figures")?;
        Ok(RunningMonitor { wake, thread })
    }

    fn run(&mut self, woken: &mpsc::Receiver<()>) {
        let start = Instant::now();
        let (mut line, mut record) = (Window::at(start), Window::at(start));
        let (mut registration, mut reported) = (start, false);
        loop {
            let figures = self.counters.figures();
            let now = Instant::now();
            if now >= line.begun + LINE_PERIOD {
                self.print_line(&line.before, &figures, now - line.begun);
                line = Window {
                    begun: now,
                    before: figures,
                };
            }
            if let Some(limit) = self.idle_exit
                && figures.idle >= limit
                && !figures.draining
            {
                let secs = limit.as_secs();
                log_line::print(self.log, &format!("idle for {secs} s: the node ends"));
                self.stop.stop();
                self.idle_exit = None;
            }
            // The beginning of draining is registered at once.
            if now >= registration || figures.draining != self.record.draining {
                registration = now + self.register(&record, &figures, &mut reported);
                record = Window {
                    begun: now,
                    before: figures,
                };
            }
            match woken.recv_timeout(LOOK_PERIOD) {
                Ok(()) | Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
        }
        if let Some(registry) = &mut self.registry
            && let Err(why) = registry.leave(&self.record)
        {
            tracing::warn!("{why}");
        }
    }

    /// Registers the record and returns the pause until the next registration.
    fn register(
        &mut self,
        window: &Window,
        figures: &NodeFigures,
        reported: &mut bool,
    ) -> Duration {
        let Some(registry) = &mut self.registry else {
            return LINE_PERIOD;
        };
        let record = &mut self.record;
        record.draining = figures.draining;
        record.load = figures.load_since(&window.before, window.begun.elapsed());
        if let Some(speed) = figures.msamples_per_sec_since(&window.before) {
            record.msamples_per_sec = speed;
        }
        match registry.register(record) {
            Ok(()) => *reported = false,
            // Current players are not affected; the same fault is logged once.
            Err(why) if !*reported => {
                *reported = true;
                tracing::warn!("{why}; this is tried again");
            }
            Err(_) => {}
        }
        registry.period()
    }

    /// Prints the figures of a period, unless there were no players and no traffic in it.
    fn print_line(&self, before: &NodeFigures, now: &NodeFigures, period: Duration) {
        if now.players == 0 && now.sent_bytes == before.sent_bytes {
            return;
        }
        let secs = period.as_secs_f64();
        let tiles = (now.tiles - before.tiles) as f64 / secs;
        let mbits = (now.sent_bytes - before.sent_bytes) as f64 * 8e-6 / secs;
        let busy = 100.0 * now.load_since(before, period);
        let speed = now.msamples_per_sec_since(before).unwrap_or(0.0);
        let players = now.players;
        log_line::print(
            self.log,
            &format!(
                "figures: {players} players, busy {busy:.0} %, {tiles:.1} tiles/s, \
                 {speed:.2} Msample/s, {mbits:.2} Mbit/s"
            ),
        );
    }
}

/// Interval over which figures are counted.
struct Window {
    begun: Instant,
    before: NodeFigures,
}

impl Window {
    fn at(begun: Instant) -> Self {
        let before = NodeFigures::default();
        Self { begun, before }
    }
}

const LINE_PERIOD: Duration = Duration::from_secs(60);
/// Period in which the figures are evaluated.
const LOOK_PERIOD: Duration = Duration::from_secs(1);
