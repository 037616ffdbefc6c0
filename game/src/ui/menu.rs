//! Menu over the table, and the pages that it opens.
//!
//! Every page works with the keyboard alone: arrows and Tab move the focus, Enter or Space activates, Esc
//! goes back.

use carom_billiards::game_match::MatchView;
use carom_billiards::rules::RuleSet;
use carom_text::text;
use carom_window::theme;
use egui::{Button, Context, FocusDirection, Id, Key, Modal, RichText, ScrollArea, Ui};

use super::form::explain;
use super::keys::Rebinding;
use super::new_game::NewGame;
pub use super::page::{MenuInput, Page};
use super::{keys, new_game, preferences};
use crate::input::{Action, Intent, ReplayIntent, Trigger};
use crate::settings::{Settings, SettingsStore};

/// Stack of the pages over the table, the open one last.
#[derive(Clone, Debug, Default)]
pub struct Menu {
    pages: Vec<Page>,
    rebinding: Rebinding,
    game: NewGame,
    /// Whether the page has just been opened, in which case its first button gets the focus.
    is_fresh: bool,
    /// The menu entry under the pointer.
    pointed: Option<Id>,
    /// The widget that had the focus when an arrow was last pressed, and the direction of Tab that replaces
    /// it.
    arrow: Option<(Id, FocusDirection)>,
}

/// Command of a page; changed settings are in the store.
#[derive(Clone, Debug, PartialEq)]
pub enum MenuCommand {
    /// Continue the game.
    Resume,
    /// Resume the match that is suspended during practice.
    ResumeMatch,
    /// Apply an intent, as a key over the table would.
    Act(Intent),
    /// Begin another game.
    Begin(NewGame),
    /// Begin a rematch.
    Rematch,
    /// Quit the program.
    Quit,
}

impl Menu {
    /// Opens a page.
    pub fn open(&mut self, page: Page) {
        self.pages.push(page);
        self.is_fresh = true;
        self.rebinding = Rebinding::default();
    }

    /// Closes all pages.
    pub fn close(&mut self) {
        self.pages.clear();
    }

    /// Returns to the previous page or the table.
    pub fn back(&mut self) {
        if self.rebinding.give_up() {
            return;
        }
        self.pages.pop();
        self.is_fresh = true;
    }

    /// The open page, if there is one.
    pub fn page(&self) -> Option<Page> {
        self.pages.last().copied()
    }

    /// Whether the next key, button or turn of the wheel will be bound to an action.
    pub fn wants_trigger(&self) -> bool {
        self.page() == Some(Page::Keys) && self.rebinding.wants_trigger()
    }

    /// Binds a trigger if one is expected, and returns whether it was.
    pub fn take_trigger(&mut self, trigger: Trigger, store: &mut SettingsStore) -> bool {
        let wanted = self.wants_trigger();
        if wanted {
            self.rebinding.take(trigger, &mut store.settings.bindings);
        }
        wanted
    }

    /// Draws the open page.
    pub fn draw(
        &mut self,
        ctx: &Context,
        store: &mut SettingsStore,
        input: MenuInput<'_>,
    ) -> Option<MenuCommand> {
        let page = self.page()?;
        let is_fresh = std::mem::take(&mut self.is_fresh);
        // One modal per page, so that a page does not inherit another's size.
        let modal = Modal::new(Id::unique(("menu", page as u8)));
        let shown = modal.show(ctx, |ui| {
            let height = ctx.content_rect().height() - 60.0;
            ui.set_max_height(height);
            let scrolled = ScrollArea::vertical().max_height(height);
            match page {
                Page::Top => scrolled.show(ui, |ui| self.top(ui, is_fresh, input)).inner,
                Page::Welcome => scrolled.show(ui, |ui| self.welcome(ui, is_fresh)).inner,
                Page::Result => {
                    scrolled
                        .show(ui, |ui| {
                            self.result(ui, is_fresh, input.view, &store.settings)
                        })
                        .inner
                }
                Page::NewGame => {
                    self.unstick(ui);
                    let begins = new_game::page(ui, &mut self.game, is_fresh);
                    self.footer(ui, false, None);
                    begins.then_some(())?;
                    if input.is_match_unfinished {
                        self.open(Page::GiveUp);
                        return None;
                    }
                    self.begin()
                }
                Page::GiveUp => scrolled.show(ui, |ui| self.give_up(ui, is_fresh)).inner,
                Page::Settings => {
                    let action = preferences::page(ui, store, input);
                    self.footer(ui, is_fresh, action)
                }
                Page::Keys => {
                    keys::page(ui, &mut store.settings.bindings, &mut self.rebinding);
                    self.footer(ui, is_fresh, None)
                }
            }
        });
        shown.inner
    }

