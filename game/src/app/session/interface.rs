//! The session's interface over the picture: aim, marks on balls, pages of modes, messages, statistics.

use carom_billiards::physics::{BallBody, BallState};
use carom_billiards::rules::RuleSet;
use carom_farm::quality::QUALITY_LEVELS;
use carom_text::text;
use carom_window::notifications;
use carom_window::stats::{StatsCommand, StatsInput};
use egui::{LayerId, Painter, Rect};

use super::GameSession;
use crate::app::mode::Mode;
use crate::camera::Projection;
use crate::capture::replay::ReplayCommand;
use crate::frame::farm_startup::FarmState;
use crate::input::Bindings;
use crate::play::BallMarks;
use crate::ui;
use crate::ui::layout::{Layout, Panels};

impl GameSession {
    /// Draws the statistics, the marks on the table and the mode's page with egui, and returns the layout
    /// of the part of the window that is left free.
    pub fn draw(
        &mut self,
        ctx: &egui::Context,
        bindings: &Bindings,
        now_secs: f64,
        present: &str,
    ) -> Layout {
        let moves = std::mem::take(&mut self.is_dirty);
        let room = self.draw_stats(ctx, now_secs, present, moves);
        let panels = match self.modes.mode() {
            Mode::Game => Panels::Game(self.game.contest().referee().info()),
            Mode::Replay(_) => Panels::Replay,
            Mode::Practice(_) => Panels::Practice,
        };
        self.game
            .set_framing(panels.framing(ctx.content_rect().size(), room));
        let mut layout = Layout::new(room);
        let painter = ctx.layer_painter(LayerId::background());
        self.draw_aim(&painter, now_secs);
        self.draw_mode(&painter, &mut layout, bindings, now_secs);
        layout
    }

    /// Draws the page of a mode other than the game, and executes its command.
    fn draw_mode(
        &mut self,
        painter: &Painter,
        layout: &mut Layout,
        bindings: &Bindings,
        now_secs: f64,
    ) {
        let (ctx, screen, now_secs) = (painter.ctx(), self.screen(), self.play_secs(now_secs));
        let (modes, game) = (&mut self.modes, &mut self.game);
        let laid = match modes.mode() {
            Mode::Game => return,
            Mode::Replay(player) => {
                let film = self.film.percent();
                let command =
                    ui::replay::panel(ctx, layout, player, modes.files(), film, bindings, now_secs);
                let Some(command) = command else { return };
                if command == ReplayCommand::Film {
                    return self.film_replay();
                }
                modes.command_replay(command, game, now_secs)
            }
            Mode::Practice(practice) => {
                let projection = game.projection(0.0);
                let overlay = ui::aim::AimOverlay {
                    painter,
                    screen,
                    projection: &projection,
                    ball_radius_m: BallBody::default().radius_m,
                    rules: RuleSet::Free,
                    balls: &[],
                };
                ui::practice::ring(&overlay, practice);
                let command = ui::practice::panel(ctx, layout, practice, modes.files());
                let command = command.or_else(|| ui::practice::hand(ctx, &projection, practice));
                let Some(command) = command else { return };
                modes.command_practice(command, game, now_secs)
            }
        };
        // The result of the command is drawn in the next frame.
        ctx.request_repaint();
        if let Some(Err(why)) = laid.map(|laid| self.play_from(laid)) {
            self.modes.notify(why.to_string());
        }
    }

    /// The window's rectangle, in points.
    fn screen(&self) -> Rect {
        let film = self.game.framing().film;
        let size = egui::vec2(film.x as f32, film.y as f32);
        Rect::from_min_size(egui::Pos2::ZERO, size)
    }

    fn draw_aim(&mut self, painter: &Painter, now_secs: f64) {
        if !self.is_game() {
            return;
        }
        let camera = self.viewpoint(now_secs).camera();
        let film = self.game.framing().film;
        let projection = Projection::new(&camera, film.x, film.y);
        let table = self.game.table();
        let balls = self.game.contest().world().balls().into_iter();
        let sphere = |ball: BallState| (ball.position, table.body_of(ball.number).radius_m);
        let balls: Vec<_> = balls.map(sphere).collect();
        let overlay = ui::aim::AimOverlay {
            rules: self.game.contest().referee().rules(),
            balls: &balls,
            painter,
            screen: self.screen(),
            projection: &projection,
            ball_radius_m: self.game.contest().table_layout().cue_radius_m,
        };
        self.mark_balls(&overlay);
        if let Some(shot_preview) = self.game.shot_preview(self.play_secs(now_secs)) {
            overlay.shot_preview(shot_preview);
        }
    }

