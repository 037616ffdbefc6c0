//! Detection of pointer motion between table and panels, which must not turn the aim.

use crate::input::{AimIntent, Intent};

/// Rotation of the aim by the pointer's present motion, from rest to rest. A motion that begins or ends on
/// a panel is not meant as aiming, and its rotation is undone or suppressed.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PointerTravel {
    turned_rad: f64,
    last_secs: f64,
    is_from_panel: bool,
}

impl PointerTravel {
    /// Records an intent of the player.
    pub(super) fn note(&mut self, intent: Intent, now_secs: f64) {
        match intent {
            Intent::Aim(AimIntent::Turn(by_rad)) if now_secs - self.last_secs < WAY_PAUSE_SECS => {
                self.turned_rad += by_rad;
            }
            Intent::Aim(AimIntent::Turn(by_rad)) => self.turned_rad = by_rad,
            _ => self.turned_rad = 0.0,
        }
        self.last_secs = now_secs;
    }

    /// Records that the pointer is over a panel, and returns the intent that restores the aim if the motion
    /// turned it.
    pub(super) fn enter_panel(&mut self, now_secs: f64) -> Option<AimIntent> {
        (self.is_from_panel, self.last_secs) = (true, now_secs);
        let turned_rad = std::mem::take(&mut self.turned_rad);
        (turned_rad != 0.0).then_some(AimIntent::Turn(-turned_rad))
    }

    /// Whether a pointer that moves over the table is still in a motion that began on a panel.
    pub(super) fn came_from_panel(&mut self, now_secs: f64) -> bool {
        self.is_from_panel &= now_secs - self.last_secs < WAY_PAUSE_SECS;
        if self.is_from_panel {
            self.last_secs = now_secs;
        }
        self.is_from_panel
    }
}

/// Time of rest that ends a motion, in seconds.
const WAY_PAUSE_SECS: f64 = 0.4;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::input::StrokeIntent;

    #[test]
    fn moving_to_a_panel_restores_the_aim() {
        let mut travel = PointerTravel::default();
        for (turn, now_secs) in [(0.5, 1.0), (0.25, 2.0), (0.5, 2.1)] {
            travel.note(Intent::Aim(AimIntent::Turn(turn)), now_secs);
        }
        assert_eq!(travel.enter_panel(2.2), Some(AimIntent::Turn(-0.75)));
        assert_eq!(travel.enter_panel(2.2), None);
        travel.note(Intent::Aim(AimIntent::Turn(0.5)), 2.3);
        travel.note(Intent::Stroke(StrokeIntent::Strike), 2.4);
        assert_eq!(travel.enter_panel(2.5), None);
    }

    #[test]
    fn leaving_a_panel_keeps_the_aim_until_a_pause() {
        let mut travel = PointerTravel::default();
        assert!(!travel.came_from_panel(1.0));
        travel.enter_panel(1.0);
        assert!(travel.came_from_panel(1.1) && travel.came_from_panel(1.4));
        assert!(!travel.came_from_panel(1.9) && !travel.came_from_panel(1.95));
    }
}
