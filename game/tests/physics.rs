//! The laws of the simulation, and reference shots of another simulator.

use std::{f64::consts::PI, fs, path::Path};

use carom::bench::{accuracy, breaks, closed_forms, curves, reference::Reference};
use carom::sim::{
    AimContact, BallBallLaw, BallBody, BallState, CLUSTER_ENERGY_J, Error, Event, EventKind, Laws,
    Layout, Nose, Phase, REBOUND_ENERGY_J, Shot, Stroke, Suggestion, Table, TableParts, World,
    predict, suggest,
};
use glam::{DVec2, DVec3};
use proptest::prelude::*;

const RADIUS: f64 = 0.028_575;

/// A square of noses far from everything.
fn prairie() -> Table {
    let corners = [[-50.0, -50.0], [50.0, -50.0], [50.0, 50.0], [-50.0, 50.0]].map(DVec2::from);
    Table::from_parts(TableParts {
        name: "prairie".to_owned(),
        length_m: 100.0,
        width_m: 100.0,
        nose_height_m: 0.0365,
        noses: (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect(),
        jaws: Vec::new(),
        pockets: Vec::new(),
    })
    .expect("valid")
}

fn ball(number: u8, x: f64, y: f64, velocity: DVec3, spin: DVec3) -> BallState {
    BallState {
        velocity,
        spin,
        ..BallState::at_rest(number, x, y, &BallBody::default())
    }
}

fn resting(number: u8, x: f64, y: f64) -> BallState {
    ball(number, x, y, DVec3::ZERO, DVec3::ZERO)
}

fn released(table: Table, laws: Laws, balls: Vec<BallState>) -> Shot {
    World::with_laws(table, laws, balls)
        .expect("valid")
        .release()
        .expect("it comes to rest")
}

fn ideal() -> Laws {
    Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    }
}

fn eight_ball(seed: u32) -> World {
    let table = Table::nine_foot();
    let rack = table.rack_eight(seed);
    World::new(table, rack).expect("a rack is valid")
}

/// States right before and right after an event.
fn around(shot: &Shot, event: &Event) -> [Vec<BallState>; 2] {
    [
        shot.states_at(event.time_secs.next_down()),
        shot.states_at(event.time_secs),
    ]
}

fn first_ball_contact(shot: &Shot) -> &Event {
    let is_contact = |event: &&Event| matches!(event.kind, EventKind::BallBall { .. });
    shot.events()
        .iter()
        .find(is_contact)
        .expect("the balls meet")
}

/// Kinetic and potential energy of the balls in play, over a metre under the cloth.
fn energy_j(states: &[BallState]) -> f64 {
    let in_play = states.iter().filter(|ball| ball.phase.is_on_table());
    in_play
        .map(|ball| {
            let height = ball.position.z + 1.0;
            ball.body.kinetic_energy_j(ball.velocity, ball.spin) + ball.body.mass_kg * 9.81 * height
        })
        .sum()
}

fn momentum(states: &[BallState]) -> DVec3 {
    states.iter().map(|ball| ball.velocity).sum()
}

fn references() -> Vec<Reference> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/references/physics");
    Reference::read_folder(&folder).expect("the references are in the repository")
}

#[test]
fn shots_follow_the_references() {
    // Their positions, up to 40 m, are written with nine digits.
    let closed_forms = ["backspin_slide", "pure_spin", "roll_out", "slide_to_roll"];
    let measured = accuracy::Accuracy::measure(&references()).expect("all can be played");
    assert!(
        measured.shots.len() >= 12,
        "only {} references",
        measured.shots.len()
    );
    for shot in measured.shots.iter().filter(|shot| shot.is_comparable()) {
        let exact = closed_forms.contains(&shot.name.as_str());
        let bound_mm = if exact {
            5.1e-5
        } else {
            accuracy::WORST_MAX_MM
        };
        assert!(shot.max_mm <= bound_mm, "{shot:?}");
        assert_eq!(shot.pocketed_differently, 0, "{}", shot.name);
    }
    assert!(
        measured.median_max_mm <= accuracy::MEDIAN_MAX_MM,
        "{measured}"
    );
}

