//! Frames of which nodes trace other samples each.

use std::collections::VecDeque;

use carom_farm::{Balancing, Distribution, Farm, Frame, FrameSpec};
use carom_protocol::PixelFormat;
use carom_tracer::RenderSettings;

use crate::{PATIENCE, linear};
use carom_testkit::pattern_tracer::{self, DeviceFault, Gate, PatternTracer};

/// Samples of each pixel: no number of nodes here divides them.
const SAMPLES: u32 = 13;

fn farm(tracers: Vec<PatternTracer>) -> Farm {
    let mut farm = crate::farm(tracers);
    farm.set_distribution(Distribution::Samples);
    farm
}

fn spec(seed: u32) -> FrameSpec {
    FrameSpec {
        settings: RenderSettings {
            samples: SAMPLES,
            first_sample: 5,
            seed,
            ..RenderSettings::default()
        },
        ..crate::spec(seed)
    }
}

fn trace(farm: &mut Farm, seed: u32) -> Frame {
    farm.submit(spec(seed)).unwrap();
    farm.wait_frame(PATIENCE).expect("a frame")
}

/// What one node makes of it with as many samples, but for the order in which they are added.
fn assert_right(frame: &Frame, seed: u32) {
    for (found, right) in linear(frame)
        .iter()
        .zip(pattern_tracer::picture(&spec(seed)))
    {
        for (found, right) in found.iter().zip(right) {
            // Each pass is rounded to a float, and the mean of them.
            assert!(
                (found - right).abs() <= 2.0 * f32::EPSILON,
                "{found} for {right}, seed {seed}"
            );
        }
    }
}

#[test]
fn merged_samples_are_the_picture_of_one_node() {
    let mut farm = farm(vec![
        PatternTracer::new(),
        PatternTracer::new(),
        PatternTracer::new(),
    ]);
    let mut in_flight = VecDeque::new();
    let mut passes_max = 0;
    let balancers = Balancing::all().chain(Balancing::all());
    for (seed, balancing) in balancers.enumerate() {
        farm.set_balancing(balancing);
        farm.submit(spec(seed as u32)).unwrap();
        in_flight.push_back(seed as u32);
        if farm.in_flight() == 3 {
            let frame = farm.wait_frame(PATIENCE).expect("a frame");
            assert_right(&frame, in_flight.pop_front().unwrap());
            let delivered: u32 = frame.stats.tiles_by_node.iter().sum();
            assert_eq!(delivered, 16 * 9 * frame.stats.passes);
            passes_max = passes_max.max(frame.stats.passes);
        }
    }
    assert!(
        (2..=3).contains(&passes_max),
        "{passes_max} passes of 3 nodes"
    );
}

#[test]
fn a_node_that_fails_costs_samples_that_others_take_over() {
    for fault in [DeviceFault::Error, DeviceFault::Panic] {
        let faulty = PatternTracer::new().with_fault(fault, 100);
        let mut farm = farm(vec![faulty, PatternTracer::new().with_pace(30)]);
        for seed in 0..4 {
            assert_right(&trace(&mut farm, seed), seed);
        }
    }
    let gate = Gate::closed();
    let hanging = PatternTracer::new().with_fault(DeviceFault::Hang(gate.clone()), 20);
    let mut farm = farm(vec![hanging, PatternTracer::new().with_pace(30)]);
    let frame = trace(&mut farm, 0);
    assert_right(&frame, 0);
    assert_eq!(frame.stats.passes, 2);
    assert!(frame.stats.reissued_tiles > 0);
    gate.open();
}

#[test]
fn what_cannot_be_merged_is_divided_by_tiles() {
    let mut farm = farm(vec![PatternTracer::new(), PatternTracer::new()]);
    let mut passes_of = |spec: FrameSpec| {
        farm.submit(spec).unwrap();
        farm.wait_frame(PATIENCE).expect("a frame").stats.passes
    };
    let with = |settings: RenderSettings| FrameSpec {
        settings,
        ..spec(0)
    };
    let settings = spec(0).settings;
    let format = PixelFormat::Srgb8 { exposure: 1.0 };
    assert_eq!(passes_of(spec(0)), 2);
    assert_eq!(passes_of(FrameSpec { format, ..spec(0) }), 1);
    let denoise = true;
    assert_eq!(
        passes_of(with(RenderSettings {
            denoise,
            ..settings
        })),
        1
    );
    let samples = 1;
    assert_eq!(
        passes_of(with(RenderSettings {
            samples,
            ..settings
        })),
        1
    );
}
