//! The scheduler with a farm on virtual time.

use carom_farm::FrameStats;
use carom_farm::quality::{SMOOTH_PERIOD_SECS, STEADY_PERIOD_SECS};
use carom_tracer::sampling::uniforms;
use carom_tracer::{Camera, Lens, ObjectPose};
use glam::Vec3;

use super::shown_frame::SETTLE_SECS;
use super::*;
use crate::frame::accumulation::Accumulator;
use crate::play::ShotClock;

const WINDOW: ImageSize = ImageSize::new(64, 36);
const STEP_SECS: f64 = 0.004;

fn scene_at(x: f64) -> SceneUpdate {
    let camera = Camera {
        eye: Vec3::new(x as f32, 0.0, 1.0),
        target: Vec3::ZERO,
        up: Vec3::Z,
        fov_x_deg: 44.0,
        lens: Lens::default(),
        near_m: 0.0,
    };
    SceneUpdate {
        camera: Some(camera),
        poses: Vec::new(),
        ..SceneUpdate::default()
    }
}

/// A farm of one node on virtual time: frames are traced one after another, each pixel the
/// first sample's index or the camera's place.
struct TestBench {
    scheduler: FrameScheduler,
    accumulator: Accumulator,
    now_secs: f64,
    free_at_secs: f64,
    paths_per_sec: f64,
    round_trip_secs: f64,
    next_id: u64,
    waiting: VecDeque<(f64, Frame)>,
    requests: Vec<FrameRequest>,
    cancels: usize,
}

impl TestBench {
    fn new(paths_per_sec: f64) -> Self {
        Self {
            scheduler: FrameScheduler::new(WINDOW, IN_FLIGHT_MAX, 5),
            accumulator: Accumulator::default(),
            now_secs: 0.0,
            free_at_secs: 0.0,
            paths_per_sec,
            round_trip_secs: 0.0,
            next_id: 0,
            waiting: VecDeque::new(),
            requests: Vec::new(),
            cancels: 0,
        }
    }

    fn step(&mut self, target: &ViewTarget) {
        loop {
            match self.scheduler.plan(
                self.now_secs,
                target,
                IN_FLIGHT_MAX.saturating_sub(self.waiting.len()),
                &scene_at,
            ) {
                SchedulerAction::Rest => break,
                SchedulerAction::Cancel(_) => {
                    self.cancels += 1;
                    self.waiting.clear();
                    self.free_at_secs = self.now_secs;
                }
                SchedulerAction::Trace(request) => self.submit(request),
            }
        }
        self.now_secs += STEP_SECS;
        while self
            .waiting
            .front()
            .is_some_and(|(done, _)| *done <= self.now_secs)
        {
            let (_, frame) = self.waiting.pop_front().unwrap();
            if let Some((series, batch)) = self.scheduler.finished(frame) {
                self.accumulator.add(series, &batch).unwrap();
                self.scheduler
                    .accumulated(self.accumulator.frame().unwrap());
            }
        }
    }

    fn picture(&mut self) -> Option<&DisplayFrame> {
        self.scheduler.present_due(&mut |_, _, _| {});
        self.scheduler.shown()
    }

    /// Half a round trip, with exponential jitter of 1 ms over a long way.
    fn way_secs(&self) -> f64 {
        if self.round_trip_secs == 0.0 {
            return 0.0;
        }
        let [u, ..] = uniforms(self.next_id as u32, self.waiting.len() as u32, 0, 7);
        0.5 * self.round_trip_secs - 0.001 * f64::from(1.0 - u).ln()
    }

    fn submit(&mut self, request: FrameRequest) {
        let paths = request.spec.size.pixels() as f64 * f64::from(request.spec.settings.samples);
        let arrived = self.now_secs + self.way_secs();
        let busy_secs = 0.001 + paths / self.paths_per_sec;
        let done = self.free_at_secs.max(arrived) + busy_secs;
        self.free_at_secs = done;
        // Frames arrive in the order of requests.
        let before = self.waiting.back().map_or(0.0, |(done, _)| *done);
        let done = before.max(done + self.way_secs());
        self.next_id += 1;
        let id = FrameId(self.next_id);
        let place = request
            .spec
            .update
            .camera
            .map_or(0.0, |camera| camera.eye.x);
        let pixels = match request.spec.format {
            PixelFormat::Srgb8 { .. } => Pixels::Srgb8(vec![
                [(place * 100.0).round() as u8; 4];
                request.spec.size.pixels()
            ]),
            _ => Pixels::Linear(vec![[0.25; 3]; request.spec.size.pixels()]),
        };
        let stats = FrameStats {
            makespan_secs: done - self.now_secs,
            busy_secs,
            ..FrameStats::default()
        };
        self.waiting.push_back((
            done,
            Frame {
                id,
                size: request.spec.size,
                pixels,
                missing: Vec::new(),
                stats,
            },
        ));
        self.scheduler.submitted(id, &request);
        self.requests.push(request);
    }
}

