//! Saved matches: a file stores the configuration and the actions of a match. It is replayed to its
//! state shot by shot, by the physics that gives the same bits on every machine.
//!
//! ```text
//! "carom match" 0x0A | version u16 | postcard: game, players, target, seed, table, actions
//! ```
//! A shot through particles is not replayed, which would take seconds: the final places of the balls
//! are stored. While particles lie on the table the version is 2, and the state of the table follows
//! the actions.

use std::{fs, path::Path, sync::Arc};

use glam::{DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};

use crate::file_format::{self, FileFormat};
use crate::{Error, FileFault, LayoutFault, Result, RuleFault, TableFault};

use super::{Match, MatchConfig, Player};
use crate::physics::{BedSave, Engine, Phase, Stroke, Table, World};
use crate::rules::{Call, Choice, RuleSet};

/// All that determines a match.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MatchSave {
    rules: RuleSet,
    players: Vec<Player>,
    target: u32,
    seed: u32,
    table: String,
    actions: Vec<MatchAction>,
    /// State of a table with particles after the last action.
    #[serde(skip)]
    particles: Option<ParticleTable>,
}

/// Balls and particles of a table between two shots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct ParticleTable {
    balls: Vec<BallAmongParticles>,
    bed: BedSave,
}

/// A ball that lies on the table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct BallAmongParticles {
    number: u8,
    position: DVec3,
    orientation: DQuat,
}

/// An action of a player that changes the match.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) enum MatchAction {
    /// A stroke, with the call and the place of a cue ball that was in hand.
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
    /// Concession of the match.
    Concede,
}

impl MatchSave {
    /// Save of a match in its current state.
    pub fn of(game: &Match) -> Self {
        Self {
            rules: game.referee().rules(),
            players: game.players().to_vec(),
            target: game.referee().target(),
            seed: game.seed,
            table: game.world().table().name().to_owned(),
            actions: game.actions.clone(),
            particles: ParticleTable::of(game.world()),
        }
    }

    /// Replays the match.
    ///
    /// # Errors
    /// [`Error::Replay`] and others if it is not a valid match: then no part of it can be used.
    pub fn play(&self) -> Result<Match> {
        let table =
            Table::named(&self.table).ok_or_else(|| TableFault::Unnamed(self.table.clone()))?;
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
        if let Some(particles) = &self.particles {
            let laid = particles.lay(&mut game.now.world);
            laid.map_err(|reason| Error::Replay {
                step: self.actions.len() + 1,
                reason: Box::new(reason),
            })?;
        }
        Ok(game)
    }

    /// The bytes of a file.
    ///
    /// # Errors
    /// [`Error::MatchBytes`] for a match of more than [`BYTES_MAX`], or [`PARTICLES_BYTES_MAX`] with particles.
    pub fn to_bytes(&self) -> Result<Vec<u8>> {
        self.encode().map_err(Error::MatchBytes)
    }

    fn encode(&self) -> Result<Vec<u8>, FileFault> {
        match &self.particles {
            None => FORMAT.encode(self),
            Some(particles) => PARTICLES_FORMAT.encode(&(self, particles)),
        }
    }

    fn decode(bytes: &[u8]) -> Result<Self, FileFault> {
        if !PARTICLES_FORMAT.is_of(bytes) {
            return FORMAT.decode(bytes);
        }
        let (save, particles): (Self, ParticleTable) = PARTICLES_FORMAT.decode(bytes)?;
        Ok(Self {
            particles: Some(particles),
            ..save
        })
    }

