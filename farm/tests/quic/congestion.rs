//! The window on simulated paths.

use std::collections::VecDeque;
use std::time::Duration;

use carom_farm::net::{DelayWindow, Path, PathConfig};

const PACKET: u64 = 1252;
const STEP: Duration = Duration::from_micros(100);

/// How a path served an application that offers `offered` bits per second for `secs`.
struct Outcome {
    delivered: f64,
    /// Of packets sent in the second half, sorted.
    waits: Vec<Duration>,
    sent: f64,
}

impl Outcome {
    fn wait(&self, quantile: f64) -> Duration {
        self.waits[((self.waits.len() - 1) as f64 * quantile) as usize]
    }
}

fn drive(config: PathConfig, offered: f64, secs: u64) -> Outcome {
    let window = DelayWindow::new(Duration::ZERO, PACKET as u16);
    drive_from(window, config, offered, secs, |_| true)
}

/// Packets leave at 1.25 windows a round trip, as quinn paces them, and are acknowledged when the
/// client's process `runs`.
fn drive_from(
    mut window: DelayWindow,
    config: PathConfig,
    offered: f64,
    secs: u64,
    runs: impl Fn(Duration) -> bool,
) -> Outcome {
    let mut there = Path::new(config, 5);
    let mut backlog = 0.0;
    let mut allowance = 0.0;
    let mut flying: VecDeque<(Duration, Option<Duration>)> = VecDeque::new();
    let mut outcome = Outcome {
        delivered: 0.0,
        waits: Vec::new(),
        sent: 0.0,
    };
    let smoothed = 2.0 * config.delay.as_secs_f64() + 0.005;
    let (mut now, end) = (Duration::ZERO, Duration::from_secs(secs));
    while now < end {
        now += STEP;
        backlog = f64::min(backlog + offered / 8.0 * STEP.as_secs_f64(), 1e7);
        let pace = 1.25 * window.bytes() as f64 / smoothed;
        allowance = f64::min(allowance + pace * STEP.as_secs_f64(), 16.0 * PACKET as f64);
        let mut index = 0;
        while index < flying.len() {
            let (sent, arrives) = flying[index];
            match arrives.map(|at| at + config.delay) {
                Some(due) if due <= now && runs(now) => {
                    let acked = if runs(due) { due } else { now };
                    let limited = backlog >= PACKET as f64;
                    window.on_ack(acked, sent, PACKET, limited);
                    window.on_end_acks(acked);
                    outcome.delivered += PACKET as f64;
                    if sent > end / 2 {
                        let wait = (acked - sent).saturating_sub(2 * config.delay);
                        outcome.waits.push(wait);
                    }
                    flying.remove(index);
                }
                // Told by later acknowledgements, a round trip or so after.
                None if sent + 3 * config.delay + 9 * STEP <= now => {
                    window.on_loss(PACKET);
                    flying.remove(index);
                }
                _ => index += 1,
            }
        }
        while backlog >= PACKET as f64
            && allowance >= PACKET as f64
            && (flying.len() as u64 + 1) * PACKET <= window.bytes()
        {
            backlog -= PACKET as f64;
            allowance -= PACKET as f64;
            outcome.sent += PACKET as f64;
            flying.push_back((now, there.send(now, PACKET as usize)));
        }
    }
    outcome.waits.sort_unstable();
    outcome
}

fn path(round_trip_ms: u64) -> PathConfig {
    PathConfig {
        delay: Duration::from_millis(round_trip_ms) / 2,
        jitter: Duration::from_millis(1),
        ..PathConfig::default()
    }
}

#[test]
fn random_loss_does_not_slow_it() {
    for loss in [0.0, 0.01, 0.02] {
        let config = PathConfig { loss, ..path(46) };
        let outcome = drive(config, 31.5e6, 6);
        let rate = outcome.delivered * 8.0 / 6.0;
        assert!(rate > 0.93 * (1.0 - loss) * 31.5e6, "{rate} at {loss}");
    }
}

