//! Page of the key bindings.

use carom_text::text;
use carom_window::theme;
use egui::{Grid, RichText, ScrollArea, Ui};

use crate::input::{Action, BindingError, Bindings, Group, Trigger};

/// State of a rebinding.
#[derive(Clone, Debug, Default)]
pub(super) struct Rebinding {
    wanted: Option<Action>,
    /// A trigger that is bound to another action, the action that it was meant for, and the error.
    conflict: Option<(Trigger, Action, BindingError)>,
    /// Reason why a trigger cannot be bound.
    refusal: Option<BindingError>,
}

impl Rebinding {
    pub(super) fn wants_trigger(&self) -> bool {
        self.wanted.is_some()
    }

    /// Cancels a rebinding; false if there was none.
    pub(super) fn give_up(&mut self) -> bool {
        let busy = self.wanted.is_some() || self.conflict.is_some();
        *self = Self::default();
        busy
    }

    pub(super) fn take(&mut self, trigger: Trigger, bindings: &mut Bindings) {
        let Some(action) = self.wanted.take() else {
            return;
        };
        match bindings.bind(trigger, action) {
            Ok(()) => {}
            Err(error @ BindingError::Taken { .. }) => {
                self.conflict = Some((trigger, action, error));
            }
            Err(error) => self.refusal = Some(error),
        }
    }
}

/// Draws the page and changes the bindings.
pub(super) fn page(ui: &mut Ui, bindings: &mut Bindings, rebinding: &mut Rebinding) {
    ui.set_width(720.0_f32.min(ui.ctx().content_rect().width() - 60.0));
    ui.heading(text!("menu-keys"));
    status(ui, bindings, rebinding);
    let height = ui.ctx().content_rect().height() - 210.0;
    // Descriptions and keys share the width that the buttons leave.
    let column = 0.5 * (ui.available_width() - BUTTONS);
    ScrollArea::vertical()
        .auto_shrink([false, true])
        .max_height(height.max(80.0))
        .show(ui, |ui| {
            Grid::new("keys")
                .num_columns(3)
                .spacing([16.0, 6.0])
                .max_col_width(column)
                .striped(true)
                .show(ui, |ui| {
                    for group in Group::ALL {
                        ui.label(RichText::new(group.title()).color(theme::ACCENT).strong());
                        ui.end_row();
                        for control in group.controls() {
                            row(ui, control.action, bindings, rebinding);
                        }
                    }
                });
        });
    if ui.button(text!("keys-restore")).clicked() {
        *bindings = Bindings::default();
        rebinding.give_up();
    }
}

fn status(ui: &mut Ui, bindings: &mut Bindings, rebinding: &mut Rebinding) {
    if let Some((trigger, action, error)) = rebinding.conflict.clone() {
        ui.horizontal_wrapped(|ui| {
            ui.label(RichText::new(error.to_string()).color(theme::ALARM));
            if ui.button(text!("keys-use")).clicked() {
                rebinding.refusal = bindings.rebind(trigger, action).err();
                rebinding.conflict = None;
            }
            if ui.button(text!("keys-leave")).clicked() {
                rebinding.conflict = None;
            }
        });
    } else if let Some(refusal) = &rebinding.refusal {
        ui.label(RichText::new(refusal.to_string()).color(theme::ALARM));
    } else if let Some(action) = rebinding.wanted {
        let words = text!("keys-press", does = action.control().does());
        ui.label(RichText::new(words).color(theme::ACCENT));
    } else {
        let unbound: Vec<&str> = bindings
            .unbound()
            .map(|action| action.control().does())
            .collect();
        let words = match unbound.as_slice() {
            [] => text!("keys-about").to_owned(),
            lost => text!("keys-unbound", controls = lost.join("; ")),
        };
        ui.label(RichText::new(words).color(theme::FAINT));
    }
}

fn row(ui: &mut Ui, action: Action, bindings: &mut Bindings, rebinding: &mut Rebinding) {
    let control = action.control();
    ui.label(control.does());
    let is_wanted = rebinding.wanted == Some(action);
    let words = if is_wanted {
        "…".to_owned()
    } else {
        all_words(bindings, action)
    };
    ui.label(RichText::new(words).color(theme::ACCENT));
    ui.horizontal(|ui| {
        let add = ui
            .button(text!("keys-add"))
            .on_hover_text(text!("keys-add-about"));
        name(&add, text!("keys-add-to", does = control.does()));
        if add.clicked() {
            *rebinding = Rebinding {
                wanted: Some(action),
                ..Rebinding::default()
            };
        }
        let clear = ui
            .button(text!("keys-clear"))
            .on_hover_text(text!("keys-clear-about"));
        name(&clear, text!("keys-clear-of", does = control.does()));
        if clear.clicked() {
            bindings.unbind(action);
        }
    });
    ui.end_row();
}

/// Labels of an action's keys, mouse buttons and, with the feature `gamepad`, gamepad controls.
fn all_words(bindings: &Bindings, action: Action) -> String {
    let gamepad = bindings.gamepad_words(action);
    match cfg!(feature = "gamepad") && !gamepad.is_empty() {
        true => format!("{}, {gamepad}", bindings.words(action)),
        false => bindings.words(action),
    }
}

/// Sets the text of a button for screen readers.
fn name(button: &egui::Response, words: String) {
    button.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Button, true, &words));
}

/// Width of a row's buttons, with their spacing.
const BUTTONS: f32 = 180.0;
