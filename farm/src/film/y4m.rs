//! YUV4MPEG2: uncompressed video that encoders and players read.
//!
//! The format is that of mjpegtools (`man yuv4mpeg`): a header line with size and rate, then for each frame
//! the word FRAME and the planes. Chroma is not subsampled (`C444`). The file cannot state its Y'CbCr
//! matrix, and players guess it from the size, BT.709 for high definition and BT.601 below, so that is what
//! is written.

use std::io::{self, Write};

use carom_tracer::ImageSize;

/// A Y4M stream that is written frame by frame.
#[derive(Debug)]
pub(super) struct Y4m<W> {
    out: W,
    size: ImageSize,
    matrix: YuvMatrix,
}

impl<W: Write> Y4m<W> {
    /// Writes the header.
    pub(super) fn begin(mut out: W, size: ImageSize, frames_per_sec: u16) -> io::Result<Self> {
        let ImageSize { width, height } = size;
        writeln!(
            out,
            "YUV4MPEG2 W{width} H{height} F{frames_per_sec}:1 Ip A1:1 C444 XCOLORRANGE=LIMITED"
        )?;
        Ok(Self {
            out,
            size,
            matrix: YuvMatrix::of(size),
        })
    }

    /// Adds a frame of sRGB bytes, row by row.
    pub(super) fn push(&mut self, rgb: &[u8]) -> io::Result<()> {
        let pixels = self.size.pixels();
        let mut planes = vec![0; 3 * pixels];
        for (i, pixel) in rgb.chunks_exact(3).take(pixels).enumerate() {
            let ycc = self.matrix.ycc([pixel[0], pixel[1], pixel[2]]);
            for (plane, value) in ycc.into_iter().enumerate() {
                planes[plane * pixels + i] = value;
            }
        }
        self.out.write_all(b"FRAME\n")?;
        self.out.write_all(&planes)
    }

    /// Ends the stream.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

/// Luma coefficients of red and blue; green's is 1 minus their sum.
#[derive(Clone, Copy, Debug, PartialEq)]
struct YuvMatrix {
    red: f32,
    blue: f32,
}

impl YuvMatrix {
    /// ITU-R BT.709-6, item 3.2.
    const HIGH: Self = Self {
        red: 0.2126,
        blue: 0.0722,
    };
    /// ITU-R BT.601-7, item 2.5.1.
    const STANDARD: Self = Self {
        red: 0.299,
        blue: 0.114,
    };

    /// The matrix that players assume for a size.
    fn of(size: ImageSize) -> Self {
        if size.width >= 1280 || size.height > 576 {
            Self::HIGH
        } else {
            Self::STANDARD
        }
    }

    /// Limited-range 8-bit Y'CbCr: luma 16 to 235, chroma 16 to 240 around 128.
    fn ycc(self, rgb: [u8; 3]) -> [u8; 3] {
        let [r, g, b] = rgb.map(|v| f32::from(v) / 255.0);
        let luma = self.red * r + (1.0 - self.red - self.blue) * g + self.blue * b;
        // Scaled so that Cb and Cr range over ±½: |B' − Y'| is at most 1 − K_B, and likewise for red.
        let chroma = |colour: f32, share: f32| (colour - luma) / (2.0 * (1.0 - share));
        [
            (16.0 + 219.0 * luma).round() as u8,
            (128.0 + 224.0 * chroma(b, self.blue)).round() as u8,
            (128.0 + 224.0 * chroma(r, self.red)).round() as u8,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_where_the_recommendations_put_them() {
        // White, black and primaries of 100 % bars.
        let high = [
            ([255, 255, 255], [235, 128, 128]),
            ([0, 0, 0], [16, 128, 128]),
            ([255, 0, 0], [63, 102, 240]),
            ([0, 255, 0], [173, 42, 26]),
            ([0, 0, 255], [32, 240, 118]),
        ];
        for (rgb, ycc) in high {
            assert_eq!(YuvMatrix::HIGH.ycc(rgb), ycc, "{rgb:?}");
        }
        assert_eq!(YuvMatrix::STANDARD.ycc([255, 0, 0]), [81, 90, 240]);
        assert_eq!(YuvMatrix::STANDARD.ycc([0, 255, 0]), [145, 54, 34]);
        assert_eq!(YuvMatrix::of(ImageSize::new(640, 360)), YuvMatrix::STANDARD);
        assert_eq!(YuvMatrix::of(ImageSize::new(1280, 720)), YuvMatrix::HIGH);
    }

    #[test]
    fn a_film_is_a_line_and_planes() {
        let mut bytes = Vec::new();
        let mut film = Y4m::begin(&mut bytes, ImageSize::new(3, 1), 25).unwrap();
        film.push(&[255, 255, 255, 0, 0, 0, 255, 0, 0]).unwrap();
        film.push(&[0; 9]).unwrap();
        film.finish().unwrap();
        let line = b"YUV4MPEG2 W3 H1 F25:1 Ip A1:1 C444 XCOLORRANGE=LIMITED\n";
        let frames = bytes.strip_prefix(line).unwrap();
        let first = [235, 16, 81, 128, 128, 90, 128, 128, 240];
        assert_eq!(frames[..15], [&b"FRAME\n"[..], &first].concat());
        assert_eq!(frames.len(), 30);
    }
}
