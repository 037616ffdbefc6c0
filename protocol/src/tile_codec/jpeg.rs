//! JPEG scans of the lossy precisions (ITU T.81, baseline), without the 600 bytes of headers and tables,
//! which both ends can construct.
//!
//! The tiles of a message are stacked into one picture as wide as the widest tile. A message of 8192
//! denoised pixels has 700 bytes at quality 90, which the tables would nearly double.

use std::sync::LazyLock;

use carom_tracer::Tile;
use jpeg_encoder::{ColorType, SamplingFactor};
use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::bytestream::ZCursor;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::error::Reason;
use crate::precision::PixelPrecision;

/// Encodes the tiles' pixels, each row-major, into a scan.
pub(crate) fn encode(precision: PixelPrecision, tiles: &[(Tile, &[[u8; 3]])]) -> Vec<u8> {
    let (width, height) = stacked(tiles.iter().map(|(tile, _)| *tile));
    let mut pixels = Vec::with_capacity(width * height);
    for (tile, tile_pixels) in tiles {
        for row in tile_pixels.chunks_exact(tile.width as usize) {
            pixels.extend_from_slice(row);
            let last = row[row.len() - 1];
            // Padded with the last pixel of the row, which adds no edge for the DCT to code.
            pixels.resize(pixels.len() + width - row.len(), last);
        }
    }
    let mut file = whole_file(precision, &pixels, width, height);
    file.truncate(file.len() - END.len());
    file.drain(..scan_start(&file));
    file
}

/// Decodes the tiles' pixels, tile after tile, from their scan. Pixels missing from a truncated scan are
/// grey.
pub(crate) fn decode(
    precision: PixelPrecision,
    tiles: &[Tile],
    scan: &[u8],
) -> Result<Vec<[u8; 3]>, Reason> {
    let (width, height) = stacked(tiles.iter().copied());
    // The size comes from the request and not from the scan, so that the decoder allocates no more than was
    // requested.
    let file = [&header(precision, width, height), scan, &END].concat();
    let options = DecoderOptions::new_fast()
        .set_max_width(width)
        .set_max_height(height)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    let mut decoder = JpegDecoder::new_with_options(ZCursor::new(&file), options);
    let stack = decoder.decode();
    let stack = stack.map_err(|why| format!("its JPEG scan cannot be decoded: {why:?}"))?;
    let (stack, rest) = stack.as_chunks::<3>();
    if decoder.dimensions() != Some((width, height))
        || stack.len() != width * height
        || !rest.is_empty()
    {
        return Err("its JPEG scan is a picture of another size".into());
    }
    let mut rows = stack.chunks_exact(width);
    let mut pixels = Vec::with_capacity(tiles.iter().map(|tile| tile.pixels()).sum());
    for tile in tiles {
        for row in rows.by_ref().take(tile.height as usize) {
            pixels.extend_from_slice(&row[..tile.width as usize]);
        }
    }
    Ok(pixels)
}

/// Width and height of the picture of stacked tiles.
fn stacked(tiles: impl Iterator<Item = Tile>) -> (usize, usize) {
    tiles.fold((0, 0), |(width, height), tile| {
        (
            width.max(tile.width as usize),
            height + tile.height as usize,
        )
    })
}

fn whole_file(
    precision: PixelPrecision,
    pixels: &[[u8; 3]],
    width: usize,
    height: usize,
) -> Vec<u8> {
    let (quality, sampling) = match precision {
        PixelPrecision::Lossy75 => (75, SamplingFactor::F_2_2),
        PixelPrecision::Lossy50 => (50, SamplingFactor::F_2_2),
        _ => (90, SamplingFactor::F_1_1),
    };
    let mut file = Vec::with_capacity(HEADER_BYTES + pixels.len());
    let mut encoder = jpeg_encoder::Encoder::new(&mut file, quality);
    encoder.set_sampling_factor(sampling);
    let encoded = encoder.encode(
        pixels.as_flattened(),
        width as u16,
        height as u16,
        ColorType::Rgb,
    );
    encoded.expect("a message has few enough pixels, and memory takes all bytes");
    file
}

/// The file up to its scan: the same for each picture of a precision, except for the size.
fn header(precision: PixelPrecision, width: usize, height: usize) -> Vec<u8> {
    static HEADERS: LazyLock<[Vec<u8>; 3]> = LazyLock::new(|| {
        [
            PixelPrecision::Lossy90,
            PixelPrecision::Lossy75,
            PixelPrecision::Lossy50,
        ]
        .map(|precision| {
            // A picture of one pixel serves as the template: headers of other sizes differ in the size alone.
            let mut file = whole_file(precision, &[[0; 3]], 1, 1);
            file.truncate(scan_start(&file));
            file
        })
    });
    let mut header = match precision {
        PixelPrecision::Lossy75 => HEADERS[1].clone(),
        PixelPrecision::Lossy50 => HEADERS[2].clone(),
        _ => HEADERS[0].clone(),
    };
    let frame = segments(&header).find(|(marker, _)| *marker == START_OF_FRAME);
    let (_, frame) = frame.expect("each file has a frame header");
    // Height and width follow the marker, the length and the sample precision (ITU T.81, B.2.2).
    header[frame + 5..frame + 7].copy_from_slice(&(height as u16).to_be_bytes());
    header[frame + 7..frame + 9].copy_from_slice(&(width as u16).to_be_bytes());
    header
}

/// Offset of the scan's entropy-coded bytes in a file.
fn scan_start(file: &[u8]) -> usize {
    let scan = segments(file).find(|(marker, _)| *marker == START_OF_SCAN);
    let (_, scan) = scan.expect("each file has a scan");
    scan + 2 + usize::from(u16::from_be_bytes([file[scan + 2], file[scan + 3]]))
}

/// Marker and offset of each segment of a file. Meaningful up to the scan, whose bytes state no length.
fn segments(file: &[u8]) -> impl Iterator<Item = (u8, usize)> + '_ {
    // Behind the marker of the start of the image, which has no length.
    let mut at = 2;
    std::iter::from_fn(move || {
        let segment = (*file.get(at + 1)?, at);
        at += 2 + usize::from(u16::from_be_bytes([*file.get(at + 2)?, *file.get(at + 3)?]));
        Some(segment)
    })
}

/// Marker of the end of the image.
const END: [u8; 2] = [0xff, 0xd9];
const START_OF_FRAME: u8 = 0xc0;
const START_OF_SCAN: u8 = 0xda;
const HEADER_BYTES: usize = 640;

#[cfg(test)]
mod tests {
    use super::*;

    /// Both ends construct the header themselves, so a change of it must raise the protocol's version.
    #[test]
    fn jpeg_header_changes_only_with_version() {
        let hashes = [
            PixelPrecision::Lossy90,
            PixelPrecision::Lossy75,
            PixelPrecision::Lossy50,
        ]
        .map(|precision| blake3::hash(&header(precision, 32, 256)).to_hex()[..8].to_owned());
        assert_eq!(
            (hashes.join(" ").as_str(), crate::message::VERSION),
            ("887c3f94 831cfbb7 a65872f9", 20)
        );
    }

    #[test]
    fn rebuilt_jpeg_header_equals_the_files() {
        for precision in [
            PixelPrecision::Lossy90,
            PixelPrecision::Lossy75,
            PixelPrecision::Lossy50,
        ] {
            for (width, height) in [(1, 1), (32, 256), (17, 40), (128, 1024)] {
                let file = whole_file(precision, &vec![[7; 3]; width * height], width, height);
                assert_eq!(header(precision, width, height), file[..scan_start(&file)]);
            }
        }
    }
}
