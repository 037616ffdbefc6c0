//! Bound on what decoding allocates: in proportion to the bytes that came, whatever lengths they tell.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use carom_protocol::codec::{decode_to_client, decode_to_node};
use carom_protocol::framing::Deframer;
use carom_protocol::limits::TO_NODE_BYTES_MAX;
use carom_protocol::tile_codec::Decoder;
use carom_protocol::{
    CodedParticles, PixelFormat, PixelPrecision, PrecisionRange, ToNode, TraceRequest,
};
use carom_tracer::Tile;

/// Counts what each thread asks for.
struct Counting;

thread_local! {
    static BYTES: Cell<usize> = const { Cell::new(0) };
}

#[expect(
    unsafe_code,
    reason = "the trait is unsafe; each call goes to the system's allocator"
)]
// SAFETY: `System` keeps the contract; counting touches nothing but a number.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BYTES.set(BYTES.get() + layout.size());
        // SAFETY: the caller's promise is handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller's promise is handed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

/// Bytes that `work` asks for in all, freed or not.
fn allocated(work: impl FnOnce()) -> usize {
    let before = BYTES.get();
    work();
    BYTES.get() - before
}

/// A sentence of an error, and what a decoder needs whatever comes.
const FIXED: usize = 4096;
/// In memory a ball's pose is 1.2 times as long as on the wire, an object 3 times; lists grow by
/// doubling and each growth is counted.
const FACTOR: usize = 12;

/// Varint of a length that no memory holds.
const HUGE: [u8; 9] = [0xff; 9];
/// Varint of a length that 64,000 bytes could hold, if each element were a byte.
const SIXTY_THOUSAND: [u8; 3] = [0xe0, 0xd4, 0x03];

fn assert_in_proportion(bytes: &[u8]) {
    let spent = allocated(|| {
        drop(decode_to_node(bytes));
        drop(decode_to_client(bytes));
    });
    assert!(
        spent <= FIXED + FACTOR * bytes.len(),
        "{spent} bytes for {} that begin {:?}",
        bytes.len(),
        &bytes[..bytes.len().min(8)]
    );
}

#[test]
fn announced_lengths_are_not_believed() {
    for variant in 0..11u8 {
        for prefix in [0, 1, 8, 32, 33, 34, 40, 80, 90, 120] {
            // Zeros are right numbers, so that each list and text of each message is reached.
            for fill in [0, 1, 3] {
                let start = [&[variant][..], &vec![fill; prefix]].concat();
                assert_in_proportion(&[&start[..], &HUGE, &[1]].concat());
                let plausible = [&start[..], &SIXTY_THOUSAND, &[0x20; 64_000]].concat();
                assert_in_proportion(&plausible);
            }
        }
    }
}

#[test]
fn announced_pose_count_reserves_no_memory() {
    let request = TraceRequest {
        frame: carom_protocol::FrameId(1),
        id: carom_protocol::RequestId(1),
        scene: carom_protocol::SceneHash([1; 32]),
        update: carom_tracer::SceneUpdate::default(),
        grid: carom_tracer::TileGrid::new(carom_tracer::ImageSize::new(8, 8), 8),
        tiles: carom_tracer::TileRange { first: 0, count: 1 },
        settings: carom_tracer::RenderSettings::default(),
        format: PixelFormat::LinearF16,
        precision: carom_protocol::PrecisionRange::EXACT,
        references: Vec::new(),
        particles: CodedParticles::default(),
    };
    let bytes = postcard::to_stdvec(&ToNode::Trace(Box::new(request))).unwrap();
    // Variant, frame, request, hash, no camera; then the number of poses.
    let poses_at = 1 + 1 + 1 + 32 + 1;
    assert_eq!(bytes[poses_at], 0);
    let lie = [&bytes[..poses_at], &SIXTY_THOUSAND, &[0x20; 64_000]].concat();
    assert_in_proportion(&lie);
    // 65,000 bytes of poses are a list too long, which is told after it has been read.
    let long = [&bytes[..poses_at], &[0xf0, 0x10], &[0; 2160 * 30]].concat();
    assert_in_proportion(&long);
}

