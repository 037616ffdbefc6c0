//! Finished pictures and their files.

use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use carom_tracer::film::Film;
use carom_tracer::tonemap::srgb8;
use carom_tracer::{Aovs, ImageSize, RadianceImage};
use png::Compression;

use crate::checkpoint::Checkpoint;
use crate::error::Error;
use crate::lock::lock;
use crate::whole_file::WholeFile;

/// A picture that a farm has traced, as its sample sums.
#[derive(Clone, Debug)]
pub struct Picture {
    film: Film,
    layers: Vec<Aovs>,
    exposure: f32,
    checkpoint: Option<Arc<Mutex<Checkpoint>>>,
}

impl Picture {
    pub(crate) fn new(film: Film, layers: Vec<Aovs>, exposure: f32) -> Self {
        Self {
            film,
            layers,
            exposure,
            checkpoint: None,
        }
    }

    pub(crate) fn with_checkpoint(self, checkpoint: Option<Checkpoint>) -> Self {
        let checkpoint = checkpoint.map(|checkpoint| Arc::new(Mutex::new(checkpoint)));
        Self { checkpoint, ..self }
    }

    /// Sets the factor of radiance for 8-bit pixels and files.
    #[must_use]
    pub fn with_exposure(self, exposure: f32) -> Self {
        Self { exposure, ..self }
    }

    /// Size in pixels.
    pub fn size(&self) -> ImageSize {
        self.film.size()
    }

    /// Samples per pixel.
    pub fn samples(&self) -> u32 {
        u32::try_from(self.film.samples_min()).unwrap_or(u32::MAX)
    }

    /// Samples that were not finite and count as black.
    pub fn dropped_samples(&self) -> u64 {
        self.film.dropped_samples()
    }

    /// Mean radiance of each pixel.
    pub fn image(&self) -> RadianceImage {
        self.film.image()
    }

    /// The film with the sample sums.
    pub const fn film(&self) -> &Film {
        &self.film
    }

    /// Albedo, normal and depth of each pixel, row by row; empty unless requested.
    pub fn layers(&self) -> &[Aovs] {
        &self.layers
    }

    /// 8-bit sRGB with an alpha of 255, row by row from the top left.
    pub fn rgba8(&self) -> Vec<[u8; 4]> {
        let opaque = |&pixel: &[f32; 3]| {
            let [r, g, b] = srgb8(pixel, self.exposure);
            [r, g, b, 255]
        };
        self.image().pixels.iter().map(opaque).collect()
    }

    /// The bytes of a PNG file of 8-bit sRGB.
    ///
    /// # Errors
    /// [`Error::File`] if encoding fails.
    pub fn png(&self) -> Result<Vec<u8>, Error> {
        let mut bytes = Vec::new();
        let written = self.encode_png(&mut bytes);
        let written = written.map_err(Error::file(Path::new("a PNG in memory")));
        written.map(|()| bytes)
    }

    /// Writes the picture: as 8-bit sRGB if the name ends in `.png` or `.jpg`, as 32-bit linear radiance
    /// with the available layers if it ends in `.exr`. The file appears only when it is complete.
    ///
    /// # Errors
    /// [`Error::PictureFormat`] for another name, [`Error::File`] if the file cannot be written.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), Error> {
        let path = path.as_ref();
        let format = FileFormat::of(path)?;
        let written = WholeFile::replace(path, |file| self.encode(format, file));
        written.map_err(Error::file(path))
    }

    /// Removes the checkpoint of [`crate::Still::checkpoint`], if there is one.
    ///
    /// # Errors
    /// [`Error::File`] if it cannot be removed.
    pub fn remove_checkpoint(&self) -> Result<(), Error> {
        let Some(checkpoint) = &self.checkpoint else {
            return Ok(());
        };
        lock(checkpoint).remove()
    }

    /// Writes the checkpoint of [`crate::Still::checkpoint`] with all samples, for a picture that could not
    /// be saved: in its place, or in the temporary folder if that fails. Returns the file; `None` without a
    /// checkpoint.
    ///
    /// # Errors
    /// [`Error::File`] if neither place can be written.
    pub fn rescue(&self) -> Result<Option<PathBuf>, Error> {
        let Some(checkpoint) = &self.checkpoint else {
            return Ok(None);
        };
        lock(checkpoint).rescue(&self.film).map(Some)
    }

    /// Writes a file of the format to an open destination.
    ///
    /// # Errors
    /// The writer's, or one that names what the format cannot hold.
    pub fn encode(&self, format: FileFormat, to: impl Write + Seek) -> io::Result<()> {
        let mut to = BufWriter::new(to);
        match format {
            FileFormat::Png => self.encode_png(&mut to)?,
            #[cfg(feature = "image-io")]
            FileFormat::Jpeg => {
                let image = self.image();
                image.encode_jpeg(self.exposure, JPEG_QUALITY, &mut to)?;
            }
            #[cfg(feature = "image-io")]
            FileFormat::Exr if self.layers.is_empty() => self.image().encode_exr(&mut to)?,
            #[cfg(feature = "image-io")]
            FileFormat::Exr => self.image().encode_exr_with_aovs(&self.layers, &mut to)?,
        }
        to.flush() // a full disk is no success
    }

    fn encode_png(&self, to: impl Write) -> io::Result<()> {
        let pixels = self.image().pixels;
        let rgb = pixels.iter().flat_map(|&pixel| srgb8(pixel, self.exposure));
        let rgb: Vec<u8> = rgb.collect();
        write_png(to, self.size(), &rgb, Compression::default())
    }
}

