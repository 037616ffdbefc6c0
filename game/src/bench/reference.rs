//! Reference shots in the schema `phys-ref-1`: trajectories that another simulator computed, with
//! the table, the constants and the models that it used, so that this one can play the same shot.
//!
//! The files put x across the table and y along it, with the origin in a corner; everything is
//! turned into the simulation's frame here. A cue's `a` is to the left there.

use std::{collections::BTreeMap, fs, path::Path};

use anyhow::{Context as _, bail, ensure};
use glam::{DQuat, DVec2, DVec3};
use serde::Deserialize;

use super::deviation::Deviation;
use crate::sim::{
    BallBallLaw, BallBody, BallState, BounceLaw, Circle, Cloth, Cue, CushionLaw, Engine, Laws,
    Phase, Shot, Stroke, Stronge, Table, TableParts, World,
};

/// One reference shot.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Of the shot.
    pub name: String,
    /// What can be asked of a simulation of it.
    pub kind: Kind,
    world: World,
    stroke: Option<Stroke>,
    pub(super) times: Vec<f64>,
    pub(super) balls: Vec<Samples>,
}

/// What a trajectory can be held to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Every position at every time.
    Shot,
    /// A rack is broken: chaotic, so that two right simulations part within a second.
    Break,
    /// Balls touch at the start: which of them takes how much of the blow is a matter of the rule
    /// for clusters, so that only the velocities after it can be compared.
    Cluster,
    /// The file's simulator let the ball fly, and had no cushions in the air: comparable until the
    /// first cushion.
    Airborne,
}

/// The way of one ball.
#[derive(Clone, Debug)]
pub(super) struct Samples {
    pub(super) number: u8,
    pub(super) positions: Vec<DVec3>,
    pub(super) velocities: Vec<DVec3>,
    pub(super) pocketed: Vec<bool>,
}

impl Reference {
    /// Reads a file.
    ///
    /// # Errors
    /// A sentence with the file and what is wrong in it.
    pub fn read(path: &Path) -> anyhow::Result<Self> {
        let read = || -> anyhow::Result<Self> {
            let size = fs::metadata(path)?.len();
            ensure!(
                size <= FILE_BYTES_MAX,
                "it has {size} bytes: at most {FILE_BYTES_MAX} are read"
            );
            Self::parse(&fs::read_to_string(path)?)
        };
        read().with_context(|| format!("the reference {}", path.display()))
    }

    /// Reads every reference of a folder, by name; `index.json` is none.
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
        let file: File = serde_json::from_str(json)?;
        ensure!(
            file.schema == SCHEMA,
            "its schema is `{}`, not `{SCHEMA}`",
            file.schema
        );
        let frame = Frame::of(&file.table.specs);
        let states = file
            .initial
            .iter()
            .map(|(id, ball)| Ok(ball.state(&frame, number(id)?, file.body())))
            .collect::<anyhow::Result<Vec<_>>>()?;
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

    /// Plays the shot with another engine from now on.
    pub fn set_engine(&mut self, engine: Engine) {
        self.world.set_engine(engine);
    }

    /// Plays the shot.
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

    /// How far a simulation of the shot is from it.
    pub fn deviation(&self, shot: &Shot) -> Deviation {
        Deviation::between(self, shot)
    }

    /// The world before the shot.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The stroke, unless the balls move by themselves.
    pub fn stroke(&self) -> Option<Stroke> {
        self.stroke
    }
}

fn kind(file: &File, states: &[BallState]) -> Kind {
    let gap = |a: &BallState, b: &BallState| {
        a.position.distance(b.position) - 2.0 * file.ball_params.radius_m
    };
    let touches = |i: usize| states[..i].iter().any(|b| gap(&states[i], b) < TOUCH_M);
    if file.physics.models.stick_ball.ends_with("3d") {
        Kind::Airborne
    } else if states.len() >= RACK_BALLS {
        Kind::Break
    } else if (0..states.len()).any(touches) {
        Kind::Cluster
    } else {
        Kind::Shot
    }
}

