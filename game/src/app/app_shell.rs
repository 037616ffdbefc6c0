//! The shell around the game, independent of the window: settings, keys, pages, messages, sound.
//!
//! ```text
//! Event ─▶ AppShell ─▶ page open? ─▶ menu
//!                  else      ─▶ Input ─▶ Intent ─▶ GameSession
//! ```

use std::time::{Duration, Instant};

use carom_billiards::rules::RuleSet;
use carom_text::text;
use carom_window::notifications::FarmNotifier;
use carom_window::toasts::Toasts;
use egui::{Align2, Context, Key, Modifiers, Popup};

use crate::app::pointer_travel::PointerTravel;
use crate::app::session::GameSession;
use crate::audio::{self, Playback};
use crate::camera::CameraIntent;
use crate::input::{
    Action, AppIntent, BindingContext, Event, GamepadControl, Input, Intent, MatchIntent,
    StrokeIntent, Trigger,
};
use crate::settings::{Settings, SettingsStore};
use crate::ui::layout::{CUE_COLUMN, Layout};
use crate::ui::lessons::Lesson;
use crate::ui::menu::{self, Menu, MenuInput, Page};
use crate::ui::{cue_panel, help, match_hud};

/// State of the interface around the session.
#[derive(Debug)]
pub struct AppShell {
    store: SettingsStore,
    input: Input,
    travel: PointerTravel,
    menu: Menu,
    help: bool,
    log: bool,
    wants_quit: bool,
    toasts: Toasts,
    notifier: FarmNotifier,
    playback: Playback,
    /// Number of the shot whose sound plays, and whether it was over at the last update.
    heard: Option<(u64, bool)>,
    /// Whether the result of the match has been shown.
    has_result: bool,
    /// Whether the player asked for a suggestion since the last stroke.
    is_suggested: bool,
    /// Whether a popup list was open when the interface was last drawn; it then receives the keys.
    has_open_list: bool,
    /// Time up to which the gamepad's sticks have been applied.
    steered_secs: f64,
}

impl AppShell {
    /// A shell with the player's settings and an output for sound.
    pub fn new(store: SettingsStore, playback: Playback) -> Self {
        let mut toasts = Toasts::default();
        for warning in store.warnings() {
            toasts.push(warning.clone(), 0.0);
        }
        Self {
            input: Input::new(store.settings.bindings.clone()),
            store,
            travel: PointerTravel::default(),
            menu: Menu::default(),
            help: false,
            log: false,
            wants_quit: false,
            toasts,
            notifier: FarmNotifier::default(),
            playback,
            heard: None,
            has_result: false,
            is_suggested: false,
            has_open_list: false,
            steered_secs: 0.0,
        }
    }

    /// Opens the welcome page for a new player.
    pub fn welcome(&mut self) {
        if self.store.settings.lesson == Lesson::default() {
            self.menu.open(Page::Welcome);
        }
    }

    /// Shows a message to the player.
    pub fn notify(&mut self, sentence: String, now_secs: f64) {
        self.toasts.push(sentence, now_secs);
    }

    /// The present settings.
    pub fn settings(&self) -> &Settings {
        &self.store.settings
    }

    /// The present settings, mutable, for those without a page such as the window's size.
    pub fn settings_mut(&mut self) -> &mut Settings {
        &mut self.store.settings
    }

    /// Saves the settings; an error is shown as a message.
    pub fn save(&mut self, now_secs: f64) {
        if let Err(why) = self.store.save() {
            tracing::error!("{why}");
            self.toasts.push(why.to_string(), now_secs);
        }
    }

    /// The page that is open over the table.
    pub fn page(&self) -> Option<Page> {
        self.menu.page()
    }

    /// Handles an event by the open page or the game. `taken` says whether egui has consumed it.
    pub fn handle(&mut self, event: Event, taken: bool, session: &mut GameSession, now_secs: f64) {
        self.input.set_carrying(session.is_placing());
        self.input.set_mode(match session.is_replay() {
            true => BindingContext::Replay,
            false => BindingContext::Table,
        });
        if self.has_open_list && matches!(event, Event::Key { pressed: true, .. }) {
            return session.redraw();
        }
        if self.menu.page().is_some() {
            self.handle_page(event, session, now_secs);
            return;
        }
        // Releases are handled even if egui has consumed them, or a control would be held for ever.
        let begins = event.trigger().is_some();
        if taken && begins {
            return;
        }
        if let (Event::Pointer(at), true, false) = (event, taken, self.input.is_holding()) {
            self.input.passes(at);
            if let Some(back) = self.travel.enter_panel(now_secs) {
                self.act(Intent::Aim(back), session, now_secs);
            }
            return;
        }
        if let Event::Pointer(at) = event
            && !self.input.is_holding()
            && !session.is_placing()
            && self.travel.came_from_panel(now_secs)
        {
            self.input.passes(at);
            return;
        }
        if let Some(intent) = self.input.handle(event) {
            self.travel.note(intent, now_secs);
            self.act(intent, session, now_secs);
        }
    }

