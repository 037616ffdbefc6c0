//! Reads reference shots (schema `phys-ref-1`: trajectories from pooltool-billiards 0.6.0) and
//! plays them with this simulation.
//!
//! The references put x across the table and y along it, with the origin in a corner; everything
//! is turned into the simulation's frame here, and `a` is to the left there.

use std::{fs, path::Path};

use carom::sim::{
    BallBallLaw, BallBody, BallState, Circle, Cloth, Cue, CushionLaw, Laws, Phase, Shot, Stroke,
    Table, TableParts, World,
};
use glam::{DQuat, DVec2, DVec3};
use serde_json::Value;

/// One reference shot.
pub(crate) struct Reference {
    pub(crate) name: String,
    world: World,
    stroke: Option<Stroke>,
    times: Vec<f64>,
    balls: Vec<Samples>,
}

struct Samples {
    number: u8,
    positions: Vec<DVec3>,
    pocketed: Vec<bool>,
}

/// How far a shot is from its reference.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Deviation {
    pub(crate) max_m: f64,
    pub(crate) rms_m: f64,
    /// Balls that end on the table in one and in a pocket in the other.
    pub(crate) pocketed_differently: usize,
    /// First sampled time at which a ball is over 1 mm off.
    pub(crate) parts_at_secs: Option<f64>,
}

impl Reference {
    pub(crate) fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let json: Value = serde_json::from_str(&text).expect("a reference is JSON");
        Self::parse(&json)
    }

    fn parse(json: &Value) -> Self {
        let frame = Frame::of(&json["table"]["specs"]);
        let laws = laws(json);
        let initial = json["initial"].as_object().expect("initial");
        let states = initial
            .iter()
            .map(|(id, ball)| state(&frame, number(id), ball));
        let world = World::with_laws(table(&frame, &json["table"]), laws, states.collect());
        let samples = json["samples"]["balls"].as_object().expect("samples");
        Self {
            name: json["name"].as_str().expect("name").to_owned(),
            world: world.expect("a reference's world is valid"),
            stroke: stroke(&json["cue"]),
            times: numbers(&json["samples"]["t"]),
            balls: samples
                .iter()
                .map(|(id, ball)| Samples::parse(&frame, id, ball))
                .collect(),
        }
    }

    pub(crate) fn play(&self) -> Shot {
        let shot = match self.stroke {
            Some(stroke) => self.world.strike(stroke),
            None => self.world.release(),
        };
        shot.unwrap_or_else(|e| panic!("{}: {e}", self.name))
    }

    pub(crate) fn deviation(&self, shot: &Shot) -> Deviation {
        let mut deviation = Deviation::default();
        let (mut sum, mut count) = (0.0, 0.0f64);
        for (sample, &t) in self.times.iter().enumerate() {
            let poses = shot.poses_at(t);
            for ball in &self.balls {
                let pose = poses
                    .iter()
                    .find(|pose| pose.number == ball.number)
                    .expect("ball");
                if ball.pocketed[sample] || !pose.on_table {
                    continue;
                }
                let off = pose.position.distance(ball.positions[sample]);
                deviation.max_m = deviation.max_m.max(off);
                sum += off * off;
                count += 1.0;
                if off > 1e-3 && deviation.parts_at_secs.is_none() {
                    deviation.parts_at_secs = Some(t);
                }
            }
        }
        let ends = shot.final_states();
        let differs = |ball: &&Samples| {
            let end = ends
                .iter()
                .find(|end| end.number == ball.number)
                .expect("ball");
            end.phase.is_on_table() == *ball.pocketed.last().expect("samples")
        };
        deviation.pocketed_differently = self.balls.iter().filter(differs).count();
        deviation.rms_m = (sum / count.max(1.0)).sqrt();
        deviation
    }
}

impl Samples {
    fn parse(frame: &Frame, id: &str, json: &Value) -> Self {
        let positions = json["pos"].as_array().expect("pos");
        Self {
            number: number(id),
            positions: positions.iter().map(|p| frame.place(vector(p))).collect(),
            pocketed: numbers(&json["state"])
                .iter()
                .map(|&state| state == 4.0)
                .collect(),
        }
    }
}

/// From the references' frame to the simulation's: a quarter turn and a shift to the middle.
struct Frame {
    length: f64,
    width: f64,
}

impl Frame {
    fn of(specs: &Value) -> Self {
        Self {
            length: float(&specs["l"]),
            width: float(&specs["w"]),
        }
    }

    fn turn(v: DVec3) -> DVec3 {
        DVec3::new(v.y, -v.x, v.z)
    }

    fn place(&self, p: DVec3) -> DVec3 {
        Self::turn(p - DVec3::new(0.5 * self.width, 0.5 * self.length, 0.0))
    }
}