    fn top(&mut self, ui: &mut Ui, is_fresh: bool, input: MenuInput<'_>) -> Option<MenuCommand> {
        let is_free_table = input.view.rules == RuleSet::Free;
        title(ui, text!("menu-title"));
        let mut entries = Entries::new(ui, is_fresh, self.pointed);
        let mut command = None;
        if entries.add(text!("menu-resume")) {
            self.close();
            command = Some(MenuCommand::Resume);
        }
        if input.is_match_waiting && entries.add(text!("menu-resume-match")) {
            self.close();
            command = Some(MenuCommand::ResumeMatch);
        }
        if entries.add(text!("menu-new-game")) {
            self.open(Page::NewGame);
        }
        for (words, action) in [
            (text!("menu-rack-again"), Action::Rack),
            (text!("menu-replays"), Action::LookBack),
            (text!("menu-practice-table"), Action::Practise),
            (text!("menu-screenshot"), Action::Photograph),
        ] {
            if (is_free_table || action != Action::Rack) && entries.add(words) {
                self.close();
                command = action.intent(1.0).map(MenuCommand::Act);
            }
        }
        if entries.add(text!("menu-settings")) {
            self.open(Page::Settings);
        }
        if entries.add(text!("menu-keys")) {
            self.open(Page::Keys);
        }
        if entries.add(text!("menu-quit")) {
            command = Some(MenuCommand::Quit);
        }
        self.pointed = entries.finish();
        command
    }

    /// Moves the focus as Tab does if an arrow has found no widget in its direction, as at the end of a row.
    fn unstick(&mut self, ui: &Ui) {
        let pressed =
            |keys: [Key; 2]| ui.input(|input| keys.iter().any(|key| input.key_pressed(*key)));
        let way = match () {
            () if pressed([Key::ArrowRight, Key::ArrowDown]) => Some(FocusDirection::Next),
            () if pressed([Key::ArrowLeft, Key::ArrowUp]) => Some(FocusDirection::Previous),
            () => None,
        };
        ui.memory_mut(|memory| {
            let focused = memory.focused();
            if let Some((id, way)) = self.arrow.take()
                && focused == Some(id)
            {
                memory.move_focus(way);
            }
            self.arrow = focused.zip(way);
        });
        if self.arrow.is_some() {
            ui.ctx().request_repaint();
        }
    }

    fn begin(&mut self) -> Option<MenuCommand> {
        self.close();
        Some(MenuCommand::Begin(self.game.clone()))
    }

    /// Page that asks for confirmation before an unfinished match is abandoned.
    fn give_up(&mut self, ui: &mut Ui, is_fresh: bool) -> Option<MenuCommand> {
        title(ui, text!("menu-give-up"));
        let mut entries = Entries::new(ui, is_fresh, self.pointed);
        let mut command = None;
        if entries.add(text!("menu-keep-match")) {
            self.back();
        }
        if entries.add(text!("menu-begin-anyway")) {
            command = self.begin();
        }
        self.pointed = entries.finish();
        command
    }

    /// Page with first choices for a new player.
    fn welcome(&mut self, ui: &mut Ui, is_fresh: bool) -> Option<MenuCommand> {
        title(ui, text!("menu-welcome"));
        let mut entries = Entries::new(ui, is_fresh, self.pointed);
        let mut command = None;
        for (words, game) in [
            (text!("menu-play"), NewGame::default()),
            (
                text!("menu-watch"),
                NewGame {
                    is_watched: true,
                    ..NewGame::default()
                },
            ),
        ] {
            if entries.add(words) {
                command = Some(MenuCommand::Begin(game));
            }
        }
        if entries.add(text!("menu-practice")) {
            command = Some(MenuCommand::Resume);
        }
        self.pointed = entries.finish();
        if command.is_some() {
            self.close();
        }
        command
    }

