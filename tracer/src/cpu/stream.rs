//! Streams of paths: structure of arrays, compacted in place.

use fearless_simd::{f32x8, mask32x8, prelude::*, u32x8};

use super::lanes::{Float, LANES, Mask, Vec3x, Word};
use crate::aov::AOV_CHANNELS;

/// Paths in flight of one thread. Buffers are allocated once.
pub(super) struct Stream {
    /// Number of live paths, at the front of every column.
    pub(super) len: usize,
    pub(super) origin: Triple,
    pub(super) direction: Triple,
    /// Throughput.
    pub(super) beta: Triple,
    /// Radiance gathered so far.
    pub(super) radiance: Triple,
    /// Density of the last direction per solid angle times the area lights' `light_weight_sum` at its
    /// origin; ∞ if all light along it counts with weight 1, −∞ likewise if the path was scattered inside a
    /// body at its origin.
    pub(super) pdf: Box<[f32]>,
    /// The density alone; used if there is an environment map or an emissive surface.
    pub(super) sampled_pdf: Box<[f32]>,
    pub(super) has_sampled_pdf: bool,
    /// Distance along the ray to its hit; for a camera ray until the hit is found, the length of its
    /// unnormalised direction.
    pub(super) distance: Box<[f32]>,
    /// Id of the primitive hit; after shading, of the one on which the ray starts.
    pub(super) primitive: Box<[u32]>,
    /// Film position (column in the lower, row in the upper 16 bits); used until camera rays are generated.
    pub(super) film: Box<[u32]>,
    /// [`crate::sampling::pixel_key`].
    pub(super) pixel: Box<[u32]>,
    /// [`crate::sampling::sample_key`].
    pub(super) sample: Box<[u32]>,
    /// Index of the path in [`Stream::finished`].
    pub(super) slot: Box<[u32]>,
    /// Shadow rays of the diffuse lobe and of the coat's mirror.
    pub(super) shadows: [Shadows; 2],
    /// Radiance of terminated paths, by slot.
    pub(super) finished: Triple,
    /// AOVs of first hits by slot, for denoised images.
    pub(super) aovs: [Box<[f32]>; AOV_CHANNELS],
}

/// One shadow ray per path, valid between shading and connecting.
pub(super) struct Shadows {
    /// Origins, for the first lobe in scenes with refracted NEE; elsewhere the path's origin is used.
    pub(super) origin: Triple,
    pub(super) direction: Triple,
    /// Distance to the light, metres; 0 where there is no ray.
    pub(super) distance: Box<[f32]>,
    /// Id of the target area light, or of no primitive.
    pub(super) light: Box<[u32]>,
    /// Radiance times throughput that arrives if the ray is not occluded.
    pub(super) radiance: Triple,
}

/// Channel of [`Stream::aovs`], directly before the emission.
const INVERSE_DEPTH: usize = 6;

/// Three columns of a vector or colour.
pub(super) struct Triple(pub(super) [Box<[f32]>; 3]);

/// Position of a packet in a stream.
#[derive(Clone, Copy)]
pub(super) struct StreamPacket {
    /// Index of its first path.
    pub(super) at: usize,
    /// Number of its paths.
    pub(super) lanes: usize,
}

/// Packets of a stream of `len` paths; the last may be incomplete.
pub(super) fn packets(len: usize) -> impl Iterator<Item = StreamPacket> {
    (0..len).step_by(LANES).map(move |at| StreamPacket {
        at,
        lanes: LANES.min(len - at),
    })
}

impl StreamPacket {
    /// The lanes that hold a path.
    #[inline(always)]
    pub(super) fn mask<S: Simd>(self, simd: S) -> Mask<S> {
        Mask::from_bitmask(simd, (1 << self.lanes) - 1)
    }
}

