//! Reprojection for temporal accumulation and for latency hiding, by [`carom_tracer::reproject`].
//!
//! Earlier frames are reprojected onto a new one to reduce its noise; the newest frame is reprojected to
//! the present camera and balls, so that the picture moves at the display's rate between frames of the
//! farm.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, channel};

use anyhow::Context as _;
use carom_tracer::reproject::View;
use carom_tracer::reproject::temporal_accumulation::{STILL_FRAMES_MAX, TemporalAccumulation};
use carom_tracer::{CompiledScene, ImageSize, Scene, SceneUpdate, Tile};
use carom_window::display::DisplayFrame;
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Accumulates and reprojects pictures on a thread pool of its own. The cost in CPU time a pixel is
/// [`NEW_PIXEL_NANOS`] and [`ACCUMULATED_PIXEL_NANOS`] for a new picture, and [`MOVED_PIXEL_NANOS`] for
/// each reprojection, of which there is none while the newest picture shows the present.
#[derive(Debug)]
pub struct Reprojector {
    scene: CompiledScene,
    /// Views of pictures that are still being traced, the newest first.
    expected: VecDeque<ExpectedView>,
    /// Serial number of the newest picture seen, and its view.
    from: Option<(u64, View)>,
    /// An unused view, whose buffers are reused.
    spare: Option<View>,
    /// The last view that a picture was reprojected to, whose buffers are reused.
    to: Option<View>,
    moved: Option<ReprojectedFrame>,
    accumulation: TemporalAccumulation,
    /// The serial number of the picture that was accumulated last.
    accumulated: Option<u64>,
    count: u64,
    /// A pool apart from the tracer's, whose tasks take longer than a frame is shown.
    threads: ThreadPool,
}

/// View of a requested picture (its first hits), computed while the farm traces it.
#[derive(Debug)]
struct ExpectedView {
    update: SceneUpdate,
    size: ImageSize,
    view: Receiver<View>,
}

#[derive(Debug)]
struct ReprojectedFrame {
    /// Serial number of the picture that was reprojected.
    of: u64,
    picture: DisplayFrame,
    disocclusion_fraction: f64,
}

impl Reprojector {
    /// A reprojector for pictures of `scene`.
    ///
    /// # Errors
    /// If the scene is invalid, or threads cannot be started.
    pub fn new(scene: &Scene) -> anyhow::Result<Self> {
        let threads = ThreadPoolBuilder::new().thread_name(|_| "reprojection".into());
        Ok(Self {
            scene: CompiledScene::new(scene)?,
            expected: VecDeque::new(),
            from: None,
            spare: None,
            to: None,
            moved: None,
            accumulation: TemporalAccumulation::default(),
            accumulated: None,
            count: 0,
            threads: threads.build().context("threads for reprojection")?,
        })
    }

    /// Begins to compute the view of a requested picture of `size` after `update`, so that it can be
    /// reprojected as soon as it arrives.
    pub fn expect(&mut self, update: &SceneUpdate, size: ImageSize) {
        let update = bodies(update);
        let (sender, found) = channel();
        let (mut scene, of, earlier) = (self.scene.clone(), update.clone(), self.spare.take());
        self.threads.spawn(move || {
            if scene.apply(&of).is_ok() {
                // The receiver is gone if the picture was given up.
                _ = sender.send(view(&scene, size, earlier));
            }
        });
        // The oldest is probably of a cancelled picture; otherwise its view is computed again when it
        // arrives.
        self.expected.truncate(EXPECTED_MAX - 1);
        self.expected.push_front(ExpectedView {
            update,
            size,
            view: found,
        });
    }

    /// The view of `picture`, if it was expected.
    fn expected(&mut self, picture: &DisplayFrame) -> Option<View> {
        let update = bodies(&picture.update);
        let is_of = |view: &ExpectedView| (view.size, &view.update) == (picture.size, &update);
        let place = self.expected.iter().position(is_of)?;
        // May wait, but only for work that began when the picture was requested and that is needed now
        // anyway.
        self.expected.remove(place)?.view.recv().ok()
    }

