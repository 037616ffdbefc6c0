//! Batches of window events, each of which egui handles in one pass.

use egui::{Event, RawInput};

/// Splits the events since the last frame before and after each press or release of a button, and before each
/// second key press. egui hit-tests once per pass, at the pointer's final position: if a slider were dragged
/// between two slow frames in a single pass, the pointer would have left it already. Keyboard focus likewise
/// moves once per pass, however often Tab was pressed.
pub fn passes(mut raw: RawInput) -> Vec<RawInput> {
    let events = std::mem::take(&mut raw.events);
    let mut passes = Vec::with_capacity(1);
    let mut pass = raw.take();
    let (mut was_button, mut has_key) = (false, false);
    for event in events {
        let is_button = matches!(event, Event::PointerButton { .. });
        let is_key = matches!(event, Event::Key { pressed: true, .. });
        let is_pointer = is_button || matches!(event, Event::PointerMoved(_));
        // A press acts at the position where the pointer was before it.
        let is_after_button = was_button && is_pointer;
        if is_after_button || (is_button && !pass.events.is_empty()) || (has_key && is_key) {
            passes.push(std::mem::replace(&mut pass, raw.clone()));
            (was_button, has_key) = (false, false);
        }
        was_button |= is_button;
        has_key |= is_key;
        pass.events.push(event);
    }
    passes.push(pass);
    passes
}

#[cfg(test)]
mod tests {
    use egui::{Context, Key, Modifiers, PointerButton, Pos2, Rect, Slider, Vec2, pos2};

    use super::*;

    fn button(pos: Pos2, pressed: bool) -> Event {
        Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        }
    }

    /// A slider's value after some frames.
    fn slid(frames: impl IntoIterator<Item = RawInput>) -> f64 {
        let (ctx, mut value) = (Context::default(), 0.0);
        for raw in frames {
            let output = ctx.run_ui(raw, |ui| {
                ui.spacing_mut().slider_width = 200.0;
                let slider = Slider::new(&mut value, 0.0..=1.0).show_value(false);
                ui.put(
                    Rect::from_min_size(Pos2::ZERO, Vec2::new(200.0, 20.0)),
                    slider,
                );
            });
            output.drop_without_applying_deltas();
        }
        value
    }

    #[test]
    fn a_slider_follows_a_drag_between_two_pictures() {
        let (from, to) = (pos2(20.0, 10.0), pos2(150.0, 10.0));
        let events = vec![
            Event::PointerMoved(from),
            button(from, true),
            Event::PointerMoved(pos2(90.0, 10.0)),
            Event::PointerMoved(to),
            button(to, false),
            Event::PointerMoved(pos2(400.0, 300.0)),
        ];
        let quick = RawInput {
            events: events.clone(),
            ..RawInput::default()
        };
        let slow = events.into_iter().map(|event| RawInput {
            events: vec![event],
            ..RawInput::default()
        });
        let still = RawInput::default;
        let slow = slid(std::iter::once(still()).chain(slow));
        let quick = slid(std::iter::once(still()).chain(passes(quick)));
        assert!(slow > 0.6, "{slow}");
        assert_eq!(quick, slow);
    }

    /// Platforms also send other events than the pointer's while a button is held.
    #[test]
    fn a_drag_begins_in_a_pass_of_its_own_whatever_comes_between() {
        let (from, to) = (pos2(20.0, 10.0), pos2(150.0, 10.0));
        let raw = RawInput {
            events: vec![
                Event::PointerMoved(from),
                button(from, true),
                Event::ModifiersChanged(Modifiers::NONE),
                Event::PointerMoved(to),
                button(to, false),
            ],
            ..RawInput::default()
        };
        let lengths: Vec<usize> = passes(raw).iter().map(|pass| pass.events.len()).collect();
        assert_eq!(lengths, [1, 2, 1, 1]);
    }

    #[test]
    fn keys_between_two_slow_pictures_all_count() {
        let press = |key| Event::Key {
            key,
            physical_key: None,
            pressed: true,
            repeat: false,
            modifiers: Modifiers::NONE,
        };
        let quick = RawInput {
            events: [Key::Tab, Key::Tab, Key::Tab, Key::Enter].map(press).into(),
            ..RawInput::default()
        };
        let (ctx, mut clicked) = (Context::default(), Vec::new());
        for raw in std::iter::once(RawInput::default()).chain(passes(quick)) {
            let output = ctx.run_ui(raw, |ui| {
                for line in 0..4 {
                    if ui.button(format!("line {line}")).clicked() {
                        clicked.push(line);
                    }
                }
            });
            output.drop_without_applying_deltas();
        }
        assert_eq!(clicked, [2], "three times Tab leads to the third line");
    }

    #[test]
    fn nothing_is_lost_or_said_twice() {
        let at = pos2(1.0, 2.0);
        let events = vec![
            Event::Copy,
            Event::PointerMoved(at),
            button(at, true),
            button(at, false),
            Event::Cut,
        ];
        let raw = RawInput {
            events: events.clone(),
            ..RawInput::default()
        };
        let passes = passes(raw);
        let heard = passes.iter().flat_map(|pass| pass.events.clone());
        assert_eq!(heard.collect::<Vec<_>>(), events);
        assert_eq!(passes.len(), 3);
        assert_eq!(super::passes(RawInput::default()).len(), 1);
    }
}
