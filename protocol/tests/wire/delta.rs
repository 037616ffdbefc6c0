//! Tiles told from tiles that the client holds: never wrong, whatever either end has forgotten.

use std::sync::Arc;

use carom_protocol::session::{References, SentReferences};
use carom_protocol::tile_codec::{
    Decoder, DeltaStats, Encoder, ReferenceTile, TileInput, TilePixels,
};
use carom_protocol::{
    ClientEvent, ClientSession, CodedParticles, EncodedScene, FrameId, NodeEvent, NodeSession,
    PixelFormat, PixelPrecision, PrecisionRange, RequestId, RequestReport, SceneHash, TilesDone,
    TraceRequest,
};
use carom_tracer::tonemap::srgb8;
use carom_tracer::{ImageSize, RenderSettings, SceneUpdate, Tile, TileGrid, TileRange};
use proptest::prelude::*;

use crate::any;

const TILE: Tile = Tile {
    x: 0,
    y: 0,
    width: 32,
    height: 32,
};
/// The worst error of a channel, in levels; of the lossy ones it is a mean.
const BOUNDS: [(PixelPrecision, u8); 3] = [
    (PixelPrecision::Exact, 0),
    (PixelPrecision::Within1, 1),
    (PixelPrecision::Within2, 2),
];

fn hash(mut x: u32) -> u32 {
    x = (x ^ (x >> 16)).wrapping_mul(0x7feb_352d);
    x = (x ^ (x >> 15)).wrapping_mul(0x846c_a68b);
    x ^ (x >> 16)
}

/// Soft light with a grain drawn by `seed`; `grain` 0 has none.
fn light(tile: Tile, seed: u32, grain: f32) -> Vec<[f32; 3]> {
    let pixel = |index: usize| {
        let soft = 0.2 + 0.3 * (index as f32 / tile.pixels() as f32);
        [0u32, 1, 2].map(|channel| {
            let random = hash(seed ^ hash(3 * index as u32 + channel));
            soft * (1.0 + grain * (random as f32 / u32::MAX as f32 - 0.5))
        })
    };
    (0..tile.pixels()).map(pixel).collect()
}

fn shown(radiance: &[[f32; 3]]) -> Vec<[u8; 3]> {
    radiance.iter().map(|light| srgb8(*light, 1.0)).collect()
}

struct Ends {
    encoder: Encoder,
    decoder: Decoder,
}

impl Ends {
    fn new() -> Self {
        let (encoder, decoder) = (Encoder::new(), Decoder::new());
        Self { encoder, decoder }
    }

    /// One tile there and back: bytes, what is shown, what node and client keep.
    fn send(
        &mut self,
        precision: PixelPrecision,
        radiance: &[[f32; 3]],
        sent: Option<&Arc<ReferenceTile>>,
        held: Option<&Arc<ReferenceTile>>,
    ) -> (usize, Vec<[u8; 3]>, [Arc<ReferenceTile>; 2]) {
        let input = TileInput {
            tile: TILE,
            radiance,
            reference: sent,
        };
        let (payload, mut kept) = self.encoder.encode_srgb(1.0, precision, &[input]);
        let range = PrecisionRange::only(precision);
        let decoded = self.decoder.decode_srgb(range, &[(TILE, held)], &payload);
        let mut decoded = decoded.unwrap();
        let ends = [kept.remove(0), decoded.references.remove(0)];
        (payload.len(), decoded.pixels, ends)
    }
}

fn error(a: &[[u8; 3]], b: &[[u8; 3]]) -> u8 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    pairs.map(|(a, b)| a.abs_diff(*b)).max().unwrap()
}

fn psnr(a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
    let pairs = a.as_flattened().iter().zip(b.as_flattened());
    let squares: f64 = pairs.map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * 3.0 * a.len() as f64 / squares).log10()
}

