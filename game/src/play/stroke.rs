//! The stroke and its shot, from drawing the cue back until the balls rest.

use std::cell::OnceCell;

use carom_billiards::physics::{self, Shot, Stroke};
use carom_text::text;

use crate::camera::CameraView;
use crate::input::StrokeIntent;

use super::active_shot::{self, ActiveShot};
use super::cue::SWING_SECS;
use super::shot_worker::ShotWorker;
use super::stroke_input::{StrokeInput, SwingInput};
use super::{CueView, Game, TurnPhase};

impl Game {
    /// Applies a step of a stroke. The contact is `lead_secs` later, so that the shot's first frames are
    /// ready by then, clamped to `SWING_SECS`, so that the delay is not noticeable.
    pub fn stroke(&mut self, intent: StrokeIntent, now_secs: f64, lead_secs: f64) {
        if matches!(self.phase, TurnPhase::Placing(_)) {
            return self.stroke_in_hand(intent);
        }
        if matches!(self.phase, TurnPhase::Aiming) && !self.may_play() {
            return;
        }
        let power = match (intent, &mut self.phase) {
            (StrokeIntent::BeginPull, TurnPhase::Aiming) => {
                return self.begin(StrokeInput::Pulling(0.0));
            }
            (StrokeIntent::BeginCharge, TurnPhase::Aiming) => {
                return self.begin(StrokeInput::Charging(now_secs));
            }
            (StrokeIntent::BeginSwing, TurnPhase::Aiming) => {
                return self.begin(StrokeInput::Swinging(SwingInput::default()));
            }
            (StrokeIntent::Pull(power), TurnPhase::Stroking(StrokeInput::Pulling(pulled))) => {
                *pulled = power;
                return;
            }
            (StrokeIntent::Swing(back_m), TurnPhase::Stroking(StrokeInput::Swinging(swing))) => {
                swing.swing(back_m, now_secs)
            }
            (StrokeIntent::Release, TurnPhase::Stroking(input)) => {
                let power = input.let_go(now_secs);
                if power.is_none() {
                    self.cancel();
                }
                power
            }
            (StrokeIntent::Strike, TurnPhase::Aiming) => Some(self.aim.power),
            (StrokeIntent::Cancel, _) => return self.cancel(),
            _ => None,
        };
        if let Some(power) = power {
            self.strike(power, now_secs, lead_secs);
        }
    }

    fn begin(&mut self, input: StrokeInput) {
        self.phase = TurnPhase::Stroking(input);
    }

    pub(super) fn cancel(&mut self) {
        if matches!(self.phase, TurnPhase::Stroking(_)) {
            self.phase = TurnPhase::Aiming;
        }
    }

    fn strike(&mut self, power: f64, now_secs: f64, lead_secs: f64) {
        let cue = self.cue(now_secs).map(|cue| CueView {
            power,
            is_drawn: true,
            ..cue
        });
        self.phase = TurnPhase::Aiming;
        self.aim.set_power(power);
        let stroke = self.aim.stroke(power);
        if self.contest.world().particles().is_some() {
            if let Some(worker) = self.report(ShotWorker::start(self.world(), stroke, cue)) {
                self.phase = TurnPhase::Simulating(Box::new(worker));
            }
            return;
        }
        let contact_secs = now_secs + lead_secs.clamp(SWING_SECS.start, SWING_SECS.end);
        if let Some(shot) = self.report(self.contest.strike(stroke)) {
            self.watch(stroke, shot, cue, contact_secs);
        }
    }

    /// Shows a shot through particles once its simulation has finished.
    pub(super) fn follow_simulation(&mut self, now_secs: f64) {
        let TurnPhase::Simulating(worker) = &self.phase else {
            return;
        };
        let Some(shot) = worker.poll() else { return };
        let (stroke, cue) = (worker.stroke, worker.cue.clone());
        self.phase = TurnPhase::Aiming;
        if let Some(shot) = self.report(shot) {
            self.watch(stroke, shot, cue, now_secs + SWING_SECS.end);
        }
    }

    /// Starts to show a shot, whose contact is at `contact_secs`.
    pub(super) fn watch(
        &mut self,
        stroke: Stroke,
        shot: Shot,
        cue: Option<CueView>,
        contact_secs: f64,
    ) {
        let slipped =
            |event: &physics::Event| matches!(event.kind, physics::EventKind::Miscue { .. });
        if shot.events().iter().any(slipped) {
            self.notice = Some(text!("miscue").to_owned());
        }
        (self.ai_turn, self.match_view) = (None, None);
        self.shots += 1;
        self.views.straighten();
        let pocket = self.pocket_ahead();
        self.phase = TurnPhase::Watching(Box::new(ActiveShot {
            stroke,
            shot,
            contact_secs,
            cue,
            from: self.seen_from,
            glide_secs: match self.views.view() {
                CameraView::Shooter => active_shot::RISE_SECS,
                _ => active_shot::ARRIVE_SECS,
            },
            bearing_rad: stroke.direction_rad,
            pocket,
            instant_camera: self.instant_camera,
            chase: OnceCell::new(),
            puff: OnceCell::new(),
        }));
    }

    pub(super) fn end_shot(&mut self, now_secs: f64) {
        let active = match std::mem::replace(&mut self.phase, TurnPhase::Aiming) {
            TurnPhase::Watching(active) => active,
            other => {
                self.phase = other;
                return;
            }
        };
        let end_secs = active.clock_secs(now_secs);
        let seen = active.viewpoint(end_secs, &self.views, self.table(), self.framing);
        self.seen_from = seen;
        self.contest.finish(active.stroke, &active.shot);
        self.begin_turn();
    }
}
