//! The laws of cloth, stick and contacts, one by one.

use super::*;

#[test]
fn a_sliding_ball_rolls_at_five_sevenths_of_its_speed() {
    for speed in [0.01, 1.0, 3.0, 12.0] {
        let start = ball(0, 0.0, 0.0, DVec3::X * speed, DVec3::ZERO);
        let shot = released(prairie(), Laws::default(), vec![start]);
        let rolls = &shot.events()[0];
        assert!(matches!(rolls.kind, EventKind::Rolls { ball: 0 }));
        let rolling = shot.states_at(rolls.time_secs)[0].velocity;
        assert!((rolling - DVec3::X * speed * 5.0 / 7.0).length() < 1e-14 * speed.max(1.0));
        let theory = 2.0 * speed / (7.0 * 0.2 * 9.81);
        assert!((rolls.time_secs - theory).abs() < 1e-14);
    }
}

#[test]
fn phases_last_as_long_as_theory_says() {
    let alone = |velocity, spin| {
        released(
            prairie(),
            Laws::default(),
            vec![ball(0, 0.0, 0.0, velocity, spin)],
        )
    };
    let rolling = alone(DVec3::X, DVec3::Y / RADIUS);
    assert!((rolling.duration_secs() - 1.0 / 0.0981).abs() < 1e-13);
    assert!((rolling.final_states()[0].position.x - 0.5 / 0.0981).abs() < 1e-13);

    let spinning = alone(DVec3::ZERO, DVec3::Z * 100.0);
    assert!((spinning.duration_secs() - 100.0 / 10.9).abs() < 1e-13);
    assert_eq!(spinning.final_states()[0].position, DVec3::Z * RADIUS);

    // Backspin of 5/2 v/R cancels the speed exactly: the ball slides to a dead stop.
    let dragging = alone(DVec3::X * 2.0, DVec3::Y * -5.0 / RADIUS);
    assert!((dragging.duration_secs() - 2.0 / 1.962).abs() < 1e-13);
    assert!((dragging.final_states()[0].position.x - 2.0 / 1.962).abs() < 1e-13);
}

#[test]
fn a_struck_ball_leaves_with_the_impulse_of_the_stick() {
    let world = World::new(
        prairie(),
        BallLayout {
            balls: vec![resting(0, 0.0, 0.0)],
        },
    )
    .expect("valid");
    let shot = world.strike(Stroke::straight(0.25, 2.0)).expect("valid");
    let after = shot.states_at(0.0)[0];
    let speed = 4.0 / (1.0 + 0.170_097 / 0.567);
    assert!(
        (after.velocity - speed * DVec3::new(0.25f64.cos(), 0.25f64.sin(), 0.0)).length() < 1e-14
    );
    assert_eq!(after.spin, DVec3::ZERO);

    let follow = Stroke {
        vertical: 0.4,
        ..Stroke::straight(0.0, 2.0)
    };
    let after = world.strike(follow).expect("valid").states_at(0.0)[0];
    let slip = after.velocity.x - RADIUS * after.spin.y;
    assert!(
        slip.abs() < 1e-14,
        "a blow at 2/5 of the radius rolls at once: {slip}"
    );

    let right = Stroke {
        side: 0.5,
        ..Stroke::straight(0.0, 2.0)
    };
    let after = world.strike(right).expect("valid").states_at(0.0)[0];
    assert!(
        after.spin.z > 0.0,
        "right english turns the ball anticlockwise"
    );
    let squirt = after.velocity.y.atan2(after.velocity.x).to_degrees();
    assert!(
        (1.8..2.0).contains(&squirt),
        "it deflects to the left: {squirt}"
    );
}

#[test]
fn contacts_of_balls_keep_momentum_and_restitution() {
    for (offset, spin) in [
        (0.0, DVec3::ZERO),
        (0.02, DVec3::Z * 60.0),
        (0.04, DVec3::Y * 90.0),
    ] {
        let first = ball(0, -0.1, offset, DVec3::new(3.0, 0.0, 0.0), spin);
        let second = ball(1, 0.0, 0.0, DVec3::new(-0.5, 0.01, 0.0), DVec3::X * 10.0);
        let shot = released(prairie(), Laws::default(), vec![first, second]);
        let [before, after] = around(&shot, first_ball_contact(&shot));
        assert!((momentum(&before) - momentum(&after)).length() < 1e-13);
        let normal = (before[1].position - before[0].position).normalize();
        let closing = |states: &[BallState]| (states[0].velocity - states[1].velocity).dot(normal);
        assert!((closing(&after) + 0.95 * closing(&before)).abs() < 1e-12);
        assert!(energy_j(&after) < energy_j(&before));
        let about_normal =
            |states: &[BallState]| states.iter().map(|b| b.spin.dot(normal)).sum::<f64>();
        assert!((about_normal(&before) - about_normal(&after)).abs() < 1e-10);
    }
}

