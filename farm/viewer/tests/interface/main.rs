//! Tests of the viewer's interface by its texts, keys and pointer, and by its appearance. The tests play the
//! renderer's part.

#[path = "../dolly/mod.rs"]
mod dolly;
#[path = "../../../window/tests/looks/mod.rs"]
mod looks;
mod pictures;
mod stage;

use std::path::PathBuf;

use carom_farm::{FrameStats, SceneFile};
use carom_view::controls::CONTROLS;
use carom_view::render::{FrameCamera, SaveOrder};
use egui::accesskit::Role;
use egui::{Key, Modifiers, PointerButton, Pos2, pos2};
use egui_kittest::kittest::{NodeT as _, Queryable as _};
use glam::Vec3;
use stage::{Stage, opened, scene, stage};

/// A point in the picture, outside the panel.
const PLACE: Pos2 = pos2(800.0, 300.0);

fn drag(stage: &mut Stage, button: PointerButton, modifiers: Modifiers, by: egui::Vec2) {
    let press = |pos, pressed| egui::Event::PointerButton {
        pos,
        button,
        pressed,
        modifiers,
    };
    stage.harness.hover_at(PLACE);
    stage.harness.run_steps(2);
    let events = [
        egui::Event::ModifiersChanged(modifiers),
        press(PLACE, true),
        egui::Event::PointerMoved(PLACE + 0.5 * by),
        egui::Event::PointerMoved(PLACE + by),
        press(PLACE + by, false),
        egui::Event::ModifiersChanged(Modifiers::NONE),
    ];
    for event in events {
        stage.harness.event(event);
        stage.harness.run_steps(1);
    }
    stage.harness.run_steps(2);
}

fn press(stage: &mut Stage, key: Key) {
    stage.harness.key_press(key);
    stage.harness.run_steps(2);
}

#[test]
fn an_empty_window_says_what_can_be_dropped_and_where_the_keys_are() {
    let stage = stage();
    assert!(stage.has("Drop a scene on this window"));
    assert!(stage.has(".json, .gltf, .glb, .obj, .ply"));
    assert!(stage.has("F1 shows the keys"));
    assert!(!stage.has("Exposure"), "nothing to expose");
    assert!(stage.wanted().look.is_none());
}

#[test]
fn a_file_that_is_dropped_is_asked_for_and_seen_as_its_scene_has_it() {
    let mut stage = stage();
    stage.viewer().hover(true);
    stage.viewer().open(PathBuf::from("rooms/hall.json"));
    stage.post(|news| news.reading = Some(PathBuf::from("rooms/hall.json")));
    assert_eq!(
        stage.wanted().file,
        Some((1, PathBuf::from("rooms/hall.json")))
    );
    assert!(stage.has("Reading hall.json"));
    stage.post(|news| {
        news.reading = None;
        news.opened = Some(opened(1, "rooms/hall.json", false));
    });
    let look = stage.wanted().look.expect("a scene is open");
    assert_eq!((look.scene, look.camera), (1, scene().camera));
    assert_eq!(stage.viewer().title(), "hall.json – Carom viewer");
    assert!(stage.has("1 object, 0 triangles, 2 lamps"));
    assert!(!stage.has("Drop a scene"));
}

