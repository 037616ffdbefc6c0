//! Reference shots in the schema `phys-ref-1`: trajectories that another simulator computed, with the
//! table, the constants and the models that it used, so that this one can simulate the same shot.

use std::{fs, path::Path};

use anyhow::{Context as _, bail, ensure};
use glam::DVec3;

use super::{
    break_outcome::{BreakOutcome, spread_m},
    schema::{EventJson, ReferenceFile, ReferenceFrame},
};
use carom_billiards::physics::{BallState, Engine, Shot, Stroke, World};

/// One reference shot.
#[derive(Clone, Debug)]
pub struct ReferenceShot {
    /// Name of the shot.
    pub name: String,
    /// The part of a simulation of it that can be compared.
    pub kind: ReferenceKind,
    world: World,
    stroke: Option<Stroke>,
    pub(super) times: Vec<f64>,
    pub(super) balls: Vec<BallSamples>,
}

/// The comparable part of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReferenceKind {
    /// Every position at every time.
    Shot,
    /// A rack is broken: chaotic, so that two correct simulations diverge within a second.
    Break,
    /// Balls touch at the start, and some press on each other after the impact, for which the file's
    /// simulator has a rule of its own: only the velocities after they separate are comparable.
    Cluster,
    /// The file's simulator let the ball fly, and had no cushions in the air: comparable until the
    /// first cushion.
    Airborne,
}

/// Reads a file of at most `bytes_max` bytes.
pub(super) fn read_file(path: &Path, bytes_max: u64) -> anyhow::Result<String> {
    let size = fs::metadata(path)?.len();
    ensure!(
        size <= bytes_max,
        "it has {size} bytes: at most {bytes_max} are read"
    );
    Ok(fs::read_to_string(path)?)
}

/// Samples of one ball's trajectory.
#[derive(Clone, Debug)]
pub(super) struct BallSamples {
    pub(super) number: u8,
    pub(super) positions: Vec<DVec3>,
    pub(super) velocities: Vec<DVec3>,
    pub(super) spins: Vec<DVec3>,
    pub(super) pocketed: Vec<bool>,
}

impl ReferenceShot {
    /// Reads a file.
    ///
    /// # Errors
    /// A sentence with the file and what is wrong in it.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let read = read_file(path, FILE_BYTES_MAX).and_then(|json| Self::parse(&json));
        read.with_context(|| format!("the reference {}", path.display()))
    }

    /// Reads every reference of a folder, by name; `index.json` is not one.
    ///
    /// # Errors
    /// A sentence: no folder, no reference in it, or one that cannot be read.
    pub fn read_folder(folder: &Path) -> anyhow::Result<Vec<Self>> {
        let entries = fs::read_dir(folder).with_context(|| {
            format!(
                "the folder of references {} cannot be read",
                folder.display()
            )
        })?;
        let mut paths = Vec::new();
        for entry in entries {
            let path = entry?.path();
            let is_json = path
                .extension()
                .is_some_and(|extension| extension == "json");
            if is_json && path.file_stem().is_some_and(|stem| stem != "index") {
                paths.push(path);
            }
        }
        paths.sort();
        if paths.is_empty() {
            bail!("there is no reference (*.json) in {}", folder.display());
        }
        paths.iter().map(|path| Self::read(path)).collect()
    }

    fn parse(json: &str) -> anyhow::Result<Self> {
        let file: ReferenceFile = serde_json::from_str(json)?;
        ensure!(
            file.schema == SCHEMA,
            "its schema is `{}`, not `{SCHEMA}`",
            file.schema
        );
        let frame = ReferenceFrame::of(&file.table.specs);
        let mut states = file
            .initial
            .iter()
            .map(|(id, ball)| Ok(ball.state(&frame, number(id)?, file.body())))
            .collect::<anyhow::Result<Vec<_>>>()?;
        // Simultaneous contacts are taken by ascending number, as in the game.
        states.sort_by_key(|state| state.number);
        let kind = kind(&file, &states);
        let (times, balls) = samples(&frame, &file, kind)?;
        Ok(Self {
            kind,
            world: World::with_laws(file.table.table(&frame)?, file.laws(), states)?,
            stroke: file.cue.stroke(),
            times,
            balls,
            name: file.name,
        })
    }

    /// Sets the engine that plays the shot from now on.
    pub fn set_engine(&mut self, engine: Engine) {
        self.world.set_engine(engine);
    }

    /// Simulates the shot.
    ///
    /// # Errors
    /// A sentence with the shot's name, if the simulation refuses it.
    pub fn play(&self) -> anyhow::Result<Shot> {
        let shot = match self.stroke {
            Some(stroke) => self.world.strike(stroke),
            None => self.world.release(),
        };
        shot.with_context(|| format!("the shot {}", self.name))
    }

    /// Outcome of a break in the file: the energy kept after `after_secs`, and the final positions of
    /// the balls.
    pub(super) fn outcome(&self, after_secs: f64) -> Option<BreakOutcome> {
        let states = self.world.balls();
        let energy_j = |sample: usize| -> Option<f64> {
            let of = |ball: &BallSamples| {
                let body = states
                    .iter()
                    .find(|state| state.number == ball.number)?
                    .body;
                Some(body.kinetic_energy_j(*ball.velocities.get(sample)?, *ball.spins.get(sample)?))
            };
            self.balls.iter().map(of).sum()
        };
        let then = self.times.iter().position(|&t| t >= after_secs - 1e-9)?;
        let lies = |ball: &&BallSamples| ball.pocketed.last() == Some(&false);
        let lying: Vec<_> = self
            .balls
            .iter()
            .filter(lies)
            .filter_map(|b| b.positions.last().copied())
            .collect();
        Some(BreakOutcome {
            energy_kept: energy_j(then)? / energy_j(0)?,
            spread_m: spread_m(&lying),
            pocketed: (self.balls.len() - lying.len()) as f64,
        })
    }

    /// The world before the shot.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The stroke; none if the balls are in motion from the start.
    pub fn stroke(&self) -> Option<Stroke> {
        self.stroke
    }
}