#[test]
fn struck_clusters_part_as_in_the_references() {
    let measured = accuracy::Accuracy::measure(&references()).expect("all can be played");
    let clusters = measured.shots.iter().filter(|shot| shot.kind == "cluster");
    let off: Vec<_> = clusters.map(|shot| shot.velocity_off_m_s).collect();
    assert_eq!(off.len(), 2);
    assert!(
        off.iter().all(|&off| off > 0.0 && off < 0.04),
        "of 2 m/s: {off:?}"
    );
}

#[test]
fn breaks_of_the_references_are_draws_of_ours() {
    let rows = breaks::measure(&references(), 40).expect("all can be played");
    assert_eq!(
        rows.len(),
        9,
        "two racks of the references and the game's own"
    );
    for row in &rows {
        assert!(row.halves_differ.abs() < 4.0, "{row}");
        // Energy hardly differs from draw to draw, so that its band is narrower than the models.
        let slack = 0.05 * row.mean;
        let [low, high] = row.band;
        let fits = |value: f64| (low - slack..=high + slack).contains(&value);
        assert!(row.reference.is_none_or(fits), "{row}");
    }
    let kept = rows
        .iter()
        .find(|row| row.quantity == "energy kept")
        .expect("counted");
    assert!((0.3..0.6).contains(&kept.mean), "{kept}");
}

