//! Whole shots: they end, stay in order, and have the same bits however they are watched.

use super::*;

fn assert_in_order(table: &Table, states: &[BallState]) {
    for (index, one) in states.iter().enumerate() {
        assert!(one.position.is_finite() && one.orientation.is_normalized());
        if !one.phase.is_on_table() {
            continue;
        }
        let flies = one.phase == Phase::Airborne;
        assert!(
            flies || table.contains(one.position.truncate()),
            "ball {} is outside",
            one.number
        );
        let low = one.position.z < table.nose_height_m() - 1e-9;
        for nose in table.noses().iter().filter(|nose| low && beside(nose, one)) {
            let depth = nose.normal().dot(one.position.truncate() - nose.from());
            assert!(
                !(-RADIUS..=RADIUS - 1e-6).contains(&depth),
                "ball {} in a cushion",
                one.number
            );
        }
        for other in states[..index]
            .iter()
            .filter(|other| other.phase.is_on_table())
        {
            let distance = one.position.distance(other.position);
            assert!(
                distance > 2.0 * RADIUS - 1e-6,
                "{} and {} overlap",
                one.number,
                other.number
            );
        }
    }
}

fn beside(nose: &Nose, ball: &BallState) -> bool {
    let along = nose.to() - nose.from();
    let t = (ball.position.truncate() - nose.from()).dot(along) / along.length_squared();
    (0.0..=1.0).contains(&t)
}

#[test]
fn breaks_end_with_every_ball_accounted_for() {
    for seed in 0..12 {
        let world = eight_ball(seed);
        let stroke = Stroke {
            vertical: 0.1,
            ..Stroke::straight(0.003 * f64::from(seed), 8.0)
        };
        let shot = world.strike(stroke).expect("a break ends");
        for event in shot.events() {
            assert_in_order(world.table(), &shot.states_at(event.time_secs));
        }
        assert_energy_never_grows(&shot);
        let at_rest = |ball: &BallState| ball.velocity == DVec3::ZERO && ball.spin == DVec3::ZERO;
        assert!(shot.final_states().iter().all(at_rest));
        let kept = energy_after(&shot, 0.02) / energy_after(&shot, 0.0);
        assert!(kept > 0.3, "the rack swallows {kept}");
    }
}

fn energy_after(shot: &Shot, t: f64) -> f64 {
    energy_j(&shot.states_at(t))
}

#[test]
fn the_same_break_has_the_same_bits() {
    let stroke = Stroke {
        side: 0.2,
        ..Stroke::straight(0.01, 9.0)
    };
    let [one, two] = [(); 2].map(|()| eight_ball(5).strike(stroke).expect("valid"));
    assert_eq!(one.events(), two.events());
    assert_eq!(one.final_states(), two.final_states());
    let other = eight_ball(6).strike(stroke).expect("valid");
    assert_ne!(
        one.final_states(),
        other.final_states(),
        "the seed decides the break"
    );
}

#[test]
fn a_mirrored_break_is_the_mirror_image() {
    let mirror = |v: DVec3| DVec3::new(v.x, -v.y, v.z);
    let world = eight_ball(3);
    let mirrored = world.balls().into_iter().map(|b| BallState {
        position: mirror(b.position),
        ..b
    });
    let twin = World::new(
        Table::nine_foot(),
        BallLayout {
            balls: mirrored.collect(),
        },
    )
    .expect("valid");
    let stroke = Stroke {
        side: 0.3,
        ..Stroke::straight(0.02, 7.0)
    };
    let opposite = Stroke {
        side: -0.3,
        ..Stroke::straight(-0.02, 7.0)
    };
    let shot = world.strike(stroke).expect("valid");
    let image = twin.strike(opposite).expect("valid");
    for (a, b) in shot.final_states().iter().zip(image.final_states()) {
        assert_eq!(a.phase, b.phase);
        assert!(
            (a.position - mirror(b.position)).length() < 1e-9,
            "ball {}",
            a.number
        );
    }
}

#[test]
fn poses_do_not_depend_on_how_they_are_sampled() {
    let shot = eight_ball(1)
        .strike(Stroke::straight(0.0, 6.0))
        .expect("valid");
    let times: Vec<_> = (0..400).map(|i| f64::from(i) * 0.0173).collect();
    let forward: Vec<_> = times.iter().map(|&t| shot.poses_at(t)).collect();
    let mut backward: Vec<_> = times.iter().rev().map(|&t| shot.poses_at(t)).collect();
    backward.reverse();
    assert_eq!(forward, backward);
}

#[test]
fn poses_are_continuous_over_events() {
    let stroke = Stroke {
        side: 0.3,
        vertical: -0.2,
        ..Stroke::straight(0.01, 8.0)
    };
    let shot = eight_ball(2).strike(stroke).expect("valid");
    for event in shot.events() {
        let t = event.time_secs;
        let (before, after) = (shot.poses_at(t.next_down()), shot.poses_at(t));
        for (a, b) in before.iter().zip(&after) {
            assert!(a.position.distance(b.position) < 1e-12, "{event:?}");
            assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-12, "{event:?}");
        }
    }
}

