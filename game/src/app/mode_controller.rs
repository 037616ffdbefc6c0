//! Controller of modes: opens replays and practice, executes the commands of their pages, saves files.
//!
//! ```text
//! new shots ─▶ ShotHistory ───┐
//! files (RecordingStore) ─────┴▶ Replay ───▶ optionally the game, from the replay's table
//!                                Practice ─▶ the game, from the arranged table
//! ```
//! Uses neither window nor farm; time is an argument.

use std::path::{Path, PathBuf};

use carom_billiards::physics::{Clip, Recording, Shot};
use carom_billiards::rules::RuleSet;
use carom_text::text;
use etcetera::BaseStrategy as _;

use crate::app::mode::Mode;
use crate::capture::replay::{ReplayCommand, ReplayPlayer};
use crate::capture::{RecordingKind, RecordingStore, SavedRecording, ShotHistory, shot_title};
use crate::input::ReplayIntent;
use crate::play::Game;
use crate::play::practice::{Practice, PracticeCommand, PracticeLayout};
use crate::{Error, Result};

/// The mode, and the sources of replays.
#[derive(Debug)]
pub struct ModeController {
    mode: Mode,
    history: ShotHistory,
    /// The player's data folder, if the platform names one.
    folder: Option<PathBuf>,
    files: Vec<SavedRecording>,
    notifications: Vec<String>,
}

impl ModeController {
    /// A controller with the player's data folder: `carom` in the platform's folder for data
    /// (`$XDG_DATA_HOME`, `~/.local/share`, `~/Library/Application Support` or `%APPDATA%`).
    pub fn of_player() -> Self {
        let folders = etcetera::base_strategy::choose_native_strategy();
        Self::with(folders.map(|folders| folders.data_dir().join("carom")).ok())
    }

    fn with(folder: Option<PathBuf>) -> Self {
        Self {
            mode: Mode::Game,
            history: ShotHistory::default(),
            folder,
            files: Vec::new(),
            notifications: Vec::new(),
        }
    }

    /// The mode.
    pub fn mode(&self) -> &Mode {
        &self.mode
    }

    /// The mode, mutable.
    pub fn mode_mut(&mut self) -> &mut Mode {
        &mut self.mode
    }

    /// The player's files, as listed when the page was opened or a file saved.
    pub fn files(&self) -> &[SavedRecording] {
        &self.files
    }

    /// The player's data folder.
    ///
    /// # Errors
    /// [`Error::NoFolder`] if the platform names none.
    pub fn folder(&self) -> Result<&Path> {
        self.folder.as_deref().ok_or(Error::NoFolder)
    }

