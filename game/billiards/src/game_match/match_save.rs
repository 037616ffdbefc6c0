//! A match as a file: what it was begun with and what was done. It is played again to where it stood,
//! shot by shot, by the physics that gives the same bits on every machine.
//!
//! ```text
//! "carom match" 0x0A | version u16 | postcard: game, players, seed, table, deeds
//! ```

use std::{fs, path::Path};

use glam::DVec2;
use serde::{Deserialize, Serialize};

use crate::file_format::{self, FileFormat};
use crate::{Error, FileFault, Result, RuleFault, TableFault};

use super::{Match, MatchConfig, Player};
use crate::physics::{BallState, Engine, Stroke, Table};
use crate::rules::{Call, Choice, RuleSet};

/// All that makes a match what it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MatchSave {
    rules: RuleSet,
    players: Vec<Player>,
    target: u32,
    seed: u32,
    table: String,
    actions: Vec<MatchAction>,
}

/// Something that a player did and that counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum MatchAction {
    /// A stroke, with the call that was said and the place of a cue ball that was in hand.
    Shot {
        place: Option<DVec2>,
        call: Option<Call>,
        stroke: Stroke,
        engine: String,
    },
    /// Balls laid on a free table: number and place of each.
    Layout(Vec<(u8, DVec2)>),
    /// A choice.
    Choice(Choice),
    /// Giving up.
    Concede,
}

impl MatchSave {
    /// Of a match as it stands.
    pub fn of(game: &Match) -> Self {
        Self {
            rules: game.referee().rules(),
            players: game.players().to_vec(),
            target: game.referee().target(),
            seed: game.seed,
            table: game.world().table().name().to_owned(),
            actions: game.actions.clone(),
        }
    }

    /// Plays it again.
    ///
    /// # Errors
    /// [`Error::Replay`] and others if it is no match: then nothing of it can be used.
    pub fn play(&self) -> Result<Match> {
        let table = Table::named(&self.table).ok_or_else(|| TableFault::Unnamed {
            name: self.table.clone(),
        })?;
        let mut game = Match::new(MatchConfig {
            rules: self.rules,
            players: self.players.clone(),
            target: self.target,
            seed: self.seed,
            table,
            engine: Engine::default(),
        })?;
        for (index, action) in self.actions.iter().enumerate() {
            game.replay_action(action).map_err(|reason| Error::Replay {
                step: index + 1,
                reason: Box::new(reason),
            })?;
        }
        Ok(game)
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// [`Error::MatchBytes`] for a match of more than [`BYTES_MAX`].
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        FORMAT.encode(self).map_err(Error::MatchBytes)
    }

    /// Reads what [`MatchSave::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Error::MatchBytes`]: another kind of file, another version, or damage.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        FORMAT.decode(bytes).map_err(Error::MatchBytes)
    }

    /// Writes a file: whole, or not at all.
    ///
    /// # Errors
    /// [`Error::MatchFile`].
    pub fn save(&self, path: &Path) -> Result<()> {
        let write = || -> Result<(), FileFault> {
            let bytes = FORMAT.encode(self)?;
            if let Some(folder) = path.parent() {
                fs::create_dir_all(folder).map_err(FileFault::Io)?;
            }
            file_format::replace(path, &bytes).map_err(FileFault::Io)
        };
        write().map_err(|fault| Error::MatchFile {
            path: path.to_owned(),
            action: "written",
            fault,
        })
    }

    /// Reads a file; nothing if there is none.
    ///
    /// # Errors
    /// [`Error::MatchFile`], for the reasons of [`MatchSave::from_bytes`].
    pub fn load(path: &Path) -> Result<Option<Self>> {
        if !path.is_file() {
            return Ok(None);
        }
        let read = FORMAT.read(path).and_then(|bytes| FORMAT.decode(&bytes));
        read.map(Some).map_err(|fault| Error::MatchFile {
            path: path.to_owned(),
            action: "read",
            fault,
        })
    }
}