#[test]
fn every_pocket_takes_balls() {
    for (index, pocket) in Table::nine_foot().pockets().iter().enumerate() {
        for speed in [0.8, 2.5, 6.0] {
            let from = DVec2::new(0.4 * pocket.center.x, 0.1 * pocket.center.y);
            let velocity = (speed * (pocket.center - from).normalize()).extend(0.0);
            let start = ball(0, from.x, from.y, velocity, DVec3::ZERO);
            let shot = released(Table::nine_foot(), Laws::default(), vec![start]);
            let took =
                |e: &Event| matches!(e.kind, EventKind::Pocketed { pocket, .. } if pocket == index);
            assert!(
                shot.events().iter().any(took),
                "pocket {index} at {speed} m/s"
            );
            let end = shot.final_states()[0];
            assert_eq!(end.phase, Phase::Pocketed);
            assert!(!shot.poses_at(shot.duration_secs())[0].on_table);
        }
    }
}

#[test]
fn a_ball_rolls_past_the_side_pocket_along_the_rail() {
    let velocity = DVec3::X * 1.5;
    let spin = DVec3::Z.cross(velocity) / RADIUS;
    let start = ball(0, -0.5, 0.635 - RADIUS - 1e-3, velocity, spin);
    let shot = released(Table::nine_foot(), Laws::default(), vec![start]);
    assert!(shot.states_at(0.6)[0].position.x > 0.3);
}

#[test]
fn a_ball_that_escapes_is_caught_and_reported() {
    let open = TableParts {
        name: "open".to_owned(),
        length_m: 2.0,
        width_m: 1.0,
        nose_height_m: 0.0365,
        noses: vec![
            [DVec2::new(1.0, 0.5), DVec2::new(-1.0, 0.5)],
            [DVec2::new(-1.0, -0.5), DVec2::new(1.0, -0.5)],
        ],
        jaws: Vec::new(),
        pockets: Vec::new(),
    };
    let table = Table::from_parts(open).expect("valid");
    let balls = vec![
        ball(3, 0.0, 0.0, DVec3::X * 2.0, DVec3::ZERO),
        resting(4, -0.5, 0.0),
    ];
    let shot = released(table, Laws::default(), balls);
    assert!(matches!(
        shot.events().last().map(|e| e.kind),
        Some(EventKind::LeftTable { ball: 3, .. })
    ));
    let end = shot.final_states();
    assert_eq!(
        (end[0].phase, end[1].phase),
        (Phase::OffTable, Phase::Resting)
    );
    assert!((end[0].position.x - 1.0).abs() < 1e-12);
}

#[test]
fn the_cue_ball_comes_back_into_hand() {
    let mut world = eight_ball(0);
    let scratch = Stroke::straight((0.647f64).atan2(-1.282 + 0.635), 2.0);
    let shot = world.strike(scratch).expect("valid");
    world.adopt(&shot);
    assert_eq!(world.balls()[0].phase, Phase::Pocketed);
    assert!(matches!(world.strike(scratch), Err(Error::Stroke(_))));
    assert!(world.place(0, 0.635, 0.0).is_err(), "the rack is there");
    world.place(0, -0.8, 0.1).expect("free");
    assert!(world.strike(Stroke::straight(0.0, 1.0)).is_ok());
}

/// A ball that shot across a side pocket's mouth past the end of the far facing, into the wall.
#[test]
fn a_ball_that_crosses_a_pocket_stays_before_its_wall() {
    let mut world = eight_ball(0);
    world
        .place(0, -0.297_660_978_028_897_3, 0.070_125_183_718_114_9)
        .expect("free");
    let stroke = Stroke {
        elevation_rad: 0.256_398_959_699_780_44,
        side: -0.33566053665492784,
        vertical: -0.1618562090128194,
        ..Stroke::straight(-1.130_735_134_196_903_6, 4.292_131_794_714_508)
    };
    let shot = world.strike(stroke).expect("it ends");
    assert_energy_never_grows(&shot);
    for event in shot.events() {
        assert_in_order(world.table(), &shot.states_at(event.time_secs));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..Default::default() })]

    /// Any valid stroke, from any spot: it ends, within the table, without gaining energy.
    #[test]
    fn any_stroke_ends_in_order(
        seed in 0u32..1000,
        direction_rad in -PI..PI,
        speed_m_s in prop_oneof![1e-6..1.0, 1.0..Stroke::SPEED_MAX_M_S],
        offset in 0.0..Stroke::OFFSET_MAX,
        around in -PI..PI,
        elevation_rad in 0.0..Stroke::ELEVATION_MAX_RAD,
        x in -1.2..0.5,
        y in -0.55..0.55,
    ) {
        let mut world = eight_ball(seed);
        prop_assume!(world.place(0, x, y).is_ok());
        let (vertical, side) = (offset * around.sin(), offset * around.cos());
        let stroke = Stroke { direction_rad, speed_m_s, side, vertical, elevation_rad };
        let shot = world.strike(stroke).expect("it ends");
        assert_energy_never_grows(&shot);
        for event in shot.events() {
            assert_in_order(world.table(), &shot.states_at(event.time_secs));
        }
    }
}
