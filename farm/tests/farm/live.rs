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