impl Match {
    /// Does what was done before.
    fn replay_action(&mut self, action: &MatchAction) -> Result<()> {
        match action {
            MatchAction::Shot {
                place,
                call,
                stroke,
                engine,
            } => {
                if self.at_table().is_none() {
                    return Err(RuleFault::MatchOver.into());
                }
                self.set_engine(engine.parse()?);
                if place.is_some() && *place != self.cue_ball_in_hand() {
                    place.map_or(Ok(()), |at| self.place(at))?;
                }
                self.call(*call);
                let shot = self.strike(*stroke)?;
                self.finish(*stroke, &shot);
            }
            MatchAction::Layout(places) => {
                let table = self.world().table();
                let lying = places.iter().map(|&(number, at)| {
                    let body = if number == 0 {
                        table.cue_ball()
                    } else {
                        table.ball()
                    };
                    BallState::at_rest(number, at.x, at.y, &body)
                });
                let balls: Vec<_> = lying.collect();
                self.arrange(&balls, None)?;
            }
            MatchAction::Choice(choice) => self.choose(*choice)?,
            MatchAction::Concede => self.concede(),
        }
        Ok(())
    }
}

const FORMAT: FileFormat = FileFormat {
    kind: "match",
    magic: b"carom match\n",
    version: 1,
    bytes_max: BYTES_MAX,
};
/// A shot takes about 60 bytes: more shots than anyone plays in a match.
const BYTES_MAX: u64 = 4 << 20;

#[cfg(test)]
mod tests {
    use super::*;

    fn played() -> Match {
        let players = Player::list("Ada,ai:hard").unwrap();
        let mut game = Match::new(MatchConfig::new(RuleSet::Eight, players, 7).unwrap()).unwrap();
        for (angle, speed) in [(0.0, 8.0), (0.7, 3.0), (2.0, 4.0), (-1.0, 2.0)] {
            if game.ball_in_hand_area().is_some() {
                let at = game.table_layout().head_spot() + DVec2::new(-0.1, 0.02);
                // Where it may not lie it stays.
                let _ = game.place(at);
            }
            let stroke = Stroke::straight(angle, speed);
            let shot = game.strike(stroke).unwrap();
            game.finish(stroke, &shot);
            if let Some(&choice) = game.referee().options().first() {
                game.choose(choice).unwrap();
            }
        }
        game
    }

    #[test]
    fn a_match_goes_on_where_it_was_left() {
        let game = played();
        let bytes = MatchSave::of(&game).to_bytes().unwrap();
        let again = MatchSave::from_bytes(&bytes).unwrap().play().unwrap();
        assert_eq!(again.world().balls(), game.world().balls());
        assert_eq!(again.referee(), game.referee());
        assert_eq!(again.view(), game.view());
    }

    #[test]
    fn what_was_taken_back_was_not_done() {
        let mut game = played();
        let last = game.turns().len();
        game.undo();
        game.undo();
        let again = MatchSave::of(&game).play().unwrap();
        assert_eq!(again.turns().len(), last - 2);
        assert_eq!(again.view(), game.view());
    }

    #[test]
    fn damaged_files_are_refused_and_none_is_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/match.carom");
        assert_eq!(MatchSave::load(&path).unwrap(), None);
        let record = MatchSave::of(&played());
        record.save(&path).unwrap();
        assert_eq!(MatchSave::load(&path).unwrap(), Some(record.clone()));
        let bytes = record.to_bytes().unwrap();
        for end in 0..bytes.len() {
            assert!(MatchSave::from_bytes(&bytes[..end]).is_err(), "{end}");
        }
        fs::write(&path, b"something else").unwrap();
        let why = MatchSave::load(&path).unwrap_err().to_string();
        assert!(
            why.contains("match.carom") && why.contains("does not begin"),
            "{why}"
        );
    }
}
