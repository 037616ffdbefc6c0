//! Substitutes for disoccluded pixels, which a reprojected image shows and the earlier one did not.

use std::collections::HashMap;

use super::Channel;
use crate::cpu::FirstHits;

/// The pixels of a row that were found together with both neighbours, in ascending order. Pixels
/// next to a gap are left out, as they contain some of the light of what occluded it.
pub(super) fn whole_neighbourhoods(width: usize, missing: &[usize]) -> Vec<usize> {
    let mut whole = vec![true; width];
    for &x in missing {
        whole[x.saturating_sub(1)..(x + 2).min(width)].fill(false);
    }
    (0..width).filter(|x| whole[*x]).collect()
}

/// The pixel of a row that is substituted for the missing one at `x`: the nearest of `whole` with
/// the same primitive, unless it is too far away.
pub(super) fn stand_in(primitives: &[u32], whole: &[usize], x: usize) -> Option<usize> {
    let reach = (primitives.len() / STAND_IN_SHARE).max(1);
    let (before, after) = whole.split_at(whole.partition_point(|at| *at < x));
    let is_same = |at: &&usize| primitives[**at] == primitives[x];
    let before = before.iter().rev().take_while(|at| x - **at <= reach);
    let after = after.iter().take_while(|at| **at - x <= reach);
    let nearest = before.clone().find(is_same).into_iter();
    let nearest = nearest.chain(after.clone().find(is_same));
    nearest.copied().min_by_key(|at| at.abs_diff(x))
}

/// Mean colour of each primitive in an image, from every [`MEAN_STRIDE`]-th row and column.
pub(super) struct PrimitiveMeans<T, const N: usize> {
    by_primitive: HashMap<u32, [T; N]>,
    /// Mean colour of the whole image.
    whole: [T; N],
}

impl<T: Channel, const N: usize> PrimitiveMeans<T, N> {
    pub(super) fn new(hits: &FirstHits, pixels: &[[T; N]]) -> Self {
        let mut sums: HashMap<u32, ([f32; N], f32)> = HashMap::new();
        let width = (hits.size.width as usize).max(1);
        for row in (0..pixels.len()).step_by(width * MEAN_STRIDE) {
            let (primitives, pixels) = (&hits.primitive[row..][..width], &pixels[row..][..width]);
            let of_row = primitives.iter().zip(pixels).step_by(MEAN_STRIDE);
            // The map is accessed once per run of pixels of the same primitive, as other threads
            // wait for this.
            let mut run = (primitives[0], [0.0; N], 0.0);
            let mut end = |(primitive, of_run, pixels): (u32, [f32; N], f32)| {
                let (sum, count) = sums.entry(primitive).or_insert(([0.0; N], 0.0));
                add(sum, &of_run);
                *count += pixels;
            };
            for (primitive, pixel) in of_row {
                if *primitive != run.0 {
                    end(run);
                    run = (*primitive, [0.0; N], 0.0);
                }
                add(&mut run.1, &pixel.map(Channel::to_f32));
                run.2 += 1.0;
            }
            end(run);
        }
        let (mut whole, mut count) = ([0.0; N], 0.0);
        for (sum, pixels) in sums.values() {
            add(&mut whole, sum);
            count += pixels;
        }
        let mean = |sum: [f32; N], count: f32| sum.map(|sum| T::from_f32(sum / count.max(1.0)));
        Self {
            by_primitive: sums
                .into_iter()
                .map(|(id, (sum, count))| (id, mean(sum, count)))
                .collect(),
            whole: mean(whole, count),
        }
    }

    /// The mean of a primitive, or of the whole image if that does not show it.
    pub(super) fn of(&self, primitive: u32) -> [T; N] {
        *self.by_primitive.get(&primitive).unwrap_or(&self.whole)
    }
}

fn add<const N: usize>(sum: &mut [f32; N], pixel: &[f32; N]) {
    for (sum, channel) in sum.iter_mut().zip(pixel) {
        *sum += channel;
    }
}

/// A substitute is at most this fraction (1/16) of a row's width away.
const STAND_IN_SHARE: usize = 16;
/// Stride of rows and columns in [`PrimitiveMeans`].
const MEAN_STRIDE: usize = 3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn disoccluded_pixels_take_the_nearest_of_their_object() {
        let found = |primitives: &[u32], missing: &[usize], x| {
            stand_in(
                primitives,
                &whole_neighbourhoods(primitives.len(), missing),
                x,
            )
        };
        let row = |ids: [u32; 8]| ids.repeat(4);
        assert_eq!(found(&row([5, 5, 7, 7, 5, 5, 5, 5]), &[4], 4), Some(6));
        let far = [&[5; 1][..], &[7; 40], &[5; 9]].concat();
        assert_eq!(found(&far, &[0], 0), None);
        assert_eq!(found(&[5, 5], &[0, 1], 0), None);
    }
}
