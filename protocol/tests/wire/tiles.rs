//! Tile payloads are lossless, and no bytes harm their decoder.

use carom_protocol::PixelFormat;
use carom_protocol::tile_codec::{Decoder, Encoder, TilePixels};
use carom_tracer::Tile;
use carom_tracer::tonemap::srgb8;
use proptest::prelude::*;

use crate::any;

/// Tiles with a radiance for each pixel.
type Lit = Vec<(Tile, Vec<[f32; 3]>)>;

/// Up to four tiles of odd sizes; any bit pattern, or smooth light, or one colour.
fn lit_tiles() -> impl Strategy<Value = Lit> {
    let tile = (1..40u32, 1..20u32, 0..3u8, any::<u64>());
    prop::collection::vec(tile, 1..5).prop_map(|tiles| {
        let lit = |(width, height, kind, seed)| {
            let (x, y) = (0, 0);
            let tile = Tile {
                x,
                y,
                width,
                height,
            };
            (tile, light(kind, seed, tile.pixels()))
        };
        tiles.into_iter().map(lit).collect()
    })
}

fn light(kind: u8, mut state: u64, pixels: usize) -> Vec<[f32; 3]> {
    let mut bits = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 32) as u32
    };
    let pixel = |index: usize| match kind {
        0 => [(); 3].map(|()| f32::from_bits(bits())),
        1 => [index as f32 * 1e-3; 3].map(|l| l + (bits() & 0xff) as f32 * 1e-5),
        _ => [0.25, 0.5, 0.125],
    };
    (0..pixels).map(pixel).collect()
}

fn encode(format: PixelFormat, lit: &Lit) -> Vec<u8> {
    let tiles: Vec<(Tile, &[[f32; 3]])> = lit.iter().map(|(tile, l)| (*tile, &l[..])).collect();
    Encoder::new().encode(format, &tiles)
}

fn sizes(lit: &Lit) -> Vec<Tile> {
    lit.iter().map(|(tile, _)| *tile).collect()
}

/// What the payload must hold, by the formats' definitions.
fn expected(format: PixelFormat, lit: &Lit) -> TilePixels {
    let pixels = lit
        .iter()
        .flat_map(|(_, radiance)| radiance.iter().copied());
    match format {
        PixelFormat::Srgb8 { exposure } => {
            TilePixels::Srgb8(pixels.map(|l| srgb8(l, exposure)).collect())
        }
        PixelFormat::LinearF16 => {
            let round = |l: f32| half::f16::from_f32(l.clamp(-65504.0, 65504.0)).to_f32();
            TilePixels::Linear(pixels.map(|l| l.map(round)).collect())
        }
        PixelFormat::LinearF32 => TilePixels::Linear(pixels.collect()),
    }
}

/// Bits, because NaN differs from itself.
fn bits(pixels: &TilePixels) -> Vec<u32> {
    match pixels {
        TilePixels::Srgb8(pixels) => pixels
            .as_flattened()
            .iter()
            .copied()
            .map(u32::from)
            .collect(),
        TilePixels::Linear(pixels) => pixels.as_flattened().iter().map(|l| l.to_bits()).collect(),
    }
}

