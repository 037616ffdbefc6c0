//! The session's steps of a frame, one method each, in the order of their calls.

use carom_text::text;
use carom_tracer::SceneUpdate;
use carom_window::display::DisplayFrame;
use carom_window::stats::frame_record::FrameSample;

use super::GameSession;
use super::match_practice::InterruptedMatch;
use crate::app::mode::{Mode, ModeView, ViewTime};
use crate::camera::{CameraIntent, CameraView};
use crate::frame::pipeline::FinishedFrame;
use crate::frame::scheduler::ViewTarget;

impl GameSession {
    /// Advances the game to `now_secs`.
    pub fn advance_simulation(&mut self, now_secs: f64) {
        if self.paused_secs.is_some() {
            return;
        }
        let now_secs = self.play_secs(now_secs);
        let dt_secs = (now_secs - self.last_advance_secs).clamp(0.0, ADVANCE_SECS_MAX);
        self.last_advance_secs = now_secs;
        self.game.tick(now_secs, dt_secs);
        self.modes.tick(now_secs);
        self.raise_for_practice(now_secs);
        self.is_dirty |= self.is_moving();
        if self.was_thinking != self.game.is_thinking() {
            self.was_thinking = self.game.is_thinking();
            self.is_dirty = true;
        }
        self.record_shot();
        let contest = InterruptedMatch::contest(self.interrupted.as_ref(), &self.game);
        self.autosave.update(contest);
    }

    /// Switches to the view from above for practice and back afterwards: from behind the cue half of the
    /// table is out of sight.
    fn raise_for_practice(&mut self, now_secs: f64) {
        let is_practising = matches!(self.modes.mode(), Mode::Practice(_));
        if is_practising == self.was_practising {
            return;
        }
        self.was_practising = is_practising;
        let from = match is_practising {
            true => CameraView::Shooter,
            false => CameraView::Overhead,
        };
        let turns = self.game.view() == from && (is_practising || self.is_raised_for_practice);
        self.is_raised_for_practice = is_practising && turns;
        if turns {
            self.game.look(CameraIntent::Overhead, now_secs);
        }
    }

    /// Records a new shot in the history and, with `--record`, to a file.
    pub(super) fn record_shot(&mut self) {
        let Some((number, shot)) = self.game.fresh_shot() else {
            return;
        };
        self.modes.record_shot(number, shot);
        if let Some(recorder) = &mut self.recorder {
            recorder.record(number, shot, self.game.table());
        }
    }

    /// Processes the frames that the farm has finished.
    pub fn poll_farm(&mut self, now_secs: f64) {
        let is_shown = self.stats.is_shown();
        let stats = &mut self.stats;
        let mut record = |frame: FinishedFrame| {
            stats.take(FrameSample {
                frame: frame.number,
                at_secs: now_secs,
                size: frame.size,
                samples: frame.samples,
                stats: frame.stats,
                nodes: &frame.nodes,
            });
        };
        let record = is_shown.then_some(&mut record as &mut dyn FnMut(FinishedFrame));
        self.pipeline.poll_farm(record);
    }

    /// Processes the frames that have been accumulated.
    pub fn accumulate(&mut self) {
        self.pipeline.accumulate();
    }

    /// Chooses the frame to show now.
    pub fn choose_frame(&mut self) {
        self.pipeline.choose();
    }

    /// Reprojects the chosen frame to the view at `now_secs`.
    pub fn reproject(&mut self, now_secs: f64) {
        let now = self.scene_at(ViewTime::Now(now_secs));
        self.pipeline.reproject(now_secs, &now);
    }

    /// The frame to draw under the interface.
    pub fn displayed(&self) -> Option<&DisplayFrame> {
        self.pipeline.displayed()
    }

    /// Requests the next frames.
    pub fn request_frames(&mut self, now_secs: f64) {
        let percents = [self.screenshot.percent(), self.film.percent()];
        self.is_dirty |= percents != self.capture_percents;
        self.capture_percents = percents;
        for (slot, failed) in [
            (&mut self.screenshot, "screenshot-failed"),
            (&mut self.film, "film-failed"),
        ] {
            if let Some(outcome) = slot.poll() {
                let sentence =
                    outcome.unwrap_or_else(|why| text!(failed, why = format!("{why:#}")));
                self.modes.notify(sentence);
            }
        }
        if self.is_hidden {
            return self.pipeline.cancel_all();
        }
        let view = self.mode_view(ViewTime::Now(now_secs));
        let (mode, game, table_scene) = (self.modes.mode(), &self.game, &self.table_scene);
        let scene_of = |view: &ModeView| view.update(table_scene);
        let target = match view.clock {
            Some(clock) => ViewTarget::Shot(clock),
            None => ViewTarget::Live(scene_of(&view)),
        };
        let scene_at = |moment| scene_of(&mode.view(game, ViewTime::Moment(moment)));
        self.pipeline.request(now_secs, &target, &scene_at);
    }

    /// The scene update of the present mode at a time.
    pub(super) fn scene_at(&self, time: ViewTime) -> SceneUpdate {
        self.mode_view(time).update(&self.table_scene)
    }
}

/// Longest time step of the simulation in seconds: an interruption, as while the window is dragged, is not
/// made up for.
const ADVANCE_SECS_MAX: f64 = 0.1;
