//! Laws of live pictures.

use carom_farm::{Live, LiveView, Picture};
use carom_tracer::glam::Quat;
use carom_tracer::{Camera, Material, Sphere};

use super::*;

/// A ball in a scene of its own, and its handle.
fn ball() -> (Scene, carom_tracer::ObjectHandle) {
    let mut scene = Scene::new();
    let ball = scene.add(Sphere::new(0.5), Material::grey(0.5));
    (scene, ball)
}

fn view(farm: &mut Farm, scene: &Scene) -> LiveView {
    let live = Live::new(40, 30).samples_per_frame(2).samples(16);
    farm.live(scene, live).unwrap()
}

/// The next picture that `is_wanted`.
fn wait_for(view: &mut LiveView, is_wanted: impl Fn(&Picture) -> bool) -> Picture {
    let deadline = std::time::Instant::now() + PATIENCE;
    loop {
        match view.latest().unwrap() {
            Some(picture) if is_wanted(&picture) => return picture,
            _ => assert!(std::time::Instant::now() < deadline, "no such picture came"),
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn is_whole(picture: &Picture) -> bool {
    picture.samples() == 16
}

#[test]
fn samples_gather_while_nothing_changes_and_begin_anew_when_something_does() {
    let (scene, ball) = ball();
    let mut farm = farm(vec![PatternTracer::new()]);
    let mut view = view(&mut farm, &scene);
    let first = wait_for(&mut view, is_whole);
    let camera = Camera::looking_at([0.0, -5.0, 1.0], [0.0; 3]);
    view.set_camera(camera).unwrap();
    let moved = wait_for(&mut view, is_whole);
    assert!(moved.film().to_bytes() != first.film().to_bytes());
    view.move_to(ball, [0.1, 0.0, 0.0], Quat::IDENTITY).unwrap();
    wait_for(&mut view, is_whole);
    view.set_visible(ball, false).unwrap();
    wait_for(&mut view, is_whole);
    view.resize(20, 10).unwrap();
    assert_eq!(wait_for(&mut view, is_whole).size(), ImageSize::new(20, 10));
    // What is the same is no change.
    view.set_camera(camera).unwrap();
    std::thread::sleep(Duration::from_millis(20));
    assert!(view.latest().unwrap().is_none());
}

#[test]
fn a_view_that_moves_all_the_time_is_seen_to_move() {
    let (scene, ball) = ball();
    let mut farm = farm(vec![PatternTracer::new().with_pace(100)]);
    let mut view = view(&mut farm, &scene);
    let deadline = std::time::Instant::now() + PATIENCE;
    let mut pictures = 0;
    for step in 0_u16.. {
        let x = f32::from(step) * 1e-3;
        view.move_to(ball, [x, 0.0, 0.0], Quat::IDENTITY).unwrap();
        pictures += usize::from(view.latest().unwrap().is_some());
        if pictures == 5 {
            return;
        }
        assert!(std::time::Instant::now() < deadline, "{pictures} pictures");
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_view_refuses_what_does_not_fit_and_stays_as_it_was() {
    let ((scene, _), (_, stranger)) = (ball(), ball());
    let mut farm = farm(vec![PatternTracer::new()]);
    let mut view = view(&mut farm, &scene);
    let why = view.move_to(stranger, [0.0; 3], Quat::IDENTITY);
    let why = why.unwrap_err().to_string();
    assert!(
        why.contains("object 0") && why.contains("another scene"),
        "{why}"
    );
    let blind = Camera::looking_at([f32::NAN, 0.0, 0.0], [0.0; 3]);
    let why = view.set_camera(blind).unwrap_err().to_string();
    assert!(why.contains("the camera's eye is [NaN"), "{why}");
    let why = view.resize(0, 10).unwrap_err().to_string();
    assert!(why.contains("0x10"), "{why}");
    wait_for(&mut view, is_whole);
    let why = farm.live(&Scene::new(), Live::new(4, 4)).err().unwrap();
    assert!(why.to_string().contains("0 objects"), "{why}");
}

#[test]
fn a_view_without_nodes_says_so_and_wakes_its_owner() {
    let (scene, _) = ball();
    let config = FarmConfig {
        timeout_secs: Some(1),
        ..config()
    };
    let mut farm = Farm::with_tracers(config, Vec::new()).unwrap();
    let (sender, woken) = std::sync::mpsc::channel();
    let live = Live::new(4, 4).on_frame(move || sender.send(()).unwrap_or_default());
    let mut view = farm.live(&scene, live).unwrap();
    woken.recv_timeout(PATIENCE).expect("a call");
    assert!(matches!(view.latest(), Err(Error::NoNodes { .. })));
}

#[test]
fn drafts_come_first_and_give_way_to_the_full_size() {
    let (scene, _) = ball();
    let mut farm = farm(vec![PatternTracer::new()]);
    let live = Live::new(640, 480).samples(16).drafts(Default::default());
    let mut view = farm.live(&scene, live).unwrap();
    let full = ImageSize::new(640, 480);
    for turn in 0_u8..3 {
        let eye = [f32::from(turn), -4.0, 1.0];
        view.set_camera(Camera::looking_at(eye, [0.0; 3])).unwrap();
        let whole = wait_for(&mut view, |picture| {
            is_whole(picture) && picture.size() == full
        });
        assert_eq!(whole.samples(), 16);
        let frames = view.frames();
        let draft = frames.iter().find(|frame| frame.size != full);
        let draft = draft.expect("a draft among the frames");
        assert!(draft.stats.makespan_secs > 0.0);
    }
    let quality = view.quality().expect("drafts");
    assert!(quality.secs(quality.level(), full).is_some());
}

#[test]
fn a_full_picture_is_shown_once_it_is_better_than_its_draft() {
    let (scene, _) = ball();
    let mut farm = farm(vec![PatternTracer::new().with_pace(20)]);
    let live = Live::new(640, 480).samples(32).drafts(Default::default());
    let mut view = farm.live(&scene, live).unwrap();
    let full = wait_for(&mut view, |picture| picture.size().width == 640);
    assert!(full.samples() >= Live::DRAFT_SAMPLES, "{}", full.samples());
}

#[test]
fn a_paused_view_shows_changes_and_gathers_no_samples() {
    let (scene, _) = ball();
    let mut farm = farm(vec![PatternTracer::new()]);
    let live = Live::new(64, 48)
        .samples(1 << 12)
        .drafts(Default::default());
    let mut view = farm.live(&scene, live).unwrap();
    wait_for(&mut view, |picture| picture.samples() > 16);
    view.set_paused(true);
    let camera = Camera::looking_at([0.0, -5.0, 1.0], [0.0; 3]);
    view.set_camera(camera).unwrap();
    wait_for(&mut view, |picture| picture.size().width < 64);
    view.frames();
    // Had it gone on, a frame would have come by now.
    std::thread::sleep(Duration::from_millis(50));
    assert_eq!(view.frames().len(), 0);
    view.set_paused(false);
    wait_for(&mut view, |picture| picture.samples() == 1 << 12);
}

#[test]
fn frames_that_nobody_takes_are_bounded() {
    let (scene, _) = ball();
    let mut farm = farm(vec![PatternTracer::new()]);
    let live = Live::new(8, 8).samples(256);
    let mut view = farm.live(&scene, live).unwrap();
    wait_for(&mut view, |picture| picture.samples() == 256);
    let frames = view.frames();
    assert_eq!(frames.len(), LiveView::FRAMES_MAX);
    assert!(frames.windows(2).all(|pair| pair[0].id < pair[1].id));
    assert!(view.frames().is_empty());
}