    /// The keyboard key that a gamepad's control stands for on an open page: the directional pad and the
    /// left stick move the focus, A activates the focused control, B closes an open list.
    pub fn page_key(&self, event: Event) -> Option<(Key, Modifiers)> {
        let Some(Trigger::Gamepad(control)) = event.trigger() else {
            return None;
        };
        if self.has_open_list && control == GamepadControl::B {
            return Some((Key::Escape, Modifiers::NONE));
        }
        if self.menu.page().is_none() || self.menu.wants_trigger() {
            return None;
        }
        if control == GamepadControl::A {
            return Some((Key::Enter, Modifiers::NONE));
        }
        let keys = [
            (Key::ArrowLeft, Modifiers::NONE),
            (Key::ArrowRight, Modifiers::NONE),
            (Key::Tab, Modifiers::SHIFT),
            (Key::Tab, Modifiers::NONE),
        ];
        let ways = [GamepadControl::PAD, GamepadControl::LEFT_STICK_TO];
        let place = ways
            .iter()
            .find_map(|way| way.iter().position(|to| *to == control));
        place.map(|place| keys[place])
    }

    /// Whether a gamepad's stick or button is held.
    pub fn is_steering(&self) -> bool {
        self.input.is_steering()
    }

    fn handle_page(&mut self, event: Event, session: &mut GameSession, now_secs: f64) {
        let Some(trigger) = event.trigger() else {
            return;
        };
        session.redraw();
        let action = self.input.bindings().action(trigger, BindingContext::Table);
        let is_back = trigger == Trigger::Gamepad(GamepadControl::B) && !self.menu.wants_trigger();
        if action == Some(Action::Menu) || is_back {
            self.menu.back();
            return self.save(now_secs);
        }
        if self.menu.take_trigger(trigger, &mut self.store) {
            return;
        }
        if action == Some(Action::Fullscreen) {
            self.store.settings.fullscreen ^= true;
        }
    }

    /// Routes an intent to its receiver.
    fn act(&mut self, intent: Intent, session: &mut GameSession, now_secs: f64) {
        session.redraw();
        self.teach(intent, session, now_secs);
        match intent {
            Intent::Aim(intent) => session.aim(intent, now_secs),
            Intent::Stroke(_) if session.is_over() => self.open(Page::Result, session, now_secs),
            Intent::Stroke(intent) => session.stroke(intent, now_secs),
            Intent::Camera(intent) => session.look(intent, now_secs),
            Intent::Match(intent) => session.decide(intent, now_secs),
            Intent::Replay(intent) => session.replay(intent, now_secs),
            Intent::TogglePractice => session.toggle_practice(),
            Intent::App(intent) => self.apply(intent, session, now_secs),
        }
    }

    /// Advances to the next lesson once the present one is done.
    fn teach(&mut self, intent: Intent, session: &mut GameSession, now_secs: f64) {
        if !session.match_hud().may_play {
            return;
        }
        let lesson = self.store.settings.lesson;
        let next = lesson.after(intent, self.is_suggested);
        match intent {
            Intent::Match(MatchIntent::Suggest) => self.is_suggested = true,
            Intent::Stroke(StrokeIntent::Strike | StrokeIntent::Release) => {
                self.is_suggested = false;
            }
            _ => {}
        }
        if next != lesson {
            self.store.settings.lesson = next;
            self.save(now_secs);
        }
    }

    fn apply(&mut self, intent: AppIntent, session: &mut GameSession, now_secs: f64) {
        match intent {
            AppIntent::ToggleFullscreen => {
                self.store.settings.fullscreen ^= true;
                self.save(now_secs);
            }
            AppIntent::NextAids => {
                self.store.settings.aim_aids = self.store.settings.aim_aids.next();
                let name = self.store.settings.aim_aids.name();
                self.toasts
                    .answer(text!("aids-chosen", name = name), now_secs);
                self.save(now_secs);
            }
            AppIntent::SaveView(number) => self.save_view(number.into(), session, now_secs),
            AppIntent::RecallView(number) => self.recall_view(number.into(), session, now_secs),
            AppIntent::ToggleLog => self.log = !self.log,
            AppIntent::ToggleHelp => self.help = !self.help,
            AppIntent::ToggleStats => session.toggle_stats(),
            AppIntent::TakeScreenshot => session.take_screenshot(now_secs),
            AppIntent::Escape if self.help => self.help = false,
            AppIntent::Escape => {
                // If there is nothing to cancel or close, the menu opens.
                if !session.escape() {
                    self.open(Page::Top, session, now_secs);
                }
            }
        }
    }

