//! Laws of the congestion window on simulated paths.

use std::collections::{BTreeSet, VecDeque};
use std::time::Duration;

use carom_farm::net::DelayBasedController;
use carom_testkit::link_emulator::{LinkConfig, LinkEmulator};

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

fn drive(config: LinkConfig, offered: f64, secs: u64) -> Outcome {
    let window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    drive_from(window, config, offered, secs, |_| true)
}

/// Packets leave at 1.25 windows a round trip, as quinn paces them, and are acknowledged when the
/// client's process `runs`.
fn drive_from(
    mut window: DelayBasedController,
    config: LinkConfig,
    offered: f64,
    secs: u64,
    runs: impl Fn(Duration) -> bool,
) -> Outcome {
    let mut there = LinkEmulator::new(config, 5);
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
        let pace = 1.25 * window.window_bytes() as f64 / smoothed;
        allowance = f64::min(allowance + pace * STEP.as_secs_f64(), 16.0 * PACKET as f64);
        let mut index = 0;
        while index < flying.len() {
            let (sent, arrives) = flying[index];
            match arrives.map(|at| at + config.delay) {
                Some(due) if due <= now && runs(now) => {
                    let acked = if runs(due) { due } else { now };
                    let app_limited = backlog < PACKET as f64;
                    window.on_ack(acked, sent, PACKET, app_limited);
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
            && (flying.len() as u64 + 1) * PACKET <= window.window_bytes()
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

fn path(round_trip_ms: u64) -> LinkConfig {
    LinkConfig {
        delay: Duration::from_millis(round_trip_ms) / 2,
        jitter: Duration::from_millis(1),
        ..LinkConfig::default()
    }
}

#[test]
fn random_loss_does_not_slow_it() {
    for loss in [0.0, 0.01, 0.02] {
        let config = LinkConfig { loss, ..path(46) };
        let outcome = drive(config, 31.5e6, 6);
        let rate = outcome.delivered * 8.0 / 6.0;
        assert!(rate > 0.93 * (1.0 - loss) * 31.5e6, "{rate} at {loss}");
    }
}

/// Each twentieth packet overtakes others by a quarter of the round trip.
#[test]
fn reordered_packets_do_not_slow_it() {
    let config = LinkConfig {
        reorder: 0.05,
        ..path(46)
    };
    let outcome = drive(config, 31.5e6, 30);
    let rate = outcome.delivered * 8.0 / 30.0;
    assert!(rate > 0.98 * 31.5e6, "{rate}");
}

/// The least window of a minute in which an application sends 37 Mbit/s, which the window lets
/// pass, over a path that reorders packets and acknowledgements of two packets each.
fn least_window(reorder: f64, seed: u64) -> u64 {
    let config = LinkConfig {
        reorder,
        jitter: Duration::from_micros(200),
        ..path(46)
    };
    let mut window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    let (mut there, mut back) = (
        LinkEmulator::new(config, seed),
        LinkEmulator::new(config, seed + 1),
    );
    let packets = (0..60 * 3720u32).map(|packet| {
        let (frame, place) = (packet / 62, packet % 62);
        let sent = frame * Duration::from_micros(16_667) + place * Duration::from_micros(129);
        let came = there.send(sent, PACKET as usize);
        (came.expect("nothing is lost"), sent)
    });
    let mut came: Vec<(Duration, Duration)> = packets.collect();
    came.sort_unstable();
    let told = came.iter().step_by(2).map(|(came, _)| {
        let arrives = back.send(*came, 40).expect("nothing is lost");
        (arrives, *came)
    });
    let mut told: Vec<(Duration, Duration)> = told.collect();
    told.sort_unstable();
    let (mut acked, mut least) = (0, u64::MAX);
    for (now, until) in told {
        while let Some((_, sent)) = came.get(acked).filter(|(came, _)| *came <= until) {
            window.on_ack(now, *sent, PACKET, true);
            acked += 1;
        }
        window.on_end_acks(now);
        least = least.min(window.window_bytes());
    }
    least
}

/// An acknowledgement that overtakes others leaves them nothing to tell, so that those that come
/// early may be the most of a round.
#[test]
fn reordered_acks_do_not_slow_it() {
    for seed in [1, 3, 5, 7] {
        let least = least_window(0.02, seed);
        assert!(least >= 175_000, "{least} bytes");
    }
}

/// Requests are small and far apart, and their packets wait for processors; then comes a scene.
#[test]
fn app_limited_senders_keep_the_window() {
    let mut window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    for request in 0..60 * 60u32 {
        let sent = request * Duration::from_micros(16_667);
        let waits = Duration::from_micros(u64::from(request * 7919 % 20_000));
        window.on_ack(sent + Duration::from_millis(46) + waits, sent, 300, true);
        window.on_end_acks(sent + Duration::from_millis(46) + waits);
    }
    assert!(
        window.window_bytes() > 200_000,
        "{} bytes",
        window.window_bytes()
    );
}

#[test]
fn a_slow_link_is_filled_and_its_queue_stays_short() {
    for (rate, round_trip_ms) in [(25e6, 46), (25e6, 10), (5e6, 46), (100e6, 46)] {
        let config = LinkConfig {
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
    let config = LinkConfig {
        rate: Some(25e6),
        queue_bytes: 12_000,
        ..path(46)
    };
    let outcome = drive(config, 50e6, 8);
    let (used, kept) = (outcome.delivered / 25e6, outcome.delivered / outcome.sent);
    assert!(used > 0.5, "{used}");
    assert!(kept > 0.85, "{kept} of what was sent arrived");
}

/// The first second of a node that is paired and idle for `idle` before: 31.5 Mbit/s and their
/// parities, each frame within 8 of 16.7 ms. The frames of which a packet waited to leave for more
/// than two frames, and the longest that one waited in the path's queue, in milliseconds.
fn first_second(config: LinkConfig, idle: Duration) -> (usize, f64) {
    const FRAME_PACKETS: u32 = 62;
    let mut window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    let (mut there, mut allowance) = (LinkEmulator::new(config, 5), 0.0);
    let round_trip = 2 * config.delay + STEP;
    for packet in 1..6 {
        let now = packet * round_trip;
        window.on_ack(now, now - round_trip, PACKET, true);
        window.on_end_acks(now);
    }
    let began = 6 * round_trip + idle;
    let packets = (0..60 * FRAME_PACKETS).map(|packet| {
        let (frame, place) = (packet / FRAME_PACKETS, packet % FRAME_PACKETS);
        let ms = f64::from(frame) * 16.667 + f64::from(place) * 8.0 / f64::from(FRAME_PACKETS);
        began + Duration::from_secs_f64(ms * 1e-3)
    });
    let mut packets: VecDeque<Duration> = packets.collect();
    let mut flying: VecDeque<(Duration, Duration)> = VecDeque::new();
    let (mut slow, mut queued) = (BTreeSet::new(), 0.0f64);
    let mut now = began;
    while !packets.is_empty() {
        now += STEP;
        let pace = 1.25 * window.window_bytes() as f64 / round_trip.as_secs_f64();
        allowance = f64::min(allowance + pace * STEP.as_secs_f64(), 16.0 * PACKET as f64);
        while let Some((sent, acked)) = flying.pop_front_if(|(_, acked)| *acked <= now) {
            let app_limited = packets.front().is_none_or(|due| *due > now);
            window.on_ack(acked, sent, PACKET, app_limited);
            window.on_end_acks(acked);
        }
        while packets.front().is_some_and(|due| *due <= now)
            && allowance >= PACKET as f64
            && (flying.len() as u64 + 1) * PACKET <= window.window_bytes()
        {
            allowance -= PACKET as f64;
            let due = packets.pop_front().unwrap_or_default();
            let arrives = there.send(now, PACKET as usize).expect("nothing is lost");
            if (now - due).as_secs_f64() > 2.0 / 60.0 {
                slow.insert((due - began).as_millis() * 60 / 1000);
            }
            queued = queued.max((arrives - now).saturating_sub(config.delay).as_secs_f64());
            flying.push_back((now, arrives + config.delay));
        }
    }
    (slow.len(), queued * 1e3)
}

#[test]
fn the_initial_window_suits_fast_and_slow_links() {
    for round_trip_ms in [10, 25, 46, 80] {
        for idle_secs in [0, 5] {
            let idle = Duration::from_secs(idle_secs);
            let mut config = LinkConfig {
                queue_bytes: 1 << 20,
                jitter: Duration::ZERO,
                ..path(round_trip_ms)
            };
            let (slow, _) = first_second(config, idle);
            let most = if round_trip_ms > 50 { 3 } else { 0 };
            assert!(slow <= most, "{slow} slow frames at {round_trip_ms} ms");
            config.rate = Some(25e6);
            let (_, queued) = first_second(config, idle);
            // Two frames and a packet.
            assert!(queued < 33.8, "{queued} ms queued of {round_trip_ms}");
        }
    }
}

/// A first window says nothing of what the path carries; one that was full for a round trip does.
#[test]
fn the_initial_window_is_not_validated() {
    let round_trip = Duration::from_millis(46);
    let mut window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    window.on_ack(round_trip, Duration::ZERO, PACKET, true);
    window.on_end_acks(round_trip);
    assert!(window.validated_bytes() < window.window_bytes());
    let pause = Duration::from_secs(2);
    for packet in 0..300 {
        let sent = pause + packet * Duration::from_micros(200);
        window.on_ack(sent + round_trip, sent, PACKET, false);
        window.on_end_acks(sent + round_trip);
    }
    assert_eq!(window.validated_bytes(), window.window_bytes());
}

#[test]
fn an_outage_ends_in_a_small_window_that_grows_again() {
    let mut window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    window.on_persistent_congestion(Duration::ZERO);
    assert_eq!(window.window_bytes(), 4 * PACKET);
    // To 80 kB by half each round trip.
    let outcome = drive_from(window, path(20), 31.5e6, 1, |_| true);
    let share = outcome.delivered * 8.0 / 31.5e6;
    assert!(share > 0.8, "{share} of the first second's bytes");
}

/// A receiver may acknowledge all that came at once.
#[test]
fn one_ack_a_round_trip_ends_an_outage() {
    let mut window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
    window.on_persistent_congestion(Duration::ZERO);
    let mut round_trips = 0;
    while window.window_bytes() < 200_000 {
        let sent = 46 * round_trips;
        round_trips += 1;
        let [sent, now] = [sent, 46 * round_trips].map(Duration::from_millis);
        for _ in 0..window.window_bytes() / PACKET {
            window.on_ack(now, sent, PACKET, false);
        }
        window.on_end_acks(now);
        assert!(round_trips < 12, "still {} bytes", window.window_bytes());
    }
}

#[test]
fn a_starved_receiver_is_not_slowed_further() {
    for (waits_ms, of_ms) in [(4, 20), (8, 20), (12, 20), (30, 100), (50, 200)] {
        let window = DelayBasedController::new(Duration::ZERO, PACKET as u16);
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
