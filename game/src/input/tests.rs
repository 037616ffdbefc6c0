use super::*;

fn at(x: f64, y: f64) -> Event {
    Event::Pointer(DVec2::new(x, y))
}

fn button(button: Button, pressed: bool) -> Event {
    Event::Button { button, pressed }
}

fn key(label: &str, pressed: bool) -> Event {
    Event::Key {
        key: Key::from_label(label).unwrap(),
        pressed,
        repeat: false,
    }
}

fn held(label: &str) -> Event {
    Event::Key {
        key: Key::from_label(label).unwrap(),
        pressed: true,
        repeat: true,
    }
}

fn all(input: &mut Input, events: &[Event]) -> Vec<Intent> {
    events
        .iter()
        .filter_map(|event| input.handle(*event))
        .collect()
}

#[test]
fn entering_the_window_does_not_turn_the_aim() {
    let mut input = Input::default();
    assert_eq!(
        all(
            &mut input,
            &[at(5.0, 5.0), Event::PointerLeft, at(900.0, 5.0)]
        ),
        []
    );
    assert_eq!(
        input.handle(at(910.0, 70.0)),
        Some(Intent::Aim(AimIntent::Turn(-10.0 * AIM_RAD_PER_POINT)))
    );
}

#[test]
fn fine_aim_is_ten_times_finer() {
    let mut input = Input::default();
    let turned = all(
        &mut input,
        &[
            at(0.0, 0.0),
            at(10.0, 0.0),
            key("Left Ctrl", true),
            at(20.0, 0.0),
        ],
    );
    let [
        Intent::Aim(AimIntent::Turn(coarse)),
        Intent::Aim(AimIntent::Turn(fine)),
    ] = turned[..]
    else {
        panic!("{turned:?}")
    };
    assert!((coarse / fine - 10.0).abs() < 1e-9);
}

#[test]
fn pulling_sets_power_and_strikes_when_released() {
    let mut input = Input::default();
    let events = [
        at(100.0, 100.0),
        button(Button::Left, true),
        at(150.0, 100.0 + PULL_POINTS / 2.0),
        at(150.0, 5000.0),
        button(Button::Left, false),
    ];
    let expected = [
        Intent::Stroke(StrokeIntent::BeginPull),
        Intent::Stroke(StrokeIntent::Pull(0.5)),
        Intent::Stroke(StrokeIntent::Pull(1.0)),
        Intent::Stroke(StrokeIntent::Release),
    ];
    assert_eq!(all(&mut input, &events), expected);
}

#[test]
fn the_right_button_gives_up_a_stroke() {
    let mut input = Input::default();
    let events = [
        at(0.0, 0.0),
        button(Button::Left, true),
        button(Button::Right, true),
        button(Button::Right, false),
        button(Button::Left, false),
    ];
    assert_eq!(
        all(&mut input, &events),
        [
            Intent::Stroke(StrokeIntent::BeginPull),
            Intent::Stroke(StrokeIntent::Cancel)
        ]
    );
}

#[test]
fn space_charges_once_while_it_repeats() {
    let mut input = Input::default();
    let repeat = held("Space");
    let events = [
        key("Space", true),
        repeat,
        repeat,
        key("Space", false),
        key("Space", false),
    ];
    assert_eq!(
        all(&mut input, &events),
        [
            Intent::Stroke(StrokeIntent::BeginCharge),
            Intent::Stroke(StrokeIntent::Release)
        ]
    );
}

#[test]
fn a_stroke_does_not_survive_the_loss_of_focus() {
    let mut input = Input::default();
    let events = [key("Space", true), Event::FocusLost, key("Space", false)];
    assert_eq!(
        all(&mut input, &events),
        [
            Intent::Stroke(StrokeIntent::BeginCharge),
            Intent::Stroke(StrokeIntent::Cancel)
        ]
    );
}

#[test]
fn fine_power_is_ten_times_finer() {
    let mut input = Input::default();
    let events = [
        at(0.0, 0.0),
        button(Button::Left, true),
        at(0.0, 0.5 * PULL_POINTS),
        key("Left Shift", true),
        at(0.0, 0.6 * PULL_POINTS),
    ];
    let drawn = all(&mut input, &events);
    let [
        Intent::Stroke(StrokeIntent::BeginPull),
        Intent::Stroke(StrokeIntent::Pull(coarse)),
        Intent::Stroke(StrokeIntent::Pull(fine)),
    ] = drawn[..]
    else {
        panic!("{drawn:?}")
    };
    assert!((coarse - 0.5).abs() < 1e-9 && (fine - 0.51).abs() < 1e-9);
}