    /// Takes the messages for the player since the last call.
    pub fn take_notifications(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notifications)
    }

    /// Adds a new shot to the history, each number once.
    pub fn record_shot(&mut self, number: u64, shot: &Shot) {
        self.history.record(number, shot);
    }

    /// Returns to the game; false if the game was on show already.
    pub fn close(&mut self) -> bool {
        let was = std::mem::replace(&mut self.mode, Mode::Game);
        !matches!(was, Mode::Game)
    }

    /// Opens, closes or controls a replay.
    pub fn replay(&mut self, intent: ReplayIntent, game: &Game, now_secs: f64) {
        match intent {
            ReplayIntent::Toggle => {
                if !self.close() {
                    self.open_replay(game, now_secs);
                }
            }
            ReplayIntent::Control(control) => {
                if let Mode::Replay(player) = &mut self.mode {
                    player.apply(control, now_secs);
                }
            }
        }
    }

    /// Opens or leaves practice.
    pub fn toggle_practice(&mut self, game: &Game) {
        if !self.close() {
            self.open_practice(game);
        }
    }

    /// Opens a replay of the match's shots, titled with players and outcomes, or of a free table's history,
    /// at the last shot.
    fn open_replay(&mut self, game: &Game, now_secs: f64) {
        let recording = match self.past(game) {
            Ok(recording) => recording,
            Err(error) => return self.notify(error.to_string()),
        };
        self.refresh_files();
        match ReplayPlayer::new(recording, game.table(), now_secs) {
            Some(player) => self.mode = Mode::Replay(Box::new(player)),
            None => self.notify(text!("replay-nothing-yet").to_owned()),
        }
    }

    fn past(&self, game: &Game) -> carom_billiards::Result<Recording> {
        if game.contest().referee().rules() == RuleSet::Free {
            return Ok(Recording {
                table: game.table().name().to_owned(),
                clips: self.history.clips().to_vec(),
            });
        }
        let mut recording = game.contest().recording()?;
        // The present shot has not been judged, so it is not in the match's recording.
        recording
            .clips
            .extend(game.fresh_shot().map(|(_, shot)| Clip {
                title: shot_title(recording.clips.len() as u64 + 1, shot),
                shot: shot.clone(),
            }));
        Ok(recording)
    }

    /// Opens a replay of a recording, if it is of the game's table.
    pub fn view(&mut self, recording: Recording, game: &Game, now_secs: f64) {
        if recording.table != game.table().name() {
            return self.notify(text!("replay-other-table", table = recording.table));
        }
        self.refresh_files();
        if let Some(player) = ReplayPlayer::new(recording, game.table(), now_secs) {
            self.mode = Mode::Replay(Box::new(player));
        }
    }

    fn open_practice(&mut self, game: &Game) {
        self.refresh_files();
        match Practice::new(game.world(), game.particle_precision()) {
            Ok(practice) => self.mode = Mode::Practice(Box::new(practice)),
            Err(error) => self.notify(error.to_string()),
        }
    }

    /// Executes a command of the replay page. Returns the layout to play from for [`ReplayCommand::Play`].
    pub fn command_replay(
        &mut self,
        command: ReplayCommand,
        game: &Game,
        now_secs: f64,
    ) -> Option<PracticeLayout> {
        let done = self.try_replay(command, game, now_secs);
        self.report(done)
    }

    fn try_replay(
        &mut self,
        command: ReplayCommand,
        game: &Game,
        now_secs: f64,
    ) -> Result<Option<PracticeLayout>> {
        let Mode::Replay(player) = &mut self.mode else {
            return Ok(None);
        };
        match command {
            ReplayCommand::Control(control) => player.apply(control, now_secs),
            ReplayCommand::Save(kind) => {
                let recording = match kind {
                    RecordingKind::Shot => player.excerpt(),
                    RecordingKind::Match | RecordingKind::Layout => player.recording().clone(),
                };
                self.save(kind, &recording)?;
            }
            ReplayCommand::Open(path) => self.view(Recording::load(&path)?, game, now_secs),
            // Handled by the session, which has the farm.
            ReplayCommand::Film => {}
            ReplayCommand::Play => {
                let start = player.start();
                self.mode = Mode::Game;
                return Ok(Some(start));
            }
            ReplayCommand::Close => self.mode = Mode::Game,
        }
        Ok(None)
    }

    /// Executes a command of the practice page. Returns the layout to play from for
    /// [`PracticeCommand::Play`].
    pub fn command_practice(
        &mut self,
        command: PracticeCommand,
        game: &Game,
        now_secs: f64,
    ) -> Option<PracticeLayout> {
        let done = self.try_practice(command, game, now_secs);
        self.report(done)
    }

    fn try_practice(
        &mut self,
        command: PracticeCommand,
        game: &Game,
        now_secs: f64,
    ) -> Result<Option<PracticeLayout>> {
        let Mode::Practice(practice) = &mut self.mode else {
            return Ok(None);
        };
        match command {
            PracticeCommand::Grab(at) => {
                practice.grab(at);
            }
            PracticeCommand::Drag(at) => practice.drag(at),
            PracticeCommand::LetGo => practice.let_go()?,
            PracticeCommand::Add(number) => practice.add(number)?,
            PracticeCommand::TakeAway(number) => practice.take_away(number)?,
            PracticeCommand::Brush(brush) => practice.set_brush(brush),
            PracticeCommand::Paint(at) => practice.paint(at)?,
            PracticeCommand::Trick(trick) => practice.lay_trick(trick)?,
            PracticeCommand::Sweep => practice.sweep(),
            PracticeCommand::Save => {
                let layout = practice.layout("A layout")?;
                self.save(RecordingKind::Layout, &layout)?;
            }
            PracticeCommand::Open(path) => lay(practice, &path, game, now_secs)?,
            PracticeCommand::Play => {
                let layout = practice.table_layout()?;
                self.mode = Mode::Game;
                return Ok(Some(layout));
            }
            PracticeCommand::Close => self.mode = Mode::Game,
        }
        Ok(None)
    }

    /// Advances the clock of a replay.
    pub fn tick(&mut self, now_secs: f64) {
        if let Mode::Replay(player) = &mut self.mode {
            player.tick(now_secs);
        }
    }

    fn save(&mut self, kind: RecordingKind, recording: &Recording) -> Result<()> {
        let path = self.recordings()?.save(kind, recording)?;
        self.notify(text!("saved-as", path = path.display().to_string()));
        self.refresh_files();
        Ok(())
    }

    fn recordings(&self) -> Result<RecordingStore> {
        Ok(RecordingStore::at(self.folder()?.join("shots")))
    }

    fn refresh_files(&mut self) {
        match self.recordings().and_then(|recordings| recordings.list()) {
            Ok(files) => self.files = files,
            Err(why) => self.notify(why.to_string()),
        }
    }

    /// The result of a command; an error becomes a message for the player.
    fn report(&mut self, done: Result<Option<PracticeLayout>>) -> Option<PracticeLayout> {
        done.unwrap_or_else(|why| {
            self.notify(why.to_string());
            None
        })
    }

    /// Queues a message for the player.
    pub fn notify(&mut self, sentence: String) {
        self.notifications.push(sentence);
    }
}

