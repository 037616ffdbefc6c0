//! What the window shows besides the game: a shot of before, or a table that is being laid; and what
//! is files of the shots.
//!
//! ```text
//! fresh shots ─▶ history ─┐
//! files (RecordingStore) ──────────┴▶ Replay (ReplayPlayer) ─▶ the game goes on from there, if that is wanted
//!                            Practice ──────────▶ the game's table, once it is laid
//! ```
//! Knows neither window nor farm; time is an argument.

use std::path::{Path, PathBuf};

use carom_billiards::physics::{self, BallPose, BallState, Clip, Recording, Shot};
use carom_billiards::rules::RuleSet;
use carom_tracer::Camera;
use etcetera::BaseStrategy as _;
use glam::DVec2;

use crate::camera::Viewpoint;
use crate::capture::replay::ReplayPlayer;
use crate::capture::screenshot::Screenshot;
use crate::capture::{RecordingKind, RecordingStore, SavedRecording, timeline_events};
use crate::input::{Intent, ReplayControl};
use crate::play::Game;
use crate::play::practice::Practice;

/// What is on show, and what is files.
#[derive(Debug)]
pub struct ModeController {
    mode: Mode,
    history: Vec<Clip>,
    /// The number of the last shot of the history.
    last: u64,
    /// The player's folder, or why there is none.
    folder: Result<PathBuf, String>,
    files: Vec<SavedRecording>,
    screenshot: Option<Screenshot>,
    notifications: Vec<String>,
}

/// What the window shows.
#[derive(Debug)]
pub enum Mode {
    /// The game.
    Game,
    /// A shot of before.
    Replay(Box<ReplayPlayer>),
    /// A table that is being laid.
    Practice(Box<Practice>),
}

