//! Codec of particles: 6 bytes a position, or what has changed since the request before.
//!
//! ```text
//! whole: position − position of the particle before, 16 bits each of x, y, z
//! delta: a bit for each particle, whether it moved; for those that did,
//!        displacement − displacement of the last that moved
//!        └──▶ zigzag (d ↦ 2d xor d >> 15) ──▶ planes: high bytes of x, y, z, then low bytes
//!             ──▶ zstd, if that is shorter
//! ```
//! Adjacent particles move alike, so the displacements of neighbours differ by little. Both ends remember the
//! particles of the last request of their connection, in the order of its control stream: no acknowledgement
//! is waited for, and further requests for the same frame cost a few bytes.

use std::borrow::Cow;
use std::ops::RangeInclusive;

use carom_tracer::ParticleCloud;
use glam::{I16Vec3, U16Vec3};
use zstd::bulk::Compressor;

use crate::error::{EMPTY, Reason};
use crate::message::{CodedCloud, CodedParticles, RequestId};
use crate::tile_codec::{NO_STORAGE, check_frame, undecompressed};

/// Flag of a cloud whose planes are one zstd frame.
const ZSTD: u8 = 1;
/// Flag of a cloud coded against the reference's cloud of the same index. Without planes the two are equal.
const DELTA: u8 = 2;
/// Level 1 is 30 times as fast as level 3, for a twentieth more bytes.
const ZSTD_LEVEL: i32 = 1;
/// Maximum expansion of planes over their zstd frame, unless they have at most [`EXPANSION_FREE_BYTES`].
const EXPANSION_MAX: usize = 16;
const EXPANSION_FREE_BYTES: usize = 16 * 1024;
/// Bytes of a position: three 16-bit coordinates.
const PLACE_BYTES: usize = 6;

/// Encoder of particles at the sending end of a connection.
#[derive(Default)]
pub struct ParticleEncoder {
    /// Created for the first particles: most connections have none.
    zstd: Option<Compressor<'static>>,
    planes: Vec<u8>,
    last: Option<(RequestId, Vec<ParticleCloud>)>,
}

impl ParticleEncoder {
    /// Encodes the particles of the next request. Call [`ParticleEncoder::remember`] once it has been sent.
    pub fn encode(&mut self, clouds: &[ParticleCloud]) -> CodedParticles {
        // Taken out while the clouds are encoded, which borrows the encoder mutably.
        let last = self.last.take();
        let before = last.as_ref().map_or(&[][..], |(_, clouds)| clouds);
        let coded = clouds.iter().enumerate().map(|(index, cloud)| {
            let fits = |before: &&ParticleCloud| {
                // Positions are fractions of the box: in another box equal numbers are other positions.
                let is_same_box = before.min == cloud.min && before.max == cloud.max;
                is_same_box && before.places.len() == cloud.places.len()
            };
            self.encode_cloud(cloud, before.get(index).filter(fits))
        });
        let coded: Vec<_> = coded.collect();
        let is_delta = |cloud: &CodedCloud| cloud.places[0] & DELTA != 0;
        let reference = last.as_ref().filter(|_| coded.iter().any(is_delta));
        let reference = reference.map(|(id, _)| *id);
        self.last = last;
        CodedParticles {
            reference,
            clouds: coded,
        }
    }

    /// Stores the particles of the request that was sent last, as the next one's reference.
    pub fn remember(&mut self, request: RequestId, clouds: Vec<ParticleCloud>) {
        self.last = Some((request, clouds));
    }

    fn encode_cloud(
        &mut self,
        cloud: &ParticleCloud,
        before: Option<&ParticleCloud>,
    ) -> CodedCloud {
        self.planes.clear();
        match before {
            Some(before) if before.places == cloud.places => {}
            Some(before) => delta_planes(&before.places, &cloud.places, &mut self.planes),
            None => whole_planes(&cloud.places, &mut self.planes),
        }
        let flags = if before.is_some() { DELTA } else { 0 };
        CodedCloud {
            material: cloud.material,
            radius_m: cloud.radius_m,
            form: cloud.form,
            min: cloud.min,
            max: cloud.max,
            count: cloud.places.len() as u32,
            places: self.compress(flags),
        }
    }

    /// The flags, then the planes, compressed if that is shorter.
    fn compress(&mut self, flags: u8) -> Vec<u8> {
        // The buffer for zstd is one byte shorter than the planes, so that zstd fails if it gains nothing.
        let mut places = vec![0; self.planes.len().max(1)];
        places[0] = flags | ZSTD;
        let new = || Compressor::new(ZSTD_LEVEL).expect("memory for a zstd context");
        let zstd = self.zstd.get_or_insert_with(new);
        match zstd.compress_to_buffer(&self.planes, &mut places[1..]) {
            Ok(length) if may_expand(length, self.planes.len()) => places.truncate(1 + length),
            _ => {
                places.truncate(1);
                places[0] = flags;
                places.extend_from_slice(&self.planes);
            }
        }
        places
    }
}