const IN_FLIGHT_MAX: usize = 8;
const ROUND_TRIP_SECS: f64 = 0.046;

#[test]
fn over_a_long_way_a_shot_keeps_its_clock_and_60_pictures_a_second() {
    let mut bench = TestBench::new(4e6);
    bench.round_trip_secs = ROUND_TRIP_SECS;
    for i in 0..500 {
        bench.step(&ViewTarget::Live(scene_at(f64::from(i) * 0.001)));
    }
    let start = bench.now_secs + bench.scheduler.stroke_delay_secs();
    let (mut errors, mut serials) = (Vec::new(), Vec::new());
    while bench.now_secs < start + 4.0 {
        let clock_secs = bench.now_secs - start;
        let target = ViewTarget::Shot(ShotClock {
            number: 1,
            now_secs: clock_secs,
            end_secs: 5.0,
        });
        bench.step(&target);
        if clock_secs < 0.0 {
            continue;
        }
        let picture = bench.picture().unwrap();
        let moment = picture.update.camera.unwrap().eye.x;
        errors.push((f64::from(moment) - clock_secs).abs());
        serials.push(picture.serial);
    }
    let period = SMOOTH_PERIOD_SECS;
    let good = errors.iter().filter(|error| **error <= period + STEP_SECS);
    let good = good.count();
    assert!(
        good * 100 >= errors.len() * 99,
        "{good} of {}",
        errors.len()
    );
    serials.dedup();
    assert!(serials.len() >= 4 * 60 - 5, "{} pictures", serials.len());
}

#[test]
fn over_a_long_way_the_hand_sees_60_drafts_a_second() {
    let mut bench = TestBench::new(4e6);
    bench.round_trip_secs = ROUND_TRIP_SECS;
    let mut step = |i: u32| {
        bench.step(&ViewTarget::Live(scene_at(f64::from(i) * 0.001)));
        bench.scheduler.stats().pictures
    };
    let warm = (0..500).map(&mut step).last().unwrap();
    let pictures = (500..1000).map(&mut step).last().unwrap() - warm;
    assert!(pictures >= 118, "{pictures} in 2 s");
    let lag = bench.scheduler.stats().lead_secs;
    assert!(lag < ROUND_TRIP_SECS + 0.03, "{lag} s behind the hand");
}

#[test]
fn a_still_table_is_drafted_once_and_then_refined_by_disjoint_samples() {
    let mut bench = TestBench::new(1e5);
    let target = ViewTarget::Live(scene_at(0.5));
    (0..2000).for_each(|_| bench.step(&target));
    let (draft, refinements) = bench.requests.split_first().unwrap();
    assert_eq!(draft.role, RequestKind::Interactive);
    let mut next = 0;
    for request in refinements {
        assert_eq!(
            (request.role, request.spec.size),
            (RequestKind::Accumulation, WINDOW)
        );
        assert_eq!(request.spec.settings.first_sample, next);
        next += request.spec.settings.samples;
    }
    assert!(next > 100 && next <= SAMPLES_MAX, "{next} samples in 8 s");
    // 0.25 in linear light is 137 in sRGB.
    assert_eq!(bench.picture().unwrap().rgba[0], [137, 137, 137, 255]);
}

#[test]
fn a_resolution_bounds_pictures_at_rest_and_leaves_coarser_ones() {
    let sizes = |resolution| {
        let mut bench = TestBench::new(1e6);
        bench.scheduler.set_resolution(resolution);
        for _ in 0..200 {
            bench.step(&ViewTarget::Live(scene_at(1.0)));
        }
        let size = |request: &FrameRequest| request.spec.size;
        let drafted = bench.requests.first().map(size);
        (drafted, bench.requests.last().map(size))
    };
    let (drafted, refined) = sizes(Resolution::Full);
    assert_eq!(refined, Some(WINDOW));
    assert_eq!(sizes(Resolution::Half), (drafted, Some(WINDOW.scaled(0.5))));
}

