//! Animated PNG, written frame by frame.

use std::io::{self, Write};

use carom_tracer::ImageSize;
use png::{Compression, Writer};

use crate::picture::png_encoder;

/// An animated PNG in progress; programs without animation support show its first frame.
pub(super) struct Animation<W: Write> {
    writer: Writer<W>,
}

impl<W: Write> Animation<W> {
    /// Begins an animation of exactly `frames` frames that repeats indefinitely.
    pub(super) fn begin(
        to: W,
        size: ImageSize,
        frames: u32,
        frames_per_sec: u16,
    ) -> io::Result<Self> {
        let mut encoder = png_encoder(to, size, COMPRESSION);
        encoder.set_animated(frames, 0)?;
        encoder.set_frame_delay(1, frames_per_sec)?;
        let writer = encoder.write_header()?;
        Ok(Self { writer })
    }

    /// Adds a frame of sRGB bytes, row by row.
    pub(super) fn push(&mut self, rgb: &[u8]) -> io::Result<()> {
        Ok(self.writer.write_image_data(rgb)?)
    }

    /// Ends the file.
    pub(super) fn finish(self) -> io::Result<()> {
        Ok(self.writer.finish()?)
    }
}

/// Fast, as path-traced noise compresses badly at any level.
pub(super) const COMPRESSION: Compression = Compression::Fast;

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(value: u8) -> Vec<u8> {
        vec![value; 4 * 2 * 3]
    }

    #[test]
    fn an_animation_holds_each_frame_and_its_time() {
        let mut bytes = Vec::new();
        let mut animation = Animation::begin(&mut bytes, ImageSize::new(4, 2), 3, 30).unwrap();
        for value in [10, 20, 30] {
            animation.push(&frame(value)).unwrap();
        }
        animation.finish().unwrap();
        let mut reader = png::Decoder::new(io::Cursor::new(bytes))
            .read_info()
            .unwrap();
        assert_eq!(reader.info().animation_control.unwrap().num_frames, 3);
        for value in [10, 20, 30] {
            let mut pixels = frame(0);
            reader.next_frame(&mut pixels).unwrap();
            let control = reader.info().frame_control.unwrap();
            assert_eq!((control.delay_num, control.delay_den), (1, 30));
            assert_eq!(pixels, frame(value));
        }
    }
}