#[test]
fn the_pointer_orbits_pans_looks_around_and_zooms() {
    let mut stage = stage::with_scene();
    let home = scene().camera;
    let distance = home.eye.distance(home.target);
    drag(
        &mut stage,
        PointerButton::Primary,
        Modifiers::NONE,
        egui::vec2(200.0, 50.0),
    );
    let orbited = stage.camera();
    assert_eq!(orbited.target, home.target);
    assert!((orbited.eye.distance(orbited.target) - distance).abs() < 1e-4);
    // The picture follows the pointer, so the camera moves to the left and up.
    assert!(
        orbited.eye.x < home.eye.x - 0.5 && orbited.eye.z > home.eye.z + 0.1,
        "{orbited:?}"
    );
    press(&mut stage, Key::Home);
    assert_eq!(stage.camera(), home);
    for (button, modifiers) in [
        (PointerButton::Middle, Modifiers::NONE),
        (PointerButton::Primary, Modifiers::SHIFT),
    ] {
        drag(&mut stage, button, modifiers, egui::vec2(100.0, 0.0));
        let panned = stage.camera();
        let shift = panned.target - home.target;
        assert!((panned.eye - home.eye).distance(shift) < 1e-4, "{panned:?}");
        assert!(shift.x < -0.1 && shift.y.abs() < 1e-4, "{shift}");
        press(&mut stage, Key::Home);
    }
    drag(
        &mut stage,
        PointerButton::Secondary,
        Modifiers::NONE,
        egui::vec2(100.0, 0.0),
    );
    let looked = stage.camera();
    assert!(looked.eye.distance(home.eye) < 1e-4 && looked.target.x < home.target.x - 0.1);
    press(&mut stage, Key::Home);
    stage.harness.hover_at(PLACE);
    stage.harness.event(egui::Event::MouseWheel {
        unit: egui::MouseWheelUnit::Line,
        delta: egui::vec2(0.0, 3.0),
        phase: egui::TouchPhase::Move,
        source: egui::MouseWheelSource::Wheel,
        modifiers: Modifiers::NONE,
    });
    stage.harness.run_steps(20);
    let zoomed = stage.camera();
    let nearer = zoomed.eye.distance(zoomed.target) / distance;
    assert!((0.5..0.9).contains(&nearer), "{nearer}");
}

#[test]
fn held_keys_walk_until_they_are_released() {
    let mut stage = stage::with_scene();
    let home = scene().camera;
    stage.harness.key_down(Key::W);
    stage.harness.run_steps(5);
    stage.harness.key_up(Key::W);
    stage.harness.run_steps(1);
    let walked = stage.camera();
    let forward = (home.target - home.eye).normalize();
    let way = walked.eye - home.eye;
    assert!(
        way.dot(forward) > 0.1 && way.cross(forward).length() < 1e-3,
        "{way}"
    );
    stage.harness.run_steps(5);
    assert_eq!(stage.camera(), walked);
    // Up is the world's up vector.
    stage.harness.key_down(Key::E);
    stage.harness.run_steps(3);
    stage.harness.key_up(Key::E);
    stage.harness.run_steps(1);
    let rise = stage.camera().eye - walked.eye;
    assert!(rise.normalize().dot(Vec3::Z) > 0.999, "{rise}");
}

#[test]
fn a_panel_takes_the_pointer_and_a_text_field_the_keys() {
    let mut stage = stage::with_scene();
    let home = stage.camera();
    let label = stage.harness.get_by_label("upright").rect().center();
    stage.harness.drag_at(label);
    stage.harness.run_steps(1);
    stage.harness.hover_at(label + egui::vec2(0.0, 40.0));
    stage.harness.run_steps(1);
    stage.harness.drop_at(label + egui::vec2(0.0, 40.0));
    stage.harness.run_steps(1);
    assert_eq!(stage.camera(), home);
    let field = stage.harness.get_by_role_and_label(Role::TextInput, "File");
    field.focus();
    stage.harness.run_steps(2);
    stage.harness.key_down(Key::W);
    stage.harness.key_press(Key::Num0);
    stage.harness.run_steps(3);
    stage.harness.key_up(Key::W);
    stage.harness.run_steps(1);
    assert_eq!(stage.camera(), home);
    assert_eq!(stage.lights().sky, Some(true));
}

#[test]
fn lights_are_switched_in_the_panel_and_by_keys() {
    let mut stage = stage::with_scene();
    stage.harness.get_by_label("Sky").click();
    stage.harness.run_steps(2);
    assert_eq!(stage.lights().sky, Some(false));
    stage.harness.get_by_label("window").click();
    stage.harness.run_steps(2);
    press(&mut stage, Key::Num1);
    assert_eq!(stage.lights().lamps, [false, false]);
    assert!(stage.has("All lights are off"));
    press(&mut stage, Key::Num0);
    assert_eq!(stage.lights().sky, Some(true));
    assert!(!stage.has("All lights are off"));
}

#[test]
fn keys_change_exposure_and_pause() {
    let mut stage = stage::with_scene();
    press(&mut stage, Key::Plus);
    press(&mut stage, Key::Plus);
    assert_eq!(stage.wanted().exposure, 2.0);
    press(&mut stage, Key::Minus);
    assert!((stage.wanted().exposure - std::f32::consts::SQRT_2).abs() < 1e-6);
    press(&mut stage, Key::Home);
    assert_eq!(stage.wanted().exposure, 1.0);
    press(&mut stage, Key::P);
    assert!(stage.wanted().is_paused);
    stage.harness.get_by_label("Pause").click();
    stage.harness.run_steps(2);
    assert!(!stage.wanted().is_paused);
}