#[test]
fn refinement_ends_and_then_nothing_is_asked() {
    let mut bench = TestBench::new(1e8);
    let target = ViewTarget::Live(scene_at(0.5));
    (0..3000).for_each(|_| bench.step(&target));
    assert!(bench.scheduler.is_at_rest());
    let asked: u32 = bench.requests[1..]
        .iter()
        .map(|request| request.spec.settings.samples)
        .sum();
    assert_eq!(asked, SAMPLES_MAX);
}

#[test]
fn a_movement_stops_refinement_and_is_drafted_at_once() {
    let mut bench = TestBench::new(1e5);
    (0..200).for_each(|_| bench.step(&ViewTarget::Live(scene_at(0.5))));
    assert_eq!(
        bench.requests.last().unwrap().role,
        RequestKind::Accumulation
    );
    bench.step(&ViewTarget::Live(scene_at(0.7)));
    assert_eq!(
        (bench.cancels, bench.requests.last().unwrap().role),
        (1, RequestKind::Interactive)
    );
    (0..20).for_each(|_| bench.step(&ViewTarget::Live(scene_at(0.7))));
    assert_eq!(bench.picture().unwrap().rgba[0][0], 70);
}

#[test]
fn while_the_hand_moves_drafts_keep_coming() {
    let mut bench = TestBench::new(1e5);
    for i in 0..250 {
        bench.step(&ViewTarget::Live(scene_at(f64::from(i) * 0.01)));
    }
    assert!(
        bench
            .requests
            .iter()
            .all(|request| request.role == RequestKind::Interactive)
    );
    assert_eq!(bench.cancels, 0);
    // One second at 30 pictures a second, more or less.
    assert!(
        (15..=120).contains(&bench.requests.len()),
        "{} drafts",
        bench.requests.len()
    );
}

/// Frame `id` with pixels of one value, whose left half may be missing.
fn frame(id: u64, value: u8, missing: bool) -> Frame {
    let left = Tile {
        x: 0,
        y: 0,
        width: WINDOW.width / 2,
        height: WINDOW.height,
    };
    Frame {
        id: FrameId(id),
        size: WINDOW,
        pixels: Pixels::Srgb8(vec![[value; 4]; WINDOW.pixels()]),
        missing: missing.then_some(left).into_iter().collect(),
        stats: FrameStats::default(),
    }
}

#[test]
fn what_is_late_is_filled_from_the_picture_before_until_it_comes() {
    let mut scheduler = FrameScheduler::new(WINDOW, IN_FLIGHT_MAX, 5);
    let at = |scheduler: &mut FrameScheduler, clock_secs: f64| {
        let shot = ViewTarget::Shot(ShotClock {
            number: 1,
            now_secs: clock_secs,
            end_secs: 2.0,
        });
        scheduler.plan(clock_secs + 1.0, &shot, 1, &scene_at)
    };
    let mut moments = Vec::new();
    for id in 0..3 {
        let SchedulerAction::Trace(request) = at(&mut scheduler, 0.017 * f64::from(id)) else {
            panic!("a moment is asked for");
        };
        let RequestKind::Lookahead(moment) = request.role else {
            panic!("it is a moment");
        };
        let deadline = request.deadline.unwrap().as_secs_f64();
        assert!((deadline - (moment - 0.017 * f64::from(id))).abs() < 1e-6);
        moments.push(moment);
        scheduler.submitted(FrameId(u64::from(id as u32)), &request);
    }
    let fills = std::cell::RefCell::new(Vec::new());
    let look = |scheduler: &mut FrameScheduler, clock_secs: f64| {
        at(scheduler, clock_secs);
        let fill = &mut |picture: &mut DisplayFrame, missing: &[Tile], before: &DisplayFrame| {
            assert_eq!(missing[0].width, WINDOW.width / 2);
            picture.rgba[0] = before.rgba[0];
            fills.borrow_mut().push(picture.serial);
        };
        scheduler.present_due(fill);
        scheduler
            .shown()
            .map(|picture| (picture.rgba[0][0], picture.rgba[WINDOW.pixels() - 1][0]))
    };
    // Nothing to fill it from: nothing is shown.
    scheduler.finished(frame(0, 10, true));
    assert_eq!(look(&mut scheduler, moments[0] + 0.001), None);
    scheduler.finished(frame(0, 10, false));
    assert_eq!(look(&mut scheduler, moments[0] + 0.002), Some((10, 10)));
    scheduler.finished(frame(1, 20, true));
    assert_eq!(look(&mut scheduler, moments[1] + 0.001), Some((10, 20)));
    // The late tiles replace what stood in for them, at once.
    scheduler.finished(frame(1, 20, false));
    assert_eq!(look(&mut scheduler, moments[1] + 0.002), Some((20, 20)));
    scheduler.finished(frame(2, 30, false));
    assert_eq!(look(&mut scheduler, moments[2] + 0.001), Some((30, 30)));
    assert_eq!(fills.borrow().len(), 1);
    assert_eq!(scheduler.stats().late_tiles, 2);
    assert_eq!(scheduler.stats().pictures, 3);
}