    /// Reads what [`MatchSave::to_bytes`] wrote.
    ///
    /// # Errors
    /// [`Error::MatchBytes`]: another kind of file, another version, or damage.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self> {
        Self::decode(bytes).map_err(Error::MatchBytes)
    }

    /// Writes a file atomically.
    ///
    /// # Errors
    /// [`Error::MatchFile`].
    pub fn save(&self, path: &Path) -> Result<()> {
        let write = || -> Result<(), FileFault> {
            let bytes = self.encode()?;
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

    /// Reads a file; none if it does not exist.
    ///
    /// # Errors
    /// [`Error::MatchFile`], for the reasons of [`MatchSave::from_bytes`].
    pub fn load(path: &Path) -> Result<Option<Self>> {
        if !path.is_file() {
            return Ok(None);
        }
        // Read with the larger of the two size limits: the bytes tell which format it is.
        let read = PARTICLES_FORMAT.read(path);
        let read = read.and_then(|bytes| Self::decode(&bytes));
        read.map(Some).map_err(|fault| Error::MatchFile {
            path: path.to_owned(),
            action: "read",
            fault,
        })
    }
}

impl ParticleTable {
    /// State of a table that has particles.
    fn of(world: &World) -> Option<Self> {
        let bed = BedSave::of(world.particles()?);
        let balls = world.balls().into_iter();
        let balls = balls.filter(|ball| ball.phase.is_on_table());
        let balls = balls.map(|ball| BallAmongParticles {
            number: ball.number,
            position: ball.position,
            orientation: ball.orientation,
        });
        Some(Self {
            balls: balls.collect(),
            bed,
        })
    }

    /// Restores them on a table with the same balls.
    fn lay(&self, world: &mut World) -> Result<()> {
        let mut balls = world.balls();
        for ball in &mut balls {
            let saved = self.balls.iter().find(|saved| saved.number == ball.number);
            let saved = saved.ok_or(LayoutFault::NoSuchBall(ball.number))?;
            let is_turned = saved.orientation.is_normalized();
            (ball.position, ball.orientation) = (saved.position, saved.orientation);
            if ball.position.z > ball.body.radius_m {
                // On particles.
                ball.phase = Phase::Airborne;
            }
            if !is_turned {
                return Err(LayoutFault::NotFinite(ball.number).into());
            }
        }
        let bed = self.bed.restore(world.table())?;
        let mut laid = world.with_balls(balls)?;
        laid.set_particles(Some(Arc::new(bed)));
        *world = laid;
        Ok(())
    }
}

impl Match {
    /// Repeats an action.
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
                let lying = places.iter();
                let lying = lying.map(|&(number, at)| table.resting_ball(number, at));
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
/// Format of a match on a table with particles: the state of the table follows.
const PARTICLES_FORMAT: FileFormat = FileFormat {
    version: 2,
    bytes_max: PARTICLES_BYTES_MAX,
    ..FORMAT
};
/// Maximum size with particles: 32,000 of 110 bytes, with a margin.
const PARTICLES_BYTES_MAX: u64 = 8 << 20;
/// Maximum size without particles: at about 60 bytes a shot, more shots than anyone plays in a match.
const BYTES_MAX: u64 = 4 << 20;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::{ParticleBed, ParticleMaterial, ParticlePatch, ParticlePrecision};

    fn played() -> Match {
        let players = Player::list("Ada,ai:hard").unwrap();
        let mut game = Match::new(MatchConfig::new(RuleSet::Eight, players, 7).unwrap()).unwrap();
        for (angle, speed) in [(0.0, 8.0), (0.7, 3.0), (2.0, 4.0), (-1.0, 2.0)] {
            if game.ball_in_hand_area().is_some() {
                let at = game.table_layout().head_spot() + DVec2::new(-0.1, 0.02);
                // Stays where it is if the place is not allowed.
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

    /// A ball before a strip of sand on a free table.
    fn before(materials: [ParticleMaterial; 2]) -> Match {
        let players = Player::list("1").unwrap();
        let mut game = Match::new(MatchConfig::new(RuleSet::Free, players, 7).unwrap()).unwrap();
        let table = game.world().table().clone();
        let balls = [
            table.resting_ball(0, DVec2::new(-0.15, 0.0)),
            table.resting_ball(1, DVec2::new(0.04, 0.01)),
        ];
        let squares = (0..3).flat_map(|column| (-2..2).map(move |row| (column, row)));
        let patch = |(column, row)| ParticlePatch {
            material: materials[usize::from(row == 0)],
            column,
            row,
        };
        let patches: Vec<_> = squares.map(patch).collect();
        let precision = ParticlePrecision::Coarse;
        let bed = ParticleBed::new(&table, &balls, &patches, precision).unwrap();
        game.arrange(&balls, Some(Arc::new(bed))).unwrap();
        game
    }

    fn strike(game: &mut Match, stroke: Stroke) -> crate::physics::Shot {
        let shot = game.strike(stroke).unwrap();
        game.finish(stroke, &shot);
        shot
    }

    #[test]
    fn a_match_among_particles_goes_on_with_the_same_bits() {
        goes_on_with_the_same_bits(before([ParticleMaterial::Sand, ParticleMaterial::Snow]));
        goes_on_with_the_same_bits(before([ParticleMaterial::Marbles; 2]));
    }

    fn goes_on_with_the_same_bits(mut game: Match) {
        for speed in [1.2, 0.8, 1.5] {
            let save = MatchSave::of(&game);
            let bytes = save.to_bytes().unwrap();
            assert_eq!(bytes[b"carom match\n".len()], 2);
            let read = MatchSave::from_bytes(&bytes).unwrap();
            assert!(read == save);
            let mut again = read.play().unwrap();
            let lying = |game: &Match| game.world().particles().unwrap().centers();
            assert!(lying(&again) == lying(&game));
            assert_eq!(again.world().balls(), game.world().balls());
            let stroke = Stroke::straight(0.1, speed);
            let (one, other) = (strike(&mut game, stroke), strike(&mut again, stroke));
            assert!(one.particles() == other.particles());
            assert_eq!(one.final_states(), other.final_states());
            assert!(MatchSave::of(&again).particles == MatchSave::of(&game).particles);
        }
        game.undo();
        let back = MatchSave::of(&game).play().unwrap();
        assert_eq!(back.world().balls(), game.world().balls());
        let balls = game.world().balls();
        game.arrange(&balls, None).unwrap();
        let bytes = MatchSave::of(&game).to_bytes().unwrap();
        assert_eq!(bytes[b"carom match\n".len()], 1, "as ever without them");
    }

    #[test]
    fn damaged_particles_are_refused_or_harmless() {
        let bytes = MatchSave::of(&before([ParticleMaterial::Sand, ParticleMaterial::Snow]))
            .to_bytes()
            .unwrap();
        let mut refused = 0;
        for at in (13..bytes.len()).step_by(37) {
            assert!(MatchSave::from_bytes(&bytes[..at]).is_err());
            for bit in [0x55, 0x80] {
                let mut broken = bytes.clone();
                broken[at] ^= bit;
                let played = MatchSave::from_bytes(&broken).and_then(|save| save.play());
                match played {
                    Ok(game) => assert!(game.world().particles().is_none_or(|bed| {
                        bed.centers().iter().all(|center| center.is_finite())
                    })),
                    Err(why) => {
                        assert!(why.to_string().split(' ').count() > 4, "{why}");
                        refused += 1;
                    }
                }
            }
        }
        assert!(refused > 20, "{refused}");
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
