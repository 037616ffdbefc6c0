//! How much may be on its way to a player at once: a window that follows delay, not loss.
//!
//! FAST TCP (Wei, Jin, Low and Hegde, IEEE/ACM Transactions on Networking 14(6), 2006): once a
//! round trip, with the least round trip ever seen and the one of now,
//!
//! ```text
//! w ← min(2w, (1 − γ)·w + γ·(w · least / now + α))
//! ```
//!
//! which rests where α bytes of this connection wait in the narrowest queue. No step goes below what
//! was delivered in that round trip and α: what "now" says of a window that has been cut since would
//! cut it twice.
//!
//! "Ever seen" is the least upper quartile of a round's acknowledgements. "Now" is their lower one,
//! for where others have a processor for more than half of the time, most are late, and no queue is
//! why: with the median, a client that waits for its processor 12 of each 20 ms got 77 % of
//! 31.5 Mbit/s, and all with the quartile. An acknowledgement counts as the longest way of its
//! packets: one packet in fifty that overtakes others by a quarter of the round trip would else be
//! the least, all others seem to wait, and the window shrink to next to nothing. One that overtakes
//! others leaves those nothing to tell: so a median may be too early, one round in a thousand.
//!
//! A lost packet says nothing: radio and long paths lose them at random, and a rule that halves the
//! window for each (Cubic) carried 4 of 31 Mbit/s at 1 % loss. Only when a twentieth is lost for
//! several round trips is the path taken to have a queue too short for α.
//!
//! The first window is as much as leaves no more than two frames waiting on 25 Mbit/s, which a
//! longer round trip makes more: over 46 ms 219 kB, 31.5 Mbit/s and their parities, so that the
//! first frames are not slow. Half is added each round trip until packets begin to wait. A round
//! lasts for a round trip and until enough acknowledgements have come to tell their quartile, or all
//! of the window is acknowledged; a pause before it does not count.
//!
//! The rule is pure; [`Config`] is its form for quinn.

use std::any::Any;
use std::sync::Arc;
use std::time::{Duration, Instant};

use quinn::Connection;
use quinn::congestion::{Controller, ControllerFactory};

/// The window of one connection; times are from any moment that stays the same.
#[derive(Clone, Debug)]
pub struct DelayWindow {
    window: f64,
    packet_bytes: f64,
    starting: bool,
    /// The least round trip, while nothing has been seen yet of what the path carries.
    untried: Option<Duration>,
    least: LeastRoundTrip,
    round: Round,
    /// The last acknowledgement.
    heard: Duration,
    /// Share of bytes lost, over some rounds.
    loss: f64,
    /// Bytes per second that were delivered, the most of the last rounds.
    rate: f64,
}

/// What has happened since the last change of the window.
#[derive(Clone, Debug, Default)]
struct Round {
    began: Duration,
    acked: f64,
    lost: f64,
    /// The longest of the packets of the acknowledgement that is being taken.
    ack: Option<Duration>,
    /// Of acknowledgements.
    round_trips: RoundTrips,
    /// Whether the window held something back.
    limited: bool,
}

impl DelayWindow {
    /// A window before anything is known of the path.
    pub fn new(now: Duration, packet_bytes: u16) -> Self {
        Self {
            window: first_window(Duration::ZERO),
            packet_bytes: f64::from(packet_bytes),
            starting: true,
            untried: Some(FIRST_ROUND_TRIP_MAX),
            least: LeastRoundTrip::default(),
            round: Round {
                began: now,
                ..Round::default()
            },
            heard: now,
            loss: 0.0,
            rate: 0.0,
        }
    }

    /// A packet has been acknowledged; `limited` if the window, not the application, was what
    /// held more back.
    pub fn on_ack(&mut self, now: Duration, sent: Duration, bytes: u64, limited: bool) {
        let round_trip = now.saturating_sub(sent);
        let pause = sent.saturating_sub(std::mem::replace(&mut self.heard, now));
        if pause > Duration::ZERO {
            self.end_pause(now, pause);
        }
        let round = &mut self.round;
        round.acked += bytes as f64;
        round.limited |= limited;
        round.ack = round.ack.max(Some(round_trip));
    }

