//! Sample ranges into one picture: merged in linear light and tone-mapped, on a thread of its own,
//! for a full-size picture takes as long as several frames of the window.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use carom_tracer::film::Film;
use carom_tracer::tonemap::srgb8;
use carom_tracer::{Error, ImageSize, Tile};

use crate::scene::scene_builder::EXPOSURE;

/// One sample range of a picture.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleBatch {
    /// Which picture: ranges of the same one are merged.
    pub series: u64,
    /// Pixels across and down.
    pub size: ImageSize,
    /// Mean radiance, row-major from the top left.
    pub radiance: Vec<[f32; 3]>,
    /// Paths per pixel.
    pub samples: u32,
}

/// A picture of all ranges so far.
#[derive(Clone, Debug, PartialEq)]
pub struct AccumulatedFrame {
    /// Which picture.
    pub series: u64,
    /// Pixels across and down.
    pub size: ImageSize,
    /// sRGB and 255, row-major from the top left.
    pub rgba: Vec<[u8; 4]>,
    /// Paths per pixel, of all ranges.
    pub samples: u32,
}

/// Merges one picture's ranges; a range of another picture begins anew.
#[derive(Debug, Default)]
pub struct Accumulator {
    film: Option<(u64, Film)>,
}

impl Accumulator {
    /// Adds a range to its picture.
    ///
    /// # Errors
    /// [`Error::InvalidSettings`] if its size is not that of its picture.
    pub fn add(&mut self, batch: &SampleBatch) -> Result<(), Error> {
        let SampleBatch { series, size, .. } = *batch;
        if self.film.as_ref().is_none_or(|(of, _)| *of != series) {
            self.film = Some((series, Film::new(size)));
        }
        let whole = Tile {
            x: 0,
            y: 0,
            width: size.width,
            height: size.height,
        };
        match &mut self.film {
            Some((_, film)) => film.add(whole, &batch.radiance, batch.samples),
            None => Ok(()),
        }
    }

    /// The picture so far.
    pub fn frame(&self) -> Option<AccumulatedFrame> {
        let (series, film) = self.film.as_ref()?;
        let tone_map = |&radiance: &[f32; 3]| {
            let [r, g, b] = srgb8(radiance, EXPOSURE);
            [r, g, b, 255]
        };
        Some(AccumulatedFrame {
            series: *series,
            size: film.size(),
            rgba: film.image().pixels.iter().map(tone_map).collect(),
            samples: film.samples_min() as u32,
        })
    }
}

/// An [`Accumulator`] on its own thread, which ends with this handle.
#[derive(Debug)]
pub struct AccumulationThread {
    batches: Sender<SampleBatch>,
    frames: Receiver<AccumulatedFrame>,
}

impl AccumulationThread {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system's reason.
    pub fn open() -> std::io::Result<Self> {
        let (batches, inbox) = channel();
        let (outbox, frames) = channel();
        thread::Builder::new()
            .name("accumulation".to_owned())
            .spawn(move || run(&inbox, &outbox))?;
        Ok(Self { batches, frames })
    }

    /// Hands a range over; its picture comes later.
    pub fn submit(&self, batch: SampleBatch) {
        if self.batches.send(batch).is_err() {
            tracing::error!("the thread that merges pictures has ended");
        }
    }

    /// A picture that is ready.
    pub fn poll(&self) -> Option<AccumulatedFrame> {
        self.frames.try_recv().ok()
    }
}

fn run(inbox: &Receiver<SampleBatch>, outbox: &Sender<AccumulatedFrame>) {
    let mut accumulator = Accumulator::default();
    while let Ok(first) = inbox.recv() {
        // Ranges that came meanwhile share one frame: printing is the slow part.
        for batch in std::iter::once(first).chain(inbox.try_iter()) {
            if let Err(error) = accumulator.add(&batch) {
                tracing::error!("a sample range is left out: {error}");
            }
        }
        let sent = accumulator.frame().map(|frame| outbox.send(frame));
        if sent.is_some_and(|sent| sent.is_err()) {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn batch(series: u64, radiance: f32, samples: u32) -> SampleBatch {
        let size = ImageSize::new(2, 2);
        SampleBatch {
            series,
            size,
            radiance: vec![[radiance; 3]; 4],
            samples,
        }
    }

    #[test]
    fn ranges_are_weighted_by_their_samples_in_linear_light() {
        let mut accumulator = Accumulator::default();
        accumulator.add(&batch(1, 0.0, 3)).unwrap();
        accumulator.add(&batch(1, 0.856_164_6, 1)).unwrap();
        let frame = accumulator.frame().unwrap();
        // A quarter of it is 0.21404 in linear light, which is 128 in sRGB; a mean of the tone-mapped
        // values would be 60.
        assert_eq!((frame.samples, frame.rgba[3]), (4, [128, 128, 128, 255]));
    }

    #[test]
    fn another_picture_begins_anew() {
        let mut accumulator = Accumulator::default();
        accumulator.add(&batch(1, 0.5, 3)).unwrap();
        accumulator.add(&batch(2, 1.0, 1)).unwrap();
        let frame = accumulator.frame().unwrap();
        assert_eq!(
            (frame.series, frame.samples, frame.rgba[0]),
            (2, 1, [255; 4])
        );
    }

    #[test]
    fn the_thread_prints_what_it_is_given() {
        let accumulation = AccumulationThread::open().unwrap();
        accumulation.submit(batch(7, 1.0, 2));
        let frame = accumulation.frames.recv().unwrap();
        assert_eq!((frame.series, frame.samples), (7, 2));
    }
}
