//! Cross-fade from the last picture of a moving view to the first one of the view at rest.

use carom_tracer::ImageSize;
use carom_window::display::DisplayFrame;

/// Blends the picture that was on screen into the one that replaces it, so that the change of resolution
/// and noise is smooth when the view comes to rest.
///
/// Costs 1 ns of CPU time a pixel and redraw while it lasts, and nothing otherwise.
#[derive(Debug, Default)]
pub struct CrossFade {
    fade: Option<Fade>,
    /// Number of blends so far.
    count: u64,
}

#[derive(Debug)]
struct Fade {
    /// Pixels of the old picture, resized to the new one.
    before: Vec<[u8; 4]>,
    began_secs: f64,
    /// The picture on show.
    blended: DisplayFrame,
}

impl CrossFade {
    /// Begins a fade from `before` to `after` if both show the same view.
    pub fn begin(&mut self, now_secs: f64, before: &DisplayFrame, after: &DisplayFrame) {
        if before.update != after.update || before.rgba.is_empty() {
            return;
        }
        self.fade = Some(Fade {
            before: match before.size == after.size {
                true => before.rgba.clone(),
                false => resized(before, after.size),
            },
            began_secs: now_secs,
            blended: after.clone(),
        });
    }

    /// Computes the blend with `after`, the newest picture, at `now_secs`; the fade ends when its time is
    /// over or `after` shows another view.
    pub fn advance(&mut self, now_secs: f64, after: &DisplayFrame) {
        let Some(fade) = &mut self.fade else {
            return;
        };
        let share = (now_secs - fade.began_secs) / FADE_SECS;
        let blended = &mut fade.blended;
        if !(0.0..1.0).contains(&share)
            || after.size != blended.size
            || after.update != blended.update
        {
            self.fade = None;
            return;
        }
        // A weight of 8 bits: 255 · 256 fits u16, so that the loop vectorises over 16-bit lanes.
        let weight = (share * 256.0) as u16;
        let pixels = blended.rgba.iter_mut().zip(&fade.before).zip(&after.rgba);
        for ((to, from), after) in pixels {
            for channel in 0..4 {
                let (from, after) = (u16::from(from[channel]), u16::from(after[channel]));
                to[channel] = ((from * (256 - weight) + after * weight) >> 8) as u8;
            }
        }
        self.count += 1;
        blended.serial = SERIALS_FIRST + self.count;
    }

    /// The blended picture while a fade lasts.
    pub fn blended(&self) -> Option<&DisplayFrame> {
        self.fade.as_ref().map(|fade| &fade.blended)
    }
}

/// A picture's pixels at another size, by bilinear interpolation as in the window.
fn resized(picture: &DisplayFrame, to: ImageSize) -> Vec<[u8; 4]> {
    let from = picture.size;
    let columns: Vec<(usize, usize, f32)> = (0..to.width)
        .map(|x| taps(x, to.width, from.width))
        .collect();
    let rows = (0..to.height).flat_map(|y| {
        let (top, bottom, down) = taps(y, to.height, from.height);
        let row = |y: usize| &picture.rgba[y * from.width as usize..][..from.width as usize];
        let (top, bottom) = (row(top), row(bottom));
        columns.iter().map(move |&(left, right, along)| {
            std::array::from_fn(|channel| {
                let mix = |row: &[[u8; 4]]| {
                    let (a, b) = (
                        f32::from(row[left][channel]),
                        f32::from(row[right][channel]),
                    );
                    a + (b - a) * along
                };
                let (above, below) = (mix(top), mix(bottom));
                (above + (below - above) * down + 0.5) as u8
            })
        })
    });
    rows.collect()
}

/// The two pixels of a row of `from` around the centre of pixel `at` of a row of `to`, and the weight of
/// the second.
fn taps(at: u32, to: u32, from: u32) -> (usize, usize, f32) {
    let place = (at as f32 + 0.5) * from as f32 / to as f32 - 0.5;
    let place = place.clamp(0.0, from as f32 - 1.0);
    let first = place as usize;
    (first, (first + 1).min(from as usize - 1), place.fract())
}

/// Duration of a fade in seconds: long enough to hide the step, short enough not to delay the sharp picture.
const FADE_SECS: f64 = 0.15;
/// First serial number of blended pictures, beyond those of traced and reprojected ones.
const SERIALS_FIRST: u64 = 3 << 62;

#[cfg(test)]
mod tests {
    use carom_tracer::SceneUpdate;

    use super::*;

    fn picture(serial: u64, width: u32, value: u8) -> DisplayFrame {
        let size = ImageSize::new(width, width);
        DisplayFrame {
            serial,
            size,
            rgba: vec![[value, value, value, 255]; size.pixels()],
            update: SceneUpdate::default(),
        }
    }

    #[test]
    fn a_coarse_picture_fades_into_the_sharp_one_without_a_step() {
        let (coarse, sharp) = (picture(1, 3, 40), picture(2, 8, 200));
        let mut fade = CrossFade::default();
        fade.begin(5.0, &coarse, &sharp);
        let mut last = 40;
        for frame in 0..9 {
            fade.advance(5.0 + frame as f64 / 60.0, &sharp);
            let shown = fade.blended().unwrap();
            assert_eq!(
                (shown.size, shown.serial),
                (sharp.size, SERIALS_FIRST + frame + 1)
            );
            let value = shown.rgba[0][0];
            assert!((last..=last + 20).contains(&value), "{last} {value}");
            assert!(shown.rgba.iter().all(|&p| p == [value, value, value, 255]));
            last = value;
        }
        fade.advance(5.15, &sharp);
        assert!(fade.blended().is_none());
    }

    #[test]
    fn views_that_differ_are_cut() {
        let (coarse, mut sharp) = (picture(1, 3, 40), picture(2, 8, 200));
        sharp.update.camera = Some(crate::camera::Viewpoint::behind(glam::DVec3::X, 0.0).camera());
        let mut fade = CrossFade::default();
        fade.begin(0.0, &coarse, &sharp);
        assert!(fade.blended().is_none());

        let sharp = picture(2, 8, 200);
        fade.begin(0.0, &coarse, &sharp);
        assert!(fade.blended().is_some());
        let mut moved = picture(3, 8, 100);
        moved.update.camera = Some(crate::camera::Viewpoint::behind(glam::DVec3::X, 0.0).camera());
        fade.advance(0.01, &moved);
        assert!(fade.blended().is_none());
    }

    #[test]
    fn a_resized_ramp_stays_a_ramp() {
        let mut ramp = picture(1, 4, 0);
        for (place, pixel) in ramp.rgba.iter_mut().enumerate() {
            pixel[0] = (place % 4 * 80) as u8;
        }
        let wide = resized(&ramp, ImageSize::new(8, 4));
        let row: Vec<u8> = wide[..8].iter().map(|pixel| pixel[0]).collect();
        assert_eq!(row, [0, 20, 60, 100, 140, 180, 220, 240]);
    }
}
