//! Environment-map files: OpenEXR and Radiance HDR, whose dimensions are checked before memory is
//! allocated.

use std::fmt::Display;
use std::io::Cursor;

use exr::meta::MetaData;

use crate::image_file::decode_exr;
use crate::scene::ENVIRONMENT_EDGE_MAX;
use crate::scene::validate::RADIANCE_MAX;
use crate::{ImageSize, RadianceImage};

/// Width and height of an OpenEXR or Radiance HDR file.
///
/// # Errors
/// A sentence if it is neither, or is larger than [`ENVIRONMENT_EDGE_MAX`].
pub fn size(file: &[u8]) -> Result<ImageSize, String> {
    let size = match file {
        [0x76, 0x2f, 0x31, 0x01, ..] => exr_size(file)?,
        [b'#', b'?', ..] => HdrHeader::read(file)?.size,
        _ => {
            let start = &file[..file.len().min(4)];
            return Err(format!(
                "it begins with the bytes {start:02x?}: it must be an OpenEXR or Radiance HDR file"
            ));
        }
    };
    let is_allowed = |edge: u32| (1..=ENVIRONMENT_EDGE_MAX).contains(&edge);
    if is_allowed(size.width) && is_allowed(size.height) {
        return Ok(size);
    }
    Err(format!(
        "it has {size} pixels: each side must be from 1 to {ENVIRONMENT_EDGE_MAX}"
    ))
}

/// Radiance of each pixel of an OpenEXR or Radiance HDR file. Negative channels become 0.
///
/// # Errors
/// A sentence if it is neither, is too large or malformed, or contains a number that is not finite
/// or too large.
pub fn decode(file: &[u8]) -> Result<RadianceImage, String> {
    let size = size(file)?;
    let mut image = match file.first() {
        Some(b'#') => decode_hdr(file)?,
        _ => decode_exr(Cursor::new(file)).map_err(exr_fault)?,
    };
    if image.size != size || image.pixels.len() != size.pixels() {
        return Err("its layers have different sizes".to_owned());
    }
    let is_valid = |pixel: &&[f32; 3]| pixel.iter().all(|channel| *channel <= RADIANCE_MAX);
    if let Some(place) = image.pixels.iter().position(|pixel| !is_valid(&pixel)) {
        let (x, y) = (place % size.width as usize, place / size.width as usize);
        return Err(format!(
            "its pixel ({x}, {y}) is {:?}: each channel must be at most {RADIANCE_MAX:e}",
            image.pixels[place]
        ));
    }
    for channel in image.pixels.as_flattened_mut() {
        *channel = channel.max(0.0);
    }
    Ok(image)
}

/// An image encoded as an OpenEXR file; for environment maps made in code.
///
/// # Errors
/// A sentence if it cannot be written.
pub fn encode_exr(picture: &RadianceImage) -> Result<Vec<u8>, String> {
    let mut file = Cursor::new(Vec::new());
    let written = picture.encode_exr(&mut file);
    written.map_err(|why| format!("its OpenEXR cannot be written: {why}"))?;
    Ok(file.into_inner())
}

fn exr_size(file: &[u8]) -> Result<ImageSize, String> {
    let meta = MetaData::read_from_buffered(Cursor::new(file), false).map_err(exr_fault)?;
    // The largest layer's size, as the reader allocates memory for each layer.
    let layers = meta.headers.iter();
    let largest = layers
        .map(|header| header.layer_size)
        .max_by_key(|size| size.area());
    let largest = largest.ok_or("it has no layer")?;
    let edge = |edge: usize| u32::try_from(edge).unwrap_or(u32::MAX);
    Ok(ImageSize::new(edge(largest.x()), edge(largest.y())))
}

fn exr_fault(error: impl Display) -> String {
    format!("its OpenEXR cannot be read: {error}")
}

/// Header of a Radiance HDR file (Ward, "Real Pixels", Graphics Gems II, 1991).
struct HdrHeader<'a> {
    size: ImageSize,
    /// The data after the header.
    pixels: &'a [u8],
}

