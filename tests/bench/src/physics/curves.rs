//! Published rules and curves, compared with the simulation.
//!
//! A published formula is derived for elastic balls (and for a 90° rule that is exact, without friction
//! between balls). Each is therefore compared twice: with the simulation under those laws, which must
//! agree, and with that under the laws of the game, which shows the effect of real balls.

use std::f64::consts::FRAC_PI_2;

use glam::{DVec2, DVec3};

use crate::chart::{Axis, Chart, Series};

use super::infinite_table::{ball, first_secs, infinite_table, released};
use super::published_curve::PublishedCurve;
use carom_billiards::Result;
use carom_billiards::physics::{
    BallBallLaw, BallBody, BallState, Cue, EventKind, Laws, Shot, Stroke, World,
};

/// All curves.
///
/// # Errors
/// None in practice for valid balls on an endless cloth.
pub fn measure() -> Result<Vec<PublishedCurve>> {
    Ok(vec![
        right_angle()?,
        natural_angle()?,
        throw_by_cut(
            "throw, stun, by cut",
            "Throw of a stun shot by cut angle",
            0.0,
        )?,
        throw_by_cut(
            "throw, rolling, by cut",
            "Throw of a rolling ball by cut angle",
            1.0,
        )?,
        throw_by_speed()?,
        throw_by_english()?,
        squirt()?,
        super::masse::directions()?,
        super::masse::ways()?,
        super::banks::measure()?,
    ])
}

/// Quantities without published figures to compare with.
pub const UNPUBLISHED: &str = "\
Bank angles: Alciatore publishes tendencies and films, no table or formula of angle out over angle in,
because cushions differ from table to table; so their order is held to his words, and the angles
themselves to the references (cushion_angle_*, bank*).";

/// Elastic balls with Alciatore's friction: what the formulas of TP A.14 assume.
fn elastic() -> Laws {
    Laws {
        ball_ball: BallBallLaw {
            restitution: 1.0,
            ..BallBallLaw::default()
        },
        ..Laws::default()
    }
}

/// Elastic balls without friction.
fn ideal() -> Laws {
    Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    }
}

/// The cue ball, which moves along +x, cuts a resting ball to its right.
struct CutShot {
    cut_rad: f64,
    speed_m_s: f64,
    /// Rω/v about the horizontal axis: 1 rolls, 0 is stun.
    roll: f64,
    /// Rω/v about the vertical, positive anticlockwise from above.
    english: f64,
}

impl CutShot {
    fn play(&self, laws: Laws) -> Result<Shot> {
        let radius = BallBody::default().radius_m;
        let line = DVec2::from_angle(-self.cut_rad);
        let from = -2.0 * radius * line;
        let turn = self.speed_m_s / radius;
        let spin = turn * DVec3::new(0.0, self.roll, self.english);
        let cue_ball = ball(0, from.x, from.y, self.speed_m_s * DVec3::X, spin);
        released(
            laws,
            vec![cue_ball, ball(1, 0.0, 0.0, DVec3::ZERO, DVec3::ZERO)],
        )
    }

    /// Both balls right after the contact.
    fn after(&self, laws: Laws) -> Result<[BallState; 2]> {
        let shot = self.play(laws)?;
        let meets = |kind: &EventKind| matches!(kind, EventKind::BallBall { .. });
        let states = shot.states_at(first_secs(&shot, meets));
        Ok([states[0], states[1]])
    }

    /// Angle in degrees from the line of centres to the object ball's direction, positive in the
    /// direction in which the cue ball's surface rubs it.
    fn throw_deg(&self, laws: Laws) -> Result<f64> {
        let line = DVec2::from_angle(-self.cut_rad);
        let [_, object] = self.after(laws)?;
        Ok(line.angle_to(object.velocity.truncate()).to_degrees())
    }

    /// TP A.14, the throw of elastic balls, with the friction of TP A.28.
    fn throw_published_deg(&self) -> f64 {
        let (sin, cos) = self.cut_rad.sin_cos();
        let BallBallLaw {
            friction_fast: a,
            friction_slow_extra: b,
            friction_fade_s_m: c,
            ..
        } = BallBallLaw::default();
        let v = self.speed_m_s;
        let along = v * sin + self.english * v;
        let slip = along.hypot(self.roll * v * cos);
        if slip == 0.0 {
            return 0.0;
        }
        let friction = a + b * (-c * slip).exp();
        // Coulomb's limit, or 1/7 where the contact sticks: two equal solid spheres.
        let grip = (friction * v * cos / slip).min(1.0 / 7.0);
        (grip * along / (v * cos)).atan().to_degrees()
    }
}

fn degrees(range: std::ops::RangeInclusive<u32>) -> impl Iterator<Item = f64> {
    range.map(f64::from)
}

