//! Traversal for coherent packets, as of camera rays: their beam traverses the BVH once for all of them.

use fearless_simd::prelude::*;

use super::super::beam::{Beam, least};
use super::{
    Bvh16, Bvh16Node, Entry, Float, LANES, LEAF_TAG, Mask, Nearest, RayLanes, Rays, SLACK,
    STACK_PARTS, Shape, Solid, Vec3x, Word, origin_slack, pop, queue, splat,
};

impl<F: Shape<N>, const N: usize> Bvh16<F, N> {
    /// [`Bvh16::nearest`] for coherent rays: their `beam` finds the leaves, and each ray is tested
    /// against those whose boxes it enters.
    #[inline(always)]
    pub(in super::super) fn nearest_in_beam<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: &Beam,
        nearest: &mut Nearest<S>,
    ) {
        // The traversal addresses a child by its parent and lane, which a root that is a leaf does not
        // have.
        if self.root & LEAF_TAG != 0 {
            return self.nearest(simd, rays, nearest, &Solid);
        }
        let (distance, id) = simd.vectorize(
            #[inline(always)]
            || self.nearest_by_leaf(simd, rays, beam, nearest),
        );
        nearest.distance = Float::load_array(simd, distance);
        nearest.id = Word::load_array(simd, id);
    }

    #[inline(always)]
    fn nearest_by_leaf<S: Simd>(
        &self,
        simd: S,
        rays: &Rays<S>,
        beam: &Beam,
        nearest: &Nearest<S>,
    ) -> ([f32; LANES], [u32; LANES]) {
        let columns = RayLanes::new(rays);
        let (mut distance, mut id) = (nearest.distance.to_array(), nearest.id.to_array());
        let (slack, beam_slack) = (origin_slack(rays), beam.origin_max() * SLACK);
        let all = Mask::splat(simd, true);
        // Largest of the rays' nearest distances so far: what the beam enters beyond it cannot improve
        // any ray.
        let mut farthest = f32::INFINITY;
        let (mut stack, mut waiting) = ([Entry(0); STACK_PARTS], 0);
        let mut part = self.root;
        loop {
            // Stack entries hold parent · LANES + lane instead of the child's index, because the child's
            // box is stored in its parent.
            let places: [u32; LANES] =
                std::array::from_fn(|lane| part * LANES as u32 + lane as u32);
            let node = &self.nodes[part as usize];
            let (entries, hits) = node.overlap(simd, beam, beam_slack, farthest);
            let mut next;
            (next, waiting) = match hits {
                0 => pop(&stack, waiting, farthest),
                _ => {
                    let (first, waiting) = queue(&entries, &places, hits, &mut stack, waiting);
                    (Some(first), waiting)
                }
            };
            part = loop {
                let Some(entry) = next else {
                    return (distance, id);
                };
                let place = entry.part() as usize;
                let (node, lane) = (&self.nodes[place / LANES], place % LANES);
                let part = node.parts[lane];
                if part & LEAF_TAG == 0 {
                    break part;
                }
                let leaf = &self.leaves[(part & !LEAF_TAG) as usize];
                let limit = Float::load_array(simd, distance);
                // The beam has culled leaves, this test culls rays: it costs one step for all rays, and
                // each ray that it excludes saves a step over 16 primitives.
                let mut lanes = node.entered_by(simd, lane, rays, slack, limit);
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize % LANES;
                    lanes &= lanes - 1;
                    let ray = columns.ray(simd, lane);
                    let frame = F::frame(simd, &ray);
                    let nearest = (&mut distance[lane], &mut id[lane]);
                    self.update(simd, leaf, (&ray, &frame), nearest, |_| true);
                }
                // Includes unused lanes of the last packet; they can only keep this bound large, which
                // visits more but stays correct.
                farthest = -least(simd, -Float::load_array(simd, distance), all);
                (next, waiting) = pop(&stack, waiting, farthest);
            };
        }
    }
}

impl Bvh16Node {
    /// Distances at which a beam enters the children's boxes, enlarged by `slack` for the beam's origins,
    /// and the bit mask of those that it enters up to `limit`.
    #[inline(always)]
    fn overlap<S: Simd>(
        &self,
        simd: S,
        beam: &Beam,
        slack: f32,
        limit: f32,
    ) -> ([f32; LANES], u64) {
        let center = Vec3x::load_arrays(simd, &self.center);
        let half = Vec3x::load_arrays(simd, &self.half);
        let half = Vec3x::new(half.x + slack, half.y + slack, half.z + slack);
        let (begin, end) = beam.overlap(center - half, center + half);
        let hits = begin.simd_le(end.min(limit)).to_bitmask() & self.lanes;
        (begin.to_array(), hits)
    }