proptest! {
    #![proptest_config(any::config(60))]

    #[test]
    fn precisions_keep_their_error_bounds(
        precisions in prop::collection::vec(0..6usize, 1..8),
        seeds in prop::collection::vec(0..3u32, 8),
        grain in 0.0..0.5f32,
    ) {
        let mut ends = Ends::new();
        let mut kept: Option<[Arc<ReferenceTile>; 2]> = None;
        for (index, seed) in precisions.into_iter().zip(seeds) {
            let precision = PixelPrecision::ALL[index];
            let radiance = light(TILE, seed, grain);
            let [sent, held] = kept.as_ref().map_or([None, None], |[a, b]| [Some(a), Some(b)]);
            let (_, pixels, now) = ends.send(precision, &radiance, sent, held);
            let exact = shown(&radiance);
            match BOUNDS.iter().find(|(bound, _)| *bound == precision) {
                Some((_, bound)) => prop_assert!(error(&pixels, &exact) <= *bound),
                None => prop_assert!(psnr(&pixels, &exact) > 18.0),
            }
            kept = Some(now);
        }
    }
}

/// The light of a tile of which so many pixels of 256 have changed since `seed`.
fn changed(tile: Tile, seed: u32, pixels: u32) -> Vec<[f32; 3]> {
    let (before, after) = (light(tile, seed, 0.6), light(tile, seed + 1, 0.6));
    let pairs = before.into_iter().zip(after).zip(0..);
    let pick = |((before, after), index)| {
        let changes = hash(seed ^ hash(index)) % 256 < pixels;
        if changes { after } else { before }
    };
    pairs.map(pick).collect()
}

/// An encoder that has seen all pixels change for a while.
fn busy_encoder() -> Encoder {
    let mut encoder = Encoder::new();
    let mut kept = None;
    for seed in 0..20 {
        let radiance = light(TILE, seed, 0.6);
        let input = TileInput {
            tile: TILE,
            radiance: &radiance,
            reference: kept.as_ref(),
        };
        let (_, sent) = encoder.encode_srgb(1.0, PixelPrecision::Exact, &[input; 8]);
        kept = sent.into_iter().next();
    }
    encoder
}

/// A message of changed tiles, what it shows, and its tiles as node and client keep them.
struct Told {
    payload: Vec<u8>,
    pixels: Vec<[u8; 3]>,
    sent: Vec<Arc<ReferenceTile>>,
    kept: Vec<Arc<ReferenceTile>>,
}

fn tell(
    encoder: &mut Encoder,
    precision: PixelPrecision,
    tiles: &[(Tile, Vec<[f32; 3]>)],
    held: &[Arc<ReferenceTile>],
) -> Told {
    let inputs = tiles.iter().zip(held);
    let inputs: Vec<TileInput> = inputs
        .map(|((tile, radiance), held)| TileInput {
            tile: *tile,
            radiance,
            reference: Some(held),
        })
        .collect();
    let (payload, sent) = encoder.encode_srgb(1.0, precision, &inputs);
    let told: Vec<_> = tiles
        .iter()
        .zip(held)
        .map(|((tile, _), held)| (*tile, Some(held)))
        .collect();
    let range = PrecisionRange::only(precision);
    let decoded = Decoder::new().decode_srgb(range, &told, &payload).unwrap();
    Told {
        payload,
        pixels: decoded.pixels,
        sent,
        kept: decoded.references,
    }
}

fn sent_whole(precision: PixelPrecision, tile: Tile, radiance: &[[f32; 3]]) -> Arc<ReferenceTile> {
    let input = TileInput {
        tile,
        radiance,
        reference: None,
    };
    let (_, mut kept) = Encoder::new().encode_srgb(1.0, precision, &[input]);
    kept.remove(0)
}

proptest! {
    #![proptest_config(any::config(60))]

    /// As changes while few pixels do, as planes when the encoder has seen many.
    #[test]
    fn range_coder_and_planes_give_the_same_pixels(
        sizes in prop::collection::vec((1..70u32, 1..40u32, 0..257u32), 1..5),
        seed: u32,
        before in 0..3usize,
        after in 0..3usize,
    ) {
        let seed = seed / 2;
        let tile = |width, height| Tile { x: 0, y: 0, width, height };
        let tiles: Vec<(Tile, Vec<[f32; 3]>)> = sizes
            .iter()
            .map(|&(width, height, pixels)| {
                let tile = tile(width, height);
                (tile, changed(tile, seed, pixels))
            })
            .collect();
        let held: Vec<Arc<ReferenceTile>> = tiles
            .iter()
            .map(|(tile, _)| sent_whole(PixelPrecision::ALL[before], *tile, &light(*tile, seed, 0.6)))
            .collect();
        let (precision, bound) = BOUNDS[after];
        let changes = tell(&mut Encoder::new(), precision, &tiles, &held);
        let planes = tell(&mut busy_encoder(), precision, &tiles, &held);
        let storage = [&changes, &planes].map(|told| told.payload[0] & 3);
        prop_assert!(storage[0] == 3 && storage[1] < 2, "{:?}", storage);
        prop_assert_eq!(&changes.pixels, &planes.pixels);
        prop_assert_eq!(changes.sent, changes.kept);
        let exact: Vec<[u8; 3]> = tiles.iter().flat_map(|(_, light)| shown(light)).collect();
        prop_assert!(error(&changes.pixels, &exact) <= bound);
    }
}

