//! Image files: OpenEXR for radiance, PNG and JPEG for tone-mapped images.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, Write};
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{
    self as openexr, ReadChannels as _, ReadLayers as _, ReadSpecificChannel as _,
    WritableImage as _,
};

use crate::tonemap::srgb8;
use crate::{Aovs, Error, ImageSize, RadianceImage};

impl RadianceImage {
    /// Reads the first layer with channels R, G and B of an OpenEXR file, in any number format and
    /// compression.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be read; [`Error::Format`] if it is not such a file or is
    /// larger than [`ImageSize::EDGE_MAX`], which is checked before memory is allocated.
    pub fn read_exr(path: impl AsRef<Path>) -> Result<Self, Error> {
        let path = path.as_ref();
        let meta = MetaData::read_from_file(path, false).map_err(|error| refused(path, error))?;
        for header in &meta.headers {
            let size = header.layer_size;
            if size.x().max(size.y()) > ImageSize::EDGE_MAX as usize {
                let (width, height, edge) = (size.x(), size.y(), ImageSize::EDGE_MAX);
                let message =
                    format!("it has {width}x{height} pixels: at most {edge}x{edge} are read");
                return Err(Error::format(path, message));
            }
        }
        let file = File::open(path).map_err(|source| Error::io(path, source))?;
        decode_exr(BufReader::new(file)).map_err(|error| refused(path, error))
    }

    /// Writes channels R, G and B as 32-bit floats with lossless compression.
    ///
    /// # Errors
    /// [`Error::Io`] if the file cannot be written.
    pub fn write_exr(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let file = File::create(path).map(BufWriter::new);
        file.and_then(|file| self.encode_exr(file))
            .map_err(|source| Error::io(path, source))
    }

    /// Writes the bytes of [`RadianceImage::write_exr`] to an open file.
    ///
    /// # Errors
    /// The writer's errors.
    pub fn encode_exr(&self, to: impl Write + Seek) -> io::Result<()> {
        let (width, height) = (self.size.width as usize, self.size.height as usize);
        let pixel = |at: openexr::Vec2<usize>| {
            let [r, g, b] = self.pixels[at.y() * width + at.x()];
            (r, g, b)
        };
        let channels = openexr::SpecificChannels::rgb(pixel);
        openexr::Image::from_encoded_channels((width, height), ENCODING, channels)
            .write()
            .to_buffered(to)
            .map_err(not_written)
    }

    /// Writes channels R, G and B and the AOVs of first hits as layers: `albedo.R`, `albedo.G` and
    /// `albedo.B`; `normal.X`, `normal.Y` and `normal.Z` in world space; and `Z`, the distance
    /// along the camera's axis in metres, ∞ where nothing is hit. All are 32-bit floats.
    ///
    /// # Errors
    /// The writer's errors, and one if the number of first hits is not that of pixels.
    pub fn encode_exr_with_aovs(&self, hits: &[Aovs], to: impl Write + Seek) -> io::Result<()> {
        if hits.len() != self.pixels.len() {
            return Err(io::Error::other(format!(
                "{} first hits are to be the layers of {} pixels",
                hits.len(),
                self.pixels.len()
            )));
        }
        let radiance = |c: usize| self.pixels.iter().map(|pixel| pixel[c]).collect();
        let layer = |value: &dyn Fn(&Aovs) -> f32| hits.iter().map(value).collect();
        let channel = |name: &str, values: Vec<f32>| {
            openexr::AnyChannel::new(name, openexr::FlatSamples::F32(values))
        };
        let channels = [
            channel("R", radiance(0)),
            channel("G", radiance(1)),
            channel("B", radiance(2)),
            channel("Z", layer(&Aovs::depth)),
            channel("albedo.R", layer(&|hit| hit.albedo[0])),
            channel("albedo.G", layer(&|hit| hit.albedo[1])),
            channel("albedo.B", layer(&|hit| hit.albedo[2])),
            channel("normal.X", layer(&|hit| hit.normal[0])),
            channel("normal.Y", layer(&|hit| hit.normal[1])),
            channel("normal.Z", layer(&|hit| hit.normal[2])),
        ];
        let size = (self.size.width as usize, self.size.height as usize);
        let channels = openexr::AnyChannels::sort(channels.into_iter().collect());
        openexr::Image::from_encoded_channels(size, ENCODING, channels)
            .write()
            .to_buffered(to)
            .map_err(not_written)
    }

