//! Bindings of keys, mouse buttons, the wheel and gamepad controls to actions.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use carom_text::text;

use super::key::{TWICE, WHEEL};
use super::{ACTIONS, Action, BindingContext, Button, GamepadControl, Key};

/// Control that an action can be bound to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Trigger {
    /// A key.
    Key(Key),
    /// A mouse button.
    Button(Button),
    /// A button of a gamepad, or a direction of its sticks.
    Gamepad(GamepadControl),
    /// The wheel, turned away from the player.
    WheelUp,
    /// The wheel, turned towards the player.
    WheelDown,
}

/// Error for a label that names no trigger.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{}", text!("keys-unknown", word = _0))]
pub struct UnknownTrigger(pub String);

impl Trigger {
    fn is_gamepad(&self) -> bool {
        matches!(self, Self::Gamepad(_))
    }
}

impl fmt::Display for Trigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Key(key) => key.label(),
            Self::Button(button) => button.label(),
            Self::Gamepad(control) => control.label(),
            Self::WheelUp => WHEEL[0],
            Self::WheelDown => WHEEL[1],
        })
    }
}

impl FromStr for Trigger {
    type Err = UnknownTrigger;

    fn from_str(label: &str) -> Result<Self, UnknownTrigger> {
        let is = |other: &str| other.eq_ignore_ascii_case(label);
        if let Some(key) = Key::from_label(label) {
            return Ok(Self::Key(key));
        }
        let mut others = Button::ALL
            .map(Self::Button)
            .into_iter()
            .chain(GamepadControl::all().map(Self::Gamepad))
            .chain([Self::WheelUp, Self::WheelDown]);
        others
            .find(|trigger| is(&trigger.to_string()))
            .ok_or_else(|| UnknownTrigger(label.to_owned()))
    }
}

/// The triggers of all actions. In each context a trigger is bound to at most one action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Bindings {
    actions: BTreeMap<(BindingContext, Trigger), Action>,
}

/// Reason why a trigger cannot be bound to an action.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BindingError {
    /// It is bound to another action.
    #[error("{}", text!(
        "keys-taken",
        key = trigger.to_string(),
        does = by.control().does(),
        name = by.control().name,
    ))]
    Taken {
        /// The trigger.
        trigger: Trigger,
        /// The action that it is bound to.
        by: Action,
    },
    /// The trigger is the wheel, which cannot be held.
    #[error("{}", text!(
        "keys-not-held",
        key = trigger.to_string(),
        name = action.control().name,
    ))]
    NotHeld {
        /// The trigger.
        trigger: Trigger,
        /// The action, which must be held.
        action: Action,
    },
}

impl Default for Bindings {
    fn default() -> Self {
        let mut actions = BTreeMap::new();
        for control in ACTIONS {
            // A test checks that every default is a valid trigger, and of only one action.
            let labels = control.defaults.iter();
            let triggers = labels.filter_map(|label| label.parse().ok());
            let mode = control.action.mode();
            actions.extend(triggers.map(|trigger: Trigger| ((mode, trigger), control.action)));
        }
        Self { actions }
    }
}

impl Bindings {
    /// Bindings without any trigger.
    pub fn none() -> Self {
        Self {
            actions: BTreeMap::new(),
        }
    }

    /// Binds a trigger that is unused or already bound to `action`.
    ///
    /// # Errors
    /// [`BindingError`] if another action has it, or if it cannot be held.
    pub fn bind(&mut self, trigger: Trigger, action: Action) -> Result<(), BindingError> {
        match self.actions.get(&(action.mode(), trigger)) {
            Some(&by) if by != action => return Err(BindingError::Taken { trigger, by }),
            _ => {}
        }
        self.rebind(trigger, action)
    }

    /// Binds a trigger, and removes it from the action it was bound to in the same context.
    ///
    /// # Errors
    /// [`BindingError::NotHeld`].
    pub fn rebind(&mut self, trigger: Trigger, action: Action) -> Result<(), BindingError> {
        if action.is_held() && matches!(trigger, Trigger::WheelUp | Trigger::WheelDown) {
            return Err(BindingError::NotHeld { trigger, action });
        }
        self.actions.insert((action.mode(), trigger), action);
        Ok(())
    }

    /// Removes all triggers of an action.
    pub fn unbind(&mut self, action: Action) {
        self.actions.retain(|_, bound| *bound != action);
    }

    /// The action of a trigger in a context; replays fall back to the bindings of the table.
    pub fn action(&self, trigger: Trigger, mode: BindingContext) -> Option<Action> {
        let own = self.actions.get(&(mode, trigger));
        let of_table = || self.actions.get(&(BindingContext::Table, trigger));
        own.or_else(of_table).copied()
    }

