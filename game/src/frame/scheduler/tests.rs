//! The director with a farm on virtual time.

use carom_farm::FrameStats;
use carom_tracer::Camera;
use carom_tracer::sampling::uniforms;
use glam::Vec3;

use super::*;
use crate::frame::accumulation::Bath;
use crate::frame::quality::{SMOOTH_PERIOD_SECS, STEADY_PERIOD_SECS};

const WINDOW: ImageSize = ImageSize::new(64, 36);
const STEP_SECS: f64 = 0.004;

fn scene_at(x: f64) -> SceneUpdate {
    let camera = Camera {
        eye: Vec3::new(x as f32, 0.0, 1.0),
        target: Vec3::ZERO,
        up: Vec3::Z,
        fov_x_deg: 44.0,
    };
    SceneUpdate {
        camera: Some(camera),
        poses: Vec::new(),
    }
}

/// A farm of one node on virtual time: frames are traced one after another, each pixel the
/// first sample's index or the camera's place.
struct Bench {
    director: Director,
    bath: Bath,
    now_secs: f64,
    free_at_secs: f64,
    paths_per_sec: f64,
    round_trip_secs: f64,
    next_id: u64,
    waiting: VecDeque<(f64, Frame)>,
    orders: Vec<Order>,
    cancels: usize,
}

impl Bench {
    fn new(paths_per_sec: f64) -> Self {
        Self {
            director: Director::new(WINDOW, IN_FLIGHT_MAX, 5),
            bath: Bath::default(),
            now_secs: 0.0,
            free_at_secs: 0.0,
            paths_per_sec,
            round_trip_secs: 0.0,
            next_id: 0,
            waiting: VecDeque::new(),
            orders: Vec::new(),
            cancels: 0,
        }
    }

    fn step(&mut self, subject: &Subject) {
        loop {
            match self.director.plan(
                self.now_secs,
                subject,
                IN_FLIGHT_MAX.saturating_sub(self.waiting.len()),
                &scene_at,
            ) {
                Plan::Rest => break,
                Plan::CancelAll => {
                    self.cancels += 1;
                    self.waiting.clear();
                    self.free_at_secs = self.now_secs;
                }
                Plan::Trace(order) => self.submit(order),
            }
        }
        self.now_secs += STEP_SECS;
        while self
            .waiting
            .front()
            .is_some_and(|(done, _)| *done <= self.now_secs)
        {
            let (_, frame) = self.waiting.pop_front().unwrap();
            if let Some(negative) = self.director.finished(frame) {
                self.bath.add(&negative).unwrap();
                self.director.printed(self.bath.print().unwrap());
            }
        }
    }

    fn picture(&mut self) -> Option<&Picture> {
        self.director.picture(&mut |_, _, _| {})
    }

    /// Half a round trip, with exponential jitter of 1 ms over a long way.
    fn way_secs(&self) -> f64 {
        if self.round_trip_secs == 0.0 {
            return 0.0;
        }
        let [u, ..] = uniforms(self.next_id as u32, self.waiting.len() as u32, 0, 7);
        0.5 * self.round_trip_secs - 0.001 * f64::from(1.0 - u).ln()
    }

    fn submit(&mut self, order: Order) {
        let paths = order.spec.size.pixels() as f64 * f64::from(order.spec.settings.samples);
        let arrived = self.now_secs + self.way_secs();
        let busy_secs = 0.001 + paths / self.paths_per_sec;
        let done = self.free_at_secs.max(arrived) + busy_secs;
        self.free_at_secs = done;
        // Pictures come in order.
        let before = self.waiting.back().map_or(0.0, |(done, _)| *done);
        let done = before.max(done + self.way_secs());
        self.next_id += 1;
        let id = FrameId(self.next_id);
        let place = order.spec.update.camera.map_or(0.0, |camera| camera.eye.x);
        let pixels = match order.spec.format {
            PixelFormat::Srgb8 { .. } => Pixels::Srgb8(vec![
                [(place * 100.0).round() as u8; 3];
                order.spec.size.pixels()
            ]),
            _ => Pixels::Linear(vec![[0.25; 3]; order.spec.size.pixels()]),
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
                size: order.spec.size,
                pixels,
                missing: Vec::new(),
                stats,
            },
        ));
        self.director.submitted(id, &order);
        self.orders.push(order);
    }
}