/// What the player wants of what is on show.
#[derive(Clone, Debug, PartialEq)]
pub enum Order {
    /// Of the replay's time, or another of its shots.
    Watch(ReplayControl),
    /// To save what is on show as a file.
    Keep(RecordingKind),
    /// To mode what a file holds, or lay the balls so.
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

impl ModeController {
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
            mode: Mode::Game,
            history: Vec::new(),
            last: 0,
            folder,
            files: Vec::new(),
            screenshot: None,
            notifications: Vec::new(),
        }
    }

    /// What is on show.
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// The player's files, as they were when the page was opened.
    pub fn files(&self) -> &[SavedRecording] {
        &self.files
    }

    /// Sentences for the player since the last call.
    pub fn take_notifications(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notifications)
    }

    /// Takes a shot that is played for the first time into the history; each number once.
    pub fn record_shot(&mut self, number: u64, shot: &Shot) {
        if number <= self.last {
            return;
        }
        self.last = number;
        if self.history.len() == HISTORY_MAX {
            self.history.remove(0);
        }
        self.history.push(Clip {
            title: title(number, shot),
            shot: shot.clone(),
        });
    }

    /// Shows the shots of a match with who played them and what came of them, or the history of a free
    /// table; the last shot first.
    pub fn open_replay(&mut self, game: &Game, now_secs: f64) {
        let recording = match self.past(game) {
            Ok(recording) => recording,
            Err(error) => return self.notify(error.to_string()),
        };
        self.refresh_files();
        match ReplayPlayer::new(recording, game.table(), now_secs) {
            Some(player) => self.mode = Mode::Replay(Box::new(player)),
            None => self.notify("There is no shot to look back at yet".to_owned()),
        }
    }

    fn past(&self, game: &Game) -> physics::Result<Recording> {
        if game.contest().referee().rules() == RuleSet::Free {
            return Ok(Recording {
                table: game.table().name().to_owned(),
                clips: self.history.clone(),
            });
        }
        let mut recording = game.contest().recording()?;
        // The shot that is on is not judged yet.
        recording
            .clips
            .extend(game.fresh_shot().map(|(_, shot)| Clip {
                title: title(recording.clips.len() as u64 + 1, shot),
                shot: shot.clone(),
            }));
        Ok(recording)
    }

    /// Shows a recording of the game's table.
    pub fn view(&mut self, recording: Recording, game: &Game, now_secs: f64) {
        if recording.table != game.table().name() {
            return self.notify(format!(
                "It was played on another table, {}: start the game with --replay and the file",
                recording.table
            ));
        }
        self.refresh_files();
        if let Some(player) = ReplayPlayer::new(recording, game.table(), now_secs) {
            self.mode = Mode::Replay(Box::new(player));
        }
    }

    /// Begins to lay the game's table.
    pub fn open_practice(&mut self, game: &Game) {
        self.refresh_files();
        match Practice::new(game.world()) {
            Ok(practice) => self.mode = Mode::Practice(Box::new(practice)),
            Err(error) => self.notify(error.to_string()),
        }
    }

    /// Takes a picture; one at a time. `begin` is given the folder.
    pub fn take_screenshot(&mut self, begin: impl FnOnce(PathBuf) -> Result<Screenshot, String>) {
        if self.screenshot.is_some() {
            return self.notify("A picture is being taken already".to_owned());
        }
        let folder = self.folder.clone().map(|folder| folder.join("pictures"));
        match folder.and_then(begin) {
            Ok(screenshot) => {
                self.screenshot = Some(screenshot);
                self.notify("A picture in full quality is being traced".to_owned());
            }
            Err(why) => self.notify(why),
        }
    }

    /// Does what the player wants; the balls to play on with, if that is it.
    pub fn handle_command(
        &mut self,
        command: Order,
        game: &Game,
        now_secs: f64,
    ) -> Option<Vec<BallState>> {
        let told = match (command, &mut self.mode) {
            (Order::Close, _) => {
                self.mode = Mode::Game;
                Ok(())
            }
            (Order::Play, Mode::Replay(player)) => {
                let balls = player.start();
                self.mode = Mode::Game;
                return Some(balls);
            }
            (Order::Play, Mode::Practice(practice)) => {
                let balls = practice.world().balls();
                self.mode = Mode::Game;
                return Some(balls);
            }
            (Order::Watch(watch), Mode::Replay(player)) => {
                player.apply(watch, now_secs);
                Ok(())
            }
            (Order::Keep(kind), _) => self.save(kind),
            (Order::Open(path), _) => self.open(&path, game, now_secs),
            (command, Mode::Practice(practice)) => arrange(practice, command),
            _ => Ok(()),
        };
        if let Err(why) = told {
            self.notify(why);
        }
        None
    }

    /// Takes what the player does while something else than the game is on show; whether it did.
    pub fn handle_intent(&mut self, intent: Intent, game: &Game, now_secs: f64) -> bool {
        match (&mut self.mode, intent) {
            (Mode::Game, _) => return false,
            (_, Intent::Escape | Intent::LookBack | Intent::Practise) => self.mode = Mode::Game,
            // The game's camera looks at a table that is being laid.
            (
                Mode::Practice(_),
                Intent::Orbit { .. }
                | Intent::Zoom(_)
                | Intent::NextView
                | Intent::Overhead
                | Intent::LookFrom(_),
            ) => return false,
            (Mode::Replay(player), Intent::Watch(watch)) => player.apply(watch, now_secs),
            (Mode::Replay(player), intent) => player.look(intent, game.table(), now_secs),
            _ => {}
        }
        true
    }

    /// Lets time pass.
    pub fn tick(&mut self, now_secs: f64) {
        if let Mode::Replay(player) = &mut self.mode {
            player.tick(now_secs);
        }
        let Some(outcome) = self.screenshot.as_ref().and_then(Screenshot::poll) else {
            return;
        };
        self.screenshot = None;
        self.notify(match outcome {
            Ok(path) => format!(
                "The picture is {}; beside it, as .exr, with layers",
                path.display()
            ),
            Err(why) => format!("No picture was taken: {why}"),
        });
    }

    /// As [`Game::shot_clock`], of what is on show.
    pub fn shot_clock(&self, game: &Game, now_secs: f64) -> Option<(u64, f64, f64)> {
        match &self.mode {
            Mode::Game => game.shot_clock(now_secs),
            Mode::Replay(player) => player.shot_clock(now_secs),
            Mode::Practice(_) => None,
        }
    }

    /// As [`Game::poses`], of what is on show.
    pub fn poses(&self, game: &Game, moment_secs: f64) -> Vec<BallPose> {
        match &self.mode {
            Mode::Game => game.poses(moment_secs),
            Mode::Replay(player) => player.poses(moment_secs),
            Mode::Practice(practice) => practice.poses(),
        }
    }

    /// As [`Game::camera`], of what is on show.
    pub fn camera(&self, game: &Game, moment_secs: f64) -> Camera {
        self.viewpoint(game, moment_secs).camera_in(game.table())
    }

    /// As [`Game::viewpoint`], of what is on show.
    pub fn viewpoint(&self, game: &Game, moment_secs: f64) -> Viewpoint {
        match &self.mode {
            Mode::Replay(player) => player.viewpoint(game.table(), moment_secs),
            Mode::Game | Mode::Practice(_) => game.viewpoint(moment_secs),
        }
    }

    /// Whether time alone changes what is seen.
    pub fn is_moving(&self, game: &Game) -> bool {
        match &self.mode {
            Mode::Game | Mode::Practice(_) => game.is_moving(),
            Mode::Replay(player) => player.clock().is_running() || game.is_moving(),
        }
    }

    /// Whether a picture is being taken.
    pub fn is_taking_screenshot(&self) -> bool {
        self.screenshot.is_some()
    }

    fn save(&mut self, kind: RecordingKind) -> Result<(), String> {
        let recording = match (&self.mode, kind) {
            (Mode::Replay(player), RecordingKind::Shot) => player.excerpt(),
            (Mode::Replay(player), _) => player.recording().clone(),
            (Mode::Practice(practice), _) => {
                let layout = practice.layout("A layout");
                layout.map_err(|error| error.to_string())?
            }
            (Mode::Game, _) => return Ok(()),
        };
        let path = self.recordings()?.save(kind, &recording)?;
        self.notify(format!("Kept as {}", path.display()));
        self.refresh_files();
        Ok(())
    }

    fn open(&mut self, path: &Path, game: &Game, now_secs: f64) -> Result<(), String> {
        let recording = Recording::load(path).map_err(|error| error.to_string())?;
        let Mode::Practice(practice) = &mut self.mode else {
            self.view(recording, game, now_secs);
            return Ok(());
        };
        if recording.table != game.table().name() {
            return Err(format!("It was laid on another table, {}", recording.table));
        }
        match ReplayPlayer::new(recording, game.table(), now_secs) {
            Some(player) => practice.lay(player.start()),
            None => Ok(()),
        }
    }

    fn recordings(&self) -> Result<RecordingStore, String> {
        let folder = self.folder.clone()?;
        Ok(RecordingStore::at(folder.join("shots")))
    }

    fn refresh_files(&mut self) {
        match self.recordings().and_then(|recordings| recordings.list()) {
            Ok(files) => self.files = files,
            Err(why) => self.notify(why),
        }
    }

    /// Tells the player something.
    pub fn notify(&mut self, sentence: String) {
        self.notifications.push(sentence);
    }
}