    /// An acknowledgement has been taken: of those packets that have been told since the last.
    pub fn on_end_acks(&mut self, now: Duration) {
        let round = &mut self.round;
        let Some(round_trip) = round.ack.take() else {
            return;
        };
        round.round_trips.insert(round_trip);
        let least = self.least.get().unwrap_or(round_trip);
        if let Some(first) = &mut self.untried {
            *first = round_trip.min(*first);
            self.window = first_window(*first);
        }
        let passed = now.saturating_sub(round.began) >= least.max(ROUND_MIN);
        // After an outage the window has fewer packets than that are acknowledged apart.
        let is_whole = round.acked >= self.window - self.packet_bytes;
        if passed && (is_whole || round.round_trips.are_enough()) {
            self.end_round(now);
        }
    }

    /// Packets are lost.
    pub fn on_loss(&mut self, bytes: u64) {
        self.round.lost += bytes as f64;
    }

    /// Nothing has come through for several round trips: the path is another one, if it is back.
    pub fn on_outage(&mut self, now: Duration) {
        let packet_bytes = self.packet_bytes as u16;
        *self = Self::new(now, packet_bytes);
        self.window = PACKETS_MIN * self.packet_bytes;
        self.untried = None;
    }

    /// Largest packets are of so many bytes now.
    pub fn set_packet_bytes(&mut self, packet_bytes: u16) {
        self.packet_bytes = f64::from(packet_bytes);
    }

    /// Bytes that may be on their way.
    pub fn bytes(&self) -> u64 {
        self.window as u64
    }

    /// Bytes that may be on their way and that the path is known to carry, or so likely that pixels
    /// need not be coarser for it.
    pub fn known_bytes(&self) -> u64 {
        match self.untried {
            Some(_) => self.window.min(KNOWN_BYTES) as u64,
            None => self.bytes(),
        }
    }

    /// Nothing was on its way for so long. What little came before says how long a round trip is, and
    /// nothing of the window.
    fn end_pause(&mut self, now: Duration, pause: Duration) {
        if self.round.limited {
            self.round.began += pause;
            return;
        }
        let round = Round {
            began: now,
            ..Round::default()
        };
        let trips = std::mem::replace(&mut self.round, round).round_trips.kept;
        if let Some(longest) = trips.iter().max()
            && trips.len() >= PAUSED_TRIPS_MIN
        {
            self.least.insert(now, *longest);
        }
    }

    fn end_round(&mut self, now: Duration) {
        let mut round = std::mem::replace(
            &mut self.round,
            Round {
                began: now,
                ..Round::default()
            },
        );
        let trips = &mut round.round_trips;
        let (Some(early), Some(late)) = (trips.quantile(0.25), trips.quantile(0.75)) else {
            return;
        };
        let least = self.least.insert(now, late);
        let here = early.max(least);
        let secs = now.saturating_sub(round.began).as_secs_f64();
        let delivered_per_sec = round.acked / secs.max(1e-6);
        self.rate = delivered_per_sec.max(self.rate * RATE_KEPT);
        let lost = round.lost / (round.lost + round.acked).max(1.0);
        self.loss += LOSS_GAIN * (lost - self.loss);
        let waits = here.saturating_sub(least);
        if round.limited || waits > START_WAIT_MAX {
            self.untried = None;
        }
        if self.loss > LOSS_MAX {
            self.starting = false;
            self.loss = 0.0;
            self.window *= LOSS_FACTOR;
        } else if self.starting && waits <= START_WAIT_MAX.max(least / 32) {
            if round.limited {
                let carried = delivered_per_sec * least.as_secs_f64() + self.alpha();
                self.window += 0.5 * self.window.min(carried);
            }
        } else if round.limited || 2.0 * delivered_per_sec * here.as_secs_f64() >= self.window {
            self.follow_delay(&round, delivered_per_sec * least.as_secs_f64(), waits);
        }
        if self.least.is_stale(now) {
            // To see the path without what this connection keeps waiting in it.
            self.least.renew(now);
            if round.limited {
                self.window *= DRAIN_FACTOR;
            }
        }
        let floor = PACKETS_MIN * self.packet_bytes;
        self.window = self.window.clamp(floor, BYTES_MAX);
    }

