//! A custom balancer: `cargo run --release -p carom-farm --example own_balancer`.
//!
//! The simulator compares it with the built-in ones: `cargo run --release -p carom-bench -- balance --plot charts`;
//! `CAROM_BALANCER=FILE` in the environment names another file that defines `MyBalancer`.

use carom_farm::balancer::{Balancer, Division, RequestOutcome, Shares};
use carom_farm::prelude::*;

/// Work in proportion to speed, an exponential moving average with a weight of 0.2 for each new value.
#[derive(Default)]
pub struct MyBalancer {
    /// Work per second by node; 0 where nothing is known.
    speeds: Vec<f64>,
}

impl Balancer for MyBalancer {
    fn divide(&mut self, division: &Division<'_>) -> Shares {
        let speed = |node: usize| self.speeds.get(node).copied().filter(|speed| *speed > 0.0);
        let known = self.speeds.iter().filter(|speed| **speed > 0.0);
        let slowest = known.copied().fold(f64::INFINITY, f64::min);
        // A new node gets as much as the slowest one.
        let first = if slowest.is_finite() { slowest } else { 1.0 };
        let nodes = division.candidates.iter().map(|candidate| candidate.node.0);
        let speeds: Vec<f64> = nodes.map(|node| speed(node).unwrap_or(first)).collect();
        let sum: f64 = speeds.iter().sum();
        let share = |speed: &f64| division.work * speed / sum;
        Shares::Work(speeds.iter().map(share).collect())
    }

    fn learn(&mut self, outcome: &RequestOutcome) {
        let node = outcome.node.0;
        self.speeds.resize(self.speeds.len().max(node + 1), 0.0);
        let speed = outcome.work / outcome.response_secs.max(1e-6);
        let known = &mut self.speeds[node];
        *known = if *known > 0.0 {
            *known + 0.2 * (speed - *known)
        } else {
            speed
        };
    }
}

fn main() -> carom_farm::Result<()> {
    let mut scene = Scene::new();
    for i in 0..5_u8 {
        let x = 0.6 * (f32::from(i) - 2.0);
        let paint = [0.8, 0.2 * f32::from(i), 0.1];
        scene.add(
            Sphere::new(0.25).at([x, 0.0, 0.25]),
            Material::plastic(paint),
        );
    }
    scene.add(Plane::z(0.0), Material::grey(0.5));
    let mut farm = Farm::auto()?;
    farm.set_balancer(MyBalancer::default());
    farm.render(&scene, Still::new(640, 360))?
        .save("own_balancer.png")
}