#[test]
fn a_bad_file_is_told_of_until_it_is_closed_and_the_scene_stays() {
    let mut stage = stage::with_scene();
    stage.post(|news| news.refused = Some("duck.obj: line 3: no number `x`".to_owned()));
    assert!(stage.has("duck.obj: line 3"));
    assert!(stage.wanted().look.is_some());
    press(&mut stage, Key::F1);
    press(&mut stage, Key::Escape);
    assert!(stage.has("duck.obj"), "Esc closes what was opened last");
    press(&mut stage, Key::Escape);
    assert!(!stage.has("duck.obj"));
    stage.post(|news| news.refused = Some("cow.ply: it ends too early".to_owned()));
    stage.viewer().open(PathBuf::from("horse.ply"));
    stage.harness.run_steps(2);
    assert!(!stage.has("cow.ply"));
}

#[test]
fn a_file_that_has_changed_keeps_the_view_and_another_does_not() {
    let mut stage = stage::with_scene();
    drag(
        &mut stage,
        PointerButton::Primary,
        Modifiers::NONE,
        egui::vec2(150.0, 0.0),
    );
    press(&mut stage, Key::Num1);
    let (camera, lights) = (stage.camera(), stage.lights());
    stage.post(|news| news.opened = Some(opened(2, "hall.json", true)));
    assert_eq!(stage.wanted().look.unwrap().scene, 2);
    assert_eq!((stage.camera(), stage.lights()), (camera, lights));
    stage.post(|news| news.opened = Some(opened(3, "other.json", false)));
    assert_eq!(stage.camera(), scene().camera);
    assert_eq!(stage.lights().lamps, [true, true]);
}

#[test]
fn a_still_is_ordered_told_of_cancelled_and_saved() {
    let mut stage = stage::with_scene();
    press(&mut stage, Key::Plus);
    stage.harness.get_by_label("Save still").click();
    stage.harness.run_steps(2);
    let order = stage.wanted().save.expect("an order");
    assert!(order.path.ends_with("view_0001.png"), "{order:?}");
    assert_eq!((order.size, order.samples), (stage.size(), 256));
    assert_eq!(order.exposure, stage.wanted().exposure);
    assert_eq!((order.views.len(), order.frames_per_sec), (1, None));
    stage.post(|news| news.saving = Some(0.4));
    let bar = stage.harness.get_by_role(Role::ProgressIndicator);
    assert_eq!(bar.accesskit_node().numeric_value(), Some(40.0));
    // A second file is not saved at the same time.
    stage
        .harness
        .key_press_modifiers(Modifiers::COMMAND, Key::S);
    stage.harness.run_steps(2);
    assert_eq!(stage.wanted().save.unwrap().number, order.number);
    stage.harness.get_by_label("Cancel").click();
    stage.harness.run_steps(2);
    assert_eq!(stage.wanted().cancelled_save, order.number);
    stage.post(|news| {
        news.saving = None;
        news.saved = Some(Err("it was cancelled".to_owned()));
    });
    assert!(stage.has("Not saved: it was cancelled"));
    stage.harness.get_by_label("Save turntable").click();
    stage.harness.run_steps(2);
    let film = stage.wanted().save.expect("an order");
    assert_eq!((film.number, film.views.len()), (2, 72));
    assert_eq!(film.frames_per_sec, Some(24));
    std::fs::write(&film.path, "").unwrap();
    stage.post(|news| news.saved = Some(Ok(film.path.clone())));
    assert!(stage.has("Saved ") && stage.has("view_0001.png"));
    press(&mut stage, Key::F2);
    press(&mut stage, Key::F2);
    stage
        .harness
        .key_press_modifiers(Modifiers::COMMAND, Key::S);
    stage.harness.run_steps(2);
    let next = stage.wanted().save.unwrap();
    assert!(next.path.ends_with("view_0002.png"), "{next:?}");
}

#[test]
fn help_lists_every_control_with_its_keys() {
    let mut stage = stage::with_scene();
    press(&mut stage, Key::F1);
    for control in CONTROLS {
        for part in ["key", "does"] {
            let text = carom_text::plain(&format!("view-{part}-{control}"));
            assert!(!text.is_empty(), "{part} of {control}");
            assert!(stage.has(text), "{text}");
        }
    }
    press(&mut stage, Key::Escape);
    assert!(!stage.has("Keys and mouse"));
}