impl Stream {
    /// A stream with room for `capacity` paths, rounded up to full packets.
    pub(super) fn new(capacity: usize) -> Self {
        let rows = capacity.next_multiple_of(LANES);
        let words = || vec![0u32; rows].into_boxed_slice();
        Self {
            len: 0,
            origin: Triple::new(rows),
            direction: Triple::new(rows),
            beta: Triple::new(rows),
            radiance: Triple::new(rows),
            pdf: vec![0.0; rows].into_boxed_slice(),
            sampled_pdf: vec![0.0; rows].into_boxed_slice(),
            has_sampled_pdf: false,
            distance: vec![0.0; rows].into_boxed_slice(),
            primitive: words(),
            film: words(),
            pixel: words(),
            sample: words(),
            slot: words(),
            shadows: std::array::from_fn(|_| Shadows::new(rows)),
            finished: Triple::new(rows),
            aovs: std::array::from_fn(|_| vec![0.0; rows].into_boxed_slice()),
        }
    }

    /// Terminates the paths of `packet` in `mask` with their final `radiance`.
    #[inline(always)]
    pub(super) fn finish<S: Simd>(
        &mut self,
        packet: StreamPacket,
        mask: Mask<S>,
        radiance: Vec3x<S>,
    ) {
        let mut bits = mask.to_bitmask();
        let radiance = [
            radiance.x.to_array(),
            radiance.y.to_array(),
            radiance.z.to_array(),
        ];
        while bits != 0 {
            let lane = bits.trailing_zeros() as usize % LANES;
            bits &= bits - 1;
            let slot = self.slot[packet.at + lane] as usize;
            for (column, channel) in self.finished.0.iter_mut().zip(&radiance) {
                column[slot] = channel[lane];
            }
        }
    }

    /// Stores inverse depth and directly seen emission of first hits.
    #[inline(always)]
    pub(super) fn store_emission<S: Simd>(
        &mut self,
        at: usize,
        inverse_depth: Float<S>,
        emission: Vec3x<S>,
    ) {
        let values = [inverse_depth, emission.x, emission.y, emission.z];
        for (column, values) in self.aovs[INVERSE_DEPTH..].iter_mut().zip(values) {
            store(column, at, values);
        }
    }

    #[inline(always)]
    pub(super) fn load_emission<S: Simd>(&self, simd: S, at: usize) -> (Float<S>, Vec3x<S>) {
        let aovs = |i: usize| &self.aovs[INVERSE_DEPTH + i];
        let emission = Vec3x::new(
            load(simd, aovs(1), at),
            load(simd, aovs(2), at),
            load(simd, aovs(3), at),
        );
        (load(simd, aovs(0), at), emission)
    }

    #[inline(always)]
    pub(super) fn store_aovs<S: Simd>(&mut self, at: usize, aovs: [Float<S>; AOV_CHANNELS]) {
        for (column, aovs) in self.aovs.iter_mut().zip(aovs) {
            store(column, at, aovs);
        }
    }

    /// Stores zero AOVs of a surface and no shadow rays for a packet without live paths.
    #[inline(always)]
    pub(super) fn store_miss<S: Simd>(&mut self, simd: S, at: usize) {
        let zero = Float::splat(simd, 0.0);
        for column in &mut self.aovs[..=INVERSE_DEPTH] {
            store(column, at, zero);
        }
        for shadows in &mut self.shadows {
            store(&mut shadows.distance, at, zero);
        }
    }

    /// Moves the paths of `packet` in `mask` down to `to`, which is not above the packet's position, with
    /// all columns needed between hit and shading. Returns the position after them.
    #[inline(always)]
    pub(super) fn keep<S: Simd>(
        &mut self,
        simd: S,
        packet: StreamPacket,
        mask: Mask<S>,
        to: usize,
    ) -> usize {
        let count = mask.to_bitmask().count_ones() as usize;
        // Fast path before the first terminated path: nothing moves.
        if count == LANES && to == packet.at {
            return to + LANES;
        }
        let triples = [
            &mut self.origin,
            &mut self.direction,
            &mut self.beta,
            &mut self.radiance,
        ];
        for column in triples.into_iter().flat_map(|triple| &mut triple.0) {
            pack_floats(simd, column, packet.at, mask, to);
        }
        for column in [&mut self.pdf, &mut self.distance] {
            pack_floats(simd, column, packet.at, mask, to);
        }
        // Compaction costs in proportion to the columns, so that unused ones are skipped.
        if self.has_sampled_pdf {
            pack_floats(simd, &mut self.sampled_pdf, packet.at, mask, to);
        }
        for column in [
            &mut self.primitive,
            &mut self.pixel,
            &mut self.sample,
            &mut self.slot,
        ] {
            pack_words(simd, column, packet.at, mask, to);
        }
        to + count
    }
}