/// Decoder of particles at the receiving end of a connection.
#[derive(Debug, Default)]
pub struct ParticleDecoder {
    last: Option<(RequestId, Vec<ParticleCloud>)>,
}

impl ParticleDecoder {
    /// Decodes the particles of a request. Call [`ParticleDecoder::remember`] if it came in order.
    ///
    /// # Errors
    /// The rule that they break: planes that do not match the number of particles, or a reference other than
    /// the last request. The number itself has been checked by the request's validation.
    pub fn decode(&self, coded: &CodedParticles) -> Result<Vec<ParticleCloud>, Reason> {
        let before: &[ParticleCloud] = match (coded.reference, &self.last) {
            (None, _) => &[],
            (Some(reference), Some((last, clouds))) if reference == *last => clouds,
            (Some(RequestId(id)), _) => return Err(missing_reference(id)),
        };
        let clouds = coded.clouds.iter().enumerate();
        clouds
            .map(|(index, cloud)| decode_cloud(cloud, before.get(index)))
            .collect()
    }

    /// Stores the particles of the request that came last, as the next one's reference.
    pub fn remember(&mut self, request: RequestId, clouds: &[ParticleCloud]) {
        self.last = Some((request, clouds.to_vec()));
    }
}

fn decode_cloud(
    coded: &CodedCloud,
    before: Option<&ParticleCloud>,
) -> Result<ParticleCloud, Reason> {
    let count = coded.count as usize;
    let Some((&flags, planes)) = coded.places.split_first() else {
        return Err(EMPTY.into());
    };
    if flags > (ZSTD | DELTA) {
        return Err(NO_STORAGE.into());
    }
    let before = before.map(|before| &before.places[..]);
    let before = match flags & DELTA {
        0 => None,
        _ => Some(before.filter(|before| before.len() == count)),
    };
    let places = match before {
        Some(None) => None,
        Some(Some(before)) if planes.is_empty() => Some(before.to_vec()),
        Some(Some(before)) => {
            // The mask tells how many displacements follow, but is compressed with them: only bounds are
            // known yet.
            let mask_bytes = count.div_ceil(8);
            let sizes = mask_bytes..=mask_bytes + PLACE_BYTES * count;
            places_after(before, &stored(flags, planes, &sizes)?)
        }
        None => {
            let size = PLACE_BYTES * count;
            whole_places(count, &stored(flags, planes, &(size..=size))?)
        }
    };
    let places = places
        .ok_or_else(|| format!("its {count} particles are too many, or other bytes are theirs"))?;
    Ok(ParticleCloud {
        material: coded.material,
        radius_m: coded.radius_m,
        form: coded.form,
        min: coded.min,
        max: coded.max,
        places,
    })
}

fn missing_reference(id: u64) -> Reason {
    format!(
        "its particles are coded against request {id}, which is not the last one with particles"
    )
    .into()
}

fn expanded(bytes: usize) -> Reason {
    format!("its particles become {bytes} bytes of too few: store them").into()
}

/// The uncompressed planes, whose length must be one of `sizes`.
fn stored<'a>(
    flags: u8,
    planes: &'a [u8],
    sizes: &RangeInclusive<usize>,
) -> Result<Cow<'a, [u8]>, Reason> {
    if flags & ZSTD == 0 {
        return Ok(Cow::Borrowed(planes));
    }
    let size = check_frame(planes, sizes)?;
    // Checked before memory is allocated for the planes.
    if !may_expand(planes.len(), size) {
        return Err(expanded(size));
    }
    let mut bytes = vec![0; size];
    let length = zstd::bulk::decompress_to_buffer(planes, &mut bytes[..]);
    let length = length.map_err(|why| undecompressed(&why))?;
    bytes.truncate(length);
    Ok(Cow::Owned(bytes))
}

/// Whether `compressed` bytes of zstd may expand to `size`. Without this bound a few bytes of a hostile
/// player would occupy the network thread of a node for a millisecond.
fn may_expand(compressed: usize, size: usize) -> bool {
    size <= EXPANSION_FREE_BYTES.max(EXPANSION_MAX * compressed)
}

fn whole_planes(places: &[U16Vec3], planes: &mut Vec<u8>) {
    let mut last = U16Vec3::ZERO;
    let differences = places.iter().map(|place| {
        let difference = place.wrapping_sub(last);
        last = *place;
        fold(difference)
    });
    push_planes(&differences.collect::<Vec<_>>(), planes);
}

