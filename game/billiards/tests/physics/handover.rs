//! From the air to the cloth and back: what one law hands over the other takes up.

use super::*;
use carom_billiards::physics::{HOP_LEAST_M, Surface};

/// Energy, momentum and angular momentum where a ball touches the cloth, whether it hops on or lies
/// from then on. The impulse acts at the touching point, so that the angular momentum about that point
/// stays: the change of spin belongs to the change of velocity. Friction is at most Coulomb's, and what
/// vertical speed is lost without a bounce is less than that of the least hop.
fn assert_bounces_conserve(shot: &Shot) -> [usize; 2] {
    let (restitution, friction) = (0.5, 0.2);
    let hop_m_s = (2.0 * 9.81 * HOP_LEAST_M).sqrt();
    let mut ends = [0, 0];
    for event in shot.events() {
        let EventKind::Bounces {
            ball: number,
            surface: Surface::Cloth,
            ..
        } = event.kind
        else {
            continue;
        };
        let at_once = |other: &&Event| other.time_secs == event.time_secs;
        if shot.events().iter().filter(at_once).count() > 1 {
            continue;
        }
        let of = |states: &[BallState]| *states.iter().find(|b| b.number == number).expect("there");
        let [before, after] = around(shot, event).map(|states| of(&states));
        assert!(before.position.distance(after.position) < 1e-9, "{event:?}");
        let speed = before.velocity.length() + RADIUS * before.spin.length() + 1e-3;
        let change = after.velocity - before.velocity;
        let turned = -2.5 / RADIUS * DVec3::Z.cross(change) - (after.spin - before.spin);
        assert!(
            RADIUS * turned.length() < 1e-11 * speed,
            "{before:?} {after:?}"
        );
        let fall = -before.velocity.z;
        let drag = change.truncate().length();
        let most = friction * (1.0 + restitution) * fall;
        assert!(drag <= most + 1e-11 * speed, "{drag} m/s of {most}");
        if after.phase == Phase::Airborne {
            assert!((after.velocity.z - restitution * fall).abs() < 1e-11 * speed);
            ends[0] += 1;
        } else {
            assert_eq!((after.velocity.z, after.position.z), (0.0, RADIUS));
            assert!(restitution * fall < hop_m_s, "{fall} m/s are no small hop");
            ends[1] += 1;
        }
    }
    assert_energy_never_grows(shot);
    ends
}

#[test]
fn a_masse_hops_and_hands_its_spin_over_to_the_cloth() {
    let balls = vec![resting(0, -0.4, 0.0), resting(1, 0.6, 0.3)];
    let world = World::new(Table::nine_foot(), BallLayout { balls }).expect("valid");
    let stroke = Stroke {
        side: 0.35,
        vertical: 0.15,
        elevation_rad: 65f64.to_radians(),
        ..Stroke::straight(0.0, 3.0)
    };
    let shot = world.strike(stroke).expect("valid");
    let [hops, landings] = assert_bounces_conserve(&shot);
    assert!(hops > 0 && landings > 0, "{hops} hops, {landings} landings");
    let way = |t: f64| shot.states_at(t)[0].velocity.truncate().to_angle();
    let landed = shot.events().iter().rfind(|event| {
        matches!(
            event.kind,
            EventKind::Bounces {
                surface: Surface::Cloth,
                ball: 0,
                ..
            }
        )
    });
    let t = landed.expect("it lands").time_secs;
    let turned = (way(t + 0.2) - way(t)).abs();
    assert!(turned > 0.1, "it curves by {turned} rad once it slides");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 256, failure_persistence: None, ..Default::default() })]

    /// Thrown from anywhere over the cloth, with any spin.
    #[test]
    fn every_bounce_hands_over_what_it_had(
        place in (-1.0..1.0, -0.5..0.5, 0.0..0.4),
        velocity in (-4.0..4.0, -4.0..4.0, -3.0..3.0),
        spin in (-300.0..300.0, -300.0..300.0, -300.0..300.0),
    ) {
        let thrown = BallState {
            position: DVec3::from(place) + DVec3::Z * RADIUS,
            phase: Phase::Airborne,
            ..ball(0, 0.0, 0.0, DVec3::from(velocity), DVec3::from(spin))
        };
        let balls = vec![thrown, resting(1, 0.3, 0.1)];
        if let Ok(world) = World::with_laws(Table::nine_foot(), Laws::default(), balls) {
            assert_bounces_conserve(&world.release().expect("it ends"));
        }
    }
}