    /// Writes 8-bit sRGB of `exposure ·` radiance, tone mapped by [`srgb8`].
    ///
    /// # Errors
    /// [`Error::Io`] or [`Error::Format`] if the file cannot be written.
    pub fn write_png(&self, path: impl AsRef<Path>, exposure: f32) -> Result<(), Error> {
        let path = path.as_ref();
        let write = || -> Result<(), png::EncodingError> {
            let file = BufWriter::new(File::create(path)?);
            let mut encoder = png::Encoder::new(file, self.size.width, self.size.height);
            encoder.set_color(png::ColorType::Rgb);
            encoder.set_depth(png::BitDepth::Eight);
            encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
            let pixels = self.pixels.iter().flat_map(|&pixel| srgb8(pixel, exposure));
            let mut writer = encoder.write_header()?;
            writer.write_image_data(&pixels.collect::<Vec<u8>>())?;
            writer.finish()
        };
        write().map_err(|error| match error {
            png::EncodingError::IoError(source) => Error::io(path, source),
            other => Error::format(path, other.to_string()),
        })
    }
}

impl RadianceImage {
    /// Writes a JPEG of 8-bit sRGB of `exposure ·` radiance, tone mapped by [`srgb8`]. `quality` is
    /// 1 to 100; higher values need more bytes.
    ///
    /// # Errors
    /// The writer's errors, and one for an image with an edge of more than 65,535 pixels.
    pub fn encode_jpeg(&self, exposure: f32, quality: u8, to: impl Write) -> io::Result<()> {
        let ImageSize { width, height } = self.size;
        let (Ok(width), Ok(height)) = (u16::try_from(width), u16::try_from(height)) else {
            let most = u16::MAX;
            return Err(io::Error::other(format!(
                "a JPEG of {width}x{height} pixels: at most {most}x{most} are possible"
            )));
        };
        let pixels = self.pixels.iter().flat_map(|&pixel| srgb8(pixel, exposure));
        let pixels: Vec<u8> = pixels.collect();
        jpeg_encoder::Encoder::new(to, quality)
            .encode(&pixels, width, height, jpeg_encoder::ColorType::Rgb)
            .map_err(|error| match error {
                jpeg_encoder::EncodingError::IoError(source) => source,
                other => io::Error::other(other.to_string()),
            })
    }
}

/// Scan lines in increasing order. Tiles would be written in the order in which threads finish
/// them, so the bytes of equal images would differ from run to run.
const ENCODING: openexr::Encoding = openexr::Encoding::SMALL_LOSSLESS;

/// The first layer with channels R, G and B, in any number format and compression.
pub(crate) fn decode_exr(from: impl Read + Seek) -> exr::error::Result<RadianceImage> {
    let image = openexr::read()
        .no_deep_data()
        .largest_resolution_level()
        .specific_channels()
        .required("R")
        .required("G")
        .required("B")
        .collect_pixels(
            |size, _| RadianceImage::black(ImageSize::new(size.x() as u32, size.y() as u32)),
            |image, at, (r, g, b): (f32, f32, f32)| {
                image.pixels[at.y() * image.size.width as usize + at.x()] = [r, g, b];
            },
        )
        .first_valid_layer()
        .all_attributes()
        .from_buffered(from)?;
    Ok(image.layer_data.channel_data.pixels)
}

fn refused(path: &Path, error: exr::error::Error) -> Error {
    let message = match error {
        exr::error::Error::Io(source) => return Error::io(path, source),
        exr::error::Error::NotSupported(what) => format!("this kind of EXR is not read: {what}"),
        exr::error::Error::Invalid(what) => {
            format!("it is not an EXR picture with channels R, G and B: {what}")
        }
        exr::error::Error::Aborted => "reading was interrupted".to_owned(),
    };
    Error::format(path, message)
}