fn whole_places(count: usize, planes: &[u8]) -> Option<Vec<U16Vec3>> {
    let mut last = U16Vec3::ZERO;
    let places = read_planes(count, planes)?.map(|folded| {
        last = last.wrapping_add(unfold(folded));
        last
    });
    Some(places.collect())
}

fn delta_planes(before: &[U16Vec3], places: &[U16Vec3], planes: &mut Vec<u8>) {
    let mut mask = vec![0; places.len().div_ceil(8)];
    let mut last = U16Vec3::ZERO;
    let mut differences = Vec::new();
    for (index, (place, before)) in places.iter().zip(before).enumerate() {
        let way = place.wrapping_sub(*before);
        if way != U16Vec3::ZERO {
            mask[index / 8] |= 1 << (index % 8);
            differences.push(fold(way.wrapping_sub(last)));
            last = way;
        }
    }
    planes.append(&mut mask);
    push_planes(&differences, planes);
}

/// Positions from a mask and planes. Mask bits behind the last particle are ignored.
fn places_after(before: &[U16Vec3], planes: &[u8]) -> Option<Vec<U16Vec3>> {
    let (mask, planes) = planes.split_at_checked(before.len().div_ceil(8))?;
    let has_moved = |index: usize| mask[index / 8] >> (index % 8) & 1 == 1;
    let moved = (0..before.len()).filter(|index| has_moved(*index)).count();
    let mut differences = read_planes(moved, planes)?;
    let mut way = U16Vec3::ZERO;
    let places = before.iter().enumerate().map(|(index, before)| {
        let difference = has_moved(index).then(|| differences.next()).flatten();
        let Some(folded) = difference else {
            return *before;
        };
        way = way.wrapping_add(unfold(folded));
        before.wrapping_add(way)
    });
    Some(places.collect())
}

/// Appends the high bytes of x, of y and of z, then the low bytes.
fn push_planes(numbers: &[U16Vec3], planes: &mut Vec<u8>) {
    for shift in [8, 0] {
        for axis in 0..3 {
            planes.extend(numbers.iter().map(|number| (number[axis] >> shift) as u8));
        }
    }
}

/// The numbers in `count` entries of each plane; `None` if the planes have another length.
fn read_planes(count: usize, planes: &[u8]) -> Option<impl Iterator<Item = U16Vec3>> {
    if planes.len() != PLACE_BYTES * count {
        return None;
    }
    let byte = move |plane: usize, index: usize| u16::from(planes[plane * count + index]);
    let number = move |axis: usize, index: usize| byte(axis, index) << 8 | byte(axis + 3, index);
    Some((0..count).map(move |index| U16Vec3::from([0, 1, 2].map(|axis| number(axis, index)))))
}

/// Zigzag code: small numbers of either sign become small unsigned ones, so that high bytes are mostly 0.
fn fold(difference: U16Vec3) -> U16Vec3 {
    let signs: I16Vec3 = difference.as_i16vec3() >> 15i16;
    (difference << 1u16) ^ signs.as_u16vec3()
}

/// The inverse of [`fold`].
fn unfold(folded: U16Vec3) -> U16Vec3 {
    let signs = U16Vec3::ZERO.wrapping_sub(folded & U16Vec3::ONE);
    (folded >> 1u16) ^ signs
}

#[cfg(test)]
mod tests {
    use carom_tracer::{Material, ParticleForm};
    use glam::Vec3;

    use super::*;

    fn cloud(places: Vec<U16Vec3>) -> ParticleCloud {
        ParticleCloud {
            material: Material::grey(0.5),
            radius_m: 1e-3,
            form: ParticleForm::Balls,
            min: Vec3::ZERO,
            max: Vec3::ONE,
            places,
        }
    }

    /// Positions that repeat, that are far apart and that lie at both ends of the range.
    fn places(count: usize, seed: u32) -> Vec<U16Vec3> {
        let place = |index: usize| {
            let [x, y, z, edge] = carom_tracer::sampling::uniforms(index as u32, seed, 1, 2);
            let scale = if edge < 0.1 { 1e9 } else { 65535.0 };
            (Vec3::new(x, y, z) * scale).as_u16vec3()
        };
        (0..count).map(place).collect()
    }

