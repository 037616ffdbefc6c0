//! Laws of marbles: restitution, momentum, heaps.

use carom_mpm::{Ball, Bodies, Marble, MarbleState, Marbles, Obstacle};
use glam::DVec3;

fn marbles(marble: Marble, gravity: f64) -> Marbles {
    Marbles::new(marble, DVec3::new(0.0, 0.0, -gravity), 0.02).expect("valid")
}

fn sphere(x: f64, y: f64, z: f64) -> MarbleState {
    MarbleState {
        position: DVec3::new(x, y, z),
        velocity: DVec3::ZERO,
        spin: DVec3::ZERO,
    }
}

fn slate() -> Bodies {
    Bodies {
        obstacles: vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)],
        ..Bodies::default()
    }
}

#[test]
fn two_marbles_part_with_their_restitution() {
    for restitution in [0.3, 0.6, 0.9] {
        let marble = Marble {
            restitution,
            ..Marble::default()
        };
        for speed in [0.1, 2.0] {
            let mut heap = marbles(marble, 0.0);
            let mut thrown = sphere(-0.02, 0.0, 0.0);
            thrown.velocity.x = speed;
            heap.add(thrown).unwrap();
            heap.add(sphere(0.0, 0.0, 0.0)).unwrap();
            for _ in 0..4 {
                heap.step(0.02 / speed, &mut Bodies::default()).unwrap();
            }
            let [one, other] = [0, 1].map(|i| heap.spheres()[i].velocity.x);
            let found = (other - one) / speed;
            assert!(
                (found - restitution).abs() < 0.03,
                "{found}, not {restitution}"
            );
            assert!((one + other - speed).abs() < 1e-12);
        }
    }
}

#[test]
fn momentum_of_marbles_and_a_ball_is_kept() {
    let mut heap = marbles(Marble::default(), 0.0);
    for i in 0..60u32 {
        let [x, y, z] = [i % 4, i / 4 % 5, i / 20].map(|k| f64::from(k) * 0.0161);
        heap.add(sphere(x, y, z)).unwrap();
    }
    let mut ball = Ball::new(DVec3::new(-0.06, 0.03, 0.02), 0.028_575, 0.17);
    ball.velocity = DVec3::new(3.0, 0.1, 0.0);
    ball.angular_velocity = DVec3::new(10.0, 60.0, -20.0);
    let marble = *heap.marble();
    let sums = |heap: &Marbles, ball: &Ball| {
        let mut momentum = ball.mass_kg * ball.velocity;
        let mut spin = ball.moment_of_inertia() * ball.angular_velocity
            + ball.mass_kg * ball.position.cross(ball.velocity);
        for s in heap.spheres() {
            momentum += marble.mass_kg() * s.velocity;
            spin += marble.mass_kg() * s.position.cross(s.velocity)
                + marble.moment_of_inertia() * s.spin;
        }
        (momentum, spin)
    };
    let before = sums(&heap, &ball);
    let mut bodies = Bodies {
        balls: vec![ball],
        ..Bodies::default()
    };
    for _ in 0..50 {
        heap.step(2e-3, &mut bodies).unwrap();
    }
    let after = sums(&heap, &bodies.balls[0]);
    assert!(after.0.distance(before.0) < 1e-12, "{after:?} {before:?}");
    assert!(bodies.balls[0].velocity.x < 2.7);
    assert!(after.1.distance(before.1) < 1e-9 * before.1.length());
}

/// A poured heap: layers that shrink upwards, slightly displaced.
fn poured(marble: Marble) -> (Marbles, Bodies) {
    let mut heap = marbles(marble, 9.81);
    for layer in 0..6i32 {
        let reach = 5 - layer;
        for x in -reach..=reach {
            for y in -reach..=reach {
                let shift = 0.003 * f64::from(layer % 3 - 1);
                let [x, y] = [x, y].map(|k| 0.0165 * f64::from(k) + shift);
                heap.add(sphere(x, y, 0.008 + 0.0165 * f64::from(layer)))
                    .unwrap();
            }
        }
    }
    (heap, slate())
}

/// The slope of a heap at rest, in degrees: its height over the horizontal extent of marbles that lie on
/// others.
fn slope_deg(marble: Marble) -> f64 {
    let (mut heap, mut bodies) = poured(marble);
    let mut secs = 0.0;
    while !heap.is_asleep() && secs < 8.0 {
        heap.step(0.02, &mut bodies).unwrap();
        secs += 0.02;
    }
    assert!(heap.is_asleep(), "it moves after {secs} s");
    let before = heap.snapshot();
    for _ in 0..360 {
        heap.step(10.0, &mut bodies).unwrap();
    }
    assert_eq!(heap.snapshot(), before, "an hour later");
    let under = heap.spheres().iter().filter(|s| s.position.z < 0.0075);
    assert_eq!(under.count(), 0, "none is pressed into the slate");
    let tops = heap.spheres().iter().map(|s| s.position.z);
    let top = tops.fold(0.0, f64::max);
    let heaped = heap.spheres().iter().filter(|s| s.position.z > 0.012);
    let distances = heaped.map(|s| s.position.truncate().length());
    let reach = distances.fold(0.0, f64::max) + 0.016;
    ((top - 0.008) / reach).atan().to_degrees()
}

#[test]
fn heaps_come_to_rest_stay_an_hour_and_are_steeper_of_rougher_marbles() {
    let smooth = slope_deg(Marble::default());
    let rough = slope_deg(Marble {
        friction: 0.8,
        rolling_friction: 0.2,
        ..Marble::default()
    });
    // Spheres on a level plane: the lowest roll away. Poured on each other, glass beads stand at 22°.
    assert!((4.0..22.0).contains(&smooth), "{smooth}°");
    assert!((smooth + 3.0..35.0).contains(&rough), "{smooth}°, {rough}°");
}

#[test]
fn a_snapshot_goes_on_with_the_same_bits() {
    let (mut heap, mut bodies) = poured(Marble::default());
    heap.step(0.1, &mut bodies).unwrap();
    let snapshot = heap.snapshot();
    let (mut again, _) = poured(Marble::default());
    again.restore(&snapshot).unwrap();
    for _ in 0..10 {
        heap.step(0.01, &mut bodies).unwrap();
        again.step(0.01, &mut bodies).unwrap();
    }
    assert_eq!(heap.snapshot(), again.snapshot());
}

#[test]
fn marbles_that_are_no_numbers_are_refused() {
    let mut heap = marbles(Marble::default(), 9.81);
    let nan = sphere(f64::NAN, 0.0, 0.0);
    let why = heap.add(nan).unwrap_err().to_string();
    assert!(why.contains("finite"), "{why}");
    let marble = Marble {
        radius_m: -1.0,
        ..Marble::default()
    };
    assert!(Marbles::new(marble, DVec3::ZERO, 0.0).is_err());
    assert!(heap.step(f64::NAN, &mut slate()).is_err());
}

#[test]
fn marbles_that_diverge_say_so() {
    let (mut heap, mut bodies) = poured(Marble::default());
    let center = heap.spheres()[0].position;
    let mut ball = Ball::new(center, 0.028_575, 1e9);
    ball.velocity = DVec3::splat(1e300);
    bodies.balls.push(ball);
    let why = heap.step(1.0, &mut bodies).unwrap_err().to_string();
    assert!(why.contains("marbles"), "{why}");
}