#[test]
fn range_coding_a_few_changes_beats_planes() {
    let seeds = [10, 20, 30, 40, 50, 60, 70, 80];
    let held = seeds.map(|seed| sent_whole(PixelPrecision::Exact, TILE, &light(TILE, seed, 0.6)));
    let bytes = |encoder: &mut Encoder, pixels| {
        let tiles = seeds.map(|seed| (TILE, changed(TILE, seed, pixels)));
        let told = tell(encoder, PixelPrecision::Exact, &tiles, &held);
        told.payload.len()
    };
    for (pixels, percent) in [(2, 75), (13, 90)] {
        let changes = bytes(&mut Encoder::new(), pixels);
        let planes = bytes(&mut busy_encoder(), pixels);
        assert!(
            100 * changes <= percent * planes,
            "{pixels}: {changes} of {planes} bytes"
        );
    }
}

#[test]
fn still_pictures_are_range_coded_again() {
    let mut encoder = busy_encoder();
    let held = vec![sent_whole(PixelPrecision::Exact, TILE, &light(TILE, 7, 0.6)); 8];
    let tiles = vec![(TILE, light(TILE, 7, 0.6)); 8];
    let mut way = || tell(&mut encoder, PixelPrecision::Exact, &tiles, &held).payload[0] & 3;
    let ways: Vec<u8> = (0..400).map(|_| way()).collect();
    assert!(ways.is_sorted(), "{ways:?}");
    assert_eq!([ways[0], ways[399]], [0, 3]);
}

/// Reading changes takes longer, the more there are: of many, as the camera turns, so many messages are
/// planes that a decoder keeps its rate.
#[test]
fn more_changes_mean_fewer_range_coded_messages() {
    let held = vec![sent_whole(PixelPrecision::Exact, TILE, &light(TILE, 7, 0.6)); 8];
    let told_by_changes = |pixels| {
        let tiles = vec![(TILE, changed(TILE, 7, pixels)); 8];
        let mut encoder = Encoder::new();
        let mut ways = || tell(&mut encoder, PixelPrecision::Exact, &tiles, &held).payload[0] & 3;
        let ways: Vec<u8> = (0..600).map(|_| ways()).skip(300).collect();
        ways.iter().filter(|way| **way == 3).count()
    };
    let shares = [6, 24, 48, 256].map(told_by_changes);
    assert_eq!(shares[0], 300);
    assert!(shares.is_sorted_by(|less, more| less > more), "{shares:?}");
    assert!(shares[3] < 15, "{shares:?}");
}

#[test]
fn delta_stats_count_referenced_and_changed_pixels() {
    let mut encoder = Encoder::new();
    let mut send = |precision, radiance: &[[f32; 3]], reference: Option<&Arc<ReferenceTile>>| {
        let input = TileInput {
            tile: TILE,
            radiance,
            reference,
        };
        let (_, kept) = encoder.encode_srgb(1.0, precision, &[input]);
        let DeltaStats {
            referenced,
            changed,
            intra,
        } = encoder.delta_stats();
        ([referenced, changed, intra], kept[0].clone())
    };
    let (before, after) = (light(TILE, 7, 0.6), changed(TILE, 7, 20));
    let pairs = shown(&before).into_iter().zip(shown(&after));
    let differ = pairs.filter(|(before, after)| before != after).count();
    for precision in [PixelPrecision::Exact, PixelPrecision::Lossy75] {
        let (delta, first) = send(precision, &before, None);
        assert_eq!(delta, [0, 0, 1024]);
        let (delta, _) = send(precision, &after, Some(&first));
        assert_eq!(delta, [1024, differ, 0]);
    }
    // Nothing can be told from a JPEG tile but what has changed in it.
    let (_, lossy) = send(PixelPrecision::Lossy75, &before, None);
    let (delta, _) = send(PixelPrecision::Exact, &after, Some(&lossy));
    assert_eq!(delta, [1024, differ, 1024]);
}