    #[test]
    fn particles_come_back_as_they_were() {
        let (mut encoder, mut decoder) = (ParticleEncoder::default(), ParticleDecoder::default());
        let random = places(1001, 1);
        let mut some_moved = random.clone();
        for place in some_moved.iter_mut().step_by(7) {
            *place = place.wrapping_add(U16Vec3::new(3, 65_530, 0));
        }
        let frames = [
            vec![],
            vec![cloud(random.clone())],
            vec![cloud(random.clone())],
            vec![cloud(some_moved.clone()), cloud(vec![])],
            vec![cloud(places(1001, 2)), cloud(places(3, 4))],
            vec![cloud(places(1000, 2)), cloud(places(3, 4))],
            vec![cloud(some_moved)],
        ];
        for (clouds, id) in frames.into_iter().zip(1..) {
            let coded = encoder.encode(&clouds);
            encoder.remember(RequestId(id), clouds.clone());
            let decoded = decoder.decode(&coded).expect("what was encoded");
            assert_eq!(decoded, clouds, "frame {id}");
            decoder.remember(RequestId(id), &decoded);
        }
    }

    #[test]
    fn what_did_not_move_is_free() {
        let mut encoder = ParticleEncoder::default();
        let clouds = vec![cloud(places(20_000, 1))];
        let bytes = |coded: &CodedParticles| coded.clouds[0].places.len();
        let whole = encoder.encode(&clouds);
        assert!(bytes(&whole) <= 1 + 6 * 20_000);
        encoder.remember(RequestId(1), clouds.clone());
        assert_eq!(bytes(&encoder.encode(&clouds)), 1);
        let mut moved = clouds;
        for place in &mut moved[0].places[500..600] {
            *place = place.wrapping_add(U16Vec3::new(40, 50, 60));
        }
        assert!(bytes(&encoder.encode(&moved)) < 200);
    }

    #[test]
    fn particles_that_do_not_fit_are_refused() {
        let mut encoder = ParticleEncoder::default();
        let clouds = vec![cloud(places(100, 1))];
        let whole = encoder.encode(&clouds);
        encoder.remember(RequestId(1), clouds.clone());
        let delta = encoder.encode(&[cloud(places(100, 2))]);
        let mut decoder = ParticleDecoder::default();
        let missing = Err(missing_reference(1));
        assert_eq!(decoder.decode(&delta), missing);
        decoder.remember(RequestId(2), &clouds);
        assert_eq!(decoder.decode(&delta), missing);
        let changed = |change: &dyn Fn(&mut CodedCloud)| {
            let mut coded = whole.clone();
            change(&mut coded.clouds[0]);
            decoder.decode(&coded)
        };
        assert_eq!(changed(&|cloud| cloud.places.clear()), Err(EMPTY.into()));
        assert_eq!(
            changed(&|cloud| cloud.places[0] = 4),
            Err(NO_STORAGE.into())
        );
        assert!(changed(&|cloud| cloud.count = 1 << 30).is_err());
        assert!(changed(&|cloud| cloud.count += 1).is_err());
        assert!(changed(&|cloud| cloud.places.truncate(300)).is_err());
        assert!(changed(&|cloud| cloud.places[0] |= DELTA).is_err());
    }

    #[test]
    fn few_bytes_cost_little() {
        let lying = vec![U16Vec3::ONE; 20_000];
        let coded = ParticleEncoder::default().encode(&[cloud(lying)]);
        let mut bomb = coded.clone();
        assert_eq!(
            bomb.clouds[0].places[0], 0,
            "it is stored: it would be too short"
        );
        let planes = bomb.clouds[0].places.split_off(1);
        bomb.clouds[0].places[0] = ZSTD;
        let frame = zstd::bulk::compress(&planes, ZSTD_LEVEL).unwrap();
        bomb.clouds[0].places.extend(frame);
        let refused = ParticleDecoder::default().decode(&bomb).unwrap_err();
        assert_eq!(refused, expanded(120_000));
    }

    /// Each truncation and each changed byte is refused or decodes to particles of the stated number.
    #[test]
    fn broken_bytes_neither_panic_nor_grow() {
        let mut encoder = ParticleEncoder::default();
        let mut decoder = ParticleDecoder::default();
        let clouds = vec![cloud(places(50, 1))];
        encoder.remember(RequestId(1), clouds.clone());
        decoder.remember(RequestId(1), &clouds);
        let mut moved = clouds.clone();
        for place in &mut moved[0].places[..30] {
            *place = place.wrapping_add(U16Vec3::ONE);
        }
        for coded in [
            ParticleEncoder::default().encode(&clouds),
            encoder.encode(&moved),
        ] {
            let bytes = coded.clouds[0].places.clone();
            for cut in 0..bytes.len() {
                for value in [0, 1, 2, 3, 0x7f, 0xff] {
                    let mut broken = coded.clone();
                    broken.clouds[0].places[cut] = value;
                    if let Ok(read) = decoder.decode(&broken) {
                        assert_eq!(read[0].places.len(), 50);
                    }
                }
                let mut broken = coded.clone();
                broken.clouds[0].places.truncate(cut);
                if let Ok(read) = decoder.decode(&broken) {
                    assert_eq!(read[0].places.len(), 50);
                }
            }
        }
    }
}