#[test]
fn statistics_are_taken_in_only_while_they_are_shown() {
    let mut stage = stage::with_scene();
    assert!(!stage.wanted().has_statistics);
    press(&mut stage, Key::F3);
    assert!(stage.wanted().has_statistics);
    stage.post(|news| {
        news.frames = (0..3)
            .map(|id| carom_farm::LiveFrame {
                id: carom_farm::FrameId(id),
                size: carom_tracer::ImageSize::new(640, 360),
                samples: 1,
                stats: FrameStats {
                    makespan_secs: 0.0125,
                    ..FrameStats::default()
                },
            })
            .collect();
    });
    stage.harness.run_steps(5);
    assert!(stage.has("each takes 12.5 ms"), "{:?}", stage.texts());
    assert!(stage.has("sharpness 50 %"));
    for _ in 0..4 {
        press(&mut stage, Key::F3);
    }
    assert!(!stage.wanted().has_statistics);
}

#[test]
fn why_there_are_no_pictures_stands_until_there_are() {
    let mut stage = stage::with_scene();
    stage.post(|news| news.fault = Some("no node answers".to_owned()));
    stage.harness.run_steps(200);
    assert!(stage.has("No pictures: no node answers"));
    stage.post(|news| news.fault = Some(String::new()));
    assert!(!stage.has("No pictures"));
}

#[test]
fn the_line_tells_how_many_samples_are_there() {
    let mut stage = stage::with_scene();
    stage.picture(5, true);
    assert!(stage.has("hall.json · F1 keys"));
    stage.picture(16, false);
    assert!(stage.has("hall.json · 16 of 64 samples"));
    stage.post(|news| news.is_cleared = true);
    assert!(stage.viewer().displayed().is_none());
}

#[test]
fn ctrl_q_quits_and_f11_fills_the_screen() {
    let mut stage = stage();
    assert!(!stage.viewer().wants_quit() && !stage.viewer().wants_fullscreen());
    press(&mut stage, Key::F11);
    assert!(stage.viewer().wants_fullscreen());
    stage
        .harness
        .key_press_modifiers(Modifiers::COMMAND, Key::Q);
    stage.harness.run_steps(2);
    assert!(stage.viewer().wants_quit());
}

fn time(stage: &Stage) -> (usize, f64) {
    stage.wanted().look.unwrap().time.expect("it is animated")
}

#[test]
fn an_animation_plays_stops_and_is_wound_by_keys_and_panel() {
    let mut stage = stage::with_dolly();
    stage.harness.run_steps(5);
    assert_eq!(time(&stage), (0, 0.0), "it stands until it is to play");
    press(&mut stage, Key::Space);
    stage.harness.run_steps(5);
    let (_, playing) = time(&stage);
    assert!((0.3..1.5).contains(&playing), "{playing}");
    // It starts again at its end.
    stage.harness.run_steps(22);
    assert!((0.0..2.0).contains(&time(&stage).1));
    stage.harness.get_by_label("Stop").click();
    stage.harness.run_steps(2);
    let stopped = time(&stage);
    stage.harness.run_steps(5);
    assert_eq!(time(&stage), stopped);
    stage.harness.get_by_label("Play").click();
    stage.harness.run_steps(3);
    assert_ne!(time(&stage), stopped);
    assert!(stage.has("Time") && stage.has("Speed") && stage.has("ride"));
}

/// Whether the camera is at the position of `dolly` at the shown time.
fn is_on_dolly(stage: &Stage) -> bool {
    let file = SceneFile::open(stage.folder.path().join("dolly.gltf")).unwrap();
    stage.camera() == file.camera(0, Some(time(stage))).unwrap()
}