/// Each twentieth packet overtakes others by a quarter of the round trip.
#[test]
fn packets_that_overtake_others_do_not_slow_it() {
    let config = PathConfig {
        reorder: 0.05,
        ..path(46)
    };
    let outcome = drive(config, 31.5e6, 30);
    let rate = outcome.delivered * 8.0 / 30.0;
    assert!(rate > 0.98 * 31.5e6, "{rate}");
}

#[test]
fn a_slow_link_is_filled_and_its_queue_stays_short() {
    for (rate, round_trip_ms) in [(25e6, 46), (25e6, 10), (5e6, 46), (100e6, 46)] {
        let config = PathConfig {
            rate: Some(rate),
            queue_bytes: 1 << 20,
            ..path(round_trip_ms)
        };
        let outcome = drive(config, 1.25 * rate, 8);
        let used = outcome.delivered * 8.0 / 8.0 / rate;
        let frames_2 = Duration::from_micros(33_333);
        let wait = outcome.wait(0.99);
        assert!(used > 0.85, "{used} of {rate} at {round_trip_ms} ms");
        assert!(wait < frames_2, "{wait:?} at {rate} and {round_trip_ms} ms");
    }
}

#[test]
fn a_short_queue_is_not_flooded() {
    let config = PathConfig {
        rate: Some(25e6),
        queue_bytes: 12_000,
        ..path(46)
    };
    let outcome = drive(config, 50e6, 8);
    let (used, kept) = (outcome.delivered / 25e6, outcome.delivered / outcome.sent);
    assert!(used > 0.5, "{used}");
    assert!(kept > 0.85, "{kept} of what was sent arrived");
}

#[test]
fn the_first_frames_are_not_slow() {
    let outcome = drive(path(46), 31.5e6, 1);
    let share = outcome.delivered * 8.0 / 31.5e6;
    assert!(share > 0.9, "{share} of the first second's bytes");
}

#[test]
fn an_outage_ends_in_a_small_window_that_grows_again() {
    let mut window = DelayWindow::new(Duration::ZERO, PACKET as u16);
    window.on_outage(Duration::ZERO);
    assert_eq!(window.bytes(), 4 * PACKET);
    // To 80 kB by half each round trip.
    let outcome = drive_from(window, path(20), 31.5e6, 1, |_| true);
    let share = outcome.delivered * 8.0 / 31.5e6;
    assert!(share > 0.8, "{share} of the first second's bytes");
}

/// A receiver may acknowledge all that came at once.
#[test]
fn after_an_outage_one_acknowledgement_a_round_trip_is_enough() {
    let mut window = DelayWindow::new(Duration::ZERO, PACKET as u16);
    window.on_outage(Duration::ZERO);
    let mut round_trips = 0;
    while window.bytes() < 200_000 {
        let sent = 46 * round_trips;
        round_trips += 1;
        let [sent, now] = [sent, 46 * round_trips].map(Duration::from_millis);
        for _ in 0..window.bytes() / PACKET {
            window.on_ack(now, sent, PACKET, true);
        }
        window.on_end_acks(now);
        assert!(round_trips < 12, "still {} bytes", window.bytes());
    }
}

#[test]
fn a_client_that_waits_for_its_processor_is_not_slowed_further() {
    for (waits_ms, of_ms) in [(4, 20), (8, 20), (12, 20), (30, 100), (50, 200)] {
        let window = DelayWindow::new(Duration::ZERO, PACKET as u16);
        let runs = |now: Duration| now.as_millis() % of_ms >= waits_ms;
        let outcome = drive_from(window, path(46), 31.5e6, 6, runs);
        let share = outcome.delivered * 8.0 / 6.0 / 31.5e6;
        println!("{waits_ms} of {of_ms} ms: {share:.3}");
        assert!(
            share > 0.95,
            "{share} of what was offered, {waits_ms} of {of_ms} ms"
        );
    }
}