proptest! {
    #![proptest_config(any::config(300))]

    #[test]
    fn pixels_arrive_bit_for_bit(format in any::format(), lit in lit_tiles()) {
        let payload = encode(format, &lit);
        let decoded = Decoder::new().decode(format, &sizes(&lit), &payload).unwrap();
        prop_assert_eq!(bits(&decoded), bits(&expected(format, &lit)));
    }

    #[test]
    fn payload_exceeds_pixels_by_modes_and_a_byte(
        format in any::format(),
        lit in lit_tiles(),
    ) {
        let pixels: usize = lit.iter().map(|(tile, _)| tile.pixels()).sum();
        prop_assert!(encode(format, &lit).len() <= 1 + lit.len().div_ceil(2) + pixels * format.bytes());
    }

    #[test]
    fn pixels_do_not_depend_on_the_tiles_beside_them(format in any::format(), lit in lit_tiles()) {
        let (mut encoder, mut decoder) = (Encoder::new(), Decoder::new());
        let mut apart = Vec::new();
        for (tile, radiance) in &lit {
            let payload = encoder.encode(format, &[(*tile, radiance)]);
            apart.extend(bits(&decoder.decode(format, &[*tile], &payload).unwrap()));
        }
        let together = decoder.decode(format, &sizes(&lit), &encode(format, &lit)).unwrap();
        prop_assert_eq!(apart, bits(&together));
    }

    #[test]
    fn a_payload_cut_short_is_an_error(
        format in any::format(),
        lit in lit_tiles(),
        at: prop::sample::Index,
    ) {
        let payload = encode(format, &lit);
        let cut = &payload[..at.index(payload.len())];
        prop_assert!(Decoder::new().decode(format, &sizes(&lit), cut).is_err());
    }

    #[test]
    fn damaged_payloads_are_sized_right_or_errors(
        format in any::format(),
        lit in lit_tiles(),
        at: prop::sample::Index,
        bit in 0..8u8,
    ) {
        let mut payload = encode(format, &lit);
        *at.get_mut(&mut payload) ^= 1 << bit;
        let pixels: usize = lit.iter().map(|(tile, _)| tile.pixels()).sum();
        if let Ok(decoded) = Decoder::new().decode(format, &sizes(&lit), &payload) {
            prop_assert_eq!(decoded.len(), pixels);
        }
    }

    #[test]
    fn a_payload_of_other_tiles_is_an_error(format in any::format(), lit in lit_tiles()) {
        let payload = encode(format, &lit);
        let mut tiles = sizes(&lit);
        tiles[0].height += 1;
        prop_assert!(Decoder::new().decode(format, &tiles, &payload).is_err());
    }

    #[test]
    fn any_payload_is_sized_right_or_an_error(
        format in any::format(),
        start in prop_oneof![Just(vec![0]), Just(vec![1]), Just(ZSTD_START.to_vec())],
        bytes in prop::collection::vec(any::<u8>(), 0..200),
    ) {
        let (x, y, width, height) = (0, 0, 5, 3);
        let payload = [start, bytes].concat();
        let tiles = [Tile { x, y, width, height }];
        if let Ok(decoded) = Decoder::new().decode(format, &tiles, &payload) {
            prop_assert_eq!(decoded.len(), 15);
        }
    }
}

/// The header byte of compressed planes and the magic number of a zstd frame.
const ZSTD_START: [u8; 5] = [1, 0x28, 0xb5, 0x2f, 0xfd];
const FORMAT: PixelFormat = PixelFormat::Srgb8 { exposure: 1.0 };
const TILE: Tile = Tile {
    x: 0,
    y: 0,
    width: 32,
    height: 32,
};

fn refused(frame: &[u8]) -> String {
    let payload = [&[1], frame].concat();
    let decoded = Decoder::new().decode(FORMAT, &[TILE], &payload);
    decoded
        .expect_err("a payload that must be refused")
        .to_string()
}

fn good_frame() -> Vec<u8> {
    let payload = Encoder::new().encode(FORMAT, &[(TILE, &[[0.5; 3]; 1024])]);
    assert_eq!(payload[..5], ZSTD_START);
    payload[1..].to_vec()
}

#[test]
fn zstd_bomb_is_refused() {
    // A frame of unknown size whose single block repeats a byte 128 KiB (RFC 8878, RLE_Block),
    // and one that states the right size but has eight such blocks.
    let block = |last: u32| ((128 * 1024) << 3 | 1 << 1 | last).to_le_bytes();
    let unknown = [&ZSTD_START[1..], &[0x00, 0x58], &block(1)[..3], &[7]].concat();
    assert!(refused(&unknown).contains("states no size"));
    let size: u32 = 1024 * 3;
    let header = [&ZSTD_START[1..], &[0xa0], &size.to_le_bytes()[..]].concat();
    let blocks: Vec<u8> = (0..8)
        .flat_map(|index| [&block(u32::from(index == 7))[..3], &[7]].concat())
        .collect();
    refused(&[header, blocks].concat());
}

#[test]
fn bytes_beside_the_zstd_frame_are_refused() {
    let frame = good_frame();
    assert!(refused(&[&frame[..], &frame].concat()).contains("follow its end"));
    assert!(refused(&[&frame[..], &[0]].concat()).contains("follow its end"));
    let skippable = [0x50, 0x2a, 0x4d, 0x18, 1, 0, 0, 0, 9];
    assert!(refused(&[&skippable[..], &frame].concat()).contains("no zstd frame"));
    assert!(refused(&[&frame[..], &skippable].concat()).contains("follow its end"));
}

#[test]
fn zstd_dictionaries_and_old_formats_are_refused() {
    // The first bit pair of the frame header's descriptor is the size of the dictionary's id.
    let frame = good_frame();
    let with_dictionary = [&frame[..4], &[frame[4] | 1, 42], &frame[5..]].concat();
    assert!(refused(&with_dictionary).contains("dictionary"));
    let legacy = [&[0x27], &frame[1..]].concat();
    assert!(refused(&legacy).contains("no zstd frame"));
}

#[test]
fn no_tile_is_no_pixel() {
    for format in [FORMAT, PixelFormat::LinearF16, PixelFormat::LinearF32] {
        let payload = Encoder::new().encode(format, &[]);
        let pixels = Decoder::new().decode(format, &[], &payload).unwrap();
        assert!(pixels.is_empty());
    }
}
