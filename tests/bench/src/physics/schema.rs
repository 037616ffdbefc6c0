//! The schema `phys-ref-1` of reference shots, and its translation into the simulation's types.
//!
//! The files have x across the table and y along it, with the origin in a corner; everything is
//! converted to the simulation's frame here. A positive `a` of a cue is to the left.

use std::collections::BTreeMap;

use glam::{DQuat, DVec2, DVec3};
use serde::Deserialize;

use carom_billiards::physics::{
    BallBallLaw, BallBody, BallState, BounceLaw, Circle, Cloth, Cue, CushionLaw, Laws, Phase,
    Stroke, Table, TableParts,
};

/// Conversion from the references' frame to the simulation's: a quarter turn and a shift to the middle.
pub(super) struct ReferenceFrame {
    pub(super) middle: DVec3,
}

impl ReferenceFrame {
    pub(super) fn of(specs: &Specs) -> Self {
        Self {
            middle: DVec3::new(0.5 * specs.width_m, 0.5 * specs.length_m, 0.0),
        }
    }

    pub(super) fn turn(v: DVec3) -> DVec3 {
        DVec3::new(v.y, -v.x, v.z)
    }

    pub(super) fn place(&self, p: DVec3) -> DVec3 {
        Self::turn(p - self.middle)
    }
}

#[derive(Deserialize)]
pub(super) struct ReferenceFile {
    pub(super) schema: String,
    pub(super) name: String,
    pub(super) table: TableJson,
    pub(super) ball_params: BallParams,
    pub(super) physics: PhysicsJson,
    pub(super) cue: CueJson,
    pub(super) initial: BTreeMap<String, StateJson>,
    pub(super) events: Vec<EventJson>,
    pub(super) samples: SamplesJson,
}

#[derive(Deserialize)]
pub(super) struct TableJson {
    pub(super) specs: Specs,
    pub(super) linear_cushions: Vec<NoseJson>,
    pub(super) circular_cushions: Vec<CircleJson>,
    pub(super) pockets: Vec<CircleJson>,
}

#[derive(Deserialize)]
pub(super) struct Specs {
    #[serde(rename = "l")]
    pub(super) length_m: f64,
    #[serde(rename = "w")]
    pub(super) width_m: f64,
    pub(super) cushion_height: f64,
}

#[derive(Deserialize)]
pub(super) struct NoseJson {
    pub(super) p1: DVec3,
    pub(super) p2: DVec3,
    pub(super) direction: u8,
}

#[derive(Deserialize)]
pub(super) struct CircleJson {
    pub(super) center: DVec3,
    pub(super) radius: f64,
}

#[derive(Deserialize)]
pub(super) struct BallParams {
    pub(super) m: f64,
    #[serde(rename = "R")]
    pub(super) radius_m: f64,
    pub(super) u_s: f64,
    pub(super) u_r: f64,
    pub(super) u_sp_proportionality: f64,
    pub(super) e_b: f64,
    pub(super) e_c: f64,
    pub(super) f_c: f64,
    pub(super) g: f64,
}

#[derive(Deserialize)]
pub(super) struct PhysicsJson {
    pub(super) models: Models,
    pub(super) params: Params,
}

#[derive(Deserialize)]
pub(super) struct Models {
    pub(super) ball_ball: String,
    pub(super) stick_ball: String,
}

#[derive(Deserialize)]
pub(super) struct Params {
    pub(super) ball_linear_cushion: CushionParams,
}

#[derive(Deserialize)]
pub(super) struct CushionParams {
    pub(super) omega_ratio: f64,
}

#[derive(Deserialize)]
pub(super) struct CueJson {
    #[serde(rename = "V0")]
    pub(super) speed_m_s: f64,
    pub(super) phi: f64,
    pub(super) theta: f64,
    pub(super) a: f64,
    pub(super) b: f64,
    pub(super) specs: CueSpecs,
}

#[derive(Deserialize)]
pub(super) struct CueSpecs {
    #[serde(rename = "M")]
    pub(super) mass_kg: f64,
    pub(super) end_mass: f64,
}

#[derive(Deserialize)]
pub(super) struct StateJson {
    pub(super) pos: DVec3,
    pub(super) vel: DVec3,
    pub(super) spin: DVec3,
}

#[derive(Deserialize)]
pub(super) struct EventJson {
    pub(super) t: f64,
    #[serde(rename = "type")]
    pub(super) kind: String,
}

#[derive(Deserialize)]
pub(super) struct SamplesJson {
    pub(super) t: Vec<f64>,
    pub(super) balls: BTreeMap<String, TrajectoryJson>,
}

#[derive(Deserialize)]
pub(super) struct TrajectoryJson {
    pub(super) state: Vec<u8>,
    pub(super) pos: Vec<DVec3>,
    pub(super) vel: Vec<DVec3>,
    pub(super) spin: Vec<DVec3>,
}

impl ReferenceFile {
    pub(super) fn body(&self) -> BallBody {
        BallBody {
            mass_kg: self.ball_params.m,
            radius_m: self.ball_params.radius_m,
        }
    }

    pub(super) fn laws(&self) -> Laws {
        let ball = &self.ball_params;
        Laws {
            cue: Cue {
                mass_kg: self.cue.specs.mass_kg,
                end_mass_kg: self.cue.specs.end_mass,
                // The references' tip never slips.
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
            cushion: CushionLaw {
                restitution: ball.e_c,
                friction: ball.f_c,
                frequency_ratio: self.physics.params.ball_linear_cushion.omega_ratio,
            },
            slate: if self.physics.models.stick_ball.ends_with("_3d") {
                BounceLaw::SLATE
            } else {
                BounceLaw::FLAT
            },
            pocket: BounceLaw::POCKET,
        }
    }
}

/// The references limit friction by the impulse e·m·v/2·2 = e·m·v of restitution alone, Coulomb's law
/// by the whole impulse (1 + e)·m·v/2: their friction is ours times 2e/(1 + e).
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
    pub(super) fn table(&self, frame: &ReferenceFrame) -> anyhow::Result<Table> {
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
    /// The ends with the balls on the left. The side that collides is given by a flag, relative to the
    /// line's normal with positive y, or positive x for a line along y.
    fn ends(&self, frame: &ReferenceFrame) -> Vec<[DVec2; 2]> {
        let along = self.p2 - self.p1;
        let positive = if along.x == 0.0 {
            DVec3::X
        } else {
            DVec3::new(-along.y / along.x, 1.0, 0.0)
        };
        let ends = [self.p1, self.p2].map(|p| frame.place(p).truncate());
        let left = (ends[1] - ends[0]).perp();
        let front = ReferenceFrame::turn(positive).truncate();
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
    pub(super) fn state(&self, frame: &ReferenceFrame, number: u8, body: BallBody) -> BallState {
        BallState {
            number,
            body,
            position: frame.place(self.pos),
            velocity: ReferenceFrame::turn(self.vel),
            spin: ReferenceFrame::turn(self.spin),
            orientation: DQuat::IDENTITY,
            phase: Phase::Resting,
        }
    }
}

impl CueJson {
    pub(super) fn stroke(&self) -> Option<Stroke> {
        (self.speed_m_s > 0.0).then(|| Stroke {
            direction_rad: (self.phi - 90.0).to_radians(),
            speed_m_s: self.speed_m_s,
            side: -self.a,
            vertical: self.b,
            elevation_rad: self.theta.to_radians(),
        })
    }
}
