//! Dust in air, on slate and on balls.

use carom_mpm::{Ball, Bodies, Dust, Grain, Obstacle};
use glam::{DVec3, Vec3};

const FALL: Vec3 = Vec3::new(0.0, 0.0, -9.81);

#[test]
fn dust_falls_at_the_speed_of_stokes_however_it_is_stepped() {
    let grain = Grain::default();
    let terminal = -9.81 * grain.relaxation_secs();
    let places = [1, 1000].map(|steps| {
        let mut dust = Dust::new(grain, FALL).expect("valid");
        dust.add(Vec3::Z, Vec3::X).expect("finite");
        for _ in 0..steps {
            dust.step(1.0 / f64::from(steps), &mut Bodies::default())
                .expect("valid");
        }
        let speck = dust.specks()[0];
        assert!(
            (speck.velocity.z / terminal - 1.0).abs() < 1e-4,
            "{speck:?}"
        );
        assert!(
            (speck.position.x - grain.relaxation_secs()).abs() < 1e-5,
            "{speck:?}"
        );
        speck.position
    });
    assert!(places[0].distance(places[1]) < 1e-4, "{places:?}");
}

#[test]
fn dust_settles_until_a_ball_takes_it_along() {
    let grain = Grain::default();
    let mut dust = Dust::new(grain, FALL).expect("valid");
    dust.add(Vec3::new(0.0, 0.0, 0.01), Vec3::new(0.5, 0.0, 0.5))
        .expect("finite");
    let obstacles = vec![Obstacle::plane(DVec3::ZERO, DVec3::Z)];
    let mut bodies = Bodies {
        obstacles,
        ..Bodies::default()
    };
    dust.step(10.0, &mut bodies).expect("valid");
    let settled = dust.specks()[0];
    assert!(
        settled.is_settled && settled.position.z.abs() < 1e-6,
        "{settled:?}"
    );
    dust.step(3600.0, &mut bodies).expect("valid");
    assert_eq!(dust.specks()[0], settled, "an hour of rest");
    let mut ball = Ball::new(settled.position.as_dvec3() + DVec3::Z * 0.02, 0.03, 0.17);
    ball.velocity.x = 2.0;
    bodies.balls.push(ball);
    dust.step(0.001, &mut bodies).expect("valid");
    let speck = dust.specks()[0];
    assert!(!speck.is_settled && speck.velocity.x > 1.9, "{speck:?}");
    let gained = f64::from(grain.mass_kg()) * f64::from(speck.velocity.x);
    assert!(
        (bodies.balls[0].impulse.x + gained).abs() < 1e-6 * gained,
        "{bodies:?}"
    );
}
