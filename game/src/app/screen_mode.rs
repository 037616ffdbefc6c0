//! What the window shows besides the game: a shot of before, or a table that is being laid; and what
//! is kept of the shots.
//!
//! ```text
//! fresh shots ─▶ history ─┐
//! files (Shelf) ──────────┴▶ Replay (Viewing) ─▶ the game goes on from there, if that is wanted
//!                            Practice ──────────▶ the game's table, once it is laid
//! ```
//! Knows neither window nor farm; time is an argument.

use std::path::{Path, PathBuf};

use carom_billiards::physics::{self, BallPose, BallState, Recording, Shot, Take};
use carom_billiards::rules::RuleSet;
use carom_tracer::Camera;
use etcetera::BaseStrategy as _;
use glam::DVec2;

use crate::camera::Viewpoint;
use crate::capture::replay::Viewing;
use crate::capture::screenshot::Screenshot;
use crate::capture::{Kept, Kind, Shelf, moments};
use crate::input::{Intent, Watch};
use crate::play::Game;
use crate::play::practice::Practice;

/// What is on show, and what is kept.
#[derive(Debug)]
pub struct Booth {
    show: Show,
    history: Vec<Take>,
    /// The number of the last shot of the history.
    last: u64,
    /// The player's folder, or why there is none.
    folder: Result<PathBuf, String>,
    kept: Vec<Kept>,
    screenshot: Option<Screenshot>,
    news: Vec<String>,
}

/// What the window shows.
#[derive(Debug)]
pub enum Show {
    /// The game.
    Game,
    /// A shot of before.
    Replay(Box<Viewing>),
    /// A table that is being laid.
    Practice(Box<Practice>),
}

/// What the player wants of the booth.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Of the replay's time, or another of its shots.
    Watch(Watch),
    /// To keep what is on show as a file.
    Keep(Kind),
    /// To show what a file holds, or lay the balls so.
    Open(PathBuf),
    /// To take a ball into the hand at this place of the table, m.
    Grab(DVec2),
    /// To move it there.
    Drag(DVec2),
    /// To put it down.
    LetGo,
    /// To put another ball on the table.
    Add(u8),
    /// To take one off it.
    TakeAway(u8),
    /// To play on: from before the shot on show, or with the balls as they are laid.
    Play,
    /// To go back to the game as it was.
    Close,
}

impl Booth {
    /// With the player's own folder: `carom` in the platform's folder for data (`$XDG_DATA_HOME`,
    /// `~/.local/share`, `~/Library/Application Support` or `%APPDATA%`).
    pub fn of_player() -> Self {
        let folder = etcetera::base_strategy::choose_native_strategy()
            .map(|folders| folders.data_dir().join("carom"))
            .map_err(|error| format!("there is no folder for files: {error}"));
        Self::with(folder)
    }

    fn with(folder: Result<PathBuf, String>) -> Self {
        Self {
            show: Show::Game,
            history: Vec::new(),
            last: 0,
            folder,
            kept: Vec::new(),
            screenshot: None,
            news: Vec::new(),
        }
    }

    /// What is on show.
    pub fn show(&self) -> &Show {
        &self.show
    }

    /// The player's files, as they were when the page was opened.
    pub fn kept(&self) -> &[Kept] {
        &self.kept
    }

