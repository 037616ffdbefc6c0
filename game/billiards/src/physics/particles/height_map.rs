//! Height map of particles at rest on the cloth.

use glam::{DVec3, IVec2, Vec3};

/// Height of the particles over each square of the cloth.
#[derive(Clone, Debug)]
pub(super) struct HeightMap {
    edge_m: f64,
    /// The square of the smallest coordinates.
    first: IVec2,
    columns: usize,
    /// Heights in m, row by row; none where nothing lies.
    tops: Vec<Option<f32>>,
}

impl HeightMap {
    /// Map of the tops of particles that lie `spacing_m` apart.
    pub(super) fn new(tops: &[Vec3], spacing_m: f64) -> Self {
        // Twice the spacing, so that no square under particles is empty.
        let edge_m = 2.0 * spacing_m;
        let square = |top: Vec3| (top.truncate().as_dvec2() / edge_m).floor().as_ivec2();
        let none = (IVec2::MAX, IVec2::MIN);
        let squares = tops.iter().map(|top| square(*top));
        let (first, last) = squares.fold(none, |(min, max), at| (min.min(at), max.max(at)));
        let size = (last.saturating_sub(first) + 1)
            .max(IVec2::ZERO)
            .as_usizevec2();
        let columns = size.x.min(SQUARES_MAX);
        let mut map = Self {
            edge_m,
            first,
            columns,
            tops: vec![None; columns * size.y.min(SQUARES_MAX)],
        };
        for top in tops {
            if let Some(index) = map.index(square(*top)) {
                let highest = map.tops[index].map_or(top.z, |highest| highest.max(top.z));
                map.tops[index] = Some(highest);
            }
        }
        map
    }

    fn index(&self, square: IVec2) -> Option<usize> {
        let at = square.saturating_sub(self.first);
        let is_inside = at.cmpge(IVec2::ZERO).all() && at.x < self.columns as i32;
        let index = at.y.max(0) as usize * self.columns + at.x.max(0) as usize;
        (is_inside && index < self.tops.len()).then_some(index)
    }

    /// Whether a sphere overlaps the particles.
    pub(super) fn touches(&self, center: DVec3, radius_m: f64) -> bool {
        let low = ((center.truncate() - radius_m) / self.edge_m)
            .floor()
            .as_ivec2();
        let high = ((center.truncate() + radius_m) / self.edge_m)
            .floor()
            .as_ivec2();
        let rows = low.y..=high.y;
        let mut squares = rows.flat_map(|y| (low.x..=high.x).map(move |x| IVec2::new(x, y)));
        squares.any(|square| {
            let top = self.index(square).and_then(|index| self.tops[index]);
            top.is_some_and(|top| {
                let corner = square.as_dvec2() * self.edge_m;
                // The nearest point of the column over the square, which is solid up to its top.
                let near = center.truncate().clamp(corner, corner + self.edge_m);
                let height = center.z.min(top.into());
                near.extend(height).distance(center) < radius_m
            })
        })
    }
}

/// Maximum squares along each axis: more than a table has, which bounds the memory that stray particles
/// take.
const SQUARES_MAX: usize = 2048;
