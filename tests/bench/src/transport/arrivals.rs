//! Arrival times of the messages of each frame.

use std::collections::BTreeMap;
use std::sync::mpsc::RecvTimeoutError;
use std::time::{Duration, Instant};

use anyhow::anyhow;
use carom_farm::net::LinkEvent;
use carom_protocol::session::ClientEvent;

use super::{
    Args, FRAMES_PER_SECOND, LinkCase, NoiseTracer, PERIOD, START, TransportRow, TransportSetup,
};
use crate::BenchError;
use crate::timing::quantiles;

/// Record of the arrived messages.
#[derive(Default)]
pub(super) struct Arrivals {
    pub(super) requested: Vec<Instant>,
    /// Frame and time in milliseconds of each message.
    times: Vec<(u64, f64)>,
    /// Arrivals by frame.
    came: BTreeMap<u64, FrameArrivals>,
}

/// Arrived parts of a frame.
#[derive(Default)]
struct FrameArrivals {
    messages: u32,
    tiles: u32,
    bytes: usize,
    /// Time of decoding.
    decoding: Duration,
}

impl Arrivals {
    /// Takes events until `due`.
    pub(super) fn collect(
        &mut self,
        setup: &TransportSetup,
        case: &LinkCase,
        due: Instant,
    ) -> Result<(), BenchError> {
        loop {
            let left = due.saturating_duration_since(Instant::now());
            let (at, events) = match setup.events.recv_timeout(left) {
                Ok(events) => events,
                Err(RecvTimeoutError::Timeout) => return Ok(()),
                Err(RecvTimeoutError::Disconnected) => return Err(anyhow!("the link ended").into()),
            };
            for event in events {
                self.take(setup, case, at, event)?;
            }
        }
    }

    fn take(
        &mut self,
        setup: &TransportSetup,
        case: &LinkCase,
        at: Instant,
        event: LinkEvent,
    ) -> Result<(), BenchError> {
        let (frame, tiles, bytes) = match event {
            LinkEvent::Session(ClientEvent::Tiles {
                frame,
                tiles,
                payload_bytes,
                ..
            }) => (frame.0, tiles, payload_bytes),
            // A frame has one request, which has the frame's number.
            LinkEvent::Decoded { request, took } => {
                self.came.entry(request.0).or_default().decoding += took;
                return Ok(());
            }
            LinkEvent::Lost { why, .. } => {
                return Err(anyhow!("the link was lost: {why}").into());
            }
            _ => return Ok(()),
        };
        let came = self.came.entry(frame).or_default();
        came.messages += 1;
        came.tiles += tiles.count;
        came.bytes += bytes;
        let since = match case.path {
            None if came.tiles < NoiseTracer::grid().len() => None,
            None => self.requested.get(frame as usize).copied(),
            Some(_) => setup.noise.handed_over(frame as u32, tiles),
        };
        let since = since.map(|since| match case.ready {
            true => since + came.decoding,
            false => since,
        });
        if let Some(since) = since {
            let ms = at.saturating_duration_since(since).as_secs_f64() * 1e3;
            self.times.push((frame, ms));
        }
        Ok(())
    }

    pub(super) fn row(&self, args: &Args, case: &LinkCase, sender: &'static str) -> TransportRow {
        let frames = args.seconds * FRAMES_PER_SECOND;
        let times = self.times.iter().filter(|(frame, _)| *frame >= START);
        let [p50_ms, p99_ms] = quantiles(times.map(|(_, ms)| *ms), [0.5, 0.99]);
        let came = self.came.range(START..);
        let messages: u32 = came.clone().map(|(_, came)| came.messages).sum();
        let bytes: usize = came.map(|(_, came)| came.bytes).sum();
        let frames = (frames - START) as f64;
        let asked = frames * f64::from(NoiseTracer::MESSAGES);
        TransportRow {
            path: case.name,
            sender,
            precision: if case.governed { "governed" } else { "exact" },
            p50_ms,
            p99_ms,
            queue_p99_ms: None,
            start_slow_frames: self.start_slow_frames(case),
            missing_percent: 100.0 * (1.0 - f64::from(messages) / asked),
            mbit_per_second: 8e-6 * bytes as f64 / (frames * PERIOD.as_secs_f64()),
        }
    }

    fn start_slow_frames(&self, case: &LinkCase) -> usize {
        let delay = case.path.map_or(Duration::ZERO, |path| path.delay);
        let late_ms = (delay + 2 * PERIOD).as_secs_f64() * 1e3;
        let is_slow = |frame: &u64| {
            let tiles = self.came.get(frame).map_or(0, |came| came.tiles);
            let mut times = self.times.iter().filter(|(of, _)| of == frame);
            tiles < NoiseTracer::grid().len() || times.any(|(_, ms)| *ms > late_ms)
        };
        (0..START).filter(is_slow).count()
    }
}
