//! Preview of the shot to come: by the code that will play it.

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
    /// The next, and after the last the first.
    #[must_use]
    pub fn next(self) -> Self {
        match self {
            Self::Off => Self::Line,
            Self::Line => Self::Ghost,
            Self::Ghost => Self::Full,
            Self::Full => Self::Off,
        }
    }

    /// For people.
    pub fn name(self) -> &'static str {
        match self {
            Self::Off => text!("aids-off"),
            Self::Line => text!("aids-line"),
            Self::Ghost => text!("aids-ghost"),
            Self::Full => text!("aids-full"),
        }
    }
}

/// What a stroke will do, as far as it is shown.
#[derive(Clone, Debug, PartialEq)]
pub struct ShotPreview {
    /// Whether more than the cue ball's way is shown.
    pub aids: AimAids,
    /// To the first contact.
    pub line: AimLine,
    /// With [`AimAids::Full`]: of each ball that moves.
    pub ways: Vec<BallPath>,
}

/// Where a ball goes.
#[derive(Clone, Debug, PartialEq)]
pub struct BallPath {
    /// Its number.
    pub number: u8,
    /// Centres, in m, from the stroke to the end.
    pub path: Vec<DVec3>,
    /// What ends it.
    pub end: PathEnd,
}

/// What ends a path that is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// The ball rests on the table.
    Rests,
    /// It is in a pocket, or off the table.
    LeavesTable,
    /// It touches particles, or a ball that has: how it goes on takes seconds to simulate.
    Particles,
}

impl ShotPreview {
    /// Of `stroke`, up to where balls touch particles; nothing for a stroke that cannot be struck: striking it says why.
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

/// Sampled often enough to look smooth, and at each event, so that corners are sharp; each up to the time until which it
/// is known, if there is one.
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
