//! Laws of the link emulator: each packet meets the configured delay, loss, rate and order.

use std::time::Duration;

use carom_testkit::{link_emulator::LinkConfig, link_emulator::LinkEmulator};

const MS: Duration = Duration::from_millis(1);

#[test]
fn packets_pass_that_are_short_enough() {
    let config = LinkConfig {
        packet_bytes_max: 1400,
        ..LinkConfig::default()
    };
    let mut path = LinkEmulator::new(config, 1);
    let passes = [1400, 1401, 1200].map(|bytes| path.send(MS, bytes).is_some());
    assert_eq!(passes, [true, false, true]);
    let config = LinkConfig {
        packet_bytes_max: 1199,
        ..config
    };
    let why = config.validate().unwrap_err().to_string();
    assert!(why.contains("1199"), "{why}");
}

#[test]
fn losses_have_their_rate_and_burst_length() {
    for (loss, burst) in [(0.01, 1.0), (0.01, 4.0), (0.2, 6.0), (0.5, 2.0)] {
        let config = LinkConfig {
            loss,
            burst,
            ..LinkConfig::default()
        };
        let mut path = LinkEmulator::new(config, 7);
        let count = 400_000;
        let fates: Vec<bool> = (0..count)
            .map(|_| path.send(Duration::ZERO, 1).is_none())
            .collect();
        let lost = fates.iter().filter(|lost| **lost).count() as f64;
        let bursts = fates.windows(2).filter(|pair| !pair[0] && pair[1]).count() as f64;
        let share = lost / f64::from(count);
        assert!((share / loss - 1.0).abs() < 0.1, "{share} for {loss}");
        if burst > 1.0 {
            let mean = lost / bursts;
            assert!((mean / burst - 1.0).abs() < 0.1, "{mean} for {burst}");
        }
    }
}

#[test]
fn a_rate_spreads_packets_and_a_full_queue_drops_them() {
    let config = LinkConfig {
        rate: Some(8e6),
        queue_bytes: 10_000,
        ..LinkConfig::default()
    };
    let mut path = LinkEmulator::new(config, 1);
    let arrivals: Vec<_> = (0..20).map(|_| path.send(Duration::ZERO, 1000)).collect();
    let expected = (1..=10).map(|packet| Some(packet * MS));
    assert!(arrivals.into_iter().eq(expected.chain([None; 10])));
    assert_eq!(path.send(5 * MS, 1000), Some(11 * MS));
}

#[test]
fn jitter_keeps_the_order_and_has_its_mean() {
    let mut config = LinkConfig {
        delay: 20 * MS,
        jitter: MS,
        ..LinkConfig::default()
    };
    let arrivals = |config| -> Vec<Duration> {
        let mut path = LinkEmulator::new(config, 3);
        let sent = (0..20_000).map(|packet| packet * 20 * MS);
        sent.filter_map(|now| path.send(now, 100)).collect()
    };
    let delays = arrivals(config).into_iter().zip(0..);
    let sum: f64 = delays
        .map(|(at, packet)| (at - packet * 20 * MS).as_secs_f64())
        .sum();
    assert!((sum / 20_000.0 - 0.021).abs() < 1e-4);
    assert!(arrivals(config).is_sorted());
    config.reorder = 0.1;
    let mut path = LinkEmulator::new(config, 3);
    let arrivals: Vec<_> = (0..1000).filter_map(|p| path.send(p * MS, 100)).collect();
    assert!(!arrivals.is_sorted());
}

#[test]
fn what_is_out_of_range_is_named() {
    let refused = |config: LinkConfig| config.validate().unwrap_err().to_string();
    let config = LinkConfig::default();
    assert!(
        refused(LinkConfig {
            loss: 1.5,
            ..config
        })
        .contains("loss is 1.5")
    );
    assert!(
        refused(LinkConfig {
            burst: 0.0,
            ..config
        })
        .contains("burst is 0")
    );
    assert!(
        refused(LinkConfig {
            rate: Some(0.0),
            ..config
        })
        .contains("rate")
    );
    assert!(
        refused(LinkConfig {
            reorder: f64::NAN,
            ..config
        })
        .contains("reorder")
    );
}
