//! A simulated player: a session and a shell, without a window and without a farm.

use std::path::PathBuf;

use carom::app::app_shell::AppShell;
use carom::app::session::GameSession;
use carom::audio::Playback;
use carom::camera::Viewpoint;
use carom::input::{Event, Key};
use carom::play::free_table;
use carom::scene::ball_materials::BallSet;
use carom::scene::table_scene::TableScene;
use carom::settings::SettingsStore;
use carom_billiards::game_match::{Match, MatchConfig, Player};
use carom_billiards::rules::RuleSet;
use carom_farm::{FarmConfig, LocalNode};
use carom_tracer::ImageSize;
use carom_window::theme;
use egui::{Ui, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable as _;
use glam::DVec2;

/// GameSession, shell and their time.
pub(crate) struct Seat {
    pub(crate) session: GameSession,
    pub(crate) shell: AppShell,
    pub(crate) now_secs: f64,
    pub(crate) has_quit: bool,
}

impl Seat {
    /// At the free table.
    pub(crate) fn free() -> Self {
        Self::new(
            free_table(TableScene::table(), 1).unwrap(),
            SettingsStore::default(),
        )
    }

    /// A player at the free table, with settings in a file.
    pub(crate) fn kept_in(settings: PathBuf) -> Self {
        let contest = free_table(TableScene::table(), 1).unwrap();
        Self::new(contest, SettingsStore::open(settings))
    }

    /// A player in a game of 8-ball between two people.
    pub(crate) fn eight() -> Self {
        Self::match_of(RuleSet::Eight, "Ada,Bo")
    }

    /// A player in a match of these players.
    pub(crate) fn match_of(rules: RuleSet, players: &str) -> Self {
        let players = Player::list(players).unwrap();
        let setup = MatchConfig::new(rules, players, 3).unwrap();
        Self::new(Match::new(setup).unwrap(), SettingsStore::default())
    }

    /// A player in a match that Ada has lost to Bo.
    pub(crate) fn lost() -> Self {
        let players = Player::list("Ada,Bo").unwrap();
        let setup = MatchConfig::new(RuleSet::Eight, players, 3).unwrap();
        let mut contest = Match::new(setup).unwrap();
        contest.concede();
        Self::new(contest, SettingsStore::default())
    }

    fn new(contest: Match, store: SettingsStore) -> Self {
        let config = FarmConfig {
            local: LocalNode::None,
            ..FarmConfig::default()
        };
        let mut session = GameSession::new(config, contest, BallSet::Classic.into()).unwrap();
        session.resize(ImageSize::new(0, 0));
        Self {
            session,
            shell: AppShell::new(store, Playback::new(None)),
            now_secs: 1.0,
            has_quit: false,
        }
    }

    /// A frame of 1/20 s.
    pub(crate) fn draw(&mut self, ui: &mut Ui) {
        self.now_secs += 0.05;
        self.step(self.now_secs);
        self.shell.tick(&mut self.session, self.now_secs);
        self.shell
            .draw(ui.ctx(), &mut self.session, self.now_secs, DISPLAY);
        self.has_quit |= self.shell.wants_quit();
    }

    /// The steps of a frame without a window.
    fn step(&mut self, now_secs: f64) {
        self.session.advance_simulation(now_secs);
        self.session.poll_farm(now_secs);
        self.session.request_frames(now_secs);
    }

    /// Handles an input event; `taken` says whether it is over a panel.
    pub(crate) fn handle(&mut self, event: Event, taken: bool) {
        self.now_secs += 0.01;
        self.shell
            .handle(event, taken, &mut self.session, self.now_secs);
    }

    /// Presses and releases a key.
    pub(crate) fn key(&mut self, label: &str) {
        for pressed in [true, false] {
            self.hold(label, pressed);
        }
    }

    /// Presses or releases a key.
    pub(crate) fn hold(&mut self, label: &str, pressed: bool) {
        let event = Event::Key {
            key: Key::from_label(label).unwrap(),
            pressed,
            repeat: false,
        };
        self.handle(event, false);
    }

    /// Runs frames until the shot has ended.
    pub(crate) fn wait(&mut self) {
        while self.session.shot_clock(self.now_secs).is_some() {
            self.now_secs += 0.5;
            self.step(self.now_secs);
        }
    }

    /// Runs frames until the computer has decided on its next shot.
    pub(crate) fn think(&mut self) {
        self.step(self.now_secs);
        while self.session.match_hud().intention.is_none() {
            self.wait();
            self.step(self.now_secs);
            std::thread::yield_now();
        }
    }

    /// The present viewpoint.
    pub(crate) fn viewpoint(&self) -> Viewpoint {
        self.session.viewpoint(self.now_secs)
    }

    /// The viewpoint once the camera has come to rest.
    pub(crate) fn settled(&mut self) -> Viewpoint {
        let mut now_secs = self.now_secs;
        for _ in 0..200 {
            now_secs += 0.05;
            self.step(now_secs);
        }
        // `self.now_secs` is unchanged, so that the shell's time does not include the wait.
        self.viewpoint()
    }
}

/// Event of the pointer at a position in the window, in points.
pub(crate) fn at(x: f64, y: f64) -> Event {
    Event::Pointer(DVec2::new(x, y))
}

/// A test window with a player.
pub(crate) fn harness(seat: Seat) -> Harness<'static, Seat> {
    harness_of(seat, WINDOW)
}

/// A test window of another size with a player.
pub(crate) fn harness_of(seat: Seat, size: Vec2) -> Harness<'static, Seat> {
    let mut harness = Harness::builder()
        .with_size(size)
        .with_step_dt(0.05)
        .with_context_setup(|ctx| theme::apply(ctx, 1.0, true))
        .build_ui_state(|ui, seat: &mut Seat| seat.draw(ui), seat);
    harness.run_steps(4);
    harness
}

/// Presses a key of the game.
pub(crate) fn press(harness: &mut Harness<'_, Seat>, label: &str) {
    harness.state_mut().key(label);
    harness.run_steps(4);
}

/// Clicks the widget with this label, and runs frames until the layout has settled.
pub(crate) fn click(harness: &mut Harness<'_, Seat>, label: &str) {
    harness.get_by_label(label).click();
    harness.run_steps(12);
}

pub(crate) const WINDOW: Vec2 = Vec2::new(960.0, 540.0);
const DISPLAY: &str = "a display";
