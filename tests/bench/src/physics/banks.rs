//! Bank angles. Only tendencies are published, as cushions differ: a fast bank is shorter than a slow
//! one, which has the distance to curve as it takes up its roll; running english makes a bank longer,
//! reverse english shorter (Alciatore, "Banks and kicks").

use glam::DVec3;

use crate::chart::{Axis, Chart, Series};

use super::{
    infinite_table::{EDGE_M, ball, first_secs, single_ball_from},
    published_curve::PublishedCurve,
};
use carom_billiards::Result;
use carom_billiards::physics::{BallBody, EventKind};

/// A bank shot of a rolling ball.
#[derive(Clone, Copy)]
struct BankShot {
    name: &'static str,
    speed_m_s: f64,
    /// Rω/v about the vertical: positive is running english.
    english: f64,
}

impl BankShot {
    /// Angle in degrees from the cushion's normal to the ball's position after [`WAY_M`].
    fn out_deg(&self, in_deg: f64) -> Result<f64> {
        let BallBody { radius_m, .. } = BallBody::default();
        let (sin, cos) = in_deg.to_radians().sin_cos();
        let velocity = self.speed_m_s * DVec3::new(cos, sin, 0.0);
        // Clockwise spin is running english for a ball that continues to the left of a cushion ahead.
        let spin = DVec3::Z.cross(velocity) - self.english * self.speed_m_s * DVec3::Z;
        let shot = single_ball_from(ball(0, EDGE_M - 0.1, 0.0, velocity, spin / radius_m))?;
        let touches = |kind: &EventKind| matches!(kind, EventKind::Cushion { .. });
        let t = first_secs(&shot, touches);
        let from = shot.states_at(t)[0].position;
        let way = |t: f64| shot.states_at(t)[0].position - from;
        let (mut near, mut far) = (t, t + 60.0);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (near + far);
            if way(middle).length() < WAY_M {
                near = middle;
            } else {
                far = middle;
            }
        }
        let way = way(near);
        Ok(way.y.atan2(-way.x).to_degrees())
    }
}

/// Bank angles, and by how much they violate the tendencies.
///
/// # Errors
/// None in practice for one ball.
pub(super) fn measure() -> Result<PublishedCurve> {
    let mut series = vec![Series::line("mirror", vec![(10.0, 10.0), (70.0, 70.0)])];
    let mut outs = Vec::new();
    for bank in BANKS {
        let angles =
            (10..=70u32).map(|angle| Ok((f64::from(angle), bank.out_deg(f64::from(angle))?)));
        let points = angles.collect::<Result<Vec<_>>>()?;
        outs.push(points.clone());
        series.push(Series::line(bank.name, points));
    }
    let mut error_max = 0.0f64;
    for (longer, shorter, until_deg) in LONGER {
        let pairs = outs[longer].iter().zip(&outs[shorter]);
        for ((_, long), (_, short)) in pairs.take_while(|((at, _), _)| *at <= until_deg) {
            error_max = error_max.max(short - long);
        }
    }
    Ok(PublishedCurve::new(
        "bank angles",
        "Alciatore, Banks and kicks: order of the curves",
        error_max,
        Chart::new(
            "Bank angles of a rolling ball, seen 0.6 m on",
            Axis::linear("angle in, degrees from the normal"),
            Axis::linear("angle out, degrees from the normal"),
            series,
        ),
    ))
}

const BANKS: [BankShot; 5] = [
    BankShot {
        name: "slow, 1 m/s",
        speed_m_s: 1.0,
        english: 0.0,
    },
    BankShot {
        name: "medium, 2 m/s",
        speed_m_s: 2.0,
        english: 0.0,
    },
    BankShot {
        name: "fast, 6 m/s",
        speed_m_s: 6.0,
        english: 0.0,
    },
    BankShot {
        name: "medium, running",
        speed_m_s: 2.0,
        english: 0.5,
    },
    BankShot {
        name: "medium, reverse",
        speed_m_s: 2.0,
        english: -0.5,
    },
];
/// Pairs of indices into [`BANKS`], of which the first is the longer, and the angle in up to which this
/// must hold: nearly along the cushion a ball's surface slips whatever its english, and those curves
/// meet.
const LONGER: [(usize, usize, f64); 4] = [(0, 1, 70.0), (1, 2, 70.0), (3, 1, 40.0), (1, 4, 40.0)];
/// Distance from the cushion at which the angle is taken.
const WAY_M: f64 = 0.6;
/// Bisections from a minute to a picosecond.
const BISECTIONS: u32 = 46;