#[test]
fn a_held_cue_follows_the_pointer() {
    let mut input = Input::default();
    let events = [
        at(0.0, 0.0),
        key("F", true),
        at(30.0, 40.0),
        key("F", false),
    ];
    let expected = [
        Intent::Stroke(StrokeIntent::BeginSwing),
        Intent::Stroke(StrokeIntent::Swing(40.0 * SWING_M_PER_POINT)),
        Intent::Stroke(StrokeIntent::Release),
    ];
    assert_eq!(all(&mut input, &events), expected);
}

#[test]
fn keys_step_by_a_degree_and_finely_by_a_tenth() {
    let mut input = Input::default();
    let events = [
        key("Left", true),
        held("Left"),
        key("Left", false),
        key("Right Shift", true),
        key("Right", true),
        key("Right Shift", false),
        key("Right", true),
    ];
    let degree = 1f64.to_radians();
    let expected =
        [degree, degree, -0.1 * degree, -degree].map(|by_rad| Intent::Aim(AimIntent::Turn(by_rad)));
    assert_eq!(all(&mut input, &events), expected);
}

#[test]
fn single_actions_do_not_repeat_while_held() {
    let mut input = Input::default();
    let events = [key("R", true), held("R"), held("R")];
    assert_eq!(all(&mut input, &events), [Intent::Match(MatchIntent::Rack)]);
}

#[test]
fn every_control_works_from_another_trigger() {
    for control in ACTIONS {
        let mut bindings = Bindings::none();
        let trigger: Trigger = "Pad 5".parse().unwrap();
        bindings.bind(trigger, control.action).unwrap();
        let mut input = Input::new(bindings);
        input.set_mode(control.action.mode());
        let events = [
            at(0.0, 0.0),
            key("Pad 5", true),
            at(0.0, 9.0),
            key("Pad 5", false),
        ];
        let intents = all(&mut input, &events);
        match control.action {
            Action::Fine => assert_eq!(intents, []),
            Action::Orbit => assert!(matches!(
                intents[..],
                [Intent::Camera(CameraIntent::Orbit { .. })]
            )),
            Action::Stroke | Action::Charge | Action::Swing => {
                assert_eq!(
                    intents.last(),
                    Some(&Intent::Stroke(StrokeIntent::Release)),
                    "{}",
                    control.name
                );
            }
            _ => assert_eq!(intents.len(), 1, "{}", control.name),
        }
    }
}

#[test]
fn replay_keys_count_first_in_replays_only() {
    let mut input = Input::default();
    let press = [key("Space", true), key("Space", false), key("V", true)];
    input.set_mode(BindingContext::Replay);
    let watched = all(&mut input, &press);
    assert_eq!(
        watched,
        [
            Intent::Replay(ReplayIntent::Control(ReplayControl::Toggle)),
            Intent::Camera(CameraIntent::NextView)
        ]
    );
    input.set_mode(BindingContext::Table);
    assert_eq!(
        all(&mut input, &press)[0],
        Intent::Stroke(StrokeIntent::BeginCharge)
    );
}

#[test]
fn a_toggle_on_the_wheel_takes_a_whole_notch() {
    let mut bindings = Bindings::default();
    bindings.rebind(Trigger::WheelUp, Action::Rack).unwrap();
    let mut input = Input::new(bindings);
    let turns = [0.4, 0.4, 0.4, 0.4, -0.2, 0.7, 0.2].map(Event::Wheel);
    assert_eq!(
        all(&mut input, &turns),
        [
            Intent::Match(MatchIntent::Rack),
            Action::ZoomOut.intent(0.2).unwrap()
        ]
    );
}

#[test]
fn the_wheel_zooms_by_its_notches() {
    let mut input = Input::default();
    assert_eq!(
        input.handle(Event::Wheel(-2.0)),
        Action::ZoomOut.intent(2.0)
    );
}

#[test]
fn the_mouse_turns_as_far_and_as_the_settings_say() {
    let moved = |mouse| {
        let mut input = Input::default();
        input.set_mouse(mouse);
        let orbit = |pressed| Event::Button {
            button: Button::Right,
            pressed,
        };
        let from = DVec2::new(100.0, 100.0);
        input.handle(Event::Pointer(from));
        let aimed = input.handle(Event::Pointer(from + DVec2::new(10.0, 0.0)));
        input.handle(orbit(true));
        let orbited = input.handle(Event::Pointer(from + DVec2::new(10.0, 20.0)));
        match (aimed, orbited) {
            (
                Some(Intent::Aim(AimIntent::Turn(turn))),
                Some(Intent::Camera(CameraIntent::Orbit { pitch_rad, .. })),
            ) => [turn, pitch_rad],
            other => panic!("{other:?}"),
        }
    };
    let [turn, pitch] = moved(MouseSettings::default());
    let quick = MouseSettings {
        speed: 2.5,
        inverts_pitch: true,
    };
    let [quick_turn, quick_pitch] = moved(quick);
    assert!((quick_turn - 2.5 * turn).abs() < 1e-12);
    assert!((quick_pitch + 2.5 * pitch).abs() < 1e-12);
}