impl<'a> HdrHeader<'a> {
    fn read(file: &'a [u8]) -> Result<Self, String> {
        let mut rest = file;
        let mut is_rgbe = false;
        loop {
            let (line, after) = hdr_line(rest)?;
            rest = after;
            if let Some(format) = line.strip_prefix("FORMAT=") {
                is_rgbe = format.trim() == "32-bit_rle_rgbe";
                if !is_rgbe {
                    return Err(format!(
                        "its format is {format}: it must be 32-bit_rle_rgbe"
                    ));
                }
            }
            if line.is_empty() {
                break;
            }
        }
        if !is_rgbe {
            return Err("its header has no line FORMAT=32-bit_rle_rgbe".to_owned());
        }
        let (line, pixels) = hdr_line(rest)?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let size = match words[..] {
            ["-Y", height, "+X", width] => height.parse().ok().zip(width.parse().ok()),
            _ => None,
        };
        let (height, width) = size.ok_or_else(|| {
            format!("its size is given as `{line}`: it must be `-Y <height> +X <width>`")
        })?;
        let size = ImageSize::new(width, height);
        Ok(Self { size, pixels })
    }
}

fn hdr_line(bytes: &[u8]) -> Result<(&str, &[u8]), String> {
    const LINE_BYTES_MAX: usize = 4096;
    let mut start = bytes[..bytes.len().min(LINE_BYTES_MAX)].iter();
    let end = start.position(|byte| *byte == b'\n');
    let end = end.ok_or("its header has no end")?;
    let line = std::str::from_utf8(&bytes[..end]).map_err(|_| "its header is no text")?;
    Ok((line.trim_end_matches('\r'), &bytes[end + 1..]))
}

fn decode_hdr(file: &[u8]) -> Result<RadianceImage, String> {
    let HdrHeader { size, mut pixels } = HdrHeader::read(file)?;
    let width = size.width as usize;
    let mut image = RadianceImage::black(size);
    let mut row = vec![[0; 4]; width];
    for (y, radiance) in image.pixels.chunks_mut(width).enumerate() {
        pixels =
            hdr_row(pixels, &mut row).ok_or_else(|| format!("its row {y} is broken or cut off"))?;
        for (radiance, rgbe) in radiance.iter_mut().zip(&row) {
            *radiance = from_rgbe(*rgbe);
        }
    }
    Ok(image)
}

fn from_rgbe([r, g, b, exponent]: [u8; 4]) -> [f32; 3] {
    if exponent == 0 {
        return [0.0; 3];
    }
    // The exponent has a bias of 128, and the mantissas are fractions of 256, which makes 136. No
    // half step is added to them, so that 0 stays 0.
    let scale = 2f64.powi(i32::from(exponent) - 136);
    [r, g, b].map(|mantissa| (f64::from(mantissa) * scale) as f32)
}

