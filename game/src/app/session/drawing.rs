//! What a session draws over the picture: the cue and its aim, pages, sentences, statistics.

use carom_billiards::physics::BallBody;
use egui::{LayerId, Painter, Rect};

use super::{FarmSlot, Session};
use crate::app::farm_notifications;
use crate::app::screen_mode::Show;
use crate::camera::Projection;
use crate::frame::quality::LADDER;
use crate::input::Bindings;
use crate::play::CueView;
use crate::ui;
use crate::ui::stats::{Facts, Wish};

impl Session {
    /// Draws the statistics, and what is marked on the table, with egui; the part of the window that the
    /// statistics leave free.
    pub fn draw(
        &mut self,
        ctx: &egui::Context,
        bindings: &Bindings,
        now_secs: f64,
        present: &str,
    ) -> Rect {
        let moves = std::mem::take(&mut self.dirty);
        let room = self.draw_stats(ctx, now_secs, present, moves);
        let painter = ctx.layer_painter(LayerId::background());
        let cue = self.cue(now_secs);
        self.draw_aim(&painter, cue.as_ref(), now_secs);
        self.draw_booth(&painter, room, bindings, now_secs);
        let notice = self.notice();
        let overlay = ui::Overlay {
            notice: notice.as_deref(),
            has_page: !self.is_game(),
        };
        ui::draw(&painter, room, &overlay);
        room
    }

    /// Draws the page of what is shown in place of the game, and does what it asks for.
    fn draw_booth(&mut self, painter: &Painter, room: Rect, bindings: &Bindings, now_secs: f64) {
        let (ctx, screen) = (painter.ctx(), self.screen());
        let kept = self.booth.kept();
        let order = match self.booth.show() {
            Show::Game => None,
            Show::Replay(viewing) => {
                ui::replay::panel(ctx, room, viewing, kept, bindings, now_secs)
            }
            Show::Practice(practice) => {
                let camera = self.game.camera(self.moment(now_secs));
                let projection = Projection::new(&camera, self.film.x, self.film.y);
                let sketch = ui::aim::Sketch {
                    painter,
                    screen,
                    projection: &projection,
                    ball_radius_m: BallBody::default().radius_m,
                };
                ui::practice::ring(&sketch, practice);
                let asked = ui::practice::panel(ctx, room, practice, kept);
                asked.or_else(|| ui::practice::hand(ctx, &projection, practice))
            }
        };
        let Some(order) = order else {
            return;
        };
        // Its outcome is drawn with the next frame.
        ctx.request_repaint();
        if let Some(balls) = self.booth.obey(order, &self.game, now_secs)
            && let Err(why) = self.game.lay(&balls)
        {
            self.booth.say(why);
        }
    }

    /// The window, in points.
    fn screen(&self) -> Rect {
        let size = egui::vec2(self.film.x as f32, self.film.y as f32);
        Rect::from_min_size(egui::Pos2::ZERO, size)
    }

    fn draw_aim(&mut self, painter: &Painter, cue: Option<&CueView>, now_secs: f64) {
        if !self.is_game() {
            return;
        }
        let moment = self.moment(now_secs);
        let projection = Projection::new(&self.game.camera(moment), self.film.x, self.film.y);
        let sketch = ui::aim::Sketch {
            painter,
            screen: self.screen(),
            projection: &projection,
            ball_radius_m: self.game.contest().ground().cue_radius_m,
        };
        self.mark_balls(&sketch);
        if let Some(foresight) = self.game.foresight(now_secs) {
            sketch.foresight(foresight);
        }
        if let Some(cue) = cue {
            sketch.cue(cue);
        }
    }

    /// Marks a cue ball that is carried, and balls that must not be hit first.
    fn mark_balls(&mut self, sketch: &ui::aim::Sketch<'_>) {
        if let Some(placing) = self.game.placing() {
            let area = self.game.contest().hand();
            sketch.area(self.game.contest().ground(), area);
            sketch.carried(placing.at, placing.verdict.is_ok());
            return;
        }
        if self.game.may_play() {
            let view = self.game.board();
            let lie = self.game.contest().lie();
            let others = lie
                .iter()
                .filter(|p| p.ball != 0 && !view.on.contains(&p.ball));
            for ball in others.filter(|_| !view.on.is_empty()) {
                sketch.dimmed(ball.at, self.game.contest().ground().radius_m);
            }
        }
    }

    fn notice(&self) -> Option<String> {
        match &self.farm {
            FarmSlot::Failed(why) => Some(format!("No pictures: {why}")),
            FarmSlot::Ready(farm) if self.director.figures().pictures > 0 => {
                let stands = farm_notifications::standing(&farm.nodes());
                stands.or_else(|| self.game_notice())
            }
            _ => farm_notifications::standing(&self.nodes()),
        }
    }

    fn game_notice(&self) -> Option<String> {
        let placing = self.game.placing();
        let refused = placing.and_then(|placing| placing.verdict.clone().err());
        refused.or_else(|| self.game.notice().map(str::to_owned))
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
        let (figures, quality) = (self.director.figures(), self.director.quality());
        let window = self.director.window();
        let facts = Facts {
            nodes: &nodes,
            balancing: self.balancing,
            distribution: self.distribution,
            window,
            dial: quality.dial(),
            period_secs: quality.period_secs(),
            stop: quality.level(),
            stops_secs: LADDER.map(|stop| quality.secs(stop, window)),
            lead_secs: figures.lead_secs,
            skipped: figures.skipped,
            guessed: self.warp.guessed(),
            draw_secs: self.draw_secs,
            present,
        };
        let room = self.stats.draw(ctx, now_secs, &facts);
        for wish in self.stats.take_wishes() {
            self.dirty = true;
            match wish {
                Wish::Dial(dial) => self.wished_dial = Some(dial),
                Wish::Balancing(balancing) => {
                    self.balancing = balancing;
                    if let FarmSlot::Ready(farm) = &mut self.farm {
                        farm.set_balancer(balancing);
                    }
                }
                Wish::Distribution(distribution) => {
                    self.distribution = distribution;
                    if let FarmSlot::Ready(farm) = &mut self.farm {
                        farm.set_distribution(distribution);
                    }
                }
            }
        }
        room
    }
}