    fn save_view(&mut self, place: usize, session: &mut GameSession, now_secs: f64) {
        if let Some(saved) = self.store.settings.views.get_mut(place) {
            *saved = Some(session.viewpoint(now_secs));
            let key = self.input.bindings().words(Action::SavedView(place as u8));
            let sentence = text!("view-saved", number = place + 1, key = key);
            self.toasts.answer(sentence, now_secs);
            self.save(now_secs);
            session.redraw();
        }
    }

    fn recall_view(&mut self, place: usize, session: &mut GameSession, now_secs: f64) {
        match self.store.settings.views.get(place) {
            Some(Some(saved)) => {
                session.look(CameraIntent::LookFrom(*saved), now_secs);
            }
            _ => {
                let key = self.input.bindings().words(Action::KeepView(place as u8));
                let sentence = text!("view-empty", number = place + 1, key = key);
                self.toasts.answer(sentence, now_secs);
                session.redraw();
            }
        }
    }

    /// Opens a page over the table, and cancels a stroke in progress.
    pub fn open(&mut self, page: Page, session: &mut GameSession, now_secs: f64) {
        if let Some(intent) = self.input.let_go() {
            self.act(intent, session, now_secs);
        }
        self.menu.open(page);
        session.redraw();
    }

    /// Draws the game's interface, and over it pages, help and messages.
    pub fn draw(&mut self, ctx: &Context, session: &mut GameSession, now_secs: f64, display: &str) {
        let mut layout = session.draw(ctx, self.input.bindings(), now_secs, display);
        self.has_open_list = Popup::is_any_open(ctx);
        if let Some(preference) = session.take_requested_quality() {
            self.store.settings.quality = preference;
            self.save(now_secs);
        }
        if self.menu.page().is_none() {
            if self.help {
                return help::panel(ctx, self.input.bindings());
            }
            if session.is_game() {
                self.draw_game(ctx, &mut layout, session, now_secs);
            }
            let mut standing = session.standing_notices();
            standing.extend(self.lesson(session));
            if !(self.toasts.is_empty() && standing.is_empty()) {
                layout.dock(ctx, "notes", Align2::CENTER_TOP, |ui| {
                    self.toasts.show(ui, &standing)
                });
            }
            return;
        }
        let (sound, farm) = (self.playback.state(), session.farm_line());
        let view = session.match_hud().view;
        let input = MenuInput {
            view: &view,
            is_match_unfinished: session.has_interrupted_match() || view.is_unfinished(),
            is_match_waiting: session.has_interrupted_match(),
            sound: &sound,
            display,
            farm: &farm,
        };
        let command = self.menu.draw(ctx, &mut self.store, input);
        self.has_open_list = Popup::is_any_open(ctx);
        if self.menu.page().is_none() {
            self.save(now_secs);
        }
        match command {
            Some(menu::MenuCommand::Rematch) => {
                if let Err(why) = session.rematch(seed_of_clock(view.rules)) {
                    self.toasts.push(why.to_string(), now_secs);
                }
            }
            Some(menu::MenuCommand::ResumeMatch) => session.resume_match(),
            Some(menu::MenuCommand::Quit) => self.wants_quit = true,
            Some(menu::MenuCommand::Act(intent)) => self.act(intent, session, now_secs),
            Some(menu::MenuCommand::Begin(game)) => {
                let begun = game
                    .begin(seed_of_clock(game.rules), self.store.settings.table)
                    .map_err(anyhow::Error::msg);
                if let Err(why) = begun.and_then(|contest| session.begin(contest)) {
                    self.toasts.push(why.to_string(), now_secs);
                }
            }
            Some(menu::MenuCommand::Resume) | None => {}
        }
    }

    /// Whether the player has chosen to quit.
    pub fn wants_quit(&self) -> bool {
        self.wants_quit
    }