#[test]
fn unchanged_tile_takes_few_bytes() {
    for precision in PixelPrecision::ALL {
        let mut ends = Ends::new();
        let radiance = light(TILE, 1, 0.4);
        let (first, before, [sent, held]) = ends.send(precision, &radiance, None, None);
        let (bytes, after, _) = ends.send(precision, &radiance, Some(&sent), Some(&held));
        assert_eq!(before, after);
        assert!(bytes < 10, "{precision}: {bytes} bytes after {first}");
    }
}

#[test]
fn coarser_precision_keeps_finer_pixels() {
    let mut ends = Ends::new();
    let radiance = light(TILE, 1, 0.4);
    let (_, exact, [sent, held]) = ends.send(PixelPrecision::Exact, &radiance, None, None);
    let (bytes, pixels, _) =
        ends.send(PixelPrecision::Lossy50, &radiance, Some(&sent), Some(&held));
    assert_eq!((bytes < 10, pixels), (true, exact));
}

#[test]
fn coarser_precision_than_asked_is_an_error() {
    let radiance = light(TILE, 1, 0.1);
    for precision in &PixelPrecision::ALL[1..] {
        let input = TileInput {
            tile: TILE,
            radiance: &radiance,
            reference: None,
        };
        let (payload, _) = Encoder::new().encode_srgb(1.0, *precision, &[input]);
        let range = PrecisionRange::EXACT;
        let refused = Decoder::new().decode_srgb(range, &[(TILE, None)], &payload);
        let why = refused.unwrap_err().to_string();
        assert!(why.contains("exact was asked for"), "{why}");
    }
}

#[test]
fn missing_reference_is_an_error() {
    let mut ends = Ends::new();
    let radiance = light(TILE, 1, 0.1);
    for precision in PixelPrecision::ALL {
        let (_, _, [sent, _]) = ends.send(precision, &radiance, None, None);
        let input = TileInput {
            tile: TILE,
            radiance: &radiance,
            reference: Some(&sent),
        };
        let (payload, _) = ends.encoder.encode_srgb(1.0, precision, &[input]);
        let range = PrecisionRange::only(precision);
        let refused = ends.decoder.decode_srgb(range, &[(TILE, None)], &payload);
        assert!(refused.unwrap_err().to_string().contains("not held"));
    }
}

const GRID: TileGrid = TileGrid::new(ImageSize::new(96, 80), 32);

/// Tiles as the client's screen has them.
type Shown = Vec<(TileRange, Vec<[u8; 3]>)>;

/// Two sessions and what the node remembers.
struct FramePair {
    client: ClientSession,
    node: NodeSession,
    sent: SentReferences,
    request: u64,
    encoder: Encoder,
}

impl FramePair {
    fn new() -> Self {
        let mut client = ClientSession::new();
        let scene = any::balls(2);
        client
            .set_scene(&EncodedScene::new(&scene).unwrap())
            .unwrap();
        let mut pair = Self {
            client,
            node: NodeSession::new(any::node_info("node")),
            sent: SentReferences::default(),
            request: 0,
            encoder: Encoder::new(),
        };
        pair.exchange(0, |_| false);
        pair
    }

    fn ask(&mut self, tiles: TileRange, precision: PixelPrecision) {
        self.request += 1;
        let request = TraceRequest {
            frame: FrameId(self.request),
            id: RequestId(self.request),
            scene: SceneHash::of(&any::balls(2)),
            update: SceneUpdate::default(),
            grid: GRID,
            tiles,
            settings: RenderSettings::default(),
            format: PixelFormat::Srgb8 { exposure: 1.0 },
            precision: PrecisionRange::only(precision),
            references: Vec::new(),
            particles: CodedParticles::default(),
        };
        self.client.trace(request).unwrap();
    }