#[test]
fn the_view_rides_on_the_files_camera_until_it_is_moved_and_again_by_a_key() {
    let mut stage = stage::with_dolly();
    press(&mut stage, Key::Space);
    for _ in 0..4 {
        stage.harness.run_steps(3);
        assert!(is_on_dolly(&stage), "{:?}", stage.camera());
    }
    assert!(time(&stage).1 > 0.5);
    press(&mut stage, Key::Space);
    // After seeking, it is at the position of that time.
    let slider = stage.harness.get_by_role_and_label(Role::Slider, "Time");
    slider.focus();
    let before = time(&stage);
    for _ in 0..3 {
        press(&mut stage, Key::ArrowRight);
    }
    assert_ne!(time(&stage), before);
    assert!(is_on_dolly(&stage));
    // Once moved, it stays although the animation continues.
    let by = egui::vec2(150.0, 40.0);
    drag(&mut stage, PointerButton::Primary, Modifiers::NONE, by);
    let moved = stage.camera();
    assert!(!is_on_dolly(&stage));
    press(&mut stage, Key::Space);
    stage.harness.run_steps(6);
    assert_eq!(stage.camera(), moved);
    for key in [Key::C, Key::Home] {
        press(&mut stage, key);
        assert!(is_on_dolly(&stage), "{key:?}");
        drag(&mut stage, PointerButton::Middle, Modifiers::NONE, by);
        assert!(!is_on_dolly(&stage), "{key:?}");
    }
    // To the other one and back.
    press(&mut stage, Key::C);
    press(&mut stage, Key::C);
    assert_eq!(stage.camera().eye, Vec3::new(0.0, -20.0, 0.0));
    press(&mut stage, Key::C);
    assert!(is_on_dolly(&stage));
}

#[test]
fn a_camera_is_chosen_in_the_panel_and_the_free_one_stays_where_the_files_was() {
    let mut stage = stage::with_dolly();
    let choose = |stage: &mut Stage, name: &str| {
        let choice = Role::ComboBox;
        stage
            .harness
            .get_by_role_and_label(choice, "Camera")
            .click();
        stage.harness.run_steps(3);
        let names = stage.harness.get_all_by_label(name);
        names.last().unwrap().click();
        stage.harness.run_steps(3);
    };
    choose(&mut stage, "wide");
    assert_eq!(stage.camera().eye, Vec3::new(0.0, -20.0, 0.0));
    choose(&mut stage, "dolly");
    assert!(is_on_dolly(&stage));
    choose(&mut stage, "Free");
    let free = stage.camera();
    press(&mut stage, Key::Space);
    stage.harness.run_steps(6);
    assert_eq!(stage.camera(), free);
    assert!(!is_on_dolly(&stage));
    // A scene file without cameras offers no choice.
    stage.post(|news| news.opened = Some(opened(2, "hall.json", false)));
    assert!(!stage.has("Camera"));
    press(&mut stage, Key::C);
    assert_eq!(stage.camera(), scene().camera);
}

fn order(stage: &mut Stage, button: &str) -> SaveOrder {
    stage.harness.get_by_label(button).scroll_to_me();
    stage.harness.run_steps(10);
    stage.harness.get_by_label(button).click();
    stage.harness.run_steps(2);
    stage.wanted().save.expect("an order")
}

#[test]
fn an_animation_is_ordered_frame_by_frame_through_the_camera_that_is_chosen() {
    let mut stage = stage::with_dolly();
    let film = order(&mut stage, "Save animation");
    assert_eq!((film.views.len(), film.frames_per_sec), (48, Some(24)));
    for (frame, view) in (0..).zip(film.views.iter()) {
        assert_eq!(view.camera, FrameCamera::OfFile(0));
        assert_eq!(view.time, Some((0, f64::from(frame) / 24.0)));
    }
    let by = egui::vec2(90.0, 0.0);
    drag(&mut stage, PointerButton::Primary, Modifiers::NONE, by);
    let film = order(&mut stage, "Save animation");
    let placed = FrameCamera::Placed(stage.camera());
    assert!(film.views.iter().all(|view| view.camera == placed));
    // A turntable is a film of a single time, and a still one of its pictures.
    press(&mut stage, Key::Space);
    stage.harness.run_steps(4);
    press(&mut stage, Key::Space);
    let now = Some(time(&stage));
    let film = order(&mut stage, "Save turntable");
    assert!(film.views.len() == 72 && film.views.iter().all(|view| view.time == now));
    let still = order(&mut stage, "Save still");
    assert_eq!(still.frames_per_sec, None);
    assert_eq!((still.views[0].camera, still.views[0].time), (placed, now));
    stage.post(|news| news.opened = Some(opened(2, "hall.json", false)));
    assert!(!stage.has("Save animation"), "nothing moves");
}
