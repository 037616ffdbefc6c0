//! The client of a farm of processes, which are changed while it asks for frames.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use carom_farm::{Farm, Frame, FrameSpec, NodeStatus, Pixels};
use carom_testkit::simulator::SimulationReport;
use carom_tracer::ImageSize;

use super::process::{NodeAction, NodeProcess, ScheduledAction};
use crate::wait::WaitArgs;
use crate::{BenchError, scenes};

/// Number of different frames: consecutive ones differ, so that none costs less for being like the one
/// before.
const SEEDS: u64 = 4;

/// Requested frames, and their expected pixels.
pub(super) struct ExpectedFrames {
    size: ImageSize,
    samples: u32,
    right: Vec<Pixels>,
}

impl ExpectedFrames {
    /// Traces the expected pixels with `farm`.
    pub(super) fn new(
        farm: &mut Farm,
        size: ImageSize,
        samples: u32,
        wait: WaitArgs,
    ) -> Result<Self, BenchError> {
        let mut pictures = Self {
            size,
            samples,
            right: Vec::new(),
        };
        for frame in 0..SEEDS {
            farm.submit(pictures.spec(frame))?;
            let frame = wait.frame(farm)?;
            pictures.right.push(frame.pixels);
        }
        Ok(pictures)
    }

    fn spec(&self, frame: u64) -> FrameSpec {
        scenes::frame(self.size, self.samples, (frame % SEEDS) as u32)
    }

    fn is_right(&self, frame: &Frame) -> bool {
        self.right[(frame.id.0 % SEEDS) as usize] == frame.pixels
    }
}

/// A run of frames.
pub(super) struct ClusterPlayer<'a> {
    pub(super) farm: Farm,
    pub(super) nodes: &'a mut [NodeProcess],
    pub(super) pictures: &'a ExpectedFrames,
    pub(super) interrupted: &'a AtomicBool,
    pub(super) wait: WaitArgs,
}

/// Rate of the requests for frames.
#[derive(Clone, Copy)]
pub(super) struct SubmissionPace {
    pub(super) frames: u64,
    pub(super) frames_in_flight: usize,
    /// Interval between submissions; absent: as soon as there is room.
    pub(super) period: Option<Duration>,
}

impl ClusterPlayer<'_> {
    /// Waits until the first `count` nodes hold the scene.
    pub(super) fn wait_ready(&self, count: usize) -> Result<(), BenchError> {
        let mut wait = self.wait.begin();
        let is_ready = |node: &NodeStatus| node.state.is_ready();
        while self
            .farm
            .nodes()
            .iter()
            .filter(|node| is_ready(node))
            .count()
            < count
        {
            if self.interrupted.load(Ordering::Relaxed) {
                return Err(BenchError::Interrupted);
            }
            wait.check_farm("the nodes", &self.farm)?;
            std::thread::sleep(POLL);
        }
        Ok(())
    }

    /// Plays the frames; returns the report, and the changes with the frames at which they took effect.
    pub(super) fn play(
        &mut self,
        pace: SubmissionPace,
        changes: &[ScheduledAction],
    ) -> Result<(SimulationReport, Vec<ScheduledAction>), BenchError> {
        let mut report = SimulationReport {
            tiles_per_frame: 1,
            ..SimulationReport::default()
        };
        let mut happened = Vec::new();
        let mut joining = Vec::new();
        let began = Instant::now();
        let (mut submitted, mut slot) = (0, 0);
        while (report.frames.len() as u64) < pace.frames {
            if self.interrupted.load(Ordering::Relaxed) {
                return Err(BenchError::Interrupted);
            }
            self.note_joins(submitted, &mut joining, &mut happened);
            let due = pace.period.map(|period| began + period * slot);
            if submitted < pace.frames && due.is_none_or(|due| Instant::now() >= due) {
                slot += 1;
                if self.farm.in_flight() < pace.frames_in_flight {
                    for change in changes.iter().filter(|change| change.frame == submitted) {
                        self.change(*change, &mut joining, &mut happened)?;
                    }
                    self.farm.submit(self.pictures.spec(submitted))?;
                    submitted += 1;
                } else if due.is_some() {
                    report.skipped += 1;
                }
            }
            let next = pace.period.map(|period| began + period * slot);
            self.take(next, pace, submitted, &mut report)?;
        }
        report.secs = began.elapsed().as_secs_f64();
        report.nodes = self.farm.nodes();
        Ok((report, happened))
    }

    /// Takes a frame, if one arrives until `next`, when another one is to be submitted.
    fn take(
        &mut self,
        next: Option<Instant>,
        pace: SubmissionPace,
        submitted: u64,
        report: &mut SimulationReport,
    ) -> anyhow::Result<()> {
        let full = self.farm.in_flight() >= pace.frames_in_flight || submitted == pace.frames;
        let patience = match next {
            Some(next) if submitted < pace.frames => next.saturating_duration_since(Instant::now()),
            _ if full => {
                let frame = self.wait.frame(&mut self.farm)?;
                self.note(frame, report);
                return Ok(());
            }
            _ => Duration::ZERO,
        };
        let before = Instant::now();
        match self.farm.wait_frame(patience) {
            Some(frame) => self.note(frame, report),
            None => std::thread::sleep(patience.saturating_sub(before.elapsed())),
        }
        Ok(())
    }

    fn note(&self, mut frame: Frame, report: &mut SimulationReport) {
        report.wrong_frames += u64::from(!self.pictures.is_right(&frame));
        frame.pixels = Pixels::Linear(Vec::new());
        let tiles: u32 = frame.stats.tiles_by_node.iter().sum();
        report.tiles_per_frame = tiles;
        // Tiles that arrived twice were traced twice; those that were cancelled in time were not.
        report.tiles_traced += u64::from(tiles + frame.stats.duplicate_tiles);
        report.frames.push(frame);
    }

    fn change(
        &mut self,
        change: ScheduledAction,
        joining: &mut Vec<ScheduledAction>,
        happened: &mut Vec<ScheduledAction>,
    ) -> Result<(), BenchError> {
        let node = &mut self.nodes[change.node];
        if change.action == NodeAction::Join {
            self.farm.add_node(&node.address())?;
            joining.push(change);
        } else {
            node.act(change.action)?;
            happened.push(change);
        }
        Ok(())
    }

    /// Records nodes that have joined: a node joins when it is ready, a few round trips after it has
    /// been called.
    fn note_joins(
        &self,
        frame: u64,
        joining: &mut Vec<ScheduledAction>,
        happened: &mut Vec<ScheduledAction>,
    ) {
        if joining.is_empty() {
            return;
        }
        let states = self.farm.nodes();
        joining.retain(|change| {
            let address = self.nodes[change.node].address();
            let is_ready = |node: &NodeStatus| node.address == address && node.state.is_ready();
            let joined = states.iter().any(is_ready);
            if joined {
                happened.push(ScheduledAction { frame, ..*change });
            }
            !joined
        });
    }
}

const POLL: Duration = Duration::from_millis(5);
