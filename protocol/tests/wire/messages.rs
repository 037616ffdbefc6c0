//! Messages arrive as they were sent, and no bytes harm a decoder.

use carom_protocol::codec::{decode_to_client, decode_to_node, encode_to_client, encode_to_node};
use carom_protocol::limits::{POSES_MAX, REQUEST_TILES_MAX, SENTENCE_BYTES_MAX, TILE_EDGE_MAX};
use carom_protocol::{
    Error, PixelFormat, PixelPrecision, ReferenceRange, Refusal, RefusalReason, RequestId,
    SceneHash, ToClient, ToNode, TraceRequest,
};
use carom_tracer::{ImageSize, ObjectPose, TileGrid, TileRange};
use glam::{Quat, Vec3};
use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

use crate::any;

proptest! {
    #![proptest_config(any::config(300))]

    #[test]
    fn messages_to_a_node_arrive_as_they_were_sent(message in any::to_node()) {
        let bytes = encode_to_node(&message).unwrap();
        prop_assert_eq!(decode_to_node(&bytes), Ok(message));
    }

    #[test]
    fn messages_to_a_client_arrive_as_they_were_sent(message in any::to_client()) {
        let bytes = encode_to_client(&message).unwrap();
        prop_assert_eq!(decode_to_client(&bytes), Ok(message));
    }

    #[test]
    fn truncated_messages_are_errors(message in any::to_node(), at: prop::sample::Index) {
        let bytes = encode_to_node(&message).unwrap();
        prop_assert!(decode_to_node(&bytes[..at.index(bytes.len())]).is_err());
    }

    #[test]
    fn any_bytes_are_a_sendable_message_or_an_error(
        bytes in prop::collection::vec(any::<u8>(), 0..300),
        variant in 0..8u8,
    ) {
        let bytes = [&[variant][..], &bytes].concat();
        if let Ok(message) = decode_to_node(&bytes) {
            prop_assert!(encode_to_node(&message).is_ok());
        }
        if let Ok(message) = decode_to_client(&bytes) {
            prop_assert!(encode_to_client(&message).is_ok());
        }
    }

    #[test]
    fn damaged_messages_are_sendable_or_errors(
        to_node in any::to_node(),
        to_client in any::to_client(),
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        let mut bytes = encode_to_node(&to_node).unwrap();
        for (at, value) in &damage {
            *at.get_mut(&mut bytes) = *value;
        }
        if let Ok(message) = decode_to_node(&bytes) {
            prop_assert!(encode_to_node(&message).is_ok());
        }
        let mut bytes = encode_to_client(&to_client).unwrap();
        for (at, value) in &damage {
            *at.get_mut(&mut bytes) = *value;
        }
        if let Ok(message) = decode_to_client(&bytes) {
            prop_assert!(encode_to_client(&message).is_ok());
        }
    }

    #[test]
    fn a_scene_under_another_hash_is_refused(bit in 0..256usize) {
        let scene = any::balls(3);
        let mut hash = SceneHash::of(&scene);
        hash.0[bit / 8] ^= 1 << (bit % 8);
        let bytes = encode_to_node(&ToNode::Scene { hash, scene: Box::new(scene) }).unwrap();
        let refused = matches!(decode_to_node(&bytes), Err(Error::Malformed { what: "scene", .. }));
        prop_assert!(refused);
    }

    #[test]
    fn each_number_of_a_request_is_checked(request in any::request()) {
        prop_assert_eq!(request.validate(), Ok(()));
        for (rule, spoil) in RULES {
            let mut spoilt = request.clone();
            spoil(&mut spoilt);
            prop_assert!(spoilt.validate().is_err(), "{}", rule);
            let message = ToNode::Trace(Box::new(spoilt));
            prop_assert!(encode_to_node(&message).is_err(), "{}", rule);
            let bytes = postcard::to_stdvec(&message).unwrap();
            let refused = matches!(decode_to_node(&bytes), Err(Error::Malformed { .. }));
            prop_assert!(refused, "{}", rule);
        }
    }
}

fn held(request: u64, first: u32, count: u32) -> ReferenceRange {
    let (request, tiles) = (RequestId(request), TileRange { first, count });
    ReferenceRange { request, tiles }
}

type Rule = (&'static str, fn(&mut TraceRequest));

/// What no request may be.
const RULES: [Rule; 18] = [
    ("tiles of no pixel", |r| r.grid.edge = 0),
    ("tiles too large", |r| r.grid.edge = TILE_EDGE_MAX + 1),
    ("a picture without rows", |r| r.grid.size.height = 0),
    ("a picture too wide", |r| r.grid.size.width = u32::MAX),
    ("no tile", |r| r.tiles.count = 0),
    ("tiles beyond the end", |r| r.tiles.first = r.grid.len()),
    ("tiles beyond all numbers", |r| r.tiles.first = u32::MAX),
    ("no sample", |r| r.settings.samples = 0),
    ("paths too deep", |r| r.settings.max_depth = u32::MAX),
    ("an exposure that is no number", |r| {
        r.format = PixelFormat::Srgb8 { exposure: f32::NAN };
    }),
    ("no exposure", |r| {
        r.format = PixelFormat::Srgb8 { exposure: 0.0 };
    }),
    ("the finest precision below the coarsest", |r| {
        (r.precision.finest, r.precision.coarsest) =
            (PixelPrecision::Within2, PixelPrecision::Exact);
    }),
    ("tiles held that are not asked for", |r| {
        r.id = RequestId(9);
        r.references = vec![held(8, r.tiles.first, r.tiles.count + 1)];
    }),
    ("tiles held twice", |r| {
        r.id = RequestId(9);
        r.references = vec![held(8, r.tiles.first, 1), held(7, r.tiles.first, 1)];
    }),
    ("tiles held of a request to come", |r| {
        r.id = RequestId(9);
        r.references = vec![held(9, r.tiles.first, 1)];
    }),
    ("a ball at no place", |r| {
        let mut pose = POSE;
        pose.position.y = f32::INFINITY;
        r.update.poses = vec![pose];
    }),
    ("too many poses", |r| {
        r.update.poses = vec![POSE; POSES_MAX + 1]
    }),
    ("hours of work", |r| {
        r.grid = TileGrid::new(ImageSize::new(4096, 4096), 64);
        r.tiles = r.grid.all();
        r.settings.samples = 257;
    }),
];

const POSE: ObjectPose = ObjectPose {
    object: 0,
    position: Vec3::ZERO,
    rotation: Quat::IDENTITY,
    visible: true,
};

#[test]
fn tiles_of_a_request_are_bounded() {
    let grid = TileGrid::new(ImageSize::new(16_384, 16_384), 1);
    let mut runner = TestRunner::deterministic();
    let mut request = any::request().new_tree(&mut runner).unwrap().current();
    request.grid = grid;
    request.settings.samples = 1;
    request.tiles = TileRange {
        first: 0,
        count: REQUEST_TILES_MAX,
    };
    assert_eq!(request.validate(), Ok(()));
    request.tiles.count += 1;
    assert!(request.validate().is_err());
}

#[test]
fn sentences_are_limited() {
    let refusal = |bytes: usize| {
        ToClient::RequestRefused(Refusal {
            request: RequestId(1),
            why: RefusalReason::Device("x".repeat(bytes)),
        })
    };
    let bytes = |length| postcard::to_stdvec(&refusal(length)).unwrap();
    assert!(decode_to_client(&bytes(SENTENCE_BYTES_MAX)).is_ok());
    assert!(decode_to_client(&bytes(SENTENCE_BYTES_MAX + 1)).is_err());
}