fn laws(json: &Value) -> Laws {
    let ball = &json["ball_params"];
    let specs = &json["cue"]["specs"];
    let ideal = json["physics"]["models"]["ball_ball"] == "frictionless_elastic";
    Laws {
        body: BallBody {
            mass_kg: float(&ball["m"]),
            radius_m: float(&ball["R"]),
        },
        cue: Cue {
            mass_kg: float(&specs["M"]),
            end_mass_kg: float(&specs["end_mass"]),
        },
        cloth: Cloth {
            sliding_friction: float(&ball["u_s"]),
            rolling_friction: float(&ball["u_r"]),
            spin_friction_m: float(&ball["u_sp_proportionality"]) * float(&ball["R"]).powi(2),
            gravity_m_s2: float(&ball["g"]),
        },
        ball_ball: if ideal {
            BallBallLaw::IDEAL
        } else {
            friction_of_references(ball)
        },
        cushion: CushionLaw {
            restitution: float(&ball["e_c"]),
            friction: float(&ball["f_c"]),
            frequency_ratio: float(
                &json["physics"]["params"]["ball_linear_cushion"]["omega_ratio"],
            ),
        },
    }
}

/// The references limit friction by the impulse e·m·v/2·2 = e·m·v of restitution alone, Coulomb's
/// law by the whole impulse (1 + e)·m·v/2: their friction is ours times 2e/(1 + e).
fn friction_of_references(ball: &Value) -> BallBallLaw {
    let restitution = float(&ball["e_b"]);
    let scale = 2.0 * restitution / (1.0 + restitution);
    let law = BallBallLaw::default();
    BallBallLaw {
        restitution,
        friction_fast: scale * law.friction_fast,
        friction_slow_extra: scale * law.friction_slow_extra,
        ..law
    }
}

fn table(frame: &Frame, json: &Value) -> Table {
    let circles = |key: &str| {
        let list = json[key].as_array().expect("circles").iter();
        list.map(|circle| Circle {
            center: frame.place(vector(&circle["center"])).truncate(),
            radius_m: float(&circle["radius"]),
        })
        .collect()
    };
    let noses = json["linear_cushions"].as_array().expect("noses").iter();
    let parts = TableParts {
        name: "reference".to_owned(),
        length_m: frame.length,
        width_m: frame.width,
        nose_height_m: float(&json["specs"]["cushion_height"]),
        noses: noses.flat_map(|nose| nose_ends(frame, nose)).collect(),
        jaws: circles("circular_cushions"),
        pockets: circles("pockets"),
    };
    Table::from_parts(parts).expect("a reference's table is valid")
}

/// The ends of a nose with the balls on the left; the side that collides is told by a flag on the
/// line's normal with positive y, or positive x for a line along y.
fn nose_ends(frame: &Frame, json: &Value) -> Vec<[DVec2; 2]> {
    let (p1, p2) = (vector(&json["p1"]), vector(&json["p2"]));
    let along = p2 - p1;
    let positive = if along.x == 0.0 {
        DVec3::X
    } else {
        DVec3::new(-along.y / along.x, 1.0, 0.0)
    };
    let ends = [p1, p2].map(|p| frame.place(p).truncate());
    let left = (ends[1] - ends[0]).perp();
    let front = Frame::turn(positive).truncate();
    let facing = |side: f64| {
        if side * left.dot(front) > 0.0 {
            ends
        } else {
            [ends[1], ends[0]]
        }
    };
    match json["direction"].as_u64() {
        Some(0) => vec![facing(-1.0)],
        Some(1) => vec![facing(1.0)],
        _ => vec![facing(1.0), facing(-1.0)],
    }
}

fn state(frame: &Frame, number: u8, json: &Value) -> BallState {
    BallState {
        number,
        position: frame.place(vector(&json["pos"])),
        velocity: Frame::turn(vector(&json["vel"])),
        spin: Frame::turn(vector(&json["spin"])),
        orientation: DQuat::IDENTITY,
        phase: Phase::Resting,
    }
}

fn stroke(json: &Value) -> Option<Stroke> {
    let speed_m_s = float(&json["V0"]);
    (speed_m_s > 0.0).then(|| Stroke {
        direction_rad: (float(&json["phi"]) - 90.0).to_radians(),
        speed_m_s,
        side: -float(&json["a"]),
        vertical: float(&json["b"]),
        elevation_rad: float(&json["theta"]).to_radians(),
    })
}

fn number(id: &str) -> u8 {
    if id == "cue" {
        0
    } else {
        id.parse().expect("a ball's number")
    }
}

fn float(json: &Value) -> f64 {
    json.as_f64().expect("a number")
}

fn numbers(json: &Value) -> Vec<f64> {
    json.as_array()
        .expect("numbers")
        .iter()
        .map(float)
        .collect()
}

fn vector(json: &Value) -> DVec3 {
    let [x, y, z] = numbers(json)[..] else {
        panic!("{json} has not three numbers")
    };
    DVec3::new(x, y, z)
}