    /// Blends `picture`, of a moving view, with the history of those before it, or with the picture
    /// `at_rest` that it replaces. Returns whether it has been accumulated: not if it is too large for the
    /// threads to do so in time, or does not fit the scene.
    pub fn accumulate(
        &mut self,
        picture: &mut DisplayFrame,
        at_rest: Option<&DisplayFrame>,
    ) -> bool {
        if self.accumulated == Some(picture.serial) {
            return true;
        }
        let threads = self.threads.current_num_threads() as f64;
        let nanos = picture.size.pixels() as f64 * ACCUMULATED_PIXEL_NANOS;
        if nanos > threads * ACCUMULATE_NANOS {
            return false;
        }
        let earlier = self.from.take();
        self.look_at(picture);
        let Some((_, view)) = &self.from else {
            return false;
        };
        let accumulation = &mut self.accumulation;
        // The history is in the view of the picture accumulated last; reprojecting it from another view
        // would smear it.
        let is_accumulated = earlier.as_ref().map(|(of, _)| *of) == self.accumulated;
        // Continues the history; or begins one with the converged picture at rest, which counts as many
        // frames; or begins one with this picture alone.
        self.threads.install(|| match &earlier {
            Some((_, earlier)) if is_accumulated => {
                accumulation.accumulate(earlier, view, &mut picture.rgba);
            }
            Some((of, earlier)) if let Some(rest) = at_rest.filter(|rest| rest.serial == *of) => {
                accumulation.begin(earlier, &rest.rgba, STILL_FRAMES_MAX);
                accumulation.accumulate(earlier, view, &mut picture.rgba);
            }
            _ => accumulation.begin(view, &picture.rgba, 1.0),
        });
        self.accumulated = Some(picture.serial);
        self.spare = earlier.map(|(_, view)| view).or(self.spare.take());
        true
    }

    /// Sets `from` to the view of `picture`, computing it unless it is known or expected.
    fn look_at(&mut self, picture: &DisplayFrame) {
        let is_known = |(of, _): &(u64, View)| *of == picture.serial;
        if self.from.as_ref().is_some_and(is_known) {
            return;
        }
        let earlier = self.from.take().map(|(_, view)| view);
        self.spare = earlier.or_else(|| self.spare.take());
        let found = self.expected(picture).or_else(|| {
            let Self { scene, spare, .. } = self;
            scene.apply(&bodies(&picture.update)).ok()?;
            let size = picture.size;
            Some(self.threads.install(|| view(scene, size, spare.take())))
        });
        self.from = found.map(|view| (picture.serial, view));
    }