    /// The triggers of an action, of which default keys and mouse buttons come first, in the order of the
    /// defaults.
    pub fn triggers(&self, action: Action) -> Vec<Trigger> {
        let defaults = action.control().defaults;
        let rank = |trigger: &Trigger| {
            let label = trigger.to_string();
            let place = defaults.iter().position(|default| *default == label);
            place
                .filter(|_| !trigger.is_gamepad())
                .unwrap_or(defaults.len())
        };
        let bound = self.actions.iter().filter(|(_, to)| **to == action);
        let mut triggers: Vec<Trigger> = bound.map(|((_, trigger), _)| *trigger).collect();
        triggers.sort_by_key(rank);
        triggers
    }

    /// Labels of an action's keyboard and mouse triggers for the interface; left and right variants of a
    /// key are named once if both are bound.
    pub fn words(&self, action: Action) -> String {
        let labels = self.labels(action, |trigger| !trigger.is_gamepad());
        match labels.is_empty() {
            true => text!("keys-none").to_owned(),
            false => labels.join(", "),
        }
    }

    /// Labels of an action's gamepad triggers for the interface; empty if it has none.
    pub fn gamepad_words(&self, action: Action) -> String {
        self.labels(action, |trigger| trigger.is_gamepad())
            .join(", ")
    }

    fn labels(&self, action: Action, is_named: fn(&Trigger) -> bool) -> Vec<String> {
        let mut words = Vec::new();
        for trigger in self.triggers(action).into_iter().filter(is_named) {
            let either_side = TWICE.into_iter().find(|(_, both)| {
                let both = both.map(Trigger::Key);
                let does = |key: &Trigger| self.action(*key, action.mode()) == Some(action);
                both.contains(&trigger) && both.iter().all(does)
            });
            let word = either_side.map_or_else(|| trigger.to_string(), |(name, _)| name.to_owned());
            if !words.contains(&word) {
                words.push(word);
            }
        }
        words
    }

    /// Actions without a key or mouse trigger.
    pub fn unbound(&self) -> impl Iterator<Item = Action> {
        let is_bound = |action: &Action| {
            let mut bound = self.actions.iter().filter(|(_, to)| *to == action);
            bound.any(|((_, trigger), _)| !trigger.is_gamepad())
        };
        let actions = ACTIONS.iter().map(|control| control.action);
        actions.filter(move |action| !is_bound(action))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_default_key_has_one_action_that_suits_it() {
        let mut bindings = Bindings::none();
        for control in ACTIONS {
            for label in control.defaults {
                let trigger: Trigger = label.parse().unwrap();
                assert_eq!(trigger.to_string(), *label);
                bindings.bind(trigger, control.action).unwrap();
            }
        }
        assert_eq!(bindings, Bindings::default());
        assert_eq!(bindings.unbound().next(), None);
    }

    #[test]
    fn taken_keys_are_told_and_move_on_insistence() {
        let mut bindings = Bindings::default();
        let w: Trigger = "w".parse().unwrap();
        let error = bindings.bind(w, Action::Rack).unwrap_err();
        assert!(error.to_string().contains("move the tip up"), "{error}");
        assert_eq!(
            bindings.action(w, BindingContext::Table),
            Some(Action::TipUp)
        );
        bindings.rebind(w, Action::Rack).unwrap();
        assert_eq!(bindings.words(Action::Rack), "R, W");
        assert_eq!(bindings.words(Action::TipUp), "nothing");
        assert_eq!(bindings.unbound().collect::<Vec<_>>(), [Action::TipUp]);
    }

    #[test]
    fn the_wheel_cannot_be_held() {
        let error = Bindings::default().rebind(Trigger::WheelUp, Action::Charge);
        assert!(error.unwrap_err().to_string().contains("cannot be held"));
    }

    #[test]
    fn left_and_right_keys_are_named_once() {
        let mut bindings = Bindings::default();
        assert_eq!(bindings.words(Action::Fine), "Ctrl, Shift");
        bindings.unbind(Action::Fine);
        bindings
            .bind("Left Alt".parse().unwrap(), Action::Fine)
            .unwrap();
        assert_eq!(bindings.words(Action::Fine), "Left Alt");
    }

    #[test]
    fn a_word_that_is_no_key_is_told_with_examples() {
        let error = "Hyper".parse::<Trigger>().unwrap_err().to_string();
        assert!(
            error.contains("`Hyper`") && error.contains("Mouse right"),
            "{error}"
        );
    }
}
