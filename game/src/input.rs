//! From mouse and keys to what the player wants.

use glam::DVec2;

/// Something that happened at the window, in the words of no windowing library.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event {
    /// The pointer is here, in points from the window's top left.
    Pointer(DVec2),
    /// The pointer has left the window.
    PointerLeft,
    /// A button went down or up.
    Button {
        /// Which.
        button: Button,
        /// Down.
        pressed: bool,
    },
    /// The wheel turned by this many notches away from the player.
    Wheel(f64),
    /// A key went down, up, or repeats while held.
    Key {
        /// Which.
        key: Key,
        /// Down.
        pressed: bool,
        /// By being held.
        repeat: bool,
    },
    /// Whether a key for fine movement (Ctrl or Shift) is held.
    Fine(bool),
    /// Keys and buttons may come up unseen from now on.
    FocusLost,
}

/// A mouse button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Strokes.
    Left,
    /// Orbits.
    Right,
    /// Aims at a point.
    Middle,
}

/// A key with a meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Aims a little to the left.
    Left,
    /// Aims a little to the right.
    Right,
    /// Looks more from above.
    Up,
    /// Looks more from the side.
    Down,
    /// Charges the stroke while held and strikes when released.
    Space,
    /// Racks the balls again.
    Rack,
    /// Shows or hides the keys.
    Help,
    /// Shows or hides the statistics.
    Stats,
    /// Gives up the stroke, or quits.
    Escape,
    /// The tip strikes higher on the cue ball.
    TipUp,
    /// Lower.
    TipDown,
    /// Farther left.
    TipLeft,
    /// Farther right.
    TipRight,
    /// In the middle, with the cue level.
    TipCenter,
    /// The butt of the cue goes up: to jump, or to curve.
    CueUp,
    /// Down.
    CueDown,
}

/// What the player wants.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Intent {
    /// Turn the aim by this many radians, left positive.
    Turn(f64),
    /// Aim at the table under this point of the window.
    AimAt(DVec2),
    /// Turn the camera round what it looks at, radians.
    Orbit {
        /// To the left.
        yaw_rad: f64,
        /// Upwards.
        pitch_rad: f64,
    },
    /// Multiply the camera's distance.
    Zoom(f64),
    /// Begin a stroke with the cue drawn back by hand.
    BeginPull,
    /// Draw the cue back to this share of its way, 0 to 1.
    Pull(f64),
    /// Begin a stroke whose power rises with time.
    BeginCharge,
    /// Strike.
    Release,
    /// Give up the stroke.
    Cancel,
    /// Give up the stroke if one is begun, else quit.
    Escape,
    /// Move the tip on the cue ball, in ball radii, to the player's right and up.
    MoveTip(DVec2),
    /// Put the tip in the middle and lay the cue level.
    CenterTip,
    /// Raise the butt of the cue by this many radians.
    Elevate(f64),
    /// Rack the balls again.
    Rack,
    /// Show or hide the keys.
    ToggleHelp,
    /// Show or hide the statistics.
    ToggleStats,
}

/// What is held, and since where.
#[derive(Clone, Copy, Debug, Default)]
pub struct Input {
    pointer: Option<DVec2>,
    drag: Drag,
    fine: bool,
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Drag {
    #[default]
    None,
    Pull {
        from_y: f64,
    },
    Orbit,
    Charge,
}

impl Input {
    /// What `event` means.
    pub fn handle(&mut self, event: Event) -> Option<Intent> {
        match event {
            Event::Pointer(at) => self.pointer_moved(at),
            Event::PointerLeft => {
                self.pointer = None;
                None
            }
            Event::Button { button, pressed } => self.button(button, pressed),
            Event::Wheel(notches) if self.fine => Some(Intent::Orbit {
                yaw_rad: 0.0,
                pitch_rad: notches * KEY_PITCH_RAD,
            }),
            Event::Wheel(notches) => Some(Intent::Zoom(ZOOM_NOTCH.powf(-notches))),
            Event::Key {
                key,
                pressed,
                repeat,
            } => self.key(key, pressed, repeat),
            Event::Fine(fine) => {
                self.fine = fine;
                None
            }
            Event::FocusLost => {
                let stroke = matches!(self.drag, Drag::Pull { .. } | Drag::Charge);
                *self = Self::default();
                stroke.then_some(Intent::Cancel)
            }
        }
    }

    fn pointer_moved(&mut self, at: DVec2) -> Option<Intent> {
        let moved = at - self.pointer.replace(at)?;
        match self.drag {
            Drag::Pull { from_y } => Some(Intent::Pull(
                ((at.y - from_y) / PULL_POINTS).clamp(0.0, 1.0),
            )),
            Drag::Orbit => Some(Intent::Orbit {
                yaw_rad: -moved.x * ORBIT_RAD_PER_POINT,
                pitch_rad: moved.y * ORBIT_RAD_PER_POINT,
            }),
            Drag::Charge => None,
            Drag::None => {
                let turn = -moved.x * AIM_RAD_PER_POINT * self.precision();
                (turn != 0.0).then_some(Intent::Turn(turn))
            }
        }
    }

    fn button(&mut self, button: Button, pressed: bool) -> Option<Intent> {
        match (button, pressed, self.drag) {
            (Button::Left, true, Drag::None) => {
                self.drag = Drag::Pull {
                    from_y: self.pointer?.y,
                };
                Some(Intent::BeginPull)
            }
            (Button::Left, false, Drag::Pull { .. }) => {
                self.drag = Drag::None;
                Some(Intent::Release)
            }
            (Button::Right, true, Drag::None) => {
                self.drag = Drag::Orbit;
                None
            }
            (Button::Right, true, Drag::Pull { .. } | Drag::Charge) => {
                self.drag = Drag::None;
                Some(Intent::Cancel)
            }
            (Button::Right, false, Drag::Orbit) => {
                self.drag = Drag::None;
                None
            }
            (Button::Middle, true, Drag::None) => Some(Intent::AimAt(self.pointer?)),
            _ => None,
        }
    }