fn kind(file: &ReferenceFile, states: &[BallState]) -> ReferenceKind {
    let gap = |a: &BallState, b: &BallState| {
        a.position.distance(b.position) - 2.0 * file.ball_params.radius_m
    };
    let touches = |i: usize| states[..i].iter().any(|b| gap(&states[i], b) < TOUCH_M);
    if file.physics.models.stick_ball.ends_with("3d") {
        ReferenceKind::Airborne
    } else if states.len() >= RACK_BALLS {
        ReferenceKind::Break
    } else if (0..states.len()).any(touches) {
        ReferenceKind::Cluster
    } else {
        ReferenceKind::Shot
    }
}

fn samples(
    frame: &ReferenceFrame,
    file: &ReferenceFile,
    kind: ReferenceKind,
) -> anyhow::Result<(Vec<f64>, Vec<BallSamples>)> {
    let is_cushion = |event: &&EventJson| event.kind.ends_with("cushion");
    let first_cushion = file.events.iter().find(is_cushion);
    let until = match first_cushion {
        Some(event) if kind == ReferenceKind::Airborne => event.t,
        _ => f64::INFINITY,
    };
    let times = &file.samples.t;
    let count = times.iter().take_while(|&&t| t < until).count();
    ensure!(count > 0, "it has no samples");
    let turned = |vectors: &[DVec3]| {
        vectors
            .iter()
            .take(count)
            .map(|&v| ReferenceFrame::turn(v))
            .collect()
    };
    let ways = file.samples.balls.iter().map(|(id, ball)| {
        let lengths = [
            ball.pos.len(),
            ball.vel.len(),
            ball.spin.len(),
            ball.state.len(),
        ];
        ensure!(
            lengths == [times.len(); 4],
            "ball {id} has {lengths:?} samples at {} times",
            times.len()
        );
        ensure!(
            file.initial.contains_key(id),
            "ball {id} is not in `initial`"
        );
        Ok(BallSamples {
            number: number(id)?,
            positions: ball
                .pos
                .iter()
                .take(count)
                .map(|&p| frame.place(p))
                .collect(),
            velocities: turned(&ball.vel),
            spins: turned(&ball.spin),
            pocketed: ball
                .state
                .iter()
                .take(count)
                .map(|&s| s == POCKETED)
                .collect(),
        })
    });
    Ok((
        times[..count].to_vec(),
        ways.collect::<anyhow::Result<_>>()?,
    ))
}

/// Number of a ball from its name in a file.
fn number(id: &str) -> anyhow::Result<u8> {
    if id == "cue" {
        return Ok(0);
    }
    id.parse()
        .with_context(|| format!("`{id}` is neither `cue` nor the number of a ball"))
}

const SCHEMA: &str = "phys-ref-1";
/// Maximum size of a file: ten times the largest of the known ones.
const FILE_BYTES_MAX: u64 = 4 << 20;
/// `state` of a ball in a pocket.
const POCKETED: u8 = 4;
/// Minimum number of balls of a break: a nine-ball rack and a cue ball; no other shot has as many.
const RACK_BALLS: usize = 10;
/// Gap in m below which balls touch: half of the gap to which the references' simulator moves balls
/// after a contact.
const TOUCH_M: f64 = 5e-7;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_wrong_with_a_file_is_said() {
        for (text, words) in [
            ("", "EOF"),
            ("[]", "invalid"),
            (r#"{"schema":"phys-ref-1"}"#, "missing field `name`"),
        ] {
            let error = format!("{:#}", ReferenceShot::parse(text).unwrap_err());
            assert!(error.contains(words), "{error}");
        }
        let folder = ReferenceShot::read_folder(Path::new("no/such/folder")).unwrap_err();
        assert!(format!("{folder:#}").contains("no/such/folder"));
    }
}