#[test]
fn a_shot_is_shown_on_its_own_clock_whatever_the_latency() {
    let mut bench = TestBench::new(4e5);
    let start = 0.3;
    let mut errors = Vec::new();
    while bench.now_secs < start + 2.0 {
        let clock_secs = bench.now_secs - start;
        bench.step(&ViewTarget::Shot(ShotClock {
            number: 1,
            now_secs: clock_secs,
            end_secs: 2.5,
        }));
        let shown = bench.picture().map(|picture| picture.rgba[0][0]);
        if let (Some(hundredths), true) = (shown, clock_secs > 0.5) {
            errors.push((f64::from(hundredths) / 100.0 - clock_secs).abs());
        }
    }
    let worst = errors.iter().copied().fold(0.0, f64::max);
    // A picture stays until the next one: at most two periods, and pixels count hundredths.
    assert!(
        errors.len() > 100 && worst <= 2.0 * STEADY_PERIOD_SECS + 0.006,
        "off by {worst} s"
    );
    let skipped = bench.scheduler.stats().skipped as usize;
    assert!(
        skipped * 20 <= bench.requests.len(),
        "{skipped} of {} skipped",
        bench.requests.len()
    );
}

fn still_of(x: f64) -> OpeningStill {
    let size = ImageSize::new(60, 34);
    OpeningStill {
        size,
        rgba: vec![[7; 4]; size.pixels()],
        update: scene_at(x),
    }
}

#[test]
fn a_still_stays_until_a_finer_frame_of_the_same_view() {
    let mut bench = TestBench::new(20_000.0);
    bench.scheduler.show_still(still_of(0.3));
    let target = ViewTarget::Live(scene_at(0.31));
    let mut shown = Vec::new();
    for _ in 0..2_000 {
        bench.step(&target);
        shown.extend(bench.picture().map(|picture| picture.size));
    }
    shown.dedup();
    assert_eq!(shown, [ImageSize::new(60, 34), WINDOW]);
    let drafts = bench.requests.iter().filter(|request| {
        request.role == RequestKind::Interactive && request.spec.size.pixels() < 60 * 34
    });
    assert!(drafts.count() > 0, "a coarser draft was traced");
}

#[test]
fn a_still_ends_when_the_view_moves_or_the_balls_lie_elsewhere() {
    for (first, then) in [(0.3, 0.5), (0.3, 0.31)] {
        let mut bench = TestBench::new(20_000.0);
        let mut still = still_of(0.3);
        if then == 0.31 {
            still.update.poses.push(ObjectPose {
                object: 0,
                position: Vec3::X,
                rotation: glam::Quat::IDENTITY,
                visible: true,
            });
        }
        bench.scheduler.show_still(still);
        bench.step(&ViewTarget::Live(scene_at(first)));
        bench.now_secs += SETTLE_SECS;
        let target = ViewTarget::Live(scene_at(then));
        let coarse = (0..500).any(|_| {
            bench.step(&target);
            let size = bench.picture().map(|picture| picture.size);
            size.is_some_and(|size| size.pixels() < 60 * 34)
        });
        assert!(coarse, "a draft is shown for {then}");
    }
}