    /// The paper's rule; `delivered` in the least round trip. Not for an application that has half of
    /// the window on its way or less: what its packets wait for is not each other.
    fn follow_delay(&mut self, round: &Round, delivered: f64, waits: Duration) {
        let least = self.least.get().unwrap_or_default().as_secs_f64();
        if self.starting {
            // It grew a round trip ago: what was delivered since is what the path carries.
            self.starting = false;
            self.window = self.window.min(self.rate * least + self.alpha());
        }
        let ratio = least / (least + waits.as_secs_f64()).max(1e-6);
        let target = delivered.clamp(self.window * ratio, self.window) + self.alpha();
        let next = (1.0 - GAMMA) * self.window + GAMMA * target;
        // An application that sends less says nothing of what more would do.
        if round.limited || next < self.window {
            self.window = next.min(2.0 * self.window);
        }
    }

    fn alpha(&self) -> f64 {
        let least = PACKETS_MIN * self.packet_bytes;
        let waits = (self.rate * ALPHA_SECS).clamp(least, ALPHA_BYTES.max(least));
        waits.max(self.window / ALPHA_PART)
    }
}

/// Round trips of acknowledgements: a sample of them, evenly spread.
#[derive(Clone, Debug, Default)]
struct RoundTrips {
    kept: Vec<Duration>,
    /// Of so many, one is kept ...
    stride: usize,
    /// ... after so many more.
    skips: usize,
}

impl RoundTrips {
    fn insert(&mut self, round_trip: Duration) {
        if self.skips > 0 {
            self.skips -= 1;
            return;
        }
        if self.kept.len() == ROUND_TRIPS_MAX {
            self.kept = self.kept.iter().copied().step_by(2).collect();
            self.stride = 2 * self.stride.max(1);
        }
        self.kept.push(round_trip);
        self.skips = self.stride.saturating_sub(1);
    }

    /// The round trip that this share of them are shorter than.
    fn quantile(&mut self, share: f64) -> Option<Duration> {
        let index = (self.kept.len().checked_sub(1)? as f64 * share) as usize;
        Some(*self.kept.select_nth_unstable(index).1)
    }

    fn are_enough(&self) -> bool {
        self.kept.len() >= ROUND_TRIPS_MIN
    }
}

/// The least round trip of the last one to two [`LEAST_AGE`]s.
#[derive(Clone, Copy, Debug, Default)]
struct LeastRoundTrip {
    now: Option<Duration>,
    before: Option<Duration>,
    since: Duration,
}

impl LeastRoundTrip {
    /// The least, with this one.
    fn insert(&mut self, now: Duration, round_trip: Duration) -> Duration {
        if self.now.is_none() {
            self.since = now;
        }
        let least = self.now.map_or(round_trip, |least| least.min(round_trip));
        self.now = Some(least);
        self.before.map_or(least, |before| before.min(least))
    }

    fn get(&self) -> Option<Duration> {
        self.now.into_iter().chain(self.before).min()
    }

    fn is_stale(&self, now: Duration) -> bool {
        now.saturating_sub(self.since) >= LEAST_AGE
    }

    fn renew(&mut self, now: Duration) {
        (self.before, self.now, self.since) = (self.now, None, now);
    }
}

/// What 25 Mbit/s carry in two frames and the time over which a window is spread.
fn first_window(round_trip: Duration) -> f64 {
    FIRST_BYTES_PER_SEC * (round_trip.as_secs_f64() / PACE + FIRST_QUEUE_SECS)
}

/// Windows that leave in a round trip, as quinn paces them.
const PACE: f64 = 1.25;