fn not_written(error: exr::error::Error) -> io::Error {
    match error {
        exr::error::Error::Io(source) => source,
        other => io::Error::other(other.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient() -> RadianceImage {
        let size = ImageSize::new(37, 5);
        let pixel = |i: usize| [i as f32 * 1e-3, 1e6 / (i + 1) as f32, f32::MIN_POSITIVE];
        RadianceImage {
            size,
            pixels: (0..size.pixels()).map(pixel).collect(),
        }
    }

    #[test]
    fn equal_pictures_make_equal_exr_files() {
        // Many blocks, so that threads finish them in a different order each time.
        let size = ImageSize::new(640, 640);
        let image = RadianceImage {
            size,
            pixels: (0..size.pixels()).map(|i| [i as f32; 3]).collect(),
        };
        let hits = vec![Aovs::default(); size.pixels()];
        let bytes = || {
            let mut bytes = io::Cursor::new(Vec::new());
            image.encode_exr_with_aovs(&hits, &mut bytes).unwrap();
            bytes.into_inner()
        };
        let first = bytes();
        for i in 1..8 {
            assert!(bytes() == first, "file {i}");
        }
    }

    #[test]
    fn exr_keeps_every_bit() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("gradient.exr");
        gradient().write_exr(&path).unwrap();
        assert_eq!(RadianceImage::read_exr(&path).unwrap(), gradient());
    }

    #[test]
    fn exr_aovs_lie_beside_the_picture() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("layers.exr");
        let image = gradient();
        let hit = |i: usize| Aovs {
            albedo: [0.5, i as f32, 0.25],
            normal: [0.0, 0.6, -0.8],
            inverse_depth: i as f32,
            emission: [9.0; 3],
        };
        let hits: Vec<Aovs> = (0..image.pixels.len()).map(hit).collect();
        let write = |hits| image.encode_exr_with_aovs(hits, File::create(&path).unwrap());
        write(&hits).unwrap();
        assert_eq!(RadianceImage::read_exr(&path).unwrap(), image);
        let file = openexr::read_all_flat_layers_from_file(&path).unwrap();
        let channels = &file.layer_data[0].channel_data.list;
        let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
        let wanted = "B G R Z albedo.B albedo.G albedo.R normal.X normal.Y normal.Z";
        assert_eq!(names.join(" "), wanted);
        let values = |c: usize| {
            channels[c]
                .sample_data
                .values_as_f32()
                .collect::<Vec<f32>>()
        };
        assert_eq!(values(3)[..3], [f32::INFINITY, 1.0, 0.5]);
        assert_eq!((values(5)[2], values(9)[7]), (2.0, -0.8));
        assert!(write(&hits[1..]).is_err());
    }

    #[test]
    fn png_holds_the_tone_mapped_pixels() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("gradient.png");
        gradient().write_png(&path, 2.0).unwrap();
        let file = std::io::BufReader::new(File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut bytes).unwrap();
        let pixels = gradient().pixels;
        let expected: Vec<u8> = pixels.iter().flat_map(|&pixel| srgb8(pixel, 2.0)).collect();
        assert_eq!(bytes, expected);
    }

    #[test]
    fn what_is_no_picture_is_refused_by_name() {
        let directory = tempfile::tempdir().unwrap();
        let refusal = |path: &Path| RadianceImage::read_exr(path).unwrap_err().to_string();
        let absent = directory.path().join("absent.exr");
        assert!(
            refusal(&absent).contains("absent.exr: No such file"),
            "{}",
            refusal(&absent)
        );
        let text = directory.path().join("text.exr");
        std::fs::write(&text, "not a picture").unwrap();
        assert!(
            refusal(&text).contains("text.exr: it is not an EXR"),
            "{}",
            refusal(&text)
        );
        let nowhere = directory.path().join("absent").join("out");
        assert!(matches!(
            gradient().write_png(&nowhere, 1.0),
            Err(Error::Io { .. })
        ));
        assert!(matches!(
            gradient().write_exr(&nowhere),
            Err(Error::Io { .. })
        ));
    }

    #[test]
    fn a_cut_file_is_refused() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("cut.exr");
        gradient().write_exr(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        for length in (0..whole.len()).step_by(7) {
            std::fs::write(&path, &whole[..length]).unwrap();
            assert!(
                RadianceImage::read_exr(&path).is_err(),
                "{length} bytes were enough"
            );
        }
    }
}