#[test]
fn ideal_balls_part_at_a_right_angle() {
    for cut_deg in [5.0, 15.0, 30.0, 45.0, 60.0, 75.0, 89.0f64] {
        let offset = 2.0 * RADIUS * cut_deg.to_radians().sin();
        let along = 2.0 * RADIUS * cut_deg.to_radians().cos() + 1e-4;
        let cue_ball = ball(0, -along, offset, DVec3::X * 2.0, DVec3::ZERO);
        let shot = released(prairie(), ideal(), vec![cue_ball, resting(1, 0.0, 0.0)]);
        let [before, after] = around(&shot, first_ball_contact(&shot));
        let angle = after[0]
            .velocity
            .angle_between(after[1].velocity)
            .to_degrees();
        assert!((angle - 90.0).abs() < 1e-9, "cut {cut_deg}: {angle}");
        assert!((energy_j(&before) - energy_j(&after)).abs() < 1e-13);
    }
}

#[test]
fn slow_stun_throws_more_than_fast() {
    let throw = |speed: f64| {
        let offset = 2.0 * RADIUS * 0.5;
        let along = 2.0 * RADIUS * 0.75f64.sqrt() + 1e-5;
        let cue_ball = ball(0, -along, offset, DVec3::X * speed, DVec3::ZERO);
        let shot = released(
            prairie(),
            Laws::default(),
            vec![cue_ball, resting(1, 0.0, 0.0)],
        );
        let [before, after] = around(&shot, first_ball_contact(&shot));
        let line = (before[1].position - before[0].position).normalize();
        line.angle_between(after[1].velocity).to_degrees()
    };
    let (slow, medium, fast) = (throw(0.447), throw(1.341), throw(3.129));
    assert!((slow - 4.9).abs() < 0.3, "{slow}: about an inch per foot");
    assert!(
        slow > medium && medium > fast && fast > 1.0,
        "{slow} {medium} {fast}"
    );
}

#[test]
fn a_rolling_ball_turns_by_its_way_over_its_radius() {
    let velocity = DVec3::new(1.2, 0.9, 0.0);
    let spin = DVec3::Z.cross(velocity) / RADIUS;
    let shot = released(
        prairie(),
        Laws::default(),
        vec![ball(0, 0.0, 0.0, velocity, spin)],
    );
    for t in [0.1, 1.0, 5.0, 14.0] {
        let pose = shot.poses_at(t)[0];
        let way = pose.position.truncate().length();
        let expected = glam::DQuat::from_axis_angle(spin.normalize(), way / RADIUS);
        assert!(pose.rotation.dot(expected).abs() > 1.0 - 1e-11, "at {t}");
    }
}

#[test]
fn orientation_follows_spin_also_where_the_axis_tilts() {
    let start = ball(
        0,
        0.0,
        0.0,
        DVec3::new(2.0, 0.3, 0.0),
        DVec3::new(20.0, -30.0, 70.0),
    );
    let shot = released(prairie(), Laws::default(), vec![start]);
    let dt = 1e-5;
    for t in [0.05, 0.2, 1.0, 3.0] {
        let turned =
            shot.poses_at(t + dt)[0].rotation * shot.poses_at(t - dt)[0].rotation.conjugate();
        let measured = turned.to_scaled_axis() / (2.0 * dt);
        assert!(
            (measured - shot.states_at(t)[0].spin).length() < 1e-3,
            "at {t}: {measured}"
        );
    }
}

#[test]
fn frozen_clusters_end_within_bounds() {
    let spacing = 2.0 * RADIUS;
    let mut balls = vec![ball(0, -0.3, 0.0, DVec3::X * 2.0, DVec3::ZERO)];
    balls.extend((1..=5).map(|i| resting(i, f64::from(i) * spacing, 0.0)));
    let shot = released(prairie(), Laws::default(), balls);
    assert_energy_never_grows(&shot);
    assert!(shot.events().len() < 1000, "{} events", shot.events().len());
    let last = shot.states_at(0.3)[5].velocity.x;
    assert!(
        last > 1.0,
        "the last ball takes most of the momentum: {last}"
    );
}

#[test]
fn balls_pressed_to_a_cushion_by_spin_stay_in_bounds() {
    for towards in [1.0, 40.0, 300.0] {
        let touching = 0.635 - RADIUS;
        let start = ball(0, 0.6, touching, DVec3::X, DVec3::new(-towards, 0.0, 20.0));
        let shot = released(Table::nine_foot(), Laws::default(), vec![start]);
        assert!(shot.events().len() < 5000, "{} events", shot.events().len());
        assert_energy_never_grows(&shot);
    }
}

/// Two balls in touch of which the rear one, with follow, pushes the front one.
///
/// The law takes it as many small collisions; what they must come to is lasting contact: while both
/// slip the cloth pulls them together with μ m g, which presses them on each other, and friction
/// where they touch takes spin from both. Once the front ball rolls it takes 7/12 of that force, and
/// somewhat more for the friction that brakes it.
#[test]
fn pressed_balls_move_as_in_lasting_contact() {
    let start = [(0.05, 14.0), (0.045, 0.0)];
    let secs = 0.06;
    let [rear, front] = start.map(|(speed, spin)| (DVec3::X * speed, DVec3::Y * spin));
    let balls = vec![
        ball(0, -2.0 * RADIUS - 1e-7, 0.0, rear.0, rear.1),
        ball(1, 0.0, 0.0, front.0, front.1),
    ];
    let states = released(prairie(), Laws::default(), balls).states_at(secs);
    let met = 0.5 * (states[0].velocity.x + states[1].velocity.x);

    let (speed, _) = lasting_contact(0.0475, [14.0, 0.0], secs);
    assert!((met - speed).abs() < 5e-3, "{met} and {speed} m/s");
    assert!(speed > 0.06, "the rear ball has pushed: {speed} m/s");
}