    /// Sentences for the player since the last call.
    pub fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }

    /// Takes a shot that is played for the first time into the history; each number once.
    pub fn note(&mut self, number: u64, shot: &Shot) {
        if number <= self.last {
            return;
        }
        self.last = number;
        if self.history.len() == HISTORY_MAX {
            self.history.remove(0);
        }
        self.history.push(Take {
            title: title(number, shot),
            shot: shot.clone(),
        });
    }

    /// Shows the shots of a match with who played them and what came of them, or the history of a free
    /// table; the last shot first.
    pub fn look_back(&mut self, game: &Game, now_secs: f64) {
        let recording = match self.past(game) {
            Ok(recording) => recording,
            Err(error) => return self.say(error.to_string()),
        };
        self.list();
        match Viewing::new(recording, game.table(), now_secs) {
            Some(viewing) => self.show = Show::Replay(Box::new(viewing)),
            None => self.say("There is no shot to look back at yet".to_owned()),
        }
    }

    fn past(&self, game: &Game) -> physics::Result<Recording> {
        if game.contest().referee().rules() == RuleSet::Free {
            return Ok(Recording {
                table: game.table().name().to_owned(),
                takes: self.history.clone(),
            });
        }
        let mut recording = game.contest().recording()?;
        // The shot that is on is not judged yet.
        recording
            .takes
            .extend(game.fresh_shot().map(|(_, shot)| Take {
                title: title(recording.takes.len() as u64 + 1, shot),
                shot: shot.clone(),
            }));
        Ok(recording)
    }

    /// Shows a recording of the game's table.
    pub fn view(&mut self, recording: Recording, game: &Game, now_secs: f64) {
        if recording.table != game.table().name() {
            return self.say(format!(
                "It was played on another table, {}: start the game with --replay and the file",
                recording.table
            ));
        }
        self.list();
        if let Some(viewing) = Viewing::new(recording, game.table(), now_secs) {
            self.show = Show::Replay(Box::new(viewing));
        }
    }

    /// Begins to lay the game's table.
    pub fn practise(&mut self, game: &Game) {
        self.list();
        match Practice::new(game.world()) {
            Ok(practice) => self.show = Show::Practice(Box::new(practice)),
            Err(error) => self.say(error.to_string()),
        }
    }

    /// Takes a picture; one at a time. `begin` is given the folder.
    pub fn photograph(&mut self, begin: impl FnOnce(PathBuf) -> Result<Screenshot, String>) {
        if self.screenshot.is_some() {
            return self.say("A picture is being taken already".to_owned());
        }
        let folder = self.folder.clone().map(|folder| folder.join("pictures"));
        match folder.and_then(begin) {
            Ok(screenshot) => {
                self.screenshot = Some(screenshot);
                self.say("A picture in full quality is being traced".to_owned());
            }
            Err(why) => self.say(why),
        }
    }

    /// Does what the player wants; the balls to play on with, if that is it.
    pub fn obey(&mut self, order: Order, game: &Game, now_secs: f64) -> Option<Vec<BallState>> {
        let told = match (order, &mut self.show) {
            (Order::Close, _) => {
                self.show = Show::Game;
                Ok(())
            }
            (Order::Play, Show::Replay(viewing)) => {
                let balls = viewing.start();
                self.show = Show::Game;
                return Some(balls);
            }
            (Order::Play, Show::Practice(practice)) => {
                let balls = practice.world().balls();
                self.show = Show::Game;
                return Some(balls);
            }
            (Order::Watch(watch), Show::Replay(viewing)) => {
                viewing.apply(watch, now_secs);
                Ok(())
            }
            (Order::Keep(kind), _) => self.keep(kind),
            (Order::Open(path), _) => self.open(&path, game, now_secs),
            (order, Show::Practice(practice)) => arrange(practice, order),
            _ => Ok(()),
        };
        if let Err(why) = told {
            self.say(why);
        }
        None
    }

    /// Takes what the player does while something else than the game is on show; whether it did.
    pub fn take(&mut self, intent: Intent, game: &Game, now_secs: f64) -> bool {
        match (&mut self.show, intent) {
            (Show::Game, _) => return false,
            (_, Intent::Escape | Intent::LookBack | Intent::Practise) => self.show = Show::Game,
            // The game's camera looks at a table that is being laid.
            (
                Show::Practice(_),
                Intent::Orbit { .. }
                | Intent::Zoom(_)
                | Intent::NextView
                | Intent::Overhead
                | Intent::LookFrom(_),
            ) => return false,
            (Show::Replay(viewing), Intent::Watch(watch)) => viewing.apply(watch, now_secs),
            (Show::Replay(viewing), intent) => viewing.look(intent, game.table(), now_secs),
            _ => {}
        }
        true
    }

    /// Lets time pass.
    pub fn tick(&mut self, now_secs: f64) {
        if let Show::Replay(viewing) = &mut self.show {
            viewing.tick(now_secs);
        }
        let Some(outcome) = self.screenshot.as_ref().and_then(Screenshot::poll) else {
            return;
        };
        self.screenshot = None;
        self.say(match outcome {
            Ok(path) => format!(
                "The picture is {}; beside it, as .exr, with layers",
                path.display()
            ),
            Err(why) => format!("No picture was taken: {why}"),
        });
    }

    /// As [`Game::shot_clock`], of what is on show.
    pub fn shot_clock(&self, game: &Game, now_secs: f64) -> Option<(u64, f64, f64)> {
        match &self.show {
            Show::Game => game.shot_clock(now_secs),
            Show::Replay(viewing) => viewing.shot_clock(now_secs),
            Show::Practice(_) => None,
        }
    }

    /// As [`Game::poses`], of what is on show.
    pub fn poses(&self, game: &Game, moment_secs: f64) -> Vec<BallPose> {
        match &self.show {
            Show::Game => game.poses(moment_secs),
            Show::Replay(viewing) => viewing.poses(moment_secs),
            Show::Practice(practice) => practice.poses(),
        }
    }

    /// As [`Game::camera`], of what is on show.
    pub fn camera(&self, game: &Game, moment_secs: f64) -> Camera {
        self.viewpoint(game, moment_secs).camera_in(game.table())
    }

    /// As [`Game::viewpoint`], of what is on show.
    pub fn viewpoint(&self, game: &Game, moment_secs: f64) -> Viewpoint {
        match &self.show {
            Show::Replay(viewing) => viewing.viewpoint(game.table(), moment_secs),
            Show::Game | Show::Practice(_) => game.viewpoint(moment_secs),
        }
    }

    /// Whether time alone changes what is seen.
    pub fn is_moving(&self, game: &Game) -> bool {
        match &self.show {
            Show::Game | Show::Practice(_) => game.is_moving(),
            Show::Replay(viewing) => viewing.clock().is_running() || game.is_moving(),
        }
    }

    /// Whether a picture is being taken.
    pub fn is_photographing(&self) -> bool {
        self.screenshot.is_some()
    }

    fn keep(&mut self, kind: Kind) -> Result<(), String> {
        let recording = match (&self.show, kind) {
            (Show::Replay(viewing), Kind::Shot) => viewing.excerpt(),
            (Show::Replay(viewing), _) => viewing.recording().clone(),
            (Show::Practice(practice), _) => {
                let layout = practice.layout("A layout");
                layout.map_err(|error| error.to_string())?
            }
            (Show::Game, _) => return Ok(()),
        };
        let path = self.shelf()?.put(kind, &recording)?;
        self.say(format!("Kept as {}", path.display()));
        self.list();
        Ok(())
    }

    fn open(&mut self, path: &Path, game: &Game, now_secs: f64) -> Result<(), String> {
        let recording = Recording::load(path).map_err(|error| error.to_string())?;
        let Show::Practice(practice) = &mut self.show else {
            self.view(recording, game, now_secs);
            return Ok(());
        };
        if recording.table != game.table().name() {
            return Err(format!("It was laid on another table, {}", recording.table));
        }
        match Viewing::new(recording, game.table(), now_secs) {
            Some(viewing) => practice.lay(viewing.start()),
            None => Ok(()),
        }
    }

    fn shelf(&self) -> Result<Shelf, String> {
        let folder = self.folder.clone()?;
        Ok(Shelf::at(folder.join("shots")))
    }

    fn list(&mut self) {
        match self.shelf().and_then(|shelf| shelf.list()) {
            Ok(kept) => self.kept = kept,
            Err(why) => self.say(why),
        }
    }

    /// Tells the player something.
    pub fn say(&mut self, sentence: String) {
        self.news.push(sentence);
    }
}

