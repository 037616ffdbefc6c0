//! Frames that every node refuses: errors that name the nodes and their reasons, not waits.

use carom_farm::{Live, Still};

use super::*;

fn refusing() -> PatternTracer {
    PatternTracer::new().with_fault(DeviceFault::Refusal, 0)
}

/// What the farm says when a frame does not come.
fn refusal(farm: &mut Farm) -> Error {
    assert!(farm.wait_frame(PATIENCE).is_none(), "the frame is refused");
    let error = farm.check_nodes().expect_err("the frame is refused");
    assert_eq!(farm.in_flight(), 0);
    farm.check_nodes().expect("it is said once");
    error
}

#[test]
fn a_frame_that_every_node_refuses_is_an_error_that_names_them() {
    let mut farm = farm(vec![refusing(), refusing()]);
    let id = farm.submit(spec(0)).unwrap();
    match refusal(&mut farm) {
        Error::FrameRefused(refusal) => {
            assert_eq!(refusal.frame, id);
            let [(first, why), (second, _)] = &refusal.nodes[..] else {
                panic!("{refusal:?}");
            };
            assert_eq!((&first[..], &second[..]), ("local", "local"));
            assert!(why.contains("9 objects"), "{why}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn one_node_that_takes_a_frame_is_enough() {
    let mut farm = farm(vec![refusing(), PatternTracer::new(), refusing()]);
    for seed in 0..4 {
        assert_right(&trace(&mut farm, seed), seed);
    }
}

#[test]
fn a_device_that_fails_again_and_again_refuses_the_frame() {
    let broken = PatternTracer::new().with_fault(DeviceFault::Error, 0);
    let mut farm = farm(vec![broken]);
    farm.submit(spec(0)).unwrap();
    let sentence = refusal(&mut farm).to_string();
    assert!(sentence.contains("it was told to fail"), "{sentence}");
}

#[test]
fn stills_and_live_views_end_with_the_sentence() {
    let mut farm = farm(vec![refusing()]);
    let why = farm.render(&scene(), Still::new(64, 36)).map(drop);
    let sentence = why.expect_err("nobody traces it").to_string();
    assert!(
        sentence.contains("local: it calls a request invalid"),
        "{sentence}"
    );
    let mut view = farm.live(&scene(), Live::new(64, 36)).unwrap();
    let error = loop {
        match view.latest() {
            Ok(_) => std::thread::yield_now(),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, Error::FrameRefused(_)), "{error}");
}

#[test]
fn a_still_that_is_refused_halfway_keeps_what_was_traced() {
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("kept");
    let still = || {
        let still = Still::new(64, 36).samples(8).frame_samples(1);
        still.checkpoint(&kept, Duration::from_secs(3600))
    };
    let mut sound = farm(vec![PatternTracer::new()]);
    let refuses_later = PatternTracer::new().with_fault(DeviceFault::Refusal, 40);
    let mut refusing = farm(vec![refuses_later]);
    let why = refusing.render(&scene(), still()).map(drop).unwrap_err();
    assert!(matches!(why, Error::FrameRefused(_)), "{why}");
    let job = sound.still(&scene(), still()).unwrap();
    let resumed = job.resumed_samples();
    assert!((1..8).contains(&resumed), "{resumed} samples");
    let picture = job.wait().unwrap();
    let alone = Still::new(64, 36).samples(8).frame_samples(1);
    let alone = sound.render(&scene(), alone).unwrap();
    assert_eq!(picture.image().pixels, alone.image().pixels);
}
