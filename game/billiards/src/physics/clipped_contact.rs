//! First contact with a bounded part of a surface whose equation is unbounded, as a nose is a part of a
//! line.
//!
//! If the first contact with the unbounded surface lies outside the part, the path is split where it
//! crosses the boundaries of the part, and the contact is sought in each piece inside. A ball that
//! enters such a piece already nearer than contact distance, and still approaching, touches at the
//! entry.

use glam::{DVec2, DVec3};

use super::{
    contact_time::{QuadraticPath, leaves_circle, reaches_plane, reaches_point},
    table::Pocket,
};

/// First time at which a path touches a part within a horizon. `touch` finds the first contact with the
/// unbounded surface, `is_there` tells whether a ball with its centre at a place would touch the part,
/// and `borders` adds the crossings of all that bounds these places.
pub(crate) fn first_touch(
    (path, horizon): (&QuadraticPath, f64),
    touch: impl Fn(&QuadraticPath, f64) -> Option<f64>,
    is_there: impl Fn(DVec3) -> bool,
    borders: impl Fn(&mut Crossings),
) -> Option<f64> {
    let t = touch(path, horizon)?;
    if is_there(path.at(t)) {
        return Some(t);
    }
    let mut crossings = Crossings {
        path: path.from(t),
        times: vec![0.0, horizon - t],
    };
    borders(&mut crossings);
    let Crossings { path, mut times } = crossings;
    times.sort_by(f64::total_cmp);
    times.windows(2).find_map(|piece| {
        let (from, to) = (piece[0], piece[1]);
        // No border is crossed within a piece, so that its midpoint decides for all of it.
        let runs_within = to > from && is_there(path.at(0.5 * (from + to)));
        let touches = || touch(&path.from(from), to - from);
        runs_within
            .then(touches)
            .flatten()
            .map(|later| t + from + later)
    })
}

/// Times at which a path crosses borders.
pub(crate) struct Crossings {
    path: QuadraticPath,
    /// The first two are 0 and the horizon.
    times: Vec<f64>,
}

impl Crossings {
    /// The vertical plane over a line through `point`.
    pub(crate) fn line(&mut self, point: DVec2, normal: DVec2) {
        self.plane(point.extend(0.0), normal.normalize_or_zero().extend(0.0));
    }

    /// The vertical planes at the ends of a line.
    pub(crate) fn ends(&mut self, from: DVec2, to: DVec2) {
        self.line(from, to - from);
        self.line(to, to - from);
    }

    pub(crate) fn level(&mut self, height: f64) {
        self.plane(height * DVec3::Z, DVec3::Z);
    }

    /// The vertical cylinder over a circle.
    pub(crate) fn circle(&mut self, center: DVec2, radius: f64) {
        self.around(|path| path.flat_from(center), radius);
    }

    /// The sphere of `radius` about the origin, as crossed by a path derived from this one.
    pub(crate) fn around(&mut self, seen: impl Fn(&QuadraticPath) -> QuadraticPath, radius: f64) {
        let (seen, horizon) = (seen(&self.path), self.times[1]);
        let crossings = [
            reaches_point(&seen, radius, horizon),
            leaves_circle(&seen, radius, horizon),
        ];
        self.times.extend(crossings.into_iter().flatten());
    }

    /// The two vertical planes at the sides of a pocket's mouth.
    pub(crate) fn mouth(&mut self, pocket: &Pocket) {
        let across = (1.0 - OPEN_COS * OPEN_COS).sqrt() * pocket.mouth.perp();
        for side in [across, -across] {
            self.line(pocket.center, (OPEN_COS * pocket.mouth + side).perp());
        }
    }

    /// The plane through a point with a unit normal.
    pub(crate) fn plane(&mut self, point: DVec3, normal: DVec3) {
        let horizon = self.times[1];
        // A parabola crosses a plane at most once in each direction, and `reaches_plane` finds the
        // crossing in one.
        for normal in [normal, -normal] {
            let crossing = reaches_plane(&self.path, (point, normal), 0.0, horizon);
            self.times.extend(crossing);
        }
    }
}

/// Cosine of the angle from the mouth at which a pocket's wall over the cloth begins: behind the
/// ends of the facings.
pub(crate) const OPEN_COS: f64 = 0.4;