const IN_FLIGHT_MAX: usize = 8;
const ROUND_TRIP_SECS: f64 = 0.046;

#[test]
fn over_a_long_way_a_shot_keeps_its_clock_and_60_pictures_a_second() {
    let mut bench = Bench::new(4e6);
    bench.round_trip_secs = ROUND_TRIP_SECS;
    for i in 0..500 {
        bench.step(&Subject::Live(scene_at(f64::from(i) * 0.001)));
    }
    let start = bench.now_secs + bench.director.stroke_delay_secs();
    let (mut errors, mut serials) = (Vec::new(), Vec::new());
    while bench.now_secs < start + 4.0 {
        let clock_secs = bench.now_secs - start;
        let subject = Subject::Shot {
            number: 1,
            clock_secs,
            end_secs: 5.0,
        };
        bench.step(&subject);
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
    let mut bench = Bench::new(4e6);
    bench.round_trip_secs = ROUND_TRIP_SECS;
    let mut step = |i: u32| {
        bench.step(&Subject::Live(scene_at(f64::from(i) * 0.001)));
        bench.director.figures().pictures
    };
    let warm = (0..500).map(&mut step).last().unwrap();
    let pictures = (500..1000).map(&mut step).last().unwrap() - warm;
    assert!(pictures >= 118, "{pictures} in 2 s");
    let lag = bench.director.figures().lead_secs;
    assert!(lag < ROUND_TRIP_SECS + 0.03, "{lag} s behind the hand");
}

#[test]
fn a_still_table_is_drafted_once_and_then_refined_by_disjoint_samples() {
    let mut bench = Bench::new(1e5);
    let subject = Subject::Live(scene_at(0.5));
    (0..2000).for_each(|_| bench.step(&subject));
    let (draft, refinements) = bench.orders.split_first().unwrap();
    assert_eq!(draft.role, Role::Draft);
    let mut next = 0;
    for order in refinements {
        assert_eq!((order.role, order.spec.size), (Role::Refinement, WINDOW));
        assert_eq!(order.spec.settings.first_sample, next);
        next += order.spec.settings.samples;
    }
    assert!(next > 100 && next <= SAMPLES_MAX, "{next} samples in 8 s");
    // 0.25 in linear light is 137 in sRGB.
    assert_eq!(bench.picture().unwrap().rgba[0], [137, 137, 137, 255]);
}

#[test]
fn refinement_ends_and_then_nothing_is_asked() {
    let mut bench = Bench::new(1e8);
    let subject = Subject::Live(scene_at(0.5));
    (0..3000).for_each(|_| bench.step(&subject));
    assert!(bench.director.is_at_rest());
    let asked: u32 = bench.orders[1..]
        .iter()
        .map(|order| order.spec.settings.samples)
        .sum();
    assert_eq!(asked, SAMPLES_MAX);
}

#[test]
fn a_movement_stops_refinement_and_is_drafted_at_once() {
    let mut bench = Bench::new(1e5);
    (0..200).for_each(|_| bench.step(&Subject::Live(scene_at(0.5))));
    assert_eq!(bench.orders.last().unwrap().role, Role::Refinement);
    bench.step(&Subject::Live(scene_at(0.7)));
    assert_eq!(
        (bench.cancels, bench.orders.last().unwrap().role),
        (1, Role::Draft)
    );
    (0..20).for_each(|_| bench.step(&Subject::Live(scene_at(0.7))));
    assert_eq!(bench.picture().unwrap().rgba[0][0], 70);
}

#[test]
fn while_the_hand_moves_drafts_keep_coming() {
    let mut bench = Bench::new(1e5);
    for i in 0..250 {
        bench.step(&Subject::Live(scene_at(f64::from(i) * 0.01)));
    }
    assert!(bench.orders.iter().all(|order| order.role == Role::Draft));
    assert_eq!(bench.cancels, 0);
    // One second at 30 pictures a second, more or less.
    assert!(
        (15..=120).contains(&bench.orders.len()),
        "{} drafts",
        bench.orders.len()
    );
}

/// Of frame `id`, all of one value, with the left half missing or not.
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
        pixels: Pixels::Srgb8(vec![[value; 3]; WINDOW.pixels()]),
        missing: missing.then_some(left).into_iter().collect(),
        stats: FrameStats::default(),
    }
}

