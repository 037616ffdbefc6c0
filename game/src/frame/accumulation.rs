//! Accumulation of sample batches into the picture on show: summed in linear light and tone-mapped, on
//! a thread of its own, as that takes as long as several frames of the window for a full-size picture.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use carom_farm::{Error, SampleBatch};
use carom_tracer::ImageSize;
use carom_tracer::film::Film;
use carom_tracer::tonemap::srgb8;

use crate::scene::scene_builder::EXPOSURE;

/// Picture of all batches so far.
#[derive(Clone, Debug, PartialEq)]
pub struct AccumulatedFrame {
    /// Identifier of the picture.
    pub series: u64,
    /// Width and height in pixels.
    pub size: ImageSize,
    /// sRGB with an alpha of 255, row-major from the top left.
    pub rgba: Vec<[u8; 4]>,
    /// Samples per pixel of all batches.
    pub samples: u32,
}

/// Sum of one picture's batches; a batch of another picture starts a new sum.
#[derive(Debug, Default)]
pub struct Accumulator {
    film: Option<(u64, Film)>,
}

impl Accumulator {
    /// Adds a batch to the picture `series`.
    ///
    /// # Errors
    /// Those of [`SampleBatch::add_to`].
    pub fn add(&mut self, series: u64, batch: &SampleBatch) -> Result<(), Error> {
        let film = self.film.take().filter(|(of, _)| *of == series);
        let (_, film) = self
            .film
            .insert(film.unwrap_or_else(|| (series, Film::new(batch.frame.size))));
        batch.add_to(film)
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

/// Handle to an [`Accumulator`] on its own thread, which ends when the handle is dropped.
#[derive(Debug)]
pub struct AccumulationThread {
    batches: Sender<(u64, SampleBatch)>,
    frames: Receiver<AccumulatedFrame>,
}

impl AccumulationThread {
    /// Starts the thread.
    ///
    /// # Errors
    /// If the system cannot start it.
    pub fn open() -> std::io::Result<Self> {
        let (batches, inbox) = channel();
        let (outbox, frames) = channel();
        thread::Builder::new()
            .name("accumulation".to_owned())
            .spawn(move || run(&inbox, &outbox))?;
        Ok(Self { batches, frames })
    }

    /// Sends a batch of the picture `series` to the thread; [`Self::poll`] returns the result later.
    pub fn submit(&self, series: u64, batch: SampleBatch) {
        if self.batches.send((series, batch)).is_err() {
            tracing::error!("the thread that accumulates pictures has ended");
        }
    }

    /// The next finished picture, if there is one.
    pub fn poll(&self) -> Option<AccumulatedFrame> {
        self.frames.try_recv().ok()
    }
}

fn run(inbox: &Receiver<(u64, SampleBatch)>, outbox: &Sender<AccumulatedFrame>) {
    let mut accumulator = Accumulator::default();
    while let Ok(first) = inbox.recv() {
        // Batches that have queued up share one frame, as tone mapping is the slow part.
        for (series, batch) in std::iter::once(first).chain(inbox.try_iter()) {
            if let Err(error) = accumulator.add(series, &batch) {
                tracing::error!("a batch of samples is left out: {error}");
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
    use carom_farm::{Frame, FrameId, FrameStats, Pixels};

    use super::*;

    fn batch(radiance: f32, samples: u32) -> SampleBatch {
        let frame = Frame {
            id: FrameId(0),
            size: ImageSize::new(2, 2),
            pixels: Pixels::Linear(vec![[radiance; 3]; 4]),
            missing: Vec::new(),
            stats: FrameStats::default(),
        };
        SampleBatch { frame, samples }
    }

    #[test]
    fn batches_are_weighted_by_samples_in_linear_light() {
        let mut accumulator = Accumulator::default();
        accumulator.add(1, &batch(0.0, 3)).unwrap();
        accumulator.add(1, &batch(0.856_164_6, 1)).unwrap();
        let frame = accumulator.frame().unwrap();
        // A quarter of it is 0.21404 in linear light, which is 128 in sRGB; a mean of the tone-mapped
        // values would be 60.
        assert_eq!((frame.samples, frame.rgba[3]), (4, [128, 128, 128, 255]));
    }

    #[test]
    fn another_picture_begins_anew() {
        let mut accumulator = Accumulator::default();
        accumulator.add(1, &batch(0.5, 3)).unwrap();
        accumulator.add(2, &batch(1.0, 1)).unwrap();
        let frame = accumulator.frame().unwrap();
        let [r, g, b] = srgb8([1.0; 3], EXPOSURE);
        assert_eq!(
            (frame.series, frame.samples, frame.rgba[0]),
            (2, 1, [r, g, b, 255])
        );
    }

    #[test]
    fn the_thread_tone_maps_what_it_is_given() {
        let accumulation = AccumulationThread::open().unwrap();
        accumulation.submit(7, batch(1.0, 2));
        let frame = accumulation.frames.recv().unwrap();
        assert_eq!((frame.series, frame.samples), (7, 2));
    }
}
