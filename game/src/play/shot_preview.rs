//! Preview of a shot, computed by the same physics code as the shot.

use carom_billiards::physics::{self, AimLine, Shot, Stroke, World};
use carom_text::text;
use clap::ValueEnum;
use glam::DVec3;

/// How much is shown of the shot to come.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum AimAids {
    /// Nothing but the cue
    Off,
    /// The cue ball's path to what it meets first
    Line,
    /// Ghost ball at contact, and where both balls go next
    #[default]
    Ghost,
    /// The paths of all balls until they rest, at the power that is set
    Full,
}

/// Which balls are marked on the cloth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum BallMarks {
    /// Balls that may be hit first are ringed, where not all may
    #[default]
    Legal,
    /// No ball is marked
    Off,
}

impl AimAids {
    /// The next level, cyclically.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Off => Self::Line,
            Self::Line => Self::Ghost,
            Self::Ghost => Self::Full,
            Self::Full => Self::Off,
        }
    }

    /// Display name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => text!("aids-off"),
            Self::Line => text!("aids-line"),
            Self::Ghost => text!("aids-ghost"),
            Self::Full => text!("aids-full"),
        }
    }
}

/// Predicted result of a stroke, as far as it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct ShotPreview {
    /// Level of detail.
    pub aids: AimAids,
    /// Line to the first contact.
    pub line: AimLine,
    /// With [`AimAids::Full`] the path of each moving ball, otherwise empty.
    pub ways: Vec<BallPath>,
}

/// Path of a ball.
#[derive(Clone, Debug, PartialEq)]
pub struct BallPath {
    /// Number of the ball.
    pub number: u8,
    /// Positions of its centre, in m, from the stroke to the end.
    pub path: Vec<DVec3>,
    /// Reason for the path's end.
    pub end: PathEnd,
}

/// Reason for the end of a path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// The ball comes to rest on the table.
    Rests,
    /// The ball falls into a pocket or off the table.
    LeavesTable,
    /// The ball touches particles, or a ball that has: simulating its further path takes seconds.
    Particles,
}

impl ShotPreview {
    /// The preview of `stroke`, with paths up to contact with particles; none for a stroke that is refused,
    /// for which striking gives the reason.
    pub(super) fn of(world: &World, stroke: Stroke, aids: AimAids) -> Option<Self> {
        if aids == AimAids::Off {
            return None;
        }
        let ways = match aids {
            AimAids::Full => {
                let shot = world.without_particles().strike(stroke).ok()?;
                let known = world.particles().map(|bed| shot.known_until_secs(bed));
                ways(&shot, &known.unwrap_or_default())
            }
            _ => Vec::new(),
        };
        let line = physics::predict(world, stroke).ok()?;
        Some(Self { aids, line, ways })
    }
}

/// Paths of the moving balls, sampled densely enough to look smooth, and at each event, so that corners are
/// sharp. A ball's path ends at its time in `known_until_secs`, if that is not empty.
fn ways(shot: &Shot, known_until_secs: &[f64]) -> Vec<BallPath> {
    let end_secs = shot.duration_secs();
    let pieces = ((end_secs / PIECE_SECS).ceil() as u32).clamp(1, PIECES_MAX);
    let even = (0..=pieces).map(|i| end_secs * f64::from(i) / f64::from(pieces));
    let mut times: Vec<f64> = even
        .chain(shot.events().iter().map(|e| e.time_secs))
        .chain(
            known_until_secs
                .iter()
                .copied()
                .filter(|secs| secs.is_finite()),
        )
        .collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut ways: Vec<BallPath> = shot.poses_at(0.0).iter().map(BallPath::begin).collect();
    for time in times {
        for (index, (way, pose)) in ways.iter_mut().zip(shot.poses_at(time)).enumerate() {
            if known_until_secs
                .get(index)
                .is_some_and(|known| time > *known)
            {
                way.end = PathEnd::Particles;
                continue;
            }
            way.end = PathEnd::of(pose.on_table);
            if way.path.last() != Some(&pose.position) {
                way.path.push(pose.position);
            }
        }
    }
    ways.retain(|way| way.path.len() > 1);
    ways
}

impl PathEnd {
    fn of(on_table: bool) -> Self {
        match on_table {
            true => Self::Rests,
            false => Self::LeavesTable,
        }
    }
}

impl BallPath {
    fn begin(pose: &physics::BallPose) -> Self {
        Self {
            number: pose.number,
            path: vec![pose.position],
            end: PathEnd::of(pose.on_table),
        }
    }
}

const PIECE_SECS: f64 = 0.03;
const PIECES_MAX: u32 = 400;

#[cfg(test)]
mod tests {
    use super::*;
    use carom_billiards::physics::Table;

    fn world() -> World {
        let table = Table::nine_foot();
        let rack = table.rack_eight(3);
        World::new(table, rack).unwrap()
    }

    #[test]
    fn the_prediction_ends_where_the_shot_ends() {
        let (world, stroke) = (world(), Stroke::straight(0.02, 6.0));
        let shot_preview = ShotPreview::of(&world, stroke, AimAids::Full).unwrap();
        let shot = world.strike(stroke).unwrap();
        let ends = shot.final_states();
        let starts = world.balls();
        for (start, end) in starts.iter().zip(&ends) {
            let way = shot_preview
                .ways
                .iter()
                .find(|way| way.number == end.number);
            match way {
                Some(way) => {
                    assert_eq!(way.path.last(), Some(&end.position), "ball {}", end.number);
                    assert_eq!(way.end, PathEnd::of(end.phase.is_on_table()));
                }
                None => assert_eq!(start.position, end.position, "ball {}", end.number),
            }
        }
        assert!(shot_preview.ways.len() > 10, "a break moves the rack");
    }

    #[test]
    fn the_levels_show_more_and_more() {
        let stroke = Stroke::straight(0.0, 3.0);
        let of = |aids| ShotPreview::of(&world(), stroke, aids);
        assert_eq!(of(AimAids::Off), None);
        let line = of(AimAids::Line).unwrap();
        assert!(line.ways.is_empty());
        assert_eq!(line.line, of(AimAids::Full).unwrap().line);
        let mut aids = AimAids::Off;
        for expected in [AimAids::Line, AimAids::Ghost, AimAids::Full, AimAids::Off] {
            aids = aids.next();
            assert_eq!(aids, expected);
        }
    }

    #[test]
    fn a_stroke_that_cannot_be_struck_is_not_foreseen() {
        assert_eq!(
            ShotPreview::of(&world(), Stroke::straight(0.0, 99.0), AimAids::Full),
            None
        );
    }
}