    /// Carries all packets; those of tiles that `lost` chooses never arrive. What the client
    /// shows, and the bytes of all tiles.
    fn exchange(&mut self, seed: u32, mut lost: impl FnMut(usize) -> bool) -> (Shown, usize) {
        while let Some(packet) = self.client.poll_transmit() {
            if let Some(NodeEvent::Trace { request, .. }) = self.node.handle(packet).unwrap() {
                self.answer(&request, seed);
            }
        }
        let (mut pictures, mut bytes, mut index) = (Vec::new(), 0, 0);
        while let Some(packet) = self.node.poll_transmit() {
            let tiles = packet.channel == carom_protocol::Channel::Tiles;
            if tiles {
                bytes += packet.bytes.len();
                index += 1;
                if lost(index) {
                    continue;
                }
            }
            for event in self.client.handle(packet).unwrap() {
                if let ClientEvent::Tiles { tiles, pixels, .. } = event {
                    let TilePixels::Srgb8(pixels) = pixels else {
                        panic!("sRGB was asked for");
                    };
                    pictures.push((tiles, pixels));
                }
            }
        }
        (pictures, bytes)
    }

    fn answer(&mut self, request: &TraceRequest, seed: u32) {
        for first in request.tiles.indices().step_by(2) {
            let count = 2.min(request.tiles.end() - first);
            let part = TileRange { first, count };
            let references: References = self.sent.references(request, part);
            let radiance: Vec<_> = GRID
                .tiles(part)
                .map(|tile| light(tile, seed, 0.3))
                .collect();
            let inputs: Vec<TileInput> = GRID
                .tiles(part)
                .zip(&radiance)
                .zip(&references)
                .map(|((tile, radiance), reference)| TileInput {
                    tile,
                    radiance,
                    reference: reference.as_ref(),
                })
                .collect();
            let precision = request.precision.finest;
            let (pixels, kept) = self.encoder.encode_srgb(1.0, precision, &inputs);
            self.sent.insert(request, part, kept);
            let done = TilesDone {
                request: request.id,
                tiles: part,
                busy_micros: 1,
                times: carom_protocol::NodeTimes::default(),
                dropped_samples: 0,
                pixels,
            };
            self.node.tiles(done).unwrap();
        }
        let report = RequestReport {
            request: request.id,
            ..RequestReport::default()
        };
        self.node.request_done(report).unwrap();
    }
}

proptest! {
    #![proptest_config(any::config(60))]

    /// Whatever is lost on the way, forgotten at the node or moved between nodes.
    #[test]
    fn lossy_network_never_corrupts_pixels(
        steps in prop::collection::vec((0..9u32, 1..9u32, 0..3u32, any::<u8>(), any::<bool>()), 1..20),
    ) {
        let mut pair = FramePair::new();
        for (first, count, seed, losses, forgets) in steps {
            if forgets {
                pair.sent = SentReferences::default();
            }
            let count = count.min(GRID.len() - first);
            pair.ask(TileRange { first, count }, PixelPrecision::Exact);
            let (pictures, _) = pair.exchange(seed, |index| losses >> (index % 8) & 1 != 0);
            for (tiles, pixels) in pictures {
                let traced = GRID.tiles(tiles).flat_map(|tile| shown(&light(tile, seed, 0.3)));
                prop_assert_eq!(traced.collect::<Vec<_>>(), pixels);
            }
            // Lost tiles leave their request open.
            pair.client.cancel_before(FrameId(u64::MAX)).unwrap();
            let (late, _) = pair.exchange(seed, |_| false);
            prop_assert!(late.is_empty());
        }
    }
}

#[test]
fn unchanged_frames_cost_few_bytes_a_tile() {
    let mut pair = FramePair::new();
    let bytes: Vec<usize> = (0..20)
        .map(|_| {
            pair.ask(GRID.all(), PixelPrecision::Within1);
            pair.exchange(7, |_| false).1
        })
        .collect();
    assert!(bytes[0] > 1000, "{bytes:?}");
    let few = 9 * GRID.len() as usize;
    assert!(bytes[1..].iter().all(|bytes| *bytes <= few), "{bytes:?}");
}