#[test]
fn what_is_late_is_filled_from_the_picture_before_until_it_comes() {
    let mut director = Director::new(WINDOW, IN_FLIGHT_MAX, 5);
    let at = |director: &mut Director, clock_secs: f64| {
        let shot = Subject::Shot {
            number: 1,
            clock_secs,
            end_secs: 2.0,
        };
        director.plan(clock_secs + 1.0, &shot, 1, &scene_at)
    };
    let mut moments = Vec::new();
    for id in 0..3 {
        let Plan::Trace(order) = at(&mut director, 0.017 * f64::from(id)) else {
            panic!("a moment is asked for");
        };
        let Role::Moment(moment) = order.role else {
            panic!("it is a moment");
        };
        let deadline = order.deadline.unwrap().as_secs_f64();
        assert!((deadline - (moment - 0.017 * f64::from(id))).abs() < 1e-6);
        moments.push(moment);
        director.submitted(FrameId(u64::from(id as u32)), &order);
    }
    let fills = std::cell::RefCell::new(Vec::new());
    let look = |director: &mut Director, clock_secs: f64| {
        at(director, clock_secs);
        let fill = &mut |picture: &mut Picture, missing: &[Tile], before: &Picture| {
            assert_eq!(missing[0].width, WINDOW.width / 2);
            picture.rgba[0] = before.rgba[0];
            fills.borrow_mut().push(picture.serial);
        };
        let picture = director.picture(fill);
        picture.map(|picture| (picture.rgba[0][0], picture.rgba[WINDOW.pixels() - 1][0]))
    };
    // Nothing to fill it from: nothing is shown.
    director.finished(frame(0, 10, true));
    assert_eq!(look(&mut director, moments[0] + 0.001), None);
    director.finished(frame(0, 10, false));
    assert_eq!(look(&mut director, moments[0] + 0.002), Some((10, 10)));
    director.finished(frame(1, 20, true));
    assert_eq!(look(&mut director, moments[1] + 0.001), Some((10, 20)));
    // The late tiles replace what stood in for them, at once.
    director.finished(frame(1, 20, false));
    assert_eq!(look(&mut director, moments[1] + 0.002), Some((20, 20)));
    director.finished(frame(2, 30, false));
    assert_eq!(look(&mut director, moments[2] + 0.001), Some((30, 30)));
    assert_eq!(fills.borrow().len(), 1);
    assert_eq!(director.figures().late_tiles, 2);
    assert_eq!(director.figures().pictures, 3);
}

#[test]
fn a_shot_is_shown_on_its_own_clock_whatever_the_latency() {
    let mut bench = Bench::new(4e5);
    let start = 0.3;
    let mut errors = Vec::new();
    while bench.now_secs < start + 2.0 {
        let clock_secs = bench.now_secs - start;
        bench.step(&Subject::Shot {
            number: 1,
            clock_secs,
            end_secs: 2.5,
        });
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
    let skipped = bench.director.figures().skipped as usize;
    assert!(
        skipped * 20 <= bench.orders.len(),
        "{skipped} of {} skipped",
        bench.orders.len()
    );
}