fn arrange(practice: &mut Practice, command: Order) -> Result<(), String> {
    match command {
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
    let told = timeline_events(shot).into_iter();
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
    use carom_billiards::game_match::{Match, MatchConfig, Player};
    use carom_billiards::physics::Stroke;

    fn modes(folder: &Path) -> (ModeController, Game) {
        (
            ModeController::with(Ok(folder.to_owned())),
            Game::new(1).unwrap(),
        )
    }

    fn played(modes: &mut ModeController, game: &Game, speeds: &[f64]) {
        for (number, &speed) in (1..).zip(speeds) {
            let shot = game.world().strike(Stroke::straight(0.0, speed)).unwrap();
            modes.record_shot(number, &shot);
            modes.record_shot(number, &shot);
        }
    }

    #[test]
    fn shots_are_looked_back_at_kept_and_opened_again() {
        let folder = tempfile::tempdir().unwrap();
        let (mut modes, game) = modes(folder.path());
        modes.open_replay(&game, 0.0);
        assert!(matches!(modes.mode(), Mode::Game));
        assert_eq!(modes.take_notifications().len(), 1);
        played(&mut modes, &game, &[2.0, 7.0]);
        modes.open_replay(&game, 0.0);
        let Mode::Replay(player) = modes.mode() else {
            panic!("nothing is shown");
        };
        assert_eq!((player.recording().clips.len(), player.take()), (2, 1));
        assert!(
            player.recording().clips[0]
                .title
                .starts_with("Shot 1: the cue strikes at 2.0")
        );
        assert!(modes.is_moving(&game) && modes.shot_clock(&game, 0.5).is_some());
        for kind in [RecordingKind::Shot, RecordingKind::Match] {
            modes.handle_command(Order::Keep(kind), &game, 1.0);
        }
        let names: Vec<&str> = modes
            .files()
            .iter()
            .map(|files| files.name.as_str())
            .collect();
        assert_eq!(names, ["match_0001", "shot_0001"]);
        assert!(
            modes
                .take_notifications()
                .iter()
                .all(|line| line.starts_with("Kept as "))
        );
        let path = modes.files()[1].path.clone();
        modes.handle_command(Order::Open(path), &game, 2.0);
        let Mode::Replay(player) = modes.mode() else {
            panic!("nothing is shown");
        };
        assert_eq!(player.recording().clips.len(), 1);
        let balls = modes.handle_command(Order::Play, &game, 3.0).unwrap();
        assert_eq!(balls.len(), 16);
        assert!(matches!(modes.mode(), Mode::Game));
    }

    #[test]
    fn the_shots_of_a_match_say_who_played_them_and_what_came_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let (mut modes, _) = modes(folder.path());
        let players = Player::list("Ada,Bo").unwrap();
        let setup = MatchConfig::new(RuleSet::Eight, players, 3).unwrap();
        let mut game = Game::of(Match::new(setup).unwrap());
        let titles = |modes: &ModeController| match modes.mode() {
            Mode::Replay(player) => {
                let takes = player.recording().clips.iter();
                takes.map(|take| take.title.clone()).collect()
            }
            _ => Vec::new(),
        };
        for intent in [Intent::SetPower(0.05), Intent::Strike] {
            game.apply(intent, 0.0, 0.0, DVec2::ONE);
        }
        modes.open_replay(&game, 0.0);
        assert!(titles(&modes)[0].starts_with("Shot 1: the cue strikes"));
        game.tick(60.0, 0.1);
        modes.open_replay(&game, 60.0);
        let titles = titles(&modes);
        assert!(
            titles[0].starts_with("1. Ada: ") && titles.len() == 1,
            "{titles:?}"
        );
    }

    #[test]
    fn a_table_is_laid_kept_and_played_on() {
        let folder = tempfile::tempdir().unwrap();
        let (mut modes, mut game) = modes(folder.path());
        modes.open_practice(&game);
        assert!(
            !modes.handle_intent(Intent::Zoom(1.1), &game, 0.0),
            "the camera is the game's"
        );
        assert!(
            modes.handle_intent(Intent::BeginPull, &game, 0.0),
            "there is no stroke"
        );
        for number in 2..=15 {
            modes.handle_command(Order::TakeAway(number), &game, 0.0);
        }
        let spot = game.table().foot_spot();
        modes.handle_command(Order::Grab(game.table().head_spot()), &game, 0.0);
        modes.handle_command(Order::Drag(spot), &game, 0.0);
        modes.handle_command(Order::LetGo, &game, 0.0);
        modes.handle_command(Order::Keep(RecordingKind::Layout), &game, 0.0);
        assert_eq!(modes.files()[0].name, "layout_0001");
        let balls = modes.handle_command(Order::Play, &game, 0.0).unwrap();
        game.lay(&balls).unwrap();
        assert_eq!(game.world().balls(), balls);
        modes.open_practice(&Game::new(2).unwrap());
        let path = modes.files()[0].path.clone();
        modes.handle_command(Order::Open(path), &game, 0.0);
        assert_eq!(
            modes.handle_command(Order::Play, &game, 0.0).unwrap().len(),
            balls.len()
        );
    }

    #[test]
    fn files_of_other_tables_and_torn_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let (mut modes, game) = modes(folder.path());
        let torn = folder.path().join("torn.carom");
        std::fs::write(&torn, "carom shot\n").unwrap();
        modes.handle_command(Order::Open(torn), &game, 0.0);
        let other = carom_billiards::physics::Table::built_in("seven_foot").unwrap();
        let other = Game::of(crate::play::free_table(other, 1).unwrap());
        let shot = other.world().release().unwrap();
        modes.view(Recording::of(other.table(), "", shot), &game, 0.0);
        let notifications = modes.take_notifications();
        assert!(
            notifications[0].contains("ends within") && notifications[1].contains("another table"),
            "{notifications:?}"
        );
        assert!(matches!(modes.mode(), Mode::Game));
    }
}
