//! Massé shots: strokes with an elevated cue, after which the cue ball curves.

use glam::{DVec2, DVec3};

use crate::chart::{Axis, Chart, Series};

use super::{
    infinite_table::{ball, infinite_table},
    published_curve::PublishedCurve,
};
use carom_billiards::Result;
use carom_billiards::physics::{Cue, Event, EventKind, Laws, Shot, Stroke, World};

/// The ball's final direction, compared with Coriolis's construction: parallel to the line from the
/// ball's contact point on the cloth to where the cue's line through the tip meets the cloth.
///
/// # Errors
/// None in practice for one ball.
pub(super) fn directions() -> Result<PublishedCurve> {
    let mut error_max = 0.0f64;
    let mut series = Vec::new();
    for degrees in ELEVATIONS_DEG {
        let (mut published, mut game) = (Vec::new(), Vec::new());
        for step in 0..=50 {
            let side = 0.01 * f64::from(step);
            let stroke = stroke(degrees, side, 2.0);
            let formula = coriolis_deg(&stroke);
            let met = final_deg(&played(straight(), stroke)?);
            error_max = error_max.max((met - formula).abs());
            published.push((side, formula));
            game.push((side, final_deg(&played(unslipping(), stroke)?)));
        }
        series.push(Series::line(format!("Coriolis, {degrees}°"), published));
        let some = game.into_iter().step_by(5).collect();
        series.push(Series::dots(format!("the game's, {degrees}°"), some));
    }
    Ok(PublishedCurve::new(
        "massé, final direction",
        "Coriolis 1835; Alciatore, TP A.19, massé shot aiming method",
        error_max,
        Chart::new(
            "Massé: final direction by the tip's offset",
            Axis::linear("offset to the side, ball radii"),
            Axis::linear("to the side of the aim, degrees"),
            series,
        ),
    ))
}

/// The ball's paths seen from above, until it rolls straight.
///
/// # Errors
/// None in practice for one ball.
pub(super) fn ways() -> Result<PublishedCurve> {
    let mut error_max = 0.0f64;
    let mut series = Vec::new();
    for degrees in ELEVATIONS_DEG {
        let stroke = stroke(degrees, 0.45, 2.0);
        let shot = played(Laws::default(), stroke)?;
        let rolls = rolls_secs(&shot);
        let place = |t: f64| shot.states_at(t)[0].position.truncate();
        let points = (0..=80).map(|i| place(1.2 * rolls * f64::from(i) / 80.0));
        series.push(Series::line(
            format!("{degrees}°"),
            points.map(|p| (p.x, p.y)).collect(),
        ));
        error_max = error_max.max(off_parabola_m(&shot, rolls) * 1e3);
    }
    Ok(PublishedCurve::new(
        "massé, way, in mm",
        "Coriolis 1835; Alciatore, TP A.4: a parabola as long as the ball slides",
        error_max,
        Chart::new(
            "Massé: the ball's way at 2 m/s and 0.45 radii to the right",
            Axis::linear("along the aim, m"),
            Axis::linear("to the left of the aim, m"),
            series,
        ),
    ))
}

/// The largest distance from the parabola that friction of constant direction gives, from the
/// ball's last landing on.
fn off_parabola_m(shot: &Shot, rolls_secs: f64) -> f64 {
    let lands = |event: &&Event| matches!(event.kind, EventKind::Bounces { .. });
    let from = shot.events().iter().rfind(lands);
    let from = from.map_or(0.0, |event| event.time_secs);
    let start = shot.states_at(from)[0];
    let slip = start.velocity - start.body.radius_m * start.spin.cross(DVec3::Z);
    let Laws { cloth, .. } = Laws::default();
    let friction = cloth.sliding_friction * cloth.gravity_m_s2 * slip.normalize();
    let off = (0..=40).map(|i| {
        let t = (rolls_secs - from) * f64::from(i) / 40.0;
        let parabola = start.position + t * (start.velocity - 0.5 * t * friction);
        shot.states_at(from + t)[0].position.distance(parabola)
    });
    off.fold(0.0, f64::max)
}

fn stroke(elevation_deg: f64, side: f64, speed_m_s: f64) -> Stroke {
    Stroke {
        side,
        elevation_rad: elevation_deg.to_radians(),
        ..Stroke::straight(0.0, speed_m_s)
    }
}

/// A ball struck along +x from the middle.
fn played(laws: Laws, stroke: Stroke) -> Result<Shot> {
    let balls = vec![ball(0, 0.0, 0.0, DVec3::ZERO, DVec3::ZERO)];
    World::with_laws(infinite_table()?, laws, balls)?.strike(stroke)
}

/// Laws with a tip that never slips, as the construction assumes.
fn unslipping() -> Laws {
    Laws {
        cue: Cue {
            tip_friction: 10.0,
            ..Cue::default()
        },
        ..Laws::default()
    }
}

/// The same with a massless end of the cue: without squirt.
fn straight() -> Laws {
    let mut laws = unslipping();
    laws.cue.end_mass_kg = 1e-15;
    laws
}

/// Time at which the ball begins to roll for good: as its slip ends, or as it lands.
fn rolls_secs(shot: &Shot) -> f64 {
    let rolls = |event: &&Event| {
        matches!(
            event.kind,
            EventKind::Rolls { .. } | EventKind::Bounces { .. }
        )
    };
    let last = shot.events().iter().rfind(rolls);
    last.map_or(0.0, |event| event.time_secs)
}

/// Final direction in degrees, taken halfway: the ball rolls straight for most of the shot.
fn final_deg(shot: &Shot) -> f64 {
    let way = shot.states_at(0.5 * shot.duration_secs())[0].velocity;
    (-way.y).atan2(way.x).to_degrees()
}

/// Direction of Coriolis's construction in degrees. Lengths are in ball radii, relative to the centre.
fn coriolis_deg(stroke: &Stroke) -> f64 {
    let (sin, cos) = stroke.elevation_rad.sin_cos();
    let cue = DVec3::new(cos, 0.0, -sin);
    let up = DVec3::new(sin, 0.0, cos);
    let depth = (1.0 - stroke.side * stroke.side - stroke.vertical * stroke.vertical).sqrt();
    let tip = stroke.side * DVec3::NEG_Y + stroke.vertical * up - depth * cue;
    // The cloth is one radius below the centre.
    let meets = tip + (1.0 + tip.z) / sin * cue;
    let line: DVec2 = meets.truncate();
    (-line.y).atan2(line.x).to_degrees()
}

const ELEVATIONS_DEG: [f64; 3] = [30.0, 50.0, 70.0];