/// Arranges the practice table as in a file.
fn lay(practice: &mut Practice, path: &Path, game: &Game, now_secs: f64) -> Result<()> {
    let recording = Recording::load(path)?;
    if recording.table != game.table().name() {
        return Err(Error::OtherTable(recording.table));
    }
    if let Some(player) = ReplayPlayer::new(recording, game.table(), now_secs) {
        practice.lay(player.start().balls, player.patches())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::mode::ViewTime;
    use crate::input::{AimIntent, StrokeIntent};
    use carom_billiards::game_match::{Match, MatchConfig, Player};
    use carom_billiards::physics::Stroke;

    fn modes(folder: &Path) -> (ModeController, Game) {
        (
            ModeController::with(Some(folder.to_owned())),
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
        assert!(
            modes.mode().is_moving(&game)
                && modes.mode().view(&game, ViewTime::Now(0.5)).clock.is_some()
        );
        for kind in [RecordingKind::Shot, RecordingKind::Match] {
            modes.command_replay(ReplayCommand::Save(kind), &game, 1.0);
        }
        let names: Vec<&str> = modes
            .files()
            .iter()
            .map(|file| file.name.as_str())
            .collect();
        assert_eq!(names, ["match_0001", "shot_0001"]);
        assert!(
            modes
                .take_notifications()
                .iter()
                .all(|line| line.starts_with("Saved as "))
        );
        let path = modes.files()[1].path.clone();
        modes.command_replay(ReplayCommand::Open(path), &game, 2.0);
        let Mode::Replay(player) = modes.mode() else {
            panic!("nothing is shown");
        };
        assert_eq!(player.recording().clips.len(), 1);
        let balls = modes
            .command_replay(ReplayCommand::Play, &game, 3.0)
            .unwrap();
        assert_eq!(balls.balls.len(), 16);
        assert!(matches!(modes.mode(), Mode::Game));
    }

    #[test]
    fn replayed_shots_name_player_and_outcome() {
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
        game.change_aim(AimIntent::SetPower(0.05), 0.0);
        game.stroke(StrokeIntent::Strike, 0.0, 0.0);
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
        for number in 2..=15 {
            modes.command_practice(PracticeCommand::TakeAway(number), &game, 0.0);
        }
        let spot = game.table().foot_spot();
        modes.command_practice(PracticeCommand::Grab(game.table().head_spot()), &game, 0.0);
        modes.command_practice(PracticeCommand::Drag(spot), &game, 0.0);
        modes.command_practice(PracticeCommand::LetGo, &game, 0.0);
        modes.command_practice(PracticeCommand::Save, &game, 0.0);
        assert_eq!(modes.files()[0].name, "layout_0001");
        let balls = modes
            .command_practice(PracticeCommand::Play, &game, 0.0)
            .unwrap();
        game.lay(&balls).unwrap();
        assert_eq!(game.world().balls(), balls.balls);
        modes.open_practice(&Game::new(2).unwrap());
        let path = modes.files()[0].path.clone();
        modes.command_practice(PracticeCommand::Open(path), &game, 0.0);
        assert_eq!(
            modes
                .command_practice(PracticeCommand::Play, &game, 0.0)
                .unwrap()
                .balls
                .len(),
            balls.balls.len()
        );
    }

    #[test]
    fn files_of_other_tables_and_torn_ones_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let (mut modes, game) = modes(folder.path());
        let torn = folder.path().join("torn.carom");
        std::fs::write(&torn, "carom shot\n").unwrap();
        played(&mut modes, &game, &[2.0]);
        modes.open_replay(&game, 0.0);
        modes.command_replay(ReplayCommand::Open(torn), &game, 0.0);
        let other = carom_billiards::physics::Table::built_in("seven_foot").unwrap();
        let other = Game::of(crate::play::free_table(other, 1).unwrap());
        let shot = other.world().release().unwrap();
        modes.view(Recording::of(other.table(), "", shot), &game, 0.0);
        let notifications = modes.take_notifications();
        assert!(
            notifications[0].contains("ends within") && notifications[1].contains("another table"),
            "{notifications:?}"
        );
        let Mode::Replay(player) = modes.mode() else {
            panic!("the replay was left");
        };
        assert_eq!(player.recording().clips.len(), 1);
    }
}