const FIRST_BYTES_PER_SEC: f64 = 25e6 / 8.0;
/// Two frames.
const FIRST_QUEUE_SECS: f64 = 2.0 / 60.0;
/// A handshake that took longer says more of the machine than of the path.
const FIRST_ROUND_TRIP_MAX: Duration = Duration::from_millis(150);
/// Two frames of 65 kB.
const KNOWN_BYTES: f64 = 131_072.0;
/// Bytes of ours that wait in the narrowest queue: 5 ms at 25 Mbit/s ...
const ALPHA_BYTES: f64 = 16_384.0;
/// ... and no longer than this on slower ones.
const ALPHA_SECS: f64 = 0.008;
/// On faster paths a sixteenth of the window, a fifteenth of the round trip.
const ALPHA_PART: f64 = 16.0;
/// The paper's own.
const GAMMA: f64 = 0.5;
/// Above it, or so much of the round trip, packets are taken to wait: jitter is seldom more in the
/// quartile of a round.
const START_WAIT_MAX: Duration = Duration::from_millis(2);
/// On a loopback a round trip has two packets, which say little.
const ROUND_MIN: Duration = Duration::from_millis(2);
/// If one acknowledgement in twelve is too early, more than half of so many are once in 100,000 rounds.
const ROUND_TRIPS_MIN: usize = 12;
/// Three of four that overtook others by chance are rare enough.
const PAUSED_TRIPS_MIN: usize = 4;
/// Enough for all.
const ROUND_TRIPS_MAX: usize = 64;
const LEAST_AGE: Duration = Duration::from_secs(10);
const DRAIN_FACTOR: f64 = 0.75;
/// Of bytes, over some eight rounds.
const LOSS_MAX: f64 = 0.05;
const LOSS_GAIN: f64 = 0.125;
const LOSS_FACTOR: f64 = 0.8;
/// Of the best rate before, each round.
const RATE_KEPT: f64 = 0.9;
const PACKETS_MIN: f64 = 4.0;
/// As many bytes as the receiver lets come.
const BYTES_MAX: f64 = 16_777_216.0;

/// Makes [`DelayWindow`]s for quinn's connections.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Config;

impl ControllerFactory for Config {
    fn build(self: Arc<Self>, now: Instant, current_mtu: u16) -> Box<dyn Controller> {
        Box::new(Adapter {
            began: now,
            window: DelayWindow::new(Duration::ZERO, current_mtu),
        })
    }
}

#[derive(Clone, Debug)]
struct Adapter {
    began: Instant,
    window: DelayWindow,
}

/// Bytes that may be on their way over a connection and that its path is known to carry.
pub(crate) fn known_bytes(connection: &Connection) -> u64 {
    match connection
        .congestion_state()
        .into_any()
        .downcast::<Adapter>()
    {
        Ok(adapter) => adapter.window.known_bytes(),
        Err(_) => connection.stats().path.cwnd,
    }
}

impl Adapter {
    fn since(&self, instant: Instant) -> Duration {
        instant.saturating_duration_since(self.began)
    }
}

impl Controller for Adapter {
    fn on_ack(
        &mut self,
        now: Instant,
        sent: Instant,
        bytes: u64,
        app_limited: bool,
        _: &quinn_proto::RttEstimator,
    ) {
        let (now, sent) = (self.since(now), self.since(sent));
        self.window.on_ack(now, sent, bytes, !app_limited);
    }

    fn on_end_acks(&mut self, now: Instant, _: u64, _: bool, _: Option<u64>) {
        self.window.on_end_acks(self.since(now));
    }

    fn on_congestion_event(
        &mut self,
        now: Instant,
        _: Instant,
        is_persistent_congestion: bool,
        lost_bytes: u64,
    ) {
        if is_persistent_congestion {
            self.window.on_outage(self.since(now));
        } else {
            self.window.on_loss(lost_bytes);
        }
    }

    fn on_mtu_update(&mut self, new_mtu: u16) {
        self.window.set_packet_bytes(new_mtu);
    }

    fn window(&self) -> u64 {
        self.window.bytes()
    }

    fn clone_box(&self) -> Box<dyn Controller> {
        Box::new(self.clone())
    }

    fn initial_window(&self) -> u64 {
        first_window(Duration::ZERO) as u64
    }

    fn into_any(self: Box<Self>) -> Box<dyn Any> {
        self
    }
}