/// Reads a row and returns the rest of the data; `None` if the row is malformed. Rows of 8 to
/// 32,767 pixels that begin with the bytes 2, 2 are run-length encoded per channel; others are
/// uncompressed.
fn hdr_row<'a>(bytes: &'a [u8], row: &mut [[u8; 4]]) -> Option<&'a [u8]> {
    let [first, second, high, low] = *bytes.first_chunk::<4>()?;
    let is_in_runs = (8..32_768).contains(&row.len()) && first == 2 && second == 2 && high < 128;
    if !is_in_runs {
        let (pixels, rest) = bytes.split_at_checked(4 * row.len())?;
        row.copy_from_slice(pixels.as_chunks().0);
        return Some(rest);
    }
    // The length of the row is repeated in the marker.
    if usize::from(high) << 8 | usize::from(low) != row.len() {
        return None;
    }
    let mut rest = &bytes[4..];
    for channel in 0..4 {
        let mut place = 0;
        while place < row.len() {
            let (&count, after) = rest.split_first()?;
            // A count above 128 is followed by one value to repeat, otherwise by that many values.
            let (count, is_run) = match count {
                0 => return None,
                129.. => (usize::from(count) - 128, true),
                _ => (usize::from(count), false),
            };
            let (values, after) = after.split_at_checked(if is_run { 1 } else { count })?;
            rest = after;
            for (index, pixel) in row.get_mut(place..place + count)?.iter_mut().enumerate() {
                pixel[channel] = values[if is_run { 0 } else { index }];
            }
            place += count;
        }
    }
    Some(rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hdr(width: usize, rows: &[u8]) -> Vec<u8> {
        let header = format!("#?RADIANCE\nGAMMA=1\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X {width}\n");
        [header.as_bytes(), rows].concat()
    }

    #[test]
    fn hdr_files_with_and_without_runs_are_read() {
        let plain = hdr(
            2,
            &[128, 64, 0, 129, 0, 0, 0, 0, 255, 1, 2, 128, 128, 0, 0, 137],
        );
        let image = decode(&plain).unwrap();
        assert_eq!(image.size, ImageSize::new(2, 2));
        assert_eq!(image.pixels[0], [1.0, 0.5, 0.0]);
        assert_eq!(image.pixels[1], [0.0; 3]);
        assert_eq!(image.pixels[3], [256.0, 0.0, 0.0]);

        let row = |red: &[u8]| [&[2, 2, 0, 9], red, &[137, 0, 137, 128, 137, 129]].concat();
        let rows = [row(&[137, 128]), row(&[5, 0, 64, 128, 0, 0, 132, 128])].concat();
        let image = decode(&hdr(9, &rows)).unwrap();
        assert_eq!(image.pixels[0], [1.0, 0.0, 1.0]);
        assert_eq!(image.pixels[10], [0.5, 0.0, 1.0]);
        assert_eq!(image.pixels[17], [1.0, 0.0, 1.0]);
    }

    #[test]
    fn broken_hdr_files_are_sentences() {
        let right = hdr(9, &[0; 72]);
        assert!(decode(&right).is_ok());
        for cut in 0..right.len() {
            assert!(decode(&right[..cut]).is_err(), "{cut}");
        }
        let long_run = hdr(9, &[2, 2, 0, 9, 138, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!(
            decode(&long_run),
            Err("its row 0 is broken or cut off".to_owned())
        );
        let huge = hdr(99_999, &[]);
        let sentence = "it has 99999x2 pixels: each side must be from 1 to 8192";
        assert_eq!(decode(&huge), Err(sentence.to_owned()));
        let turned = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+X 2 +Y 2\n";
        assert!(decode(turned).unwrap_err().contains("`+X 2 +Y 2`"));
        assert!(
            decode(b"#?RADIANCE\n\n-Y 1 +X 1\n1111")
                .unwrap_err()
                .contains("FORMAT")
        );
    }

    #[test]
    fn exr_files_are_read_and_their_numbers_checked() {
        let bytes = |pixels: [[f32; 3]; 2]| {
            let mut image = RadianceImage::black(ImageSize::new(2, 1));
            image.pixels.copy_from_slice(&pixels);
            encode_exr(&image).unwrap()
        };
        let image = decode(&bytes([[1.0, 2e9, 0.0], [-0.5, 0.25, 0.0]])).unwrap();
        assert_eq!(image.pixels, [[1.0, 2e9, 0.0], [0.0, 0.25, 0.0]]);
        for wrong in [f32::NAN, f32::INFINITY] {
            let refusal = decode(&bytes([[0.0; 3], [0.0, wrong, 0.0]])).unwrap_err();
            assert!(refusal.contains("its pixel (1, 0) is [0.0, "), "{refusal}");
        }
        let right = bytes([[1.0; 3]; 2]);
        for cut in 0..right.len() {
            assert!(decode(&right[..cut]).is_err(), "{cut}");
        }
    }
}