    /// Draws the panels of match and cue, also during a stroke. Called in game mode only: in a replay or
    /// practice the game cannot be controlled.
    fn draw_game(
        &mut self,
        ctx: &Context,
        layout: &mut Layout,
        session: &mut GameSession,
        now_secs: f64,
    ) {
        let hud = session.match_hud();
        match_hud::draw_score(ctx, layout, &hud);
        let column = layout.take_left(CUE_COLUMN);
        let asked = match_hud::draw(ctx, layout, &hud, self.input.bindings(), self.log);
        let cue = session.cue(now_secs);
        let cue = cue.filter(|cue| hud.may_play || cue.is_drawn);
        let asked = asked.or(cue.and_then(|cue| cue_panel::panel(ctx, column, &cue)));
        if let Some(intent) = asked {
            self.act(intent, session, now_secs);
        }
    }

    /// The present lesson's instruction, while it can be followed.
    fn lesson(&self, session: &mut GameSession) -> Option<String> {
        let may_play = session.is_game() && session.match_hud().may_play && !session.is_placing();
        let lesson = self.store.settings.lesson;
        lesson.sentence(self.input.bindings()).filter(|_| may_play)
    }

    /// Advances to `now_secs`: applies changed bindings, moves by held controls, shows news of farm and
    /// session, plays sound.
    pub fn tick(&mut self, session: &mut GameSession, now_secs: f64) {
        if *self.input.bindings() != self.store.settings.bindings {
            self.input = Input::new(self.store.settings.bindings.clone());
        }
        self.input.set_mouse(self.store.settings.mouse);
        // Under the result page time goes on, as the camera still moves to the whole table.
        let pauses = self.menu.page().is_some_and(|page| page != Page::Result);
        session.set_paused(pauses, now_secs);
        self.steer(session, now_secs);
        let is_over = session.is_over();
        if is_over && !self.has_result {
            let view = session.match_hud().view;
            let score = view.players[0].score.max(0) as u32;
            self.store.settings.note_drill(view.rules, score);
            self.open(Page::Result, session, now_secs);
        }
        self.has_result = is_over;
        if let Some(answer) = session.take_notice() {
            self.toasts.answer(answer, now_secs);
            session.redraw();
        }
        let news = self.notifier.observe(&session.nodes(), now_secs);
        let has_news = !news.is_empty();
        for sentence in news {
            tracing::info!("{sentence}");
            self.toasts.push(sentence, now_secs);
        }
        for sentence in session.take_notifications() {
            self.toasts.push(sentence, now_secs);
            session.redraw();
        }
        if self.toasts.tick(now_secs, self.menu.page().is_none()) || has_news {
            session.redraw();
        }
        self.update_sound(session, now_secs);
    }

    /// Time of the next change without input or farm.
    pub fn next_secs(&self) -> Option<f64> {
        self.toasts.next_secs()
    }

    /// Applies held gamepad controls over the time since the last frame.
    fn steer(&mut self, session: &mut GameSession, now_secs: f64) {
        let secs = now_secs - self.steered_secs;
        self.steered_secs = now_secs;
        if self.menu.page().is_some() {
            return;
        }
        for intent in self.input.elapse(secs) {
            self.act(intent, session, now_secs);
        }
    }

    fn update_sound(&mut self, session: &GameSession, now_secs: f64) {
        let Some(clock) = session.shot_clock(now_secs) else {
            // The shot was cut off, as by a new rack: its sound stops. One that was over fades on its own.
            if self.heard.take_if(|heard| !heard.1).is_some() {
                self.playback.stop();
            }
            return;
        };
        let is_new = self.heard.is_none_or(|heard| heard.0 != clock.number);
        self.heard = Some((clock.number, clock.now_secs > clock.end_secs - OVER_SECS));
        if let (true, Some(shot)) = (is_new, session.shot()) {
            // System time of the contact of tip and ball, at which the sound begins.
            let ahead = Duration::from_secs_f64((-clock.now_secs).max(0.0));
            let behind = Duration::from_secs_f64(clock.now_secs.max(0.0));
            let now = Instant::now();
            let at = now.checked_sub(behind).unwrap_or(now) + ahead;
            let shot = shot.clone();
            let make = move || audio::of_shot(&shot);
            self.playback.play(at, self.store.settings.volume, make);
        }
    }
}

/// Seed of a game's rack: the time, or for the daily shot the number of days since 1 January 1970, UTC.
fn seed_of_clock(rules: RuleSet) -> u32 {
    let now = std::time::UNIX_EPOCH.elapsed().unwrap_or_default();
    match rules {
        RuleSet::DailyShot => (now.as_secs() / DAY_SECS) as u32,
        _ => now.subsec_nanos() ^ now.as_secs() as u32,
    }
}

const DAY_SECS: u64 = 24 * 60 * 60;

/// Time before a shot's end from which it counts as over rather than cut off, in seconds.
const OVER_SECS: f64 = 0.3;