impl Shadows {
    fn new(rows: usize) -> Self {
        Self {
            origin: Triple::new(rows),
            direction: Triple::new(rows),
            distance: vec![0.0; rows].into_boxed_slice(),
            light: vec![0; rows].into_boxed_slice(),
            radiance: Triple::new(rows),
        }
    }
}

impl Triple {
    fn new(rows: usize) -> Self {
        Self(std::array::from_fn(|_| vec![0.0; rows].into_boxed_slice()))
    }

    #[inline(always)]
    pub(super) fn load<S: Simd>(&self, simd: S, at: usize) -> Vec3x<S> {
        let [x, y, z] = &self.0;
        Vec3x::new(load(simd, x, at), load(simd, y, at), load(simd, z, at))
    }

    #[inline(always)]
    pub(super) fn store<S: Simd>(&mut self, at: usize, v: Vec3x<S>) {
        let [x, y, z] = &mut self.0;
        store(x, at, v.x);
        store(y, at, v.y);
        store(z, at, v.z);
    }
}

#[inline(always)]
pub(super) fn load<S: Simd>(simd: S, column: &[f32], at: usize) -> Float<S> {
    Float::from_slice(simd, &column[at..at + LANES])
}

#[inline(always)]
pub(super) fn store<S: Simd>(column: &mut [f32], at: usize, values: Float<S>) {
    values.store_slice(&mut column[at..at + LANES]);
}

#[inline(always)]
pub(super) fn load_words<S: Simd>(simd: S, column: &[u32], at: usize) -> Word<S> {
    Word::from_slice(simd, &column[at..at + LANES])
}

#[inline(always)]
pub(super) fn store_words<S: Simd>(column: &mut [u32], at: usize, values: Word<S>) {
    values.store_slice(&mut column[at..at + LANES]);
}

/// Packs a packet in halves: each takes one shuffle, where packing all 16 lanes takes many.
#[inline(always)]
fn pack_floats<S: Simd>(simd: S, column: &mut [f32], at: usize, mask: Mask<S>, to: usize) {
    let (low_mask, high_mask): (mask32x8<S>, mask32x8<S>) = simd.split_mask32x16(mask);
    let (low, high): (f32x8<S>, f32x8<S>) = load(simd, column, at).split();
    // Each store writes a full half and may overwrite beyond the kept paths, but never beyond at + 16: that
    // range has been loaded already, or the next packet's store overwrites it.
    let middle = to + low_mask.to_bitmask().count_ones() as usize;
    low.compress(low_mask)
        .store_slice(&mut column[to..to + LANES / 2]);
    high.compress(high_mask)
        .store_slice(&mut column[middle..middle + LANES / 2]);
}

#[inline(always)]
fn pack_words<S: Simd>(simd: S, column: &mut [u32], at: usize, mask: Mask<S>, to: usize) {
    let (low_mask, high_mask): (mask32x8<S>, mask32x8<S>) = simd.split_mask32x16(mask);
    let (low, high): (u32x8<S>, u32x8<S>) = load_words(simd, column, at).split();
    let middle = to + low_mask.to_bitmask().count_ones() as usize;
    low.compress(low_mask)
        .store_slice(&mut column[to..to + LANES / 2]);
    high.compress(high_mask)
        .store_slice(&mut column[middle..middle + LANES / 2]);
}