fn stick(control: GamepadControl, deflection: f64) -> Event {
    Event::Stick {
        control,
        deflection,
    }
}

fn press_on_gamepad(input: &mut Input, control: GamepadControl, pressed: bool) -> Option<Intent> {
    input.handle(Event::Gamepad { control, pressed })
}

fn turned(intents: &[Intent]) -> f64 {
    let of = |intent: &Intent| match intent {
        Intent::Aim(AimIntent::Turn(rad)) => *rad,
        other => panic!("{other:?}"),
    };
    intents.iter().map(of).sum()
}

#[test]
fn a_stick_turns_the_aim_by_its_deflection_and_the_time() {
    let mut input = Input::default();
    let [left, right, ..] = GamepadControl::LEFT_STICK_TO;
    assert_eq!(input.handle(stick(left, 1.0)), None);
    assert!(input.is_steering());
    let full = turned(&input.elapse(0.05));
    input.handle(stick(left, 0.5));
    let half = turned(&input.elapse(0.05));
    assert!((full - 4.0 * half).abs() < 1e-12 && full > 0.0);
    // Many short frames have the same effect as one long frame.
    let short: f64 = (0..10).map(|_| turned(&input.elapse(0.005))).sum();
    assert!((short - half).abs() < 1e-12);
    press_on_gamepad(&mut input, GamepadControl::LEFT_TRIGGER, true);
    assert!(
        (turned(&input.elapse(0.05)) - 0.1 * half).abs() < 1e-12,
        "fine control"
    );
    press_on_gamepad(&mut input, GamepadControl::LEFT_TRIGGER, false);
    input.handle(stick(left, 0.0));
    input.handle(stick(right, 1.0));
    assert!((turned(&input.elapse(0.05)) + full).abs() < 1e-12);
    input.handle(stick(right, 0.0));
    assert!(!input.is_steering() && input.elapse(0.05).is_empty());
}

#[test]
fn a_stick_pressed_past_its_middle_makes_no_step_of_its_own() {
    let mut input = Input::default();
    let [left, ..] = GamepadControl::LEFT_STICK_TO;
    assert_eq!(press_on_gamepad(&mut input, left, true), None);
    // Bound to an action that does not repeat, the direction triggers it once.
    let mut bindings = Bindings::default();
    bindings
        .rebind(Trigger::Gamepad(left), Action::NextView)
        .unwrap();
    let mut input = Input::new(bindings);
    let next = Some(Intent::Camera(CameraIntent::NextView));
    assert_eq!(press_on_gamepad(&mut input, left, true), next);
    assert!(input.elapse(0.05).is_empty());
}

#[test]
fn a_button_of_a_gamepad_steps_at_once_and_repeats_when_held() {
    let mut input = Input::default();
    let up = GamepadControl::PAD[2];
    assert!(press_on_gamepad(&mut input, up, true).is_some());
    assert!(input.elapse(0.1).is_empty());
    let repeated: usize = (0..10).map(|_| input.elapse(0.1).len()).sum();
    assert!(repeated >= 6, "{repeated}");
    assert_eq!(press_on_gamepad(&mut input, up, false), None);
    assert!(input.elapse(0.1).is_empty());
}

#[test]
fn a_trigger_of_a_gamepad_charges_and_strikes() {
    let mut input = Input::default();
    let trigger = GamepadControl::RIGHT_TRIGGER;
    let begun = Some(Intent::Stroke(StrokeIntent::BeginCharge));
    assert_eq!(press_on_gamepad(&mut input, trigger, true), begun);
    let struck = Some(Intent::Stroke(StrokeIntent::Release));
    assert_eq!(press_on_gamepad(&mut input, trigger, false), struck);
}

#[test]
fn a_stick_carries_the_ball_in_hand_and_a_puts_it_down() {
    let mut input = Input::default();
    input.set_carrying(true);
    input.handle(Event::Pointer(DVec2::new(100.0, 100.0)));
    let [_, right, _, down] = GamepadControl::LEFT_STICK_TO;
    input.handle(stick(right, 1.0));
    input.handle(stick(down, 1.0));
    let [Intent::Match(MatchIntent::Point(at))] = input.elapse(0.1)[..] else {
        panic!("one place");
    };
    assert!(at.x > 100.0 && at.y > 100.0 && at.x == at.y, "{at}");
    let put = Some(Intent::Match(MatchIntent::Put));
    assert_eq!(press_on_gamepad(&mut input, GamepadControl::A, true), put);
}

#[test]
fn a_window_without_focus_lets_go_of_a_gamepad() {
    let mut input = Input::default();
    input.handle(stick(GamepadControl::LEFT_STICK_TO[0], 1.0));
    input.handle(Event::FocusLost);
    assert!(!input.is_steering());
}