    /// Marks a carried cue ball; otherwise the legal balls, if not all balls may be hit first.
    fn mark_balls(&mut self, overlay: &ui::aim::AimOverlay<'_>) {
        if let Some(ball_in_hand) = self.game.ball_in_hand() {
            let area = self.game.contest().ball_in_hand_area();
            overlay.area(self.game.contest().table_layout(), area);
            overlay.carried(ball_in_hand.at, ball_in_hand.verdict.is_ok());
            return;
        }
        if self.game.may_play() && self.ball_marks == BallMarks::Legal {
            let view = self.game.match_view();
            let positions = self.game.contest().ball_positions();
            let objects = positions.iter().filter(|p| p.ball != 0);
            let all_legal = objects.clone().all(|p| view.on.contains(&p.ball));
            for ball in objects.filter(|p| !all_legal && view.on.contains(&p.ball)) {
                overlay.ringed(ball.at, self.game.contest().table_layout().radius_m);
            }
        }
    }

    /// Messages that are shown as long as their reason lasts: why there are no pictures, why the cue ball
    /// may not be placed where it is held, the progress of a screenshot.
    pub fn standing_notices(&self) -> Vec<String> {
        let farm = match self.pipeline.farm() {
            FarmState::Failed(why) => Some(text!("farm-failed", why = why.as_str())),
            FarmState::Ready(farm) if self.pipeline.scheduler().stats().pictures > 0 => {
                notifications::standing(&farm.nodes())
            }
            _ => notifications::standing(&self.nodes()),
        };
        farm.into_iter().chain(self.game_notice()).collect()
    }

    fn game_notice(&self) -> Option<String> {
        let ball_in_hand = self.game.ball_in_hand();
        let fault = ball_in_hand.and_then(|ball_in_hand| ball_in_hand.verdict.err());
        let refused = fault.map(|fault| fault.to_string());
        let carried = ball_in_hand.map(|_| text!("ball-carried").to_owned());
        refused.or(carried).or_else(|| {
            let percent = self.screenshot.percent()?;
            Some(text!("screenshot-progress", percent = percent))
        })
    }

    fn draw_stats(
        &mut self,
        ctx: &egui::Context,
        now_secs: f64,
        present: &str,
        moves: bool,
    ) -> Rect {
        if !self.stats.is_shown() {
            return ctx.content_rect();
        }
        self.stats.note_redraw(now_secs, moves);
        let nodes = self.nodes();
        let (stats, quality) = (
            self.pipeline.scheduler().stats(),
            self.pipeline.scheduler().quality(),
        );
        let window = self.pipeline.scheduler().window();
        let input = StatsInput {
            nodes: &nodes,
            balancing: self.balancing,
            distribution: self.distribution,
            window,
            preference: quality.preference(),
            period_secs: quality.period_secs(),
            stop: quality.level(),
            level_secs: QUALITY_LEVELS.map(|stop| quality.secs(stop, window)),
            lead_secs: stats.lead_secs,
            skipped: stats.skipped,
            disocclusion_fraction: self.pipeline.disocclusion_fraction(),
            draw_secs: self.draw_secs,
            present,
        };
        let room = self.stats.draw(ctx, now_secs, &input);
        for command in self.stats.take_commands() {
            self.is_dirty = true;
            match command {
                StatsCommand::QualityPreference(preference) => {
                    self.requested_quality = Some(preference)
                }
                StatsCommand::Balancing(balancing) => {
                    self.balancing = balancing;
                    if let Some(farm) = self.pipeline.farm_mut() {
                        farm.set_balancing(balancing);
                    }
                }
                StatsCommand::Distribution(distribution) => {
                    self.distribution = distribution;
                    if let Some(farm) = self.pipeline.farm_mut() {
                        farm.set_distribution(distribution);
                    }
                }
            }
        }
        room
    }
}