/// A row of three is struck: the last ball goes, the first two go on together. How far is told by the
/// theory, from the state in which the blow leaves them.
#[test]
fn a_struck_pair_rolls_as_far_as_in_lasting_contact() {
    let balls = vec![
        ball(0, -0.3, 0.0, 2.0 * DVec3::X, DVec3::ZERO),
        resting(1, 0.0, 0.0),
        resting(2, 2.0 * RADIUS, 0.0),
    ];
    let shot = released(prairie(), Laws::default(), balls);
    let blow = shot.states_at(first_ball_contact(&shot).time_secs + 1e-4);
    let ends = shot.final_states();
    let mean = |of: &dyn Fn(usize) -> f64| 0.5 * (of(0) + of(1));
    let rolled = mean(&|ball| ends[ball].position.x - blow[ball].position.x);
    let speed = mean(&|ball| blow[ball].velocity.x);
    let (_, way) = lasting_contact(speed, [0, 1].map(|ball| blow[ball].spin.y), 10.0);
    assert!((rolled - way).abs() < 1.5e-3, "{rolled} and {way} m");
    assert!(way > 0.02, "the spin of the first has pushed: {way} m");
}

/// Speed and way of two balls, one behind the other, that stay in touch: of both, after a time or until
/// they rest. The spins are those of rolling forwards.
fn lasting_contact(mut speed: f64, mut spins: [f64; 2], secs: f64) -> (f64, f64) {
    let (pull, roll_resistance) = (0.2 * 9.81, 0.01 * 9.81);
    let law = BallBallLaw::default();
    let (mut way, dt) = (0.0, 1e-6);
    let (mut rear_slips, mut rolls) = (true, false);
    for _ in 0..(secs / dt) as usize {
        let rub = RADIUS * (spins[0] + spins[1]);
        let friction =
            law.friction_fast + law.friction_slow_extra * (-law.friction_fade_s_m * rub).exp();
        rolls |= RADIUS * spins[1] >= speed;
        rear_slips &= RADIUS * spins[0] > speed;
        // Force between the balls and acceleration of both, over a ball's mass.
        let (press, gain) = match (rear_slips, rolls) {
            (true, false) => (pull, 0.0),
            (true, true) => {
                let press = 7.0 * (pull + roll_resistance) / (12.0 - 5.0 * friction);
                (press, pull - press)
            }
            _ => (0.0, -roll_resistance),
        };
        let rubbed = 2.5 / RADIUS * friction * press;
        let turned = 2.5 / RADIUS * pull;
        spins[0] = if rear_slips {
            spins[0] - (turned + rubbed) * dt
        } else {
            speed / RADIUS
        };
        spins[1] = if rolls {
            speed / RADIUS
        } else {
            spins[1] + (turned - rubbed) * dt
        };
        speed += gain * dt;
        way += speed * dt;
        if speed <= 0.0 {
            break;
        }
    }
    (speed, way)
}

/// The ball touches a nose of the same height, at the same distance: how far behind it the middle of the
/// rounding lies is nothing to it.
#[test]
fn a_jaw_throws_a_ball_back_as_a_straight_cushion_does() {
    let after = |length_m: f64, jaws: Vec<Circle>| {
        let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]];
        let corners = corners.map(|[x, y]| length_m * DVec2::new(x, y));
        let table = Table::from_parts(TableParts {
            name: "with a jaw".to_owned(),
            length_m,
            width_m: length_m,
            nose_height_m: 0.0365,
            noses: (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect(),
            jaws,
            pockets: Vec::new(),
        })
        .expect("valid");
        let spin = DVec3::new(0.0, -20.0, 40.0);
        let shot = released(table, ideal(), vec![ball(0, -0.5, 0.0, DVec3::NEG_X, spin)]);
        let touches = |event: &&Event| matches!(event.kind, EventKind::Cushion { .. });
        let touch = shot.events().iter().find(touches).expect("it comes there");
        let state = shot.states_at(touch.time_secs)[0];
        (state.velocity, state.spin)
    };
    let straight = after(2.0, Vec::new());
    for radius_m in [0.004, 0.008, 0.02, 0.3, 1.0] {
        let center = DVec2::new(-1.0 - radius_m, 0.0);
        let round = after(8.0, vec![Circle { center, radius_m }]);
        assert!((round.0 - straight.0).length() < 1e-12, "{radius_m}");
        assert!((round.1 - straight.1).length() < 1e-10, "{radius_m}");
    }
}
