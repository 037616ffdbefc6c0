//! The aim line: it is what the shot does.

use super::*;

#[test]
fn the_aim_line_is_what_the_shot_does() {
    let world = eight_ball(4);
    for stroke in [
        Stroke::straight(0.005, 5.0),
        Stroke {
            side: 0.4,
            elevation_rad: 0.1,
            ..Stroke::straight(-0.01, 3.0)
        },
    ] {
        let line = predict(&world, stroke).expect("valid");
        let shot = world.strike(stroke).expect("valid");
        let contact = first_ball_contact(&shot);
        let AimContact::Ball {
            number,
            ghost,
            object_direction,
            ..
        } = line.contact
        else {
            panic!("{:?}", line.contact);
        };
        let after = shot.states_at(contact.time_secs);
        let object = after
            .iter()
            .find(|ball| ball.number == number)
            .expect("it is there");
        assert_eq!(ghost, after[0].position);
        assert_eq!(*line.path.last().expect("not empty"), ghost);
        assert_eq!(object_direction, object.velocity.normalize());
    }
    let away = predict(&world, Stroke::straight(PI * 0.5, 3.0)).expect("valid");
    assert!(matches!(
        away.contact,
        AimContact::Cushion { .. } | AimContact::Pocket { .. }
    ));
}

/// A cue ball, two targets and two others, spread over the table by a seed.
fn position(seed: u32) -> Option<World> {
    let mut balls = Vec::new();
    for number in 0..5 {
        let spread = |step: f64| (step * f64::from(seed * 5 + u32::from(number) + 1)).fract();
        let (x, y) = (
            2.2 * spread(0.754_877_666) - 1.1,
            1.0 * spread(0.569_840_291) - 0.5,
        );
        balls.push(resting(number, x, y));
    }
    World::new(Table::nine_foot(), BallLayout { balls }).ok()
}

/// The line ends where the shot first touches something, with the ball, the ghost and both ways that
/// the shot has there, bit for bit.
fn assert_predicted(world: &World, stroke: Stroke) {
    let line = predict(world, stroke).expect("valid");
    let shot = world.strike(stroke).expect("valid");
    let touched = shot.events().iter().find(|event| match event.kind {
        EventKind::BallBall { first, second, .. } => first == 0 || second == 0,
        EventKind::Cushion { ball, .. }
        | EventKind::Pocketed { ball, .. }
        | EventKind::LeftTable { ball, .. } => ball == 0,
        _ => false,
    });
    let t = touched.map_or(shot.duration_secs(), |event| event.time_secs);
    let states = shot.states_at(t);
    let of = |number: u8| {
        let found = states.iter().find(|ball| ball.number == number);
        *found.expect("it is there")
    };
    assert_eq!(*line.path.last().expect("not empty"), of(0).position);
    let met = touched.map(|event| event.kind);
    match line.contact {
        AimContact::Ball {
            number,
            ghost,
            object,
            object_direction,
            cue_direction,
        } => {
            let Some(EventKind::BallBall { first, second, .. }) = met else {
                panic!("{:?} and {met:?}", line.contact);
            };
            assert_eq!(first.max(second), number);
            assert_eq!([ghost, object], [of(0).position, of(number).position]);
            assert_eq!(object_direction, of(number).velocity.normalize_or_zero());
            assert_eq!(cue_direction, of(0).velocity.normalize_or_zero());
        }
        AimContact::Cushion { .. } => assert!(matches!(met, Some(EventKind::Cushion { .. }))),
        AimContact::Pocket { .. } => assert!(matches!(met, Some(EventKind::Pocketed { .. }))),
        _ => assert!(!matches!(met, Some(EventKind::BallBall { .. })), "{met:?}"),
    }
}

/// The ball that is hit from above is thrown back at the cue ball by the slate, at the same instant.
#[test]
fn a_ball_that_is_hit_twice_at_once_is_predicted_so() {
    let world = eight_ball(67);
    let stroke = Stroke {
        vertical: -0.137_552_594_833_558_4,
        elevation_rad: 0.285_228_968_475_161_8,
        ..Stroke::straight(0.0, 5.492_801_234_759_820_5)
    };
    let AimContact::Ball { cue_direction, .. } = predict(&world, stroke).expect("valid").contact
    else {
        panic!("it hits the rack");
    };
    let shot = world.strike(stroke).expect("valid");
    let meets =
        |event: &&Event| matches!(event.kind, EventKind::BallBall { first, .. } if first == 0);
    let at_once: Vec<f64> = shot
        .events()
        .iter()
        .filter(meets)
        .map(|event| event.time_secs)
        .collect();
    assert_eq!(at_once[0], at_once[1], "{at_once:?}");
    let after = shot.states_at(at_once[0])[0].velocity;
    assert_eq!(cue_direction, after.normalize_or_zero());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..Default::default() })]

    /// The aim line is the shot up to its first contact, bit for bit, whatever the stroke.
    #[test]
    fn the_prediction_is_the_shot(
        seed in 0u32..1000,
        direction_rad in -PI..PI,
        speed_m_s in 0.2..10.0,
        side in -0.4..0.4,
        vertical in -0.4..0.4,
        elevation_rad in 0.0..0.5,
    ) {
        let world = eight_ball(seed);
        let stroke = Stroke { direction_rad, speed_m_s, side, vertical, elevation_rad };
        assert_predicted(&world, stroke);
    }

    /// Balls anywhere, any legal stroke.
    #[test]
    fn the_prediction_is_the_shot_on_an_open_table(
        seed in 0u32..100_000,
        direction_rad in -PI..PI,
        speed_m_s in 0.05..12.0,
        side in -0.4..0.4,
        vertical in -0.4..0.4,
        elevation_rad in 0.0..1.2,
    ) {
        if let Some(world) = position(seed) {
            let stroke = Stroke { direction_rad, speed_m_s, side, vertical, elevation_rad };
            assert_predicted(&world, stroke);
        }
    }
}