    /// Page with the result of the match and the next choices.
    fn result(
        &mut self,
        ui: &mut Ui,
        is_fresh: bool,
        view: &MatchView,
        settings: &Settings,
    ) -> Option<MenuCommand> {
        title(ui, &view.prompt);
        ui.vertical_centered(|ui| {
            let scores = view.players.iter();
            let scores = scores.map(|player| format!("{} {}", player.name, player.score));
            ui.label(scores.collect::<Vec<_>>().join(" · "));
            if let Some(best) = settings.drill_best(view.rules) {
                ui.label(text!("menu-drill-best", score = best));
            }
            if let Some(banner) = &view.banner {
                explain(ui, banner);
            }
        });
        let mut entries = Entries::new(ui, is_fresh, self.pointed);
        let mut command = None;
        let again = match view.players.len() {
            1 => text!("menu-try-again"),
            _ => text!("menu-rematch"),
        };
        if entries.add(again) {
            command = Some(MenuCommand::Rematch);
        }
        if entries.add(text!("menu-new-game")) {
            self.open(Page::NewGame);
        }
        if entries.add(text!("menu-replays")) {
            let replays = Intent::Replay(ReplayIntent::Toggle);
            command = Some(MenuCommand::Act(replays));
        }
        if entries.add(text!("menu-back-to-table")) {
            command = Some(MenuCommand::Resume);
        }
        self.pointed = entries.finish();
        if command.is_some() {
            self.close();
        }
        command
    }

    /// Draws the back button at the foot of a page, and opens the page that was requested, if any.
    fn footer(&mut self, ui: &mut Ui, is_fresh: bool, wanted: Option<Page>) -> Option<MenuCommand> {
        ui.separator();
        ui.horizontal(|ui| {
            let back = ui.button(text!("menu-back"));
            if is_fresh {
                back.request_focus();
            }
            if back.clicked() {
                self.back();
            }
            ui.label(RichText::new(text!("menu-how")).color(theme::FAINT));
        });
        if let Some(page) = wanted {
            self.open(page);
        }
        None
    }
}

fn title(ui: &mut Ui, words: &str) {
    ui.set_width(260.0);
    ui.vertical_centered(|ui| ui.heading(words));
    ui.add_space(6.0);
}

/// Entries of a menu, of which one has the focus: by the pointer that moves over it, or by the arrows, which
/// wrap around from the last entry to the first.
struct Entries<'a> {
    ui: &'a mut Ui,
    is_fresh: bool,
    ids: Vec<Id>,
    /// The entry under the pointer in the last frame and in this one.
    was_pointed: Option<Id>,
    pointed: Option<Id>,
}

impl<'a> Entries<'a> {
    fn new(ui: &'a mut Ui, is_fresh: bool, was_pointed: Option<Id>) -> Self {
        Self {
            ui,
            is_fresh,
            ids: Vec::new(),
            was_pointed,
            pointed: None,
        }
    }

    fn add(&mut self, words: &str) -> bool {
        let width = self.ui.available_width();
        let button = self.ui.add_sized([width, 34.0], Button::new(words));
        let is_first = self.ids.is_empty();
        if button.hovered() {
            self.pointed = Some(button.id);
        }
        let is_newly_pointed = button.hovered() && self.was_pointed != self.pointed;
        if (is_first && self.is_fresh) || is_newly_pointed {
            button.request_focus();
        }
        self.ids.push(button.id);
        button.clicked()
    }

    /// Wraps the arrows around, and returns the entry under the pointer.
    fn finish(self) -> Option<Id> {
        let (&first, &last) = (self.ids.first()?, self.ids.last()?);
        let pressed = |key| self.ui.input(|input| input.key_pressed(key));
        let (up, down) = (pressed(Key::ArrowUp), pressed(Key::ArrowDown));
        self.ui.memory_mut(|memory| {
            let next = match memory.focused() {
                Some(id) if id == first && up => last,
                Some(id) if id == last && down => first,
                _ => return,
            };
            memory.move_focus(FocusDirection::None);
            memory.request_focus(next);
        });
        self.pointed
    }
}