    /// `picture` reprojected to the scene after `now`; `picture` itself if it shows that, or if either
    /// does not fit the scene.
    pub fn reproject_to<'a>(
        &'a mut self,
        picture: &'a DisplayFrame,
        now: &SceneUpdate,
    ) -> &'a DisplayFrame {
        let is_now =
            |update: &SceneUpdate| (update.camera, &update.poses) == (now.camera, &now.poses);
        if is_now(&picture.update) {
            self.moved = None;
            return picture;
        }
        let done =
            |moved: &ReprojectedFrame| moved.of == picture.serial && is_now(&moved.picture.update);
        if !self.moved.as_ref().is_some_and(done) {
            let memory = self.moved.take().map(|moved| moved.picture.rgba);
            self.moved = self.moved(picture, now, memory.unwrap_or_default());
        }
        self.reprojected(picture)
    }

    /// The last result of [`Reprojector::reproject_to`] for `picture`, or `picture` itself.
    pub fn reprojected<'a>(&'a self, picture: &'a DisplayFrame) -> &'a DisplayFrame {
        let moved = self.moved.as_ref();
        let moved = moved.filter(|moved| moved.of == picture.serial);
        moved.map_or(picture, |moved| &moved.picture)
    }

    /// Fills the `missing` tiles of `picture` from the picture `before`, reprojected to the view of
    /// `picture`; leaves them if either does not fit the scene.
    pub fn fill(&mut self, picture: &mut DisplayFrame, missing: &[Tile], before: &DisplayFrame) {
        let Some(moved) = self.moved(before, &picture.update, Vec::new()) else {
            return;
        };
        let (from, width) = (moved.picture.size, picture.size.width as usize);
        let scaled = |at: u32, to: u32, from: u32| (at * from / to) as usize;
        for tile in missing {
            for y in tile.y..tile.y + tile.height {
                let row = scaled(y, picture.size.height, from.height) * from.width as usize;
                for x in tile.x..tile.x + tile.width {
                    let place = row + scaled(x, picture.size.width, from.width);
                    picture.rgba[y as usize * width + x as usize] = moved.picture.rgba[place];
                }
            }
        }
    }

    /// Share of the pixels on show that were disoccluded in the newest picture, if that had to be
    /// reprojected.
    pub fn disocclusion_fraction(&self) -> Option<f64> {
        self.moved.as_ref().map(|moved| moved.disocclusion_fraction)
    }

    /// Number of pictures reprojected so far.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// `picture` reprojected to `now`, with pixels in the buffer `memory`.
    fn moved(
        &mut self,
        picture: &DisplayFrame,
        now: &SceneUpdate,
        memory: Vec<[u8; 4]>,
    ) -> Option<ReprojectedFrame> {
        self.look_at(picture);
        let Self {
            scene, from, to, ..
        } = self;
        let now = bodies(now);
        let size = moved_size(picture.size, self.threads.current_num_threads());
        let (_, from) = from.as_ref()?;
        scene.apply(&now).ok()?;
        let reprojected = self.threads.install(|| {
            let earlier = to.take();
            let to = to.insert(view(scene, size, earlier));
            from.reproject_into(&picture.rgba, to, memory)
        });
        self.count += 1;
        Some(ReprojectedFrame {
            of: picture.serial,
            disocclusion_fraction: reprojected.guessed as f64 / size.pixels().max(1) as f64,
            picture: DisplayFrame {
                serial: SERIALS_FIRST + self.count,
                size,
                rgba: reprojected.pixels,
                update: now,
            },
        })
    }
}

/// The view of `scene` in `size`, in the buffers of an earlier view if there is one.
fn view(scene: &CompiledScene, size: ImageSize, earlier: Option<View>) -> View {
    let Some(mut view) = earlier else {
        return View::new(scene, size);
    };
    view.update(scene, size);
    view
}

/// An update without its particles: they are reprojected with the surfaces behind them.
fn bodies(update: &SceneUpdate) -> SceneUpdate {
    SceneUpdate {
        camera: update.camera,
        poses: update.poses.clone(),
        particles: Vec::new(),
    }
}

/// The size of a reprojected picture: its own if the threads can reproject that in time, a smaller one of
/// the same shape otherwise, as fast motion needs less detail.
fn moved_size(size: ImageSize, threads: usize) -> ImageSize {
    // The time budget, less the cost of the new picture, as a number of pixels: in a large window, pictures
    // become coarser rather than late.
    let left_nanos = threads as f64 * MOVE_NANOS - size.pixels() as f64 * NEW_PIXEL_NANOS;
    let pixels = (left_nanos / MOVED_PIXEL_NANOS).max(PIXELS_MIN as f64);
    let share = (pixels / size.pixels().max(1) as f64).sqrt().min(1.0);
    let edge = |pixels: u32| ((f64::from(pixels) * share).round() as u32).max(1);
    ImageSize::new(edge(size.width), edge(size.height))
}