fn samples(frame: &Frame, file: &File, kind: Kind) -> anyhow::Result<(Vec<f64>, Vec<Samples>)> {
    let is_cushion = |event: &&EventJson| event.kind.ends_with("cushion");
    let first_cushion = file.events.iter().find(is_cushion);
    let until = match first_cushion {
        Some(event) if kind == Kind::Airborne => event.t,
        _ => f64::INFINITY,
    };
    let times = &file.samples.t;
    let count = times.iter().take_while(|&&t| t < until).count();
    ensure!(count > 0, "it has no samples");
    let ways = file.samples.balls.iter().map(|(id, ball)| {
        let lengths = [ball.pos.len(), ball.vel.len(), ball.state.len()];
        ensure!(
            lengths == [times.len(); 3],
            "ball {id} has {lengths:?} samples at {} times",
            times.len()
        );
        ensure!(
            file.initial.contains_key(id),
            "ball {id} is not in `initial`"
        );
        Ok(Samples {
            number: number(id)?,
            positions: ball
                .pos
                .iter()
                .take(count)
                .map(|&p| frame.place(p))
                .collect(),
            velocities: ball
                .vel
                .iter()
                .take(count)
                .map(|&v| Frame::turn(v))
                .collect(),
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

/// From the references' frame to the simulation's: a quarter turn and a shift to the middle.
struct Frame {
    middle: DVec3,
}

impl Frame {
    fn of(specs: &Specs) -> Self {
        Self {
            middle: DVec3::new(0.5 * specs.width_m, 0.5 * specs.length_m, 0.0),
        }
    }

    fn turn(v: DVec3) -> DVec3 {
        DVec3::new(v.y, -v.x, v.z)
    }

    fn place(&self, p: DVec3) -> DVec3 {
        Self::turn(p - self.middle)
    }
}

/// A number of a ball, as its name in a file.
fn number(id: &str) -> anyhow::Result<u8> {
    if id == "cue" {
        return Ok(0);
    }
    id.parse()
        .with_context(|| format!("`{id}` is neither `cue` nor the number of a ball"))
}

#[derive(Deserialize)]
struct File {
    schema: String,
    name: String,
    table: TableJson,
    ball_params: BallParams,
    physics: Physics,
    cue: CueJson,
    initial: BTreeMap<String, StateJson>,
    events: Vec<EventJson>,
    samples: SamplesJson,
}

#[derive(Deserialize)]
struct TableJson {
    specs: Specs,
    linear_cushions: Vec<NoseJson>,
    circular_cushions: Vec<CircleJson>,
    pockets: Vec<CircleJson>,
}

#[derive(Deserialize)]
struct Specs {
    #[serde(rename = "l")]
    length_m: f64,
    #[serde(rename = "w")]
    width_m: f64,
    cushion_height: f64,
}

#[derive(Deserialize)]
struct NoseJson {
    p1: DVec3,
    p2: DVec3,
    direction: u8,
}

#[derive(Deserialize)]
struct CircleJson {
    center: DVec3,
    radius: f64,
}

#[derive(Deserialize)]
struct BallParams {
    m: f64,
    #[serde(rename = "R")]
    radius_m: f64,
    u_s: f64,
    u_r: f64,
    u_sp_proportionality: f64,
    e_b: f64,
    e_c: f64,
    f_c: f64,
    g: f64,
}

#[derive(Deserialize)]
struct Physics {
    models: Models,
    params: Params,
}

#[derive(Deserialize)]
struct Models {
    ball_ball: String,
    stick_ball: String,
}

#[derive(Deserialize)]
struct Params {
    ball_linear_cushion: CushionParams,
}

#[derive(Deserialize)]
struct CushionParams {
    omega_ratio: f64,
}

#[derive(Deserialize)]
struct CueJson {
    #[serde(rename = "V0")]
    speed_m_s: f64,
    phi: f64,
    theta: f64,
    a: f64,
    b: f64,
    specs: CueSpecs,
}

#[derive(Deserialize)]
struct CueSpecs {
    #[serde(rename = "M")]
    mass_kg: f64,
    end_mass: f64,
}

#[derive(Deserialize)]
struct StateJson {
    pos: DVec3,
    vel: DVec3,
    spin: DVec3,
}

#[derive(Deserialize)]
struct EventJson {
    t: f64,
    #[serde(rename = "type")]
    kind: String,
}

#[derive(Deserialize)]
struct SamplesJson {
    t: Vec<f64>,
    balls: BTreeMap<String, WayJson>,
}

#[derive(Deserialize)]
struct WayJson {
    state: Vec<u8>,
    pos: Vec<DVec3>,
    vel: Vec<DVec3>,
}

impl File {
    fn body(&self) -> BallBody {
        BallBody {
            mass_kg: self.ball_params.m,
            radius_m: self.ball_params.radius_m,
        }
    }

    fn laws(&self) -> Laws {
        let ball = &self.ball_params;
        Laws {
            cue: Cue {
                mass_kg: self.cue.specs.mass_kg,
                end_mass_kg: self.cue.specs.end_mass,
                // Their tip never slips.
                tip_friction: 10.0,
            },
            cloth: Cloth {
                sliding_friction: ball.u_s,
                rolling_friction: ball.u_r,
                spin_friction_m: ball.u_sp_proportionality * ball.radius_m.powi(2),
                gravity_m_s2: ball.g,
            },
            ball_ball: match self.physics.models.ball_ball.as_str() {
                "frictionless_elastic" => BallBallLaw::IDEAL,
                _ => friction_of_references(ball.e_b),
            },
            cushion: CushionLaw::Stronge(Stronge {
                restitution: ball.e_c,
                friction: ball.f_c,
                frequency_ratio: self.physics.params.ball_linear_cushion.omega_ratio,
            }),
            slate: if self.physics.models.stick_ball.ends_with("_3d") {
                BounceLaw::SLATE
            } else {
                BounceLaw::FLAT
            },
            pocket: BounceLaw::POCKET,
        }
    }
}

/// The references limit friction by the impulse e·m·v/2·2 = e·m·v of restitution alone, Coulomb's
/// law by the whole impulse (1 + e)·m·v/2: their friction is ours times 2e/(1 + e).
fn friction_of_references(restitution: f64) -> BallBallLaw {
    let scale = 2.0 * restitution / (1.0 + restitution);
    let law = BallBallLaw::default();
    BallBallLaw {
        restitution,
        friction_fast: scale * law.friction_fast,
        friction_slow_extra: scale * law.friction_slow_extra,
        ..law
    }
}

impl TableJson {
    fn table(&self, frame: &Frame) -> anyhow::Result<Table> {
        let circles = |list: &[CircleJson]| {
            let circle = |circle: &CircleJson| Circle {
                center: frame.place(circle.center).truncate(),
                radius_m: circle.radius,
            };
            list.iter().map(circle).collect()
        };
        let parts = TableParts {
            name: "reference".to_owned(),
            length_m: self.specs.length_m,
            width_m: self.specs.width_m,
            nose_height_m: self.specs.cushion_height,
            noses: self
                .linear_cushions
                .iter()
                .flat_map(|nose| nose.ends(frame))
                .collect(),
            jaws: circles(&self.circular_cushions),
            pockets: circles(&self.pockets),
        };
        Ok(Table::from_parts(parts)?)
    }
}

impl NoseJson {
    /// The ends with the balls on the left; the side that collides is told by a flag on the line's
    /// normal with positive y, or positive x for a line along y.
    fn ends(&self, frame: &Frame) -> Vec<[DVec2; 2]> {
        let along = self.p2 - self.p1;
        let positive = if along.x == 0.0 {
            DVec3::X
        } else {
            DVec3::new(-along.y / along.x, 1.0, 0.0)
        };
        let ends = [self.p1, self.p2].map(|p| frame.place(p).truncate());
        let left = (ends[1] - ends[0]).perp();
        let front = Frame::turn(positive).truncate();
        let facing = |side: f64| {
            if side * left.dot(front) > 0.0 {
                ends
            } else {
                [ends[1], ends[0]]
            }
        };
        match self.direction {
            0 => vec![facing(-1.0)],
            1 => vec![facing(1.0)],
            _ => vec![facing(1.0), facing(-1.0)],
        }
    }
}

impl StateJson {
    fn state(&self, frame: &Frame, number: u8, body: BallBody) -> BallState {
        BallState {
            number,
            body,
            position: frame.place(self.pos),
            velocity: Frame::turn(self.vel),
            spin: Frame::turn(self.spin),
            orientation: DQuat::IDENTITY,
            phase: Phase::Resting,
        }
    }
}

impl CueJson {
    fn stroke(&self) -> Option<Stroke> {
        (self.speed_m_s > 0.0).then(|| Stroke {
            direction_rad: (self.phi - 90.0).to_radians(),
            speed_m_s: self.speed_m_s,
            side: -self.a,
            vertical: self.b,
            elevation_rad: self.theta.to_radians(),
        })
    }
}

const SCHEMA: &str = "phys-ref-1";
/// Ten times the largest of the known files.
const FILE_BYTES_MAX: u64 = 4 << 20;
/// `state` of a ball in a pocket.
const POCKETED: u8 = 4;
/// A nine-ball rack and a cue ball; no template has as many.
const RACK_BALLS: usize = 10;
/// Half of the gap to which the references' simulator moves balls after a contact.
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
            let error = format!("{:#}", Reference::parse(text).unwrap_err());
            assert!(error.contains(words), "{error}");
        }
        let folder = Reference::read_folder(Path::new("no/such/folder")).unwrap_err();
        assert!(format!("{folder:#}").contains("no/such/folder"));
    }
}