/// Format of a picture's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum FileFormat {
    /// 8-bit sRGB, lossless.
    Png,
    /// 8-bit sRGB, high-quality lossy.
    #[cfg(feature = "image-io")]
    Jpeg,
    /// 32-bit linear floats.
    #[cfg(feature = "image-io")]
    Exr,
}

impl FileFormat {
    /// The format of a file name's extension.
    ///
    /// # Errors
    /// [`Error::PictureFormat`] unless it ends in `.png` or, with the feature `image-io`, in `.exr`,
    /// `.jpg` or `.jpeg`.
    pub fn of(path: &Path) -> Result<Self, Error> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("png") => Ok(Self::Png),
            #[cfg(feature = "image-io")]
            Some("exr") => Ok(Self::Exr),
            #[cfg(feature = "image-io")]
            Some("jpg" | "jpeg") => Ok(Self::Jpeg),
            _ => Err(Error::PictureFormat(path.to_owned())),
        }
    }
}

/// Writes a PNG of `rgb`, sRGB bytes row by row.
///
/// # Errors
/// The writer's, or that `rgb` does not match the size.
pub(crate) fn write_png(
    to: impl Write,
    size: ImageSize,
    rgb: &[u8],
    compression: Compression,
) -> io::Result<()> {
    let mut writer = png_encoder(to, size, compression).write_header()?;
    writer.write_image_data(rgb)?;
    Ok(writer.finish()?)
}

/// A PNG encoder for sRGB bytes.
pub(crate) fn png_encoder<W: Write>(
    to: W,
    size: ImageSize,
    compression: Compression,
) -> png::Encoder<'static, W> {
    let mut encoder = png::Encoder::new(to, size.width, size.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::RelativeColorimetric);
    encoder.set_compression(compression);
    encoder
}

/// Visually lossless, at some 2 bits per pixel.
#[cfg(feature = "image-io")]
const JPEG_QUALITY: u8 = 92;

#[cfg(test)]
mod tests {
    use super::*;

    fn picture() -> Picture {
        let size = ImageSize::new(8, 4);
        let mut film = Film::new(size);
        let whole = carom_tracer::Tile {
            x: 0,
            y: 0,
            width: 8,
            height: 4,
        };
        film.add(whole, &[[0.5, 0.25, 0.125]; 32], 2).unwrap();
        Picture::new(film, Vec::new(), 1.0)
    }

    #[test]
    fn the_name_tells_the_format() {
        let folder = tempfile::tempdir().unwrap();
        for (name, magic) in [
            ("a.png", &b"\x89PNG"[..]),
            ("a.jpg", b"\xff\xd8"),
            ("A.JPEG", b"\xff\xd8"),
            ("a.exr", b"\x76\x2f\x31\x01"),
        ] {
            let path = folder.path().join(name);
            picture().save(&path).unwrap();
            assert!(std::fs::read(path).unwrap().starts_with(magic), "{name}");
        }
        let why = picture().save(folder.path().join("a.gif")).unwrap_err();
        assert!(why.to_string().contains("a.gif: the name must end in .png"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 4);
    }

    #[test]
    fn a_png_in_memory_is_that_of_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        picture().save(&path).unwrap();
        assert!(picture().png().unwrap() == std::fs::read(path).unwrap());
    }

    #[test]
    fn a_picture_that_cannot_be_written_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let taken = folder.path().join("taken.png");
        std::fs::create_dir(&taken).unwrap();
        let why = picture().save(&taken).unwrap_err().to_string();
        assert!(why.contains("taken.png"), "{why}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}