fn right_angle() -> Result<PublishedCurve> {
    let angle = |laws: Laws, cut_deg: f64, speed_m_s: f64| {
        let cut = CutShot {
            cut_rad: cut_deg.to_radians(),
            speed_m_s,
            roll: 0.0,
            english: 0.0,
        };
        let [cue_ball, object] = cut.after(laws)?;
        Ok::<_, carom_billiards::Error>(
            cue_ball
                .velocity
                .angle_between(object.velocity)
                .to_degrees(),
        )
    };
    let mut error_max = 0.0f64;
    let mut series = Vec::new();
    let mut rule = Vec::new();
    for cut in degrees(2..=88) {
        let met = angle(ideal(), cut, 2.0)?;
        error_max = error_max.max((met - 90.0).abs());
        rule.push((cut, met));
    }
    series.push(Series::line("ideal balls, any speed", rule));
    for (name, speed) in SPEEDS {
        let points = degrees(2..=88).map(|cut| Ok((cut, angle(Laws::default(), cut, speed)?)));
        series.push(Series::line(
            format!("the game's, {name}"),
            points.collect::<Result<_>>()?,
        ));
    }
    Ok(PublishedCurve::new(
        "90° rule",
        "Alciatore, TP 3.1, 90° rule",
        error_max,
        Chart::new(
            "90° rule: angle between the balls after a stun shot",
            Axis::linear("cut angle, degrees"),
            Axis::linear("angle between the balls, degrees"),
            series,
        ),
    ))
}

/// Final direction of a rolling cue ball.
fn natural_angle() -> Result<PublishedCurve> {
    let deflection = |laws: Laws, cut_deg: f64, speed_m_s: f64| {
        let cut = CutShot {
            cut_rad: cut_deg.to_radians(),
            speed_m_s,
            roll: 1.0,
            english: 0.0,
        };
        let shot = cut.play(laws)?;
        let rolls = |kind: &EventKind| matches!(kind, EventKind::Rolls { ball: 0 });
        let way = shot.states_at(first_secs(&shot, rolls))[0].velocity;
        Ok::<_, carom_billiards::Error>(way.y.atan2(way.x).to_degrees())
    };
    let published = |cut_deg: f64| {
        let (sin, cos) = cut_deg.to_radians().sin_cos();
        (sin * cos).atan2(sin * sin + 0.4).to_degrees()
    };
    let mut error_max = 0.0f64;
    let mut met = Vec::new();
    for cut in degrees(2..=88) {
        let angle = deflection(ideal(), cut, 2.0)?;
        error_max = error_max.max((angle - published(cut)).abs());
        met.push((cut, angle));
    }
    let game = degrees(2..=88).map(|cut| Ok((cut, deflection(Laws::default(), cut, 2.0)?)));
    Ok(PublishedCurve::new(
        "30° rule",
        "Alciatore, TP 3.3, 30° rule; TP A.4, post-impact cue ball trajectory",
        error_max,
        Chart::new(
            "30° rule: final deflection of a rolling cue ball",
            Axis::linear("cut angle, degrees"),
            Axis::linear("deflection, degrees"),
            vec![
                Series::line(
                    "TP 3.3",
                    degrees(2..=88).map(|c| (c, published(c))).collect(),
                ),
                Series::dots("ideal balls", met.into_iter().step_by(6).collect()),
                Series::line("the game's, 2 m/s", game.collect::<Result<_>>()?),
            ],
        ),
    ))
}

fn throw_by_cut(name: &'static str, title: &str, roll: f64) -> Result<PublishedCurve> {
    let cuts = degrees(1..=85).map(|cut_deg| {
        let cut = move |speed_m_s: f64| CutShot {
            cut_rad: cut_deg.to_radians(),
            speed_m_s,
            roll,
            english: 0.0,
        };
        (cut_deg, cut)
    });
    throw_curve(name, title, "cut angle, degrees", &cuts.collect::<Vec<_>>())
}

fn throw_by_english() -> Result<PublishedCurve> {
    let spins = (-50..=50).map(|percent| {
        let english = f64::from(percent) * 0.025;
        let cut = move |speed_m_s: f64| CutShot {
            cut_rad: 0.0,
            speed_m_s,
            roll: 0.0,
            english,
        };
        (english, cut)
    });
    throw_curve(
        "throw, full hit, by english",
        "Throw of a full hit by sidespin",
        "sidespin Rω/v, positive anticlockwise",
        &spins.collect::<Vec<_>>(),
    )
}

