//! Early reflections of the room by the image source method (Allen and Berkley, 1979).

use super::RATE_HZ;
use super::listener::{Ear, SOUND_M_S};

/// Adds the reflections of up to second order that an ear hears.
pub(super) fn reverberate(samples: &mut Vec<f32>, ear: Ear) {
    let echoes = echoes(ear);
    let longest = echoes.iter().map(|echo| echo.0).max().unwrap_or(0);
    let dry = std::mem::take(samples);
    samples.extend_from_slice(&dry);
    samples.resize(dry.len() + longest, 0.0);
    for (delay, gain) in echoes {
        for (out, sample) in samples[delay..].iter_mut().zip(&dry) {
            *out += gain * sample;
        }
    }
}

/// Delay in samples after the direct sound, and gain relative to it, of each image of the table's centre.
fn echoes(ear: Ear) -> Vec<(usize, f32)> {
    let ear = ear.place().to_array();
    let ear_m: [f64; 3] = std::array::from_fn(|axis| TABLE_M[axis] + ear[axis]);
    let image = |cell: i32, size: f64, from: f64, to: f64| {
        // In the lattice of mirrored rooms, images in odd cells are reflected, those in even ones only
        // shifted.
        let mirrored = if cell.rem_euclid(2) == 0 {
            from
        } else {
            size - from
        };
        f64::from(cell) * size + mirrored - to
    };
    let direct = (0..3)
        .map(|axis| (TABLE_M[axis] - ear_m[axis]).powi(2))
        .sum::<f64>()
        .sqrt();
    let mut echoes = Vec::new();
    for (x, y, z) in cells() {
        let order = x.abs() + y.abs() + z.abs();
        let offset = [x, y, z].into_iter().enumerate();
        let squared = offset
            .map(|(axis, cell)| image(cell, ROOM_M[axis], TABLE_M[axis], ear_m[axis]).powi(2));
        let distance = squared.sum::<f64>().sqrt();
        let delay = (distance - direct) / SOUND_M_S * f64::from(RATE_HZ);
        // Pressure is inversely proportional to the distance, and reflected once for each wall crossed.
        let gain = REFLECTED.powi(order) * direct / distance;
        echoes.push((delay.round() as usize, gain as f32));
    }
    echoes
}

fn cells() -> impl Iterator<Item = (i32, i32, i32)> {
    let range = || -REFLECTIONS_MAX..=REFLECTIONS_MAX;
    let all = range().flat_map(move |x| range().flat_map(move |y| range().map(move |z| (x, y, z))));
    all.filter(|(x, y, z)| (1..=REFLECTIONS_MAX).contains(&(x.abs() + y.abs() + z.abs())))
}

/// Size of the room, and position in it of the table's centre, in metres.
const ROOM_M: [f64; 3] = [7.0, 5.4, 2.8];
const TABLE_M: [f64; 3] = [3.3, 2.6, 0.8];
/// Reflection coefficient of pressure, of walls with carpet and curtains.
const REFLECTED: f64 = 0.5;
const REFLECTIONS_MAX: i32 = 2;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn echoes_come_later_and_softer() {
        let echoes = echoes(Ear::Left);
        assert_eq!(echoes.len(), 24, "6 walls, and 18 pairs of them");
        assert!(
            echoes
                .iter()
                .all(|(delay, gain)| *delay > 30 && (0.0..0.5).contains(gain))
        );
    }

    #[test]
    fn the_direct_sound_comes_first_and_as_it_was() {
        let mut samples = vec![1.0, 0.0, 0.0];
        reverberate(&mut samples, Ear::Left);
        assert_eq!(samples[..3], [1.0, 0.0, 0.0]);
        assert!(samples[3..].iter().any(|sample| *sample > 0.1));
    }
}
