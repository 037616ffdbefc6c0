//! The menu over the table and the pages that it opens.
//!
//! Every page works with the keyboard alone: arrows and Tab move, Enter or Space chooses, Esc goes
//! back.

use egui::{Button, Context, Id, Modal, Rect, RichText, Ui};

use super::keys::Rebinding;
use super::new_game::NewGame;
pub use super::page::{MenuInput, Page};
use super::{help, keys, new_game, preferences, theme};
use crate::input::{AppIntent, Intent, MatchIntent, PracticeIntent, ReplayIntent, Trigger};
use crate::settings::SettingsStore;

/// The pages over the table: those that led to the open one, and that one.
#[derive(Clone, Debug, Default)]
pub struct Menu {
    pages: Vec<Page>,
    rebinding: Rebinding,
    game: NewGame,
    /// Whether the page has just been opened: then its first button takes the keyboard.
    is_fresh: bool,
}

/// What a page asks for; changed settings are in the store.
#[derive(Clone, Debug, PartialEq)]
pub enum MenuCommand {
    /// To go on with the game.
    Resume,
    /// What a key over the table would do.
    Act(Intent),
    /// To begin another game.
    Begin(NewGame),
    /// To end.
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

    /// Goes to the page before, or to the table.
    pub fn back(&mut self) {
        if self.rebinding.give_up() {
            return;
        }
        self.pages.pop();
        self.is_fresh = true;
    }

    /// The page that is open.
    pub fn page(&self) -> Option<Page> {
        self.pages.last().copied()
    }

    /// Whether the next key, button or turn of the wheel is to be bound to something.
    pub fn wants_trigger(&self) -> bool {
        self.page() == Some(Page::Keys) && self.rebinding.wants_trigger()
    }

    /// Takes that key; says whether it did.
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
        // Each page its own modal, so that none inherits another's size.
        let modal = Modal::new(Id::unique(("menu", page as u8)));
        let shown = modal.show(ctx, |ui| {
            ui.set_max_height(ctx.content_rect().height() - 60.0);
            match page {
                Page::Top => self.top(ui, is_fresh, input.is_free_table),
                Page::NewGame => {
                    let begins = new_game::page(ui, &mut self.game, is_fresh);
                    self.footer(ui, false, None);
                    begins.then(|| {
                        self.close();
                        MenuCommand::Begin(self.game.clone())
                    })
                }
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

    fn top(&mut self, ui: &mut Ui, is_fresh: bool, is_free_table: bool) -> Option<MenuCommand> {
        ui.set_width(260.0);
        ui.vertical_centered(|ui| ui.heading("Carom"));
        ui.add_space(6.0);
        let mut command = None;
        if entry(ui, "Resume", is_fresh) {
            self.close();
            command = Some(MenuCommand::Resume);
        }
        if entry(ui, "New game", false) {
            self.open(Page::NewGame);
        }
        for (words, intent, is_for_all) in [
            ("Rack again", Intent::Match(MatchIntent::Rack), false),
            ("Replays", Intent::Replay(ReplayIntent::Toggle), true),
            (
                "Practice table",
                Intent::Practice(PracticeIntent::Toggle),
                false,
            ),
            ("Screenshot", Intent::App(AppIntent::TakeScreenshot), true),
        ] {
            if (is_for_all || is_free_table) && entry(ui, words, false) {
                self.close();
                command = Some(MenuCommand::Act(intent));
            }
        }
        if entry(ui, "Settings", false) {
            self.open(Page::Settings);
        }
        if entry(ui, "Keys and mouse", false) {
            self.open(Page::Keys);
        }
        if entry(ui, "Quit", false) {
            command = Some(MenuCommand::Quit);
        }
        command
    }

    /// The way back, at the foot of a page, and what the page itself asked for.
    fn footer(&mut self, ui: &mut Ui, is_fresh: bool, wanted: Option<Page>) -> Option<MenuCommand> {
        ui.separator();
        ui.horizontal(|ui| {
            let back = ui.button("Back");
            if is_fresh {
                back.request_focus();
            }
            if back.clicked() {
                self.back();
            }
            ui.label(RichText::new("Arrows and Enter choose, Esc goes back").color(theme::FAINT));
        });
        if let Some(page) = wanted {
            self.open(page);
        }
        None
    }
}

fn entry(ui: &mut Ui, words: &str, focus: bool) -> bool {
    let button = ui.add_sized([ui.available_width(), 34.0], Button::new(words));
    if focus {
        button.request_focus();
    }
    button.clicked()
}

/// The keys over the table, while they are asked for, or the first steps until the first shot.
pub fn hints(ctx: &Context, room: Rect, store: &SettingsStore, help: bool, has_played: bool) {
    if help {
        help::panel(ctx, &store.settings.bindings);
    } else if !has_played {
        help::legend(ctx, room, &store.settings.bindings);
    }
}