/// Throw over a variable, at each of [`SPEEDS`].
fn throw_curve<C: Fn(f64) -> CutShot>(
    name: &'static str,
    title: &str,
    x: &'static str,
    cuts: &[(f64, C)],
) -> Result<PublishedCurve> {
    let mut error_max = 0.0f64;
    let mut series = Vec::new();
    for (speed_name, speed) in SPEEDS {
        let mut published = Vec::new();
        let mut game = Vec::new();
        for (at, cut) in cuts {
            let cut = cut(speed);
            let formula = cut.throw_published_deg();
            error_max = error_max.max((cut.throw_deg(elastic())? - formula).abs());
            published.push((*at, formula));
            game.push((*at, cut.throw_deg(Laws::default())?));
        }
        series.push(Series::line(format!("TP A.14, {speed_name}"), published));
        let some = game.into_iter().step_by(5).collect();
        series.push(Series::dots(format!("the game's, {speed_name}"), some));
    }
    Ok(PublishedCurve::new(
        name,
        "Alciatore, TP A.14, throw; friction of TP A.28 (Marlow's data)",
        error_max,
        Chart::new(
            title,
            Axis::linear(x),
            Axis::linear("throw, degrees"),
            series,
        ),
    ))
}

fn throw_by_speed() -> Result<PublishedCurve> {
    let mut error_max = 0.0f64;
    let mut series = Vec::new();
    for (name, cut_deg) in [
        ("3/4 ball", 14.5f64),
        ("half ball", 30.0),
        ("1/4 ball", 48.6),
    ] {
        let (mut published, mut game) = (Vec::new(), Vec::new());
        for step in 1..=80 {
            let cut = CutShot {
                cut_rad: cut_deg.to_radians(),
                speed_m_s: 0.1 * f64::from(step),
                roll: 0.0,
                english: 0.0,
            };
            let formula = cut.throw_published_deg();
            error_max = error_max.max((cut.throw_deg(elastic())? - formula).abs());
            published.push((cut.speed_m_s, formula));
            game.push((cut.speed_m_s, cut.throw_deg(Laws::default())?));
        }
        series.push(Series::line(format!("TP A.14, {name}"), published));
        let some = game.into_iter().step_by(5).collect();
        series.push(Series::dots(format!("the game's, {name}"), some));
    }
    Ok(PublishedCurve::new(
        "throw, stun, by speed",
        "Alciatore, TP A.14, throw; friction of TP A.28 (Marlow's data)",
        error_max,
        Chart::new(
            "Throw of a stun shot by speed",
            Axis::linear("speed of the cue ball, m/s"),
            Axis::linear("throw, degrees"),
            series,
        ),
    ))
}

fn squirt() -> Result<PublishedCurve> {
    let ball_kg = BallBody::default().mass_kg;
    let mut error_max = 0.0f64;
    let mut series = Vec::new();
    for (name, share) in [("m/30", 30.0), ("m/20", 20.0), ("m/60", 60.0)] {
        let laws = Laws {
            cue: Cue {
                end_mass_kg: ball_kg / share,
                // The formula has no miscue.
                tip_friction: 10.0,
                ..Cue::default()
            },
            ..Laws::default()
        };
        let (mut published, mut met) = (Vec::new(), Vec::new());
        for step in 0..=55 {
            let side = 0.01 * f64::from(step);
            let across = 1.0 - side * side;
            let formula = (2.5 * side * across.sqrt() / (1.0 + share + 2.5 * across)).atan();
            let angle = squirt_rad(laws, side)?;
            error_max = error_max.max((angle - formula).to_degrees().abs());
            published.push((side, formula.to_degrees()));
            met.push((side, angle.to_degrees()));
        }
        series.push(Series::line(format!("TP A.31, end mass {name}"), published));
        let some = met.into_iter().step_by(5).collect();
        series.push(Series::dots(format!("the game's, end mass {name}"), some));
    }
    Ok(PublishedCurve::new(
        "squirt by tip offset",
        "Alciatore, TP A.31, the physics of squirt",
        error_max,
        Chart::new(
            "Squirt by the tip's offset",
            Axis::linear("offset to the side, ball radii"),
            Axis::linear("squirt, degrees"),
            series,
        ),
    ))
}

/// Angle in rad by which a ball struck along +y leaves to the left of the aim.
fn squirt_rad(laws: Laws, side: f64) -> Result<f64> {
    let balls = vec![ball(0, 0.0, 0.0, DVec3::ZERO, DVec3::ZERO)];
    let world = World::with_laws(infinite_table()?, laws, balls)?;
    let stroke = Stroke {
        side,
        ..Stroke::straight(FRAC_PI_2, 2.0)
    };
    let velocity = world.strike(stroke)?.states_at(0.0)[0].velocity;
    Ok((-velocity.x).atan2(velocity.y))
}

/// Slow, medium and fast speeds of Alciatore: 1, 3 and 7 mph.
const SPEEDS: [(&str, f64); 3] = [
    ("1 mph", 0.447_04),
    ("3 mph", 1.341_12),
    ("7 mph", 3.129_28),
];
