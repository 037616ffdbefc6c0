//! Texture files: PNG and JPEG, whose dimensions are checked before memory is allocated.

use std::io::Cursor;

use zune_jpeg::JpegDecoder;
use zune_jpeg::zune_core::colorspace::ColorSpace;
use zune_jpeg::zune_core::options::DecoderOptions;

use crate::scene::TEXTURE_EDGE_MAX;

/// An image of 8-bit red, green, blue and alpha, in row-major order from the top left.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Texels {
    /// Width and height in texels.
    pub size: [u32; 2],
    /// Red, green, blue and alpha of each texel.
    pub texels: Vec<[u8; 4]>,
}

/// Width and height of a PNG or JPEG file.
///
/// # Errors
/// A sentence if it is neither, or is larger than [`TEXTURE_EDGE_MAX`].
pub fn size(file: &[u8]) -> Result<[u32; 2], String> {
    let size = match file {
        [0x89, b'P', b'N', b'G', ..] => {
            let reader = png_decoder(file)
                .read_info()
                .map_err(|e| fault("PNG", &e))?;
            [reader.info().width, reader.info().height]
        }
        [0xff, 0xd8, 0xff, ..] => {
            let mut decoder = jpeg_decoder(file);
            decoder.decode_headers().map_err(|e| fault("JPEG", &e))?;
            let (width, height) = decoder.dimensions().unwrap_or((0, 0));
            [width as u32, height as u32]
        }
        _ => {
            let start = &file[..file.len().min(4)];
            return Err(format!(
                "it begins with the bytes {start:02x?}: it must be a PNG or JPEG file"
            ));
        }
    };
    let is_allowed = |edge: &u32| (1..=TEXTURE_EDGE_MAX).contains(edge);
    if size.iter().all(is_allowed) {
        return Ok(size);
    }
    Err(format!(
        "it has {}x{} texels: each side must be from 1 to {TEXTURE_EDGE_MAX}",
        size[0], size[1]
    ))
}

/// The texels of a PNG or JPEG file. 16-bit channels are truncated to 8 bits.
///
/// # Errors
/// A sentence if it is neither, or is too large or malformed.
pub fn decode(file: &[u8]) -> Result<Texels, String> {
    let size = size(file)?;
    let texels = match file.first() {
        Some(0x89) => decode_png(file),
        _ => decode_jpeg(file),
    }?;
    let [width, height] = size.map(|edge| edge as usize);
    if texels.len() != width * height {
        return Err(format!(
            "it holds {} texels, but has {width}x{height}",
            texels.len()
        ));
    }
    Ok(Texels { size, texels })
}

/// An image encoded as a PNG file; for textures made in code.
///
/// # Errors
/// A sentence if the number of texels is not that of the size.
pub fn encode_png(picture: &Texels) -> Result<Vec<u8>, String> {
    let [width, height] = picture.size;
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, width, height);
    encoder.set_color(png::ColorType::Rgba);
    encoder.set_depth(png::BitDepth::Eight);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(picture.texels.as_flattened())?;
        writer.finish()
    });
    written.map_err(|error| fault("PNG", &error))?;
    Ok(file)
}

fn png_decoder(file: &[u8]) -> png::Decoder<Cursor<&[u8]>> {
    let edge = TEXTURE_EDGE_MAX as usize;
    // Memory beside the texels themselves: the last two rows, and text chunks, which are not read.
    let limits = png::Limits {
        bytes: 16 * edge + (1 << 20),
    };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(file), limits);
    decoder.set_transformations(png::Transformations::EXPAND | png::Transformations::STRIP_16);
    decoder.ignore_checksums(false);
    decoder
}

fn decode_png(file: &[u8]) -> Result<Vec<[u8; 4]>, String> {
    let mut reader = png_decoder(file)
        .read_info()
        .map_err(|e| fault("PNG", &e))?;
    let bytes = reader
        .output_buffer_size()
        .ok_or("its PNG is too large for this machine")?;
    let mut rows = vec![0; bytes];
    let frame = reader.next_frame(&mut rows).map_err(|e| fault("PNG", &e))?;
    let bytes = &rows[..frame.buffer_size()];
    Ok(match frame.color_type {
        png::ColorType::Rgba => bytes.as_chunks().0.to_vec(),
        png::ColorType::Rgb => opaque(bytes),
        png::ColorType::GrayscaleAlpha => {
            let pairs = bytes.as_chunks().0.iter();
            pairs
                .map(|&[grey, alpha]| [grey, grey, grey, alpha])
                .collect()
        }
        png::ColorType::Grayscale | png::ColorType::Indexed => {
            bytes.iter().map(|&grey| [grey, grey, grey, 255]).collect()
        }
    })
}

fn jpeg_decoder(file: &[u8]) -> JpegDecoder<Cursor<&[u8]>> {
    let edge = TEXTURE_EDGE_MAX as usize;
    let options = DecoderOptions::default()
        .set_max_width(edge)
        .set_max_height(edge)
        .jpeg_set_out_colorspace(ColorSpace::RGB);
    JpegDecoder::new_with_options(Cursor::new(file), options)
}

fn decode_jpeg(file: &[u8]) -> Result<Vec<[u8; 4]>, String> {
    let bytes = jpeg_decoder(file).decode().map_err(|e| fault("JPEG", &e))?;
    Ok(opaque(&bytes))
}

fn opaque(bytes: &[u8]) -> Vec<[u8; 4]> {
    let triples = bytes.as_chunks().0.iter();
    triples.map(|&[r, g, b]| [r, g, b, 255]).collect()
}

fn fault(format: &str, error: &dyn std::fmt::Display) -> String {
    format!("its {format} cannot be read: {error}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> Texels {
        let texel = |i: u32| [(i % 5) as u8 * 50, (i / 5) as u8 * 80, 7, 200];
        Texels {
            size: [5, 3],
            texels: (0..15).map(texel).collect(),
        }
    }

    #[test]
    fn png_files_read_back() {
        let file = encode_png(&gradient()).unwrap();
        assert_eq!(size(&file), Ok([5, 3]));
        assert_eq!(decode(&file), Ok(gradient()));
    }

    #[test]
    fn every_cut_or_changed_file_is_a_sentence_or_a_picture() {
        let file = encode_png(&gradient()).unwrap();
        for cut in 0..file.len() - 12 {
            assert!(decode(&file[..cut]).is_err(), "{cut}");
        }
        for place in 0..file.len() {
            let mut changed = file.clone();
            changed[place] ^= 0x41;
            if let Ok(read) = decode(&changed) {
                assert_eq!(read.texels.len() as u32, read.size[0] * read.size[1]);
            }
        }
    }

    #[test]
    fn bombs_are_refused_by_their_size() {
        let mut file = encode_png(&gradient()).unwrap();
        // Width and height come after the signature, the chunk's length and its name; the checksum
        // follows them.
        file[16..24].copy_from_slice(&[0, 0, 0xff, 0xff, 0, 0, 0xff, 0xff]);
        let crc = crc32(&file[12..29]);
        file[29..33].copy_from_slice(&crc.to_be_bytes());
        let sentence = "it has 65535x65535 texels: each side must be from 1 to 16384";
        assert_eq!(decode(&file), Err(sentence.to_owned()));
    }

    fn crc32(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |crc, _| {
                (crc >> 1) ^ (0xedb8_8320 & (crc & 1).wrapping_neg())
            })
        })
    }
}