fn arrange(practice: &mut Practice, order: Order) -> Result<(), String> {
    match order {
        Order::Grab(at) => {
            practice.grab(at);
            Ok(())
        }
        Order::Drag(at) => {
            practice.drag(at);
            Ok(())
        }
        Order::LetGo => practice.let_go(),
        Order::Add(number) => practice.add(number),
        Order::TakeAway(number) => practice.take_away(number),
        _ => Ok(()),
    }
}

/// "Shot 3: the cue strikes at 2.1 m/s, the 5 is potted".
fn title(number: u64, shot: &Shot) -> String {
    let told = moments(shot).into_iter();
    let told = told
        .filter(|moment| !moment.is_contact)
        .map(|moment| moment.words);
    let words: Vec<String> = told.take(TOLD_MAX).collect();
    format!("Shot {number}: {}", words.join(", "))
}

/// A long evening; older shots are forgotten.
const HISTORY_MAX: usize = 500;
/// Of a break only so much is told.
const TOLD_MAX: usize = 6;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::game_match::{Match, Player, Setup};
    use carom_billiards::physics::Stroke;

    fn booth(folder: &Path) -> (Booth, Game) {
        (Booth::with(Ok(folder.to_owned())), Game::new(1).unwrap())
    }

    fn played(booth: &mut Booth, game: &Game, speeds: &[f64]) {
        for (number, &speed) in (1..).zip(speeds) {
            let shot = game.world().strike(Stroke::straight(0.0, speed)).unwrap();
            booth.note(number, &shot);
            booth.note(number, &shot);
        }
    }

    #[test]
    fn shots_are_looked_back_at_kept_and_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let (mut booth, game) = booth(folder.path());
        booth.look_back(&game, 0.0);
        assert!(matches!(booth.show(), Show::Game));
        assert_eq!(booth.take_news().len(), 1);
        played(&mut booth, &game, &[2.0, 7.0]);
        booth.look_back(&game, 0.0);
        let Show::Replay(viewing) = booth.show() else {
            panic!("nothing is shown");
        };
        assert_eq!((viewing.recording().takes.len(), viewing.take()), (2, 1));
        assert!(
            viewing.recording().takes[0]
                .title
                .starts_with("Shot 1: the cue strikes at 2.0")
        );
        assert!(booth.is_moving(&game) && booth.shot_clock(&game, 0.5).is_some());
        for kind in [Kind::Shot, Kind::Match] {
            booth.obey(Order::Keep(kind), &game, 1.0);
        }
        let names: Vec<&str> = booth.kept().iter().map(|kept| kept.name.as_str()).collect();
        assert_eq!(names, ["match_0001", "shot_0001"]);
        assert!(
            booth
                .take_news()
                .iter()
                .all(|line| line.starts_with("Kept as "))
        );
        let path = booth.kept()[1].path.clone();
        booth.obey(Order::Open(path), &game, 2.0);
        let Show::Replay(viewing) = booth.show() else {
            panic!("nothing is shown");
        };
        assert_eq!(viewing.recording().takes.len(), 1);
        let balls = booth.obey(Order::Play, &game, 3.0).unwrap();
        assert_eq!(balls.len(), 16);
        assert!(matches!(booth.show(), Show::Game));
    }

    #[test]
    fn the_shots_of_a_match_say_who_played_them_and_what_came_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let (mut booth, _) = booth(folder.path());
        let players = Player::list("Ada,Bo").unwrap();
        let setup = Setup::new(RuleSet::Eight, players, 3).unwrap();
        let mut game = Game::of(Match::new(setup).unwrap());
        let titles = |booth: &Booth| match booth.show() {
            Show::Replay(viewing) => {
                let takes = viewing.recording().takes.iter();
                takes.map(|take| take.title.clone()).collect()
            }
            _ => Vec::new(),
        };
        for intent in [Intent::SetPower(0.05), Intent::Strike] {
            game.apply(intent, 0.0, 0.0, DVec2::ONE);
        }
        booth.look_back(&game, 0.0);
        assert!(titles(&booth)[0].starts_with("Shot 1: the cue strikes"));
        game.tick(60.0, 0.1);
        booth.look_back(&game, 60.0);
        let titles = titles(&booth);
        assert!(
            titles[0].starts_with("1. Ada: ") && titles.len() == 1,
            "{titles:?}"
        );
    }

    #[test]
    fn a_table_is_laid_kept_and_played_on() {
        let folder = tempfile::tempdir().unwrap();
        let (mut booth, mut game) = booth(folder.path());
        booth.practise(&game);
        assert!(
            !booth.take(Intent::Zoom(1.1), &game, 0.0),
            "the camera is the game's"
        );
        assert!(
            booth.take(Intent::BeginPull, &game, 0.0),
            "there is no stroke"
        );
        for number in 2..=15 {
            booth.obey(Order::TakeAway(number), &game, 0.0);
        }
        let spot = game.table().foot_spot();
        booth.obey(Order::Grab(game.table().head_spot()), &game, 0.0);
        booth.obey(Order::Drag(spot), &game, 0.0);
        booth.obey(Order::LetGo, &game, 0.0);
        booth.obey(Order::Keep(Kind::Layout), &game, 0.0);
        assert_eq!(booth.kept()[0].name, "layout_0001");
        let balls = booth.obey(Order::Play, &game, 0.0).unwrap();
        game.lay(&balls).unwrap();
        assert_eq!(game.world().balls(), balls);
        booth.practise(&Game::new(2).unwrap());
        let path = booth.kept()[0].path.clone();
        booth.obey(Order::Open(path), &game, 0.0);
        assert_eq!(
            booth.obey(Order::Play, &game, 0.0).unwrap().len(),
            balls.len()
        );
    }

    #[test]
    fn files_of_other_tables_and_torn_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let (mut booth, game) = booth(folder.path());
        let torn = folder.path().join("torn.carom");
        std::fs::write(&torn, "carom shot\n").unwrap();
        booth.obey(Order::Open(torn), &game, 0.0);
        let other = carom_billiards::physics::Table::built_in("seven_foot").unwrap();
        let other = Game::of(crate::play::free_table(other, 1).unwrap());
        let shot = other.world().release().unwrap();
        booth.view(Recording::of(other.table(), "", shot), &game, 0.0);
        let news = booth.take_news();
        assert!(
            news[0].contains("ends within") && news[1].contains("another table"),
            "{news:?}"
        );
        assert!(matches!(booth.show(), Show::Game));
    }
}