    fn key(&mut self, key: Key, pressed: bool, repeat: bool) -> Option<Intent> {
        if key == Key::Space {
            return self.space(pressed, repeat);
        }
        if !pressed {
            return None;
        }
        let turn = |sign: f64| Some(Intent::Turn(sign * KEY_AIM_RAD * self.precision()));
        let pitch = |sign: f64| {
            Some(Intent::Orbit {
                yaw_rad: 0.0,
                pitch_rad: sign * KEY_PITCH_RAD,
            })
        };
        let tip = |x: f64, y: f64| Some(Intent::MoveTip(DVec2::new(x, y) * KEY_TIP_RADII));
        let elevate =
            |sign: f64| Some(Intent::Elevate(sign * KEY_ELEVATION_RAD * self.precision()));
        match key {
            Key::Left => turn(1.0),
            Key::Right => turn(-1.0),
            Key::Up => pitch(1.0),
            Key::Down => pitch(-1.0),
            Key::TipUp => tip(0.0, 1.0),
            Key::TipDown => tip(0.0, -1.0),
            Key::TipLeft => tip(-1.0, 0.0),
            Key::TipRight => tip(1.0, 0.0),
            Key::TipCenter => Some(Intent::CenterTip),
            Key::CueUp => elevate(1.0),
            Key::CueDown => elevate(-1.0),
            _ if repeat => None,
            Key::Rack => Some(Intent::Rack),
            Key::Help => Some(Intent::ToggleHelp),
            Key::Stats => Some(Intent::ToggleStats),
            Key::Escape => {
                self.drag = Drag::None;
                Some(Intent::Escape)
            }
            Key::Space => None,
        }
    }

    fn space(&mut self, pressed: bool, repeat: bool) -> Option<Intent> {
        match (pressed, self.drag) {
            (true, Drag::None) if !repeat => {
                self.drag = Drag::Charge;
                Some(Intent::BeginCharge)
            }
            (false, Drag::Charge) => {
                self.drag = Drag::None;
                Some(Intent::Release)
            }
            _ => None,
        }
    }

    fn precision(&self) -> f64 {
        if self.fine { 0.1 } else { 1.0 }
    }
}

/// Two degrees and a half.
const KEY_ELEVATION_RAD: f64 = 0.043_633;
/// A window of 1280 points turns the aim by 147°.
const AIM_RAD_PER_POINT: f64 = 0.002;
const ORBIT_RAD_PER_POINT: f64 = 0.005;
/// A quarter of a degree: 4 mm at a metre.
const KEY_AIM_RAD: f64 = 0.25 * std::f64::consts::PI / 180.0;
const KEY_PITCH_RAD: f64 = 0.04;
const KEY_TIP_RADII: f64 = 0.05;
const ZOOM_NOTCH: f64 = 1.1;
/// The way of the pointer from no power to full power.
const PULL_POINTS: f64 = 220.0;

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, y: f64) -> Event {
        Event::Pointer(DVec2::new(x, y))
    }

    fn button(button: Button, pressed: bool) -> Event {
        Event::Button { button, pressed }
    }

    fn key(key: Key, pressed: bool) -> Event {
        Event::Key {
            key,
            pressed,
            repeat: false,
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
            Some(Intent::Turn(-10.0 * AIM_RAD_PER_POINT))
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
                Event::Fine(true),
                at(20.0, 0.0),
            ],
        );
        let [Intent::Turn(coarse), Intent::Turn(fine)] = turned[..] else {
            panic!("{turned:?}")
        };
        assert!((coarse / fine - 10.0).abs() < 1e-9);
    }

    #[test]
    fn pulling_sets_the_power_leaves_the_aim_and_strikes_when_released() {
        let mut input = Input::default();
        let events = [
            at(100.0, 100.0),
            button(Button::Left, true),
            at(150.0, 100.0 + PULL_POINTS / 2.0),
            at(150.0, 5000.0),
            button(Button::Left, false),
        ];
        let expected = [
            Intent::BeginPull,
            Intent::Pull(0.5),
            Intent::Pull(1.0),
            Intent::Release,
        ];
        assert_eq!(all(&mut input, &events), expected);
    }

    #[test]
    fn the_right_button_gives_up_a_stroke_and_its_release_does_nothing() {
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
            [Intent::BeginPull, Intent::Cancel]
        );
    }

    #[test]
    fn space_charges_once_while_it_repeats() {
        let mut input = Input::default();
        let repeat = Event::Key {
            key: Key::Space,
            pressed: true,
            repeat: true,
        };
        let events = [
            key(Key::Space, true),
            repeat,
            repeat,
            key(Key::Space, false),
            key(Key::Space, false),
        ];
        assert_eq!(
            all(&mut input, &events),
            [Intent::BeginCharge, Intent::Release]
        );
    }

    #[test]
    fn a_stroke_does_not_survive_the_loss_of_focus() {
        let mut input = Input::default();
        let events = [
            key(Key::Space, true),
            Event::FocusLost,
            key(Key::Space, false),
        ];
        assert_eq!(
            all(&mut input, &events),
            [Intent::BeginCharge, Intent::Cancel]
        );
    }
}