/// Largest number of views kept for requested pictures.
const EXPECTED_MAX: usize = 3;
/// Time budget of each thread for a new picture and its first reprojection, in ns.
const MOVE_NANOS: f64 = 4e6;
/// Thread time for a pixel of a new picture and for a pixel of a reprojected one, in ns, with all of 16
/// threads busy: measured by the example `reprojection_speed` of `carom-tracer`.
const NEW_PIXEL_NANOS: f64 = 20.0;
const MOVED_PIXEL_NANOS: f64 = 50.0;
/// Thread time to accumulate a pixel, by the same example, and the time budget of each thread for a
/// picture, in ns.
const ACCUMULATED_PIXEL_NANOS: f64 = 60.0;
const ACCUMULATE_NANOS: f64 = 4.5e6;
/// Least number of pixels of a reprojected picture, however long that takes.
const PIXELS_MIN: usize = 640 * 360;
/// First serial number of reprojected frames, beyond those of traced ones.
const SERIALS_FIRST: u64 = 1 << 63;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::ball_materials::BallSet;
    use crate::scene::table_scene::TableScene;

    fn picture(update: SceneUpdate) -> DisplayFrame {
        let size = ImageSize::new(64, 36);
        let gray = |i: usize| [(i % 64 * 4) as u8, 0, 0, 255];
        DisplayFrame {
            serial: 7,
            size,
            rgba: (0..size.pixels()).map(gray).collect(),
            update,
        }
    }

    fn turned(table_scene: &TableScene, radians: f32) -> SceneUpdate {
        let mut camera = table_scene.scene().camera;
        let turn = glam::Quat::from_rotation_z(radians);
        camera.eye = camera.target + turn * (camera.eye - camera.target);
        SceneUpdate {
            camera: Some(camera),
            poses: Vec::new(),
            ..SceneUpdate::default()
        }
    }

    #[test]
    fn a_picture_of_the_present_is_shown_as_it_is() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
        let picture = picture(turned(&table_scene, 0.1));
        assert_eq!(
            reprojector
                .reproject_to(&picture, &picture.update.clone())
                .serial,
            7
        );
        assert_eq!(
            (reprojector.count(), reprojector.disocclusion_fraction()),
            (0, None)
        );
    }

    #[test]
    fn a_picture_of_the_past_is_moved_once_for_each_new_view() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
        let picture = picture(turned(&table_scene, 0.0));
        let view = turned(&table_scene, 0.02);
        let first = reprojector.reproject_to(&picture, &view).clone();
        assert_ne!((first.serial, &first.rgba), (7, &picture.rgba));
        assert_eq!(
            reprojector.reproject_to(&picture, &view).serial,
            first.serial
        );
        assert_ne!(
            reprojector
                .reproject_to(&picture, &turned(&table_scene, 0.03))
                .serial,
            first.serial
        );
        assert_eq!(reprojector.count(), 2);
        assert!(reprojector.disocclusion_fraction().unwrap() < 0.1);
    }

    #[test]
    fn a_picture_that_was_expected_is_moved_like_any_other() {
        let table_scene = TableScene::room(BallSet::Classic);
        let picture = picture(turned(&table_scene, 0.0));
        let view = turned(&table_scene, 0.02);
        let moved = |expected: &[f32]| {
            let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
            for radians in expected {
                reprojector.expect(&turned(&table_scene, *radians), picture.size);
            }
            let moved = reprojector.reproject_to(&picture, &view).rgba.clone();
            (moved, reprojector.expected.len())
        };
        let (unexpected, _) = moved(&[]);
        assert_eq!(moved(&[0.0]), (unexpected.clone(), 0));
        assert_eq!(moved(&[0.0, 0.1, 0.2]), (unexpected.clone(), 2));
        // Given up, as more than are held have been asked for since.
        assert_eq!(moved(&[0.0, 0.1, 0.2, 0.3]), (unexpected, EXPECTED_MAX));
    }

    /// A picture whose levels are 100 on average and differ by up to `noise`.
    fn noisy(serial: u64, noise: u32, update: SceneUpdate) -> DisplayFrame {
        let size = ImageSize::new(64, 36);
        let level = |i: usize| {
            let random = (i as u32 + 9973 * serial as u32).wrapping_mul(2_654_435_761) >> 16;
            let level = (100 - noise + random % (2 * noise + 1)) as u8;
            [level, level, level, 255]
        };
        DisplayFrame {
            serial,
            size,
            rgba: (0..size.pixels()).map(level).collect(),
            update,
        }
    }

    /// Mean distance of levels from 100.
    fn noise(picture: &DisplayFrame) -> f64 {
        let levels = picture.rgba.iter().map(|pixel| pixel[0].abs_diff(100));
        levels.map(f64::from).sum::<f64>() / picture.rgba.len() as f64
    }

    #[test]
    fn noise_of_moving_pictures_is_averaged_each_counted_once() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
        let first = noisy(1, 30, turned(&table_scene, 0.0));
        let mut accumulated = first.clone();
        reprojector.accumulate(&mut accumulated, None);
        assert_eq!(accumulated.rgba, first.rgba);
        let mut last = noisy(2, 30, turned(&table_scene, 0.0));
        let single = noise(&last);
        reprojector.accumulate(&mut last, None);
        let blended = noise(&last);
        assert!(blended < 0.8 * single, "{blended} of {single}");
        let again = last.clone();
        reprojector.accumulate(&mut last, None);
        assert_eq!(last.rgba, again.rgba);
    }

    #[test]
    fn a_view_that_begins_to_move_keeps_what_it_had_at_rest() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
        let rest = noisy(1, 0, turned(&table_scene, 0.0));
        let now = turned(&table_scene, 0.01);
        reprojector.reproject_to(&rest, &now);
        let mut moving = noisy(2, 30, now);
        let single = noise(&moving);
        reprojector.accumulate(&mut moving, Some(&rest));
        let blended = noise(&moving);
        assert!(blended < 0.8 * single, "{blended} of {single}");
    }

    #[test]
    fn pictures_that_would_take_too_long_are_left_as_they_are() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
        let threads = reprojector.threads.current_num_threads() as u32;
        let size = ImageSize::new(1024, 80 * threads);
        let update = turned(&table_scene, 0.0);
        let mut large = DisplayFrame {
            serial: 1,
            size,
            rgba: vec![[5; 4]; size.pixels()],
            update,
        };
        assert!(!reprojector.accumulate(&mut large, None));
        assert_eq!(
            (reprojector.accumulated, reprojector.from.is_none()),
            (None, true)
        );
    }

    #[test]
    fn missing_tiles_are_taken_from_where_the_picture_before_shows_them() {
        let table_scene = TableScene::room(BallSet::Classic);
        let mut reprojector = Reprojector::new(table_scene.scene()).unwrap();
        let before = picture(turned(&table_scene, 0.0));
        let right = |reprojector: &mut Reprojector, update: &SceneUpdate| {
            reprojector.reproject_to(&before, update).clone()
        };
        for radians in [0.0, 0.02] {
            let update = turned(&table_scene, radians);
            let right = right(&mut reprojector, &update);
            let mut holed = DisplayFrame {
                serial: 8,
                rgba: vec![[9; 4]; before.rgba.len()],
                update,
                ..before.clone()
            };
            let tile = Tile {
                x: 16,
                y: 8,
                width: 24,
                height: 12,
            };
            reprojector.fill(&mut holed, &[tile], &before);
            for (place, pixel) in holed.rgba.iter().enumerate() {
                let (x, y) = (place as u32 % 64, place as u32 / 64);
                let inside = (16..40).contains(&x) && (8..20).contains(&y);
                assert_eq!(*pixel, if inside { right.rgba[place] } else { [9; 4] });
            }
        }
    }

    #[test]
    fn large_pictures_are_moved_with_fewer_pixels_of_the_same_shape() {
        let size = moved_size(ImageSize::new(2560, 1440), 2);
        assert_eq!((size.width, size.height), (640, 360));
        assert_eq!(moved_size(ImageSize::new(0, 0), 2), ImageSize::new(1, 1));
    }

    #[test]
    fn the_more_threads_the_more_pixels_are_moved_up_to_all() {
        let full = ImageSize::new(1920, 1080);
        let pixels: Vec<usize> = [1, 4, 8, 16, 20, 32, 64]
            .map(|threads| moved_size(full, threads).pixels())
            .to_vec();
        assert!(pixels.is_sorted(), "{pixels:?}");
        assert_eq!(pixels[0], 640 * 360);
        assert_eq!(moved_size(full, 64), full);
    }
}