#[test]
fn a_scene_is_counted_while_it_is_read() {
    // Variant, hash, camera and environment; then 8,192 of a million materials with names of three bytes.
    let start = [&[1][..], &[0; 32], &[0; 52], &[0; 12]].concat();
    let material = |index: u32| {
        let [a, b, c, _] = index.to_le_bytes().map(|byte| byte & 0x7f);
        [&[3, a, b, c, 0][..], &[0; 12]].concat()
    };
    let materials: Vec<u8> = (0..1 << 13)
        .map(|index| (index & 0x7f) | (index & 0x3f80) << 1 | (index & 0x1f_c000) << 2)
        .flat_map(material)
        .collect();
    let scene = [&start[..], &[0x80, 0x80, 0x40], &materials].concat();
    let spent = allocated(|| assert!(decode_to_node(&scene).is_err()));
    assert!((1 << 14..1 << 20).contains(&spent), "{spent} bytes");
}

#[test]
fn zstd_memory_is_bounded_by_request() {
    let (x, y, width, height) = (0, 0, 32, 32);
    let tiles = [Tile {
        x,
        y,
        width,
        height,
    }; 8];
    let format = PixelFormat::Srgb8 { exposure: 1.0 };
    let size = 8 * 32 * 32 * format.bytes();
    let mut decoder = Decoder::new();
    // A 4-byte block of 128 KiB (RFC 8878, RLE_Block), fifty times over, the right size stated.
    let block = [&((128u32 * 1024) << 3 | 1 << 1).to_le_bytes()[..3], &[7]].concat();
    let header = [
        &[1, 0x28, 0xb5, 0x2f, 0xfd, 0xa0],
        &(size as u32).to_le_bytes()[..],
    ]
    .concat();
    for bomb in [
        [&header[..], &block.repeat(50), &[1, 0, 0]].concat(),
        [&header[..5], &[0x00, 0x78], &block.repeat(50), &[1, 0, 0]].concat(),
    ] {
        let spent = allocated(|| assert!(decoder.decode(format, &tiles, &bomb).is_err()));
        assert!(spent <= FIXED + size, "{spent}");
    }
}

/// Scans of JPEG that claim the world, on any tiles: a few times the picture that was asked for,
/// whose rows a decoder keeps apart by colour.
#[test]
fn jpeg_memory_is_bounded_by_request() {
    let (x, y, width, height) = (0, 0, 32, 32);
    let tile = Tile {
        x,
        y,
        width,
        height,
    };
    let size = 8 * 3 * tile.pixels();
    let range = PrecisionRange {
        finest: PixelPrecision::Exact,
        coarsest: PixelPrecision::Lossy50,
    };
    let mut decoder = Decoder::new();
    let frame = [
        0xff, 0xc0, 0, 17, 8, 0xff, 0xff, 0xff, 0xff, 3, 1, 0x11, 0, 2, 0x11, 1, 3, 0x11, 1,
    ];
    for (precision, fill) in [(3, 0), (4, 0x55), (5, 0xd9)] {
        let noise = vec![fill; 4 * size];
        for scan in [&noise[..], &[&frame[..], &noise].concat(), &[0xff; 64]] {
            let payload = [&[precision << 3 | 2], scan].concat();
            let spent = allocated(|| {
                drop(decoder.decode_srgb(range, &[(tile, None); 8], &payload));
            });
            let bound = 64 * FIXED + 6 * size + 2 * payload.len();
            assert!(spent <= bound, "{spent} of {bound}");
        }
    }
}

#[test]
fn stream_memory_is_bounded_by_received_bytes() {
    let mut deframer = Deframer::new(TO_NODE_BYTES_MAX);
    let spent = allocated(|| {
        deframer.push(&(TO_NODE_BYTES_MAX as u32).to_le_bytes());
        assert_eq!(deframer.next_packet(), Ok(None));
    });
    assert!(spent <= 64, "{spent}");
}
