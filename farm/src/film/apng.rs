//! Pictures into PNG files, one by one and as an animation.

use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use anyhow::Context as _;
use carom_tracer::ImageSize;
use png::{BitDepth, ColorType, Compression, Encoder, SrgbRenderingIntent, Writer};

/// Writes `rgb`, sRGB bytes row by row, to `path`.
///
/// # Errors
/// A sentence with the path.
pub fn write_png(path: &Path, size: ImageSize, rgb: &[u8]) -> anyhow::Result<()> {
    let write = || -> anyhow::Result<()> {
        let mut writer = encoder(path, size)?.write_header()?;
        writer.write_image_data(rgb)?;
        Ok(writer.finish()?)
    };
    write().with_context(|| format!("cannot write {}", path.display()))
}

/// An animated PNG that is written frame by frame; programs that know no animation show its first
/// frame.
pub struct Animation {
    writer: Writer<BufWriter<File>>,
}

impl Animation {
    /// Begins an animation of exactly `frames` frames that repeats for ever.
    ///
    /// # Errors
    /// A sentence with the path.
    pub fn create(
        path: &Path,
        size: ImageSize,
        frames: u32,
        frames_per_sec: u16,
    ) -> anyhow::Result<Self> {
        let begin = || -> anyhow::Result<Self> {
            let mut encoder = encoder(path, size)?;
            encoder.set_animated(frames, 0)?;
            encoder.set_frame_delay(1, frames_per_sec)?;
            let writer = encoder.write_header()?;
            Ok(Self { writer })
        };
        begin().with_context(|| format!("cannot write {}", path.display()))
    }

    /// Adds a frame of sRGB bytes, row by row.
    ///
    /// # Errors
    /// The system's reason, or a frame of another size.
    pub fn push(&mut self, rgb: &[u8]) -> anyhow::Result<()> {
        self.writer
            .write_image_data(rgb)
            .context("cannot write the animation")
    }

    /// Ends the file.
    ///
    /// # Errors
    /// The system's reason, or fewer frames than promised.
    pub fn finish(self) -> anyhow::Result<()> {
        self.writer.finish().context("cannot end the animation")
    }
}

fn encoder(path: &Path, size: ImageSize) -> anyhow::Result<Encoder<'static, BufWriter<File>>> {
    let file = BufWriter::new(File::create(path)?);
    let mut encoder = Encoder::new(file, size.width, size.height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    encoder.set_source_srgb(SrgbRenderingIntent::Perceptual);
    // Path-traced noise compresses badly whatever is tried.
    encoder.set_compression(Compression::Fast);
    Ok(encoder)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(value: u8) -> Vec<u8> {
        vec![value; 4 * 2 * 3]
    }

    #[test]
    fn an_animation_holds_each_frame_and_its_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut animation = Animation::create(&path, ImageSize::new(4, 2), 3, 30).unwrap();
        for value in [10, 20, 30] {
            animation.push(&frame(value)).unwrap();
        }
        animation.finish().unwrap();
        let file = std::io::BufReader::new(File::open(&path).unwrap());
        let mut reader = png::Decoder::new(file).read_info().unwrap();
        assert_eq!(reader.info().animation_control.unwrap().num_frames, 3);
        for value in [10, 20, 30] {
            let mut pixels = frame(0);
            reader.next_frame(&mut pixels).unwrap();
            let control = reader.info().frame_control.unwrap();
            assert_eq!((control.delay_num, control.delay_den), (1, 30));
            assert_eq!(pixels, frame(value));
        }
    }

    #[test]
    fn a_path_that_cannot_be_written_is_named() {
        let error = write_png(
            Path::new("/no/such/folder/x.png"),
            ImageSize::new(4, 2),
            &frame(1),
        );
        assert!(format!("{:#}", error.unwrap_err()).contains("/no/such/folder/x.png"));
    }
}