#[test]
fn closed_forms_and_published_curves_are_met() {
    for form in closed_forms::measure().expect("one ball always comes to rest") {
        assert!(form.error <= closed_forms::ERROR_MAX, "{form}");
    }
    for curve in curves::measure().expect("two balls always come to rest") {
        assert!(curve.error_max <= curve.bar, "{curve}");
    }
}

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
        Layout {
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

/// What the cluster and rebound rules may add in one event.
fn allowance_j(kind: &EventKind) -> f64 {
    match kind {
        EventKind::BallBall { .. } => CLUSTER_ENERGY_J,
        EventKind::Cushion { .. } | EventKind::Bounces { .. } => REBOUND_ENERGY_J,
        _ => 0.0,
    }
}

fn assert_energy_never_grows(shot: &Shot) {
    let mut last = f64::INFINITY;
    for together in shot.events().chunk_by(|a, b| a.time_secs == b.time_secs) {
        let [before, after] = around(shot, &together[0]).map(|states| energy_j(&states));
        if together[0].time_secs > 0.0 {
            let allowed: f64 = together.iter().map(|event| allowance_j(&event.kind)).sum();
            assert!(
                before <= last * (1.0 + 1e-12) + 1e-15,
                "{before} J after {last} J"
            );
            assert!(
                after <= before * (1.0 + 1e-12) + allowed + 1e-15,
                "{together:?}: {before} J to {after} J"
            );
        }
        last = after;
    }
}

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
        Layout {
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
fn a_ball_pressed_to_the_cushion_by_its_spin_ends_within_bounds() {
    for towards in [1.0, 40.0, 300.0] {
        let touching = 0.635 - RADIUS;
        let start = ball(0, 0.6, touching, DVec3::X, DVec3::new(-towards, 0.0, 20.0));
        let shot = released(Table::nine_foot(), Laws::default(), vec![start]);
        assert!(shot.events().len() < 5000, "{} events", shot.events().len());
        assert_energy_never_grows(&shot);
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
    World::new(Table::nine_foot(), Layout { balls }).ok()
}

#[test]
fn a_suggested_stroke_does_what_it_says() {
    let (mut asked, mut found) = (0, 0);
    for world in (0..24).filter_map(position) {
        let targets = [1, 2];
        let suggestion = suggest(&world, &targets, 400).expect("within limits");
        assert_eq!(
            suggestion,
            suggest(&world, &targets, 400).expect("within limits")
        );
        asked += 1;
        let Some(Suggestion {
            stroke,
            ball,
            pocket,
            simulated,
            ..
        }) = suggestion
        else {
            continue;
        };
        found += 1;
        assert!(simulated <= 400 && targets.contains(&ball));
        let shot = world.strike(stroke).expect("valid");
        let pots = |e: &Event| matches!(e.kind, EventKind::Pocketed { ball: b, pocket: p, .. } if (b, p) == (ball, pocket));
        assert!(shot.events().iter().any(pots), "{suggestion:?}");
        let ends = shot.final_states();
        assert!(ends[0].phase.is_on_table(), "the cue ball stays");
        let line = predict(&world, stroke).expect("valid");
        let AimContact::Ball { number, .. } = line.contact else {
            panic!("{:?}", line.contact);
        };
        assert!(targets.contains(&number), "a target is touched first");
    }
    assert!(
        asked > 12 && 2 * found > asked,
        "{found} of {asked} positions"
    );
}

#[test]
fn a_search_is_bounded_and_knows_when_there_is_nothing() {
    let world = position(1).expect("valid");
    for bound in [0, 1, 7] {
        let found = suggest(&world, &[1, 2], bound).expect("within limits");
        assert!(found.is_none_or(|found| found.simulated <= bound));
    }
    assert_eq!(suggest(&world, &[], 400).expect("nothing to do"), None);
    assert_eq!(suggest(&world, &[0, 9], 400).expect("nothing to do"), None);
}

#[test]
fn absurd_strokes_are_rejected_with_a_sentence() {
    let world = eight_ball(0);
    let good = Stroke::straight(0.0, 3.0);
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1.0] {
        for stroke in [
            Stroke {
                speed_m_s: bad,
                ..good
            },
            Stroke { side: bad, ..good },
            Stroke {
                vertical: bad,
                ..good
            },
            Stroke {
                elevation_rad: bad,
                ..good
            },
        ] {
            let error = world.strike(stroke).expect_err("absurd").to_string();
            assert!(
                error.starts_with("this stroke cannot be played: the "),
                "{error}"
            );
            assert!(predict(&world, stroke).is_err());
        }
    }
    assert!(
        world
            .strike(Stroke {
                direction_rad: f64::NAN,
                ..good
            })
            .is_err()
    );
    assert!(
        world
            .strike(Stroke {
                speed_m_s: 0.0,
                ..good
            })
            .is_err()
    );
    assert!(
        world
            .strike(Stroke {
                direction_rad: 1e9,
                ..good
            })
            .is_ok()
    );
}

#[test]
fn impossible_layouts_are_rejected() {
    let rejected = |balls: Vec<BallState>| {
        matches!(
            World::new(Table::nine_foot(), Layout { balls }),
            Err(Error::Layout(_))
        )
    };
    assert!(
        rejected(vec![resting(0, 0.0, 0.0), resting(1, 0.05, 0.0)]),
        "overlap"
    );
    assert!(
        rejected(vec![resting(0, 0.0, 0.0), resting(0, 0.5, 0.0)]),
        "twice"
    );
    assert!(rejected(vec![resting(0, 1.26, 0.0)]), "in a cushion");
    assert!(rejected(vec![resting(0, 0.0, 0.65)]), "in a pocket");
    assert!(rejected(vec![resting(0, 9.0, 0.0)]), "off the table");
    assert!(rejected(vec![resting(0, f64::NAN, 0.0)]), "nowhere");
    let mut floating = resting(0, 0.0, 0.0);
    floating.position.z = 0.5;
    assert!(rejected(vec![floating]), "in the air");
    let lossless = Laws {
        cloth: carom::sim::Cloth {
            rolling_friction: 0.0,
            ..Default::default()
        },
        ..ideal()
    };
    assert!(matches!(
        World::with_laws(prairie(), lossless, Vec::new()),
        Err(Error::Laws(_))
    ));
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

#[test]
fn racks_are_tight_and_legal() {
    for seed in 0..50 {
        let balls = Table::nine_foot().rack_eight(seed).balls;
        let mut numbers: Vec<_> = balls.iter().map(|ball| ball.number).collect();
        assert_eq!(balls[5].number, 8, "the 8 is in the middle");
        assert_ne!(
            balls[11].number < 8,
            balls[15].number < 8,
            "a solid and a stripe in the corners"
        );
        numbers.sort_unstable();
        assert_eq!(numbers, (0..16).collect::<Vec<_>>());
        let apex = balls[1].position;
        for neighbour in [&balls[2], &balls[3]] {
            let gap = apex.distance(neighbour.position) - 2.0 * RADIUS;
            assert!((15e-6..65e-6).contains(&gap), "{gap}");
        }
    }
}

/// The picture's table: shapes of `assets/scenes/pool.json` whose name begins so.
fn scene_shapes(prefix: &str, shape: &str) -> Vec<serde_json::Value> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/scenes/pool.json");
    let text = fs::read_to_string(path).expect("the scene is in the repository");
    let scene: serde_json::Value = serde_json::from_str(&text).expect("a scene is JSON");
    let objects = scene["objects"].as_array().expect("objects").iter();
    let named = objects.filter(|o| o["name"].as_str().is_some_and(|n| n.starts_with(prefix)));
    named.map(|object| object["shape"][shape].clone()).collect()
}

fn over_cloth(point: &serde_json::Value) -> DVec2 {
    let [x, y] = [0, 1].map(|axis| point[axis].as_f64().expect("a number"));
    DVec2::new(x, y)
}

#[test]
fn the_table_is_the_one_in_the_picture() {
    let table = Table::boxes();
    let boxes: Vec<_> = scene_shapes("cush_", "box")
        .iter()
        .map(|b| (over_cloth(&b["min"]), over_cloth(&b["max"])))
        .collect();
    let is_in_front = |nose: &Nose, (low, high): &(DVec2, DVec2)| {
        let on_face = |p: DVec2| p.cmpge(*low - 1e-9).all() && p.cmple(*high + 1e-9).all();
        let outside = nose.from().midpoint(nose.to()) + 1e-6 * nose.normal();
        let leaves = outside.cmplt(*low).any() || outside.cmpgt(*high).any();
        on_face(nose.from()) && on_face(nose.to()) && leaves
    };
    for nose in table.noses() {
        assert!(
            boxes.iter().any(|b| is_in_front(nose, b)),
            "{nose:?} is on no cushion's face"
        );
    }
    // Each box is a long face, two rounded corners and two ends.
    assert_eq!(
        (table.noses().len(), table.jaws().len()),
        (3 * boxes.len(), 2 * boxes.len())
    );
    for jaw in table.jaws() {
        let corners = boxes
            .iter()
            .flat_map(|&(a, b)| [a, b, DVec2::new(a.x, b.y), DVec2::new(b.x, a.y)]);
        let inscribed =
            |corner: DVec2| ((corner - jaw.center).abs() - jaw.radius_m).length() < 1e-9;
        assert_eq!(
            corners.filter(|&c| inscribed(c)).count(),
            1,
            "{jaw:?} rounds no corner"
        );
    }
    let discs = scene_shapes("pocket", "disc");
    assert_eq!(discs.len(), table.pockets().len());
    for (disc, pocket) in discs.iter().zip(table.pockets()) {
        assert_eq!(over_cloth(&disc["center"]), pocket.center);
        assert_eq!(disc["radius"].as_f64(), Some(pocket.radius_m));
    }
    let balls = scene_shapes("ball", "sphere");
    let places = balls
        .iter()
        .map(|ball| over_cloth(&ball["center"]))
        .zip(0..);
    let balls = places
        .map(|(place, number)| resting(number, place.x, place.y))
        .collect();
    World::new(table, Layout { balls }).expect("the picture's balls lie on the table");
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
        let line = predict(&world, stroke).expect("valid");
        let shot = world.strike(stroke).expect("valid");
        let end = *line.path.last().expect("not empty");
        let touched = shot.events().iter().find(|event| match event.kind {
            EventKind::BallBall { first, second, .. } => first == 0 || second == 0,
            EventKind::Cushion { ball, .. }
            | EventKind::Pocketed { ball, .. }
            | EventKind::LeftTable { ball, .. } => ball == 0,
            _ => false,
        });
        let t = touched.map_or(shot.duration_secs(), |event| event.time_secs);
        let there = shot.states_at(t)[0];
        prop_assert_eq!(end, there.position);
        if let AimContact::Ball { cue_direction, .. } = line.contact {
            prop_assert_eq!(cue_direction, there.velocity.normalize_or_zero());
        }
    }

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