    /// Bit mask of the rays that enter the box of the child in `lane` before `distance`.
    #[inline(always)]
    fn entered_by<S: Simd>(
        &self,
        simd: S,
        lane: usize,
        rays: &Rays<S>,
        slack: Float<S>,
        distance: Float<S>,
    ) -> u64 {
        let center = splat(simd, &self.center, lane);
        let half = splat(simd, &self.half, lane);
        let half = Vec3x::new(half.x + slack, half.y + slack, half.z + slack);
        let middle = (center - rays.origin).scale(rays.inverse);
        let near = (-half).scale_add(rays.inverse_abs, middle);
        let far = half.scale_add(rays.inverse_abs, middle);
        let entry = near.x.max(near.y).max(near.z.max(0.0));
        let exit = far.x.min(far.y).min(far.z.min(distance));
        entry.simd_le(exit).to_bitmask()
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::geometry::Geometry;
    use super::super::super::rays::NONE;
    use super::*;
    use crate::CpuTracer;
    use crate::bvh::test_scenes::{ARRANGEMENTS, ray, test_scene};
    use crate::compiled::{BvhUse, CompiledScene, ShapeKind};
    use crate::sampling::uniforms;
    use crate::simd::dispatch;

    /// Origins, then directions.
    type Six = [[f32; LANES]; 6];

    /// A ray among the primitives of a scene, and others that differ from it by up to `spread`.
    fn alike(scene: &CompiledScene, index: u32, spread: f32) -> Six {
        let middle = ray(scene, 3, index);
        let rays: [_; LANES] = std::array::from_fn(|lane| {
            let [x, y, z, along] = uniforms(index * LANES as u32 + lane as u32, 5, 1, 2);
            let aside = spread * (glam::Vec3::new(x, y, z) - 0.5);
            let direction = (middle.direction + aside).normalize();
            (middle.origin + along * aside, direction)
        });
        std::array::from_fn(|column| {
            rays.map(|(origin, direction)| match column {
                0..3 => origin[column],
                _ => direction[column - 3],
            })
        })
    }

    /// Bits of distances, and ids.
    #[inline(always)]
    fn hits<S: Simd>(
        simd: S,
        geometry: &Geometry,
        six: &Six,
        is_by_beam: bool,
    ) -> ([u32; LANES], [u32; LANES]) {
        let [ox, oy, oz, dx, dy, dz] = six.map(|column| Float::load_array(simd, column));
        let (origin, direction) = (Vec3x::new(ox, oy, oz), Vec3x::new(dx, dy, dz));
        let rays = Rays::new(simd, origin, direction, Word::splat(simd, NONE));
        let endless = Float::splat(simd, f32::INFINITY);
        let beam = Beam::new(simd, &rays, Mask::splat(simd, true), endless);
        let nearest = geometry.nearest(simd, &rays, beam.as_ref().filter(|_| is_by_beam));
        (
            nearest.distance.to_array().map(f32::to_bits),
            nearest.id.to_array(),
        )
    }

    #[test]
    fn a_beam_finds_the_same_hits_in_a_bvh_as_each_ray() {
        let mut met = 0;
        for (kind, count) in ARRANGEMENTS
            .into_iter()
            .zip([1500, 300, 70, 17, 1500, 5, 300])
        {
            let mut scene = test_scene(kind, ShapeKind::Triangle, count, 1);
            scene.bvh_use = BvhUse::Always;
            let geometry = Geometry::new(&scene);
            for level in CpuTracer::levels_available() {
                for index in 0..2_000 {
                    let spread = [0.0, 1e-4, 1e-2, 0.3][index as usize / 8 % 4];
                    let six = alike(&scene, index, spread);
                    let [each, by_beam] = [false, true].map(|is_by_beam| {
                        dispatch!(level, simd => hits(simd, &geometry, &six, is_by_beam))
                    });
                    assert_eq!(by_beam, each, "{level:?}, {kind:?}, packet {index}");
                    met += each.1.iter().filter(|id| **id != NONE).count();
                }
            }
        }
        assert!(met > 10_000, "only {met} rays meet anything");
    }
}
