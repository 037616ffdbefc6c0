//! The simulation where games rarely go: what every one of these shots keeps is that it ends, that
//! energy does not grow, that momentum is kept, that nothing passes through anything, and that the
//! same shot has the same bits.
//!
//! | extreme | test |
//! |---|---|
//! | 1e-6 … 100 m/s | `any_speed_meets_and_parts` |
//! | 1e4 rad/s | `the_fastest_spin_ends`, `a_spin_of_ten_thousand_never_adds_energy` |
//! | frames of 1e-6 … 1/30 s | `the_shot_does_not_depend_on_frames` |
//! | frozen racks, triple and symmetric contacts | `a_symmetric_rack_stays_symmetric`, `two_balls_struck_at_once_part_alike`, `frozen_racks_end` |
//! | Newton's cradle | `the_cradle_passes_the_blow_on` |
//! | on a jaw, on a pocket's edge | `balls_on_edges_end` |
//! | between two cushions; cuts of 89.9°; time reversed; edges of facings | `physics/limits.rs` |
//! | grazing within 1e-9 | `a_graze_is_a_contact_or_none` |
//! | 80 m from the origin | `far_from_the_origin_is_as_near_it` |
//! | an hour idle, an hour of shots | `an_hour_idle_changes_nothing`, `an_hour_of_shots_stays_in_order` |
//! | NaN and absurd parameters | `absurd_worlds_are_rejected`, `absurd_engines_and_frames_are_rejected` |
//! | a bound on events, never silently hit | `the_bound_on_events_is_an_error` |
//! | recorded shots, whole and damaged | `a_recorded_shot_is_read_back_to_the_bit`, `damaged_recordings_are_rejected_with_a_sentence` |
//! | the same bits in every build | `final_states_have_the_stored_bits` |
//!
//! `physics.rs` has the laws themselves, every stroke at random, absurd strokes and layouts.

#![allow(
    clippy::disallowed_methods,
    reason = "tests need no digits that all systems share"
)]

use std::f64::consts::PI;

use carom_billiards::Error;
use carom_billiards::physics::{
    BallBallLaw, BallBody, BallState, Clip, Cloth, Engine, Event, EventKind, Laws, Rapier,
    Recording, Shot, Stroke, Table, TableParts, World,
};
use glam::{DVec2, DVec3};

const RADIUS: f64 = 0.028_575;

/// A square of cushions, ten kilometres apart, so that none is ever reached.
fn endless_table() -> Table {
    let half = 5000.0;
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]].map(DVec2::from);
    Table::from_parts(TableParts {
        name: "endless".to_owned(),
        length_m: 2.0 * half,
        width_m: 2.0 * half,
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

/// What balls in motion do on a cloth without an end.
fn released(laws: Laws, balls: Vec<BallState>) -> Result<Shot, Error> {
    World::with_laws(endless_table(), laws, balls)?.release()
}

fn still(number: u8, x: f64, y: f64) -> BallState {
    ball(number, x, y, DVec3::ZERO, DVec3::ZERO)
}

/// Of motion, and of height over the cloth.
fn energy_j(states: &[BallState]) -> f64 {
    let of = |b: &BallState| {
        let height_j = b.body.mass_kg * 9.81 * b.position.z;
        b.body.kinetic_energy_j(b.velocity, b.spin) + height_j
    };
    states
        .iter()
        .filter(|b| b.phase.is_on_table())
        .map(of)
        .sum()
}

fn momentum(states: &[BallState]) -> DVec3 {
    states.iter().map(|b| b.velocity).sum()
}

fn first_contact(shot: &Shot) -> f64 {
    let meets = |event: &&Event| matches!(event.kind, EventKind::BallBall { .. });
    shot.events()
        .iter()
        .find(meets)
        .expect("the balls meet")
        .time_secs
}

/// Energy at the instants around every event: what the rules for clusters and slow rebounds may
/// add to one contact is stated with their constants.
fn assert_energy_never_grows(shot: &Shot) {
    let mut last = f64::INFINITY;
    for event in shot.events() {
        let allowed = match event.kind {
            EventKind::BallBall { .. } => carom_billiards::physics::CLUSTER_ENERGY_J,
            EventKind::Cushion { .. } | EventKind::Bounces { .. } => {
                carom_billiards::physics::REBOUND_ENERGY_J
            }
            _ => 0.0,
        };
        let now = energy_j(&shot.states_at(event.time_secs));
        assert!(
            now <= last * (1.0 + 1e-12) + allowed + 1e-15,
            "{event:?}: {last} J to {now} J"
        );
        last = now;
    }
}

fn assert_apart(states: &[BallState]) {
    for (index, one) in states.iter().enumerate() {
        assert!(one.position.is_finite() && one.velocity.is_finite() && one.spin.is_finite());
        for other in &states[..index] {
            if one.phase.is_on_table() && other.phase.is_on_table() {
                let gap = one.position.distance(other.position) - 2.0 * RADIUS;
                assert!(
                    gap > -1e-6,
                    "{} and {} overlap by {gap} m",
                    one.number,
                    other.number
                );
            }
        }
    }
}

#[test]
fn any_speed_meets_and_parts() {
    for speed in [1e-6, 1e-4, 1e-2, 1.0, 30.0, 100.0f64] {
        let gap = 1e-3 * speed.min(1.0).powi(2);
        let start = -2.0 * RADIUS - gap;
        let balls = vec![
            ball(0, start, 0.0, speed * DVec3::X, DVec3::ZERO),
            still(1, 0.0, 0.0),
        ];
        let shot = released(Laws::default(), balls).expect("it ends");
        let t = first_contact(&shot);
        let (before, after) = (shot.states_at(t.next_down()), shot.states_at(t));
        let lost = (momentum(&before) - momentum(&after)).length();
        let round_off = 1e-13 * speed.max(carom_billiards::physics::CLUSTER_SPEED_M_S);
        assert!(lost <= round_off, "{speed}: {lost}");
        assert!(
            after[1].velocity.x > after[0].velocity.x,
            "{speed}: they part"
        );
        assert!(
            after[0].velocity.y == 0.0 && after[1].velocity.y == 0.0,
            "{speed}: straight"
        );
        assert_energy_never_grows(&shot);
        assert!(
            shot.states_at(t + 1e-3)[1].position.x > 0.0,
            "{speed}: it moves"
        );
    }
}

#[test]
fn nothing_is_passed_through_at_100_m_s() {
    for degrees in 0..36 {
        let way = DVec2::from_angle((10.0 * f64::from(degrees)).to_radians());
        let balls = vec![
            ball(0, 0.0, 0.1, (100.0 * way).extend(0.0), DVec3::ZERO),
            still(1, 0.4, 0.2),
            still(2, -0.5, -0.3),
        ];
        let world = World::with_laws(Table::nine_foot(), Laws::default(), balls).expect("valid");
        let shot = world.release().expect("it ends");
        for event in shot.events() {
            assert_apart(&shot.states_at(event.time_secs));
        }
        // A ball may jump the rail, but not pass through it.
        for event in shot.events() {
            if let EventKind::LeftTable { point, .. } = event.kind {
                assert!(point.z > 1.9 * RADIUS, "{degrees}0 degrees: {event:?}");
            }
        }
        assert_energy_never_grows(&shot);
    }
}

#[test]
fn the_fastest_spin_ends() {
    for axis in [DVec3::X, DVec3::Z, DVec3::new(0.06, 0.0, 0.998)] {
        let start = ball(0, 0.0, 0.0, DVec3::ZERO, 1e4 * axis);
        let shot = released(Laws::default(), vec![start]).expect("it ends");
        let decay = 2.5 * Cloth::default().spin_friction_m * 9.81 / RADIUS.powi(2);
        assert!(shot.duration_secs() >= 0.999 * 1e4 * axis.z / decay);
        assert_eq!(shot.final_states()[0].spin, DVec3::ZERO);
        assert_energy_never_grows(&shot);
    }
}

#[test]
fn a_spin_of_ten_thousand_never_adds_energy() {
    for spin in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::new(-0.5, 0.7, 0.5)] {
        let balls = vec![
            ball(0, -0.3, 0.01, DVec3::new(3.0, 0.2, 0.0), 1e4 * spin),
            still(1, 0.0, 0.0),
            still(2, 0.5, 0.3),
        ];
        let world = World::with_laws(Table::nine_foot(), Laws::default(), balls).expect("valid");
        let shot = world.release().expect("it ends");
        assert_energy_never_grows(&shot);
        for event in shot.events() {
            assert_apart(&shot.states_at(event.time_secs));
        }
    }
}

#[test]
fn the_shot_does_not_depend_on_frames() {
    let table = Table::nine_foot();
    let rack = table.rack_eight(11);
    let world = World::new(table, rack).expect("valid");
    let stroke = Stroke {
        side: 0.25,
        ..Stroke::straight(0.004, 7.0)
    };
    let whole = world.strike(stroke).expect("valid");
    for frame_secs in [1e-6, 1e-4, 1.0 / 240.0, 1.0 / 60.0, 1.0 / 30.0] {
        let mut frames = 0u64;
        let shot = world
            .strike_in_frames(stroke, frame_secs, &mut || frames += 1)
            .expect("valid");
        assert_eq!(shot.final_states(), whole.final_states(), "at {frame_secs}");
        assert_eq!(shot.events(), whole.events(), "at {frame_secs}");
        let expected = whole.duration_secs() / frame_secs;
        assert!(
            (frames as f64 - expected).abs() <= 1.0 + 1e-6 * expected,
            "{frames} frames"
        );
    }
}

/// Rows of touching balls behind an apex on the x axis.
fn frozen_rack(rows: u8, gap: f64) -> Vec<BallState> {
    let pitch = 2.0 * RADIUS + gap;
    let places = (0..rows).flat_map(|row| (0..=row).map(move |place| (row, place)));
    let rack = places.zip(1..).map(|((row, place), number)| {
        let x = f64::from(row) * pitch * 0.75f64.sqrt();
        let y = pitch * (f64::from(place) - 0.5 * f64::from(row));
        still(number, x, y)
    });
    rack.collect()
}

#[test]
fn a_symmetric_rack_stays_symmetric() {
    // Gaps larger than round-off: in what order touching balls part is a rule, not a law.
    for gap in [1e-3, 1e-4] {
        let mut balls = vec![ball(0, -0.5, 0.0, 8.0 * DVec3::X, DVec3::ZERO)];
        balls.extend(frozen_rack(4, gap));
        let shot = released(Laws::default(), balls).expect("it ends");
        let start = shot.states_at(0.0);
        // Up to the second contact of any pair that lies on the axis chaos has had no time.
        let states = shot.states_at(first_contact(&shot) + 2e-3);
        for (one, lies) in states.iter().zip(&start) {
            let twin = start
                .iter()
                .position(|b| {
                    (b.position.y + lies.position.y).abs() < 1e-12
                        && (b.position.x - lies.position.x).abs() < 1e-12
                })
                .expect("the rack is symmetric");
            let mirrored = states[twin].velocity * DVec3::new(1.0, -1.0, 1.0);
            assert!(
                (one.velocity - mirrored).length() < 1e-6,
                "gap {gap}: ball {} {} and {mirrored}",
                one.number,
                one.velocity
            );
        }
    }
}

#[test]
fn two_balls_struck_at_once_part_alike() {
    let balls = vec![
        ball(0, -0.3, 0.0, 3.0 * DVec3::X, DVec3::ZERO),
        still(1, 0.0, RADIUS),
        still(2, 0.0, -RADIUS),
    ];
    let shot = released(Laws::default(), balls).expect("it ends");
    let after = shot.states_at(first_contact(&shot) + 0.05);
    let (up, down) = (after[1].velocity, after[2].velocity);
    assert!(up.y > 0.0 && down.y < 0.0);
    let difference = (up.length() - down.length()).abs() / up.length();
    assert!(difference < 1e-9, "{up} and {down}: {difference}");
    assert_energy_never_grows(&shot);
}

#[test]
fn frozen_racks_end() {
    for rows in [2, 5] {
        for speed in [0.05, 2.0, 15.0] {
            let mut balls = vec![ball(0, -0.4, 0.003, speed * DVec3::X, DVec3::ZERO)];
            balls.extend(frozen_rack(rows, 0.0));
            let shot = released(Laws::default(), balls).expect("it ends");
            assert!(shot.events().len() < 5000, "{} events", shot.events().len());
            assert_energy_never_grows(&shot);
            assert_apart(&shot.final_states());
        }
    }
}

#[test]
fn the_cradle_passes_the_blow_on() {
    let mut balls = vec![ball(0, -0.2, 0.0, 2.0 * DVec3::X, DVec3::ZERO)];
    balls.extend((1..=5).map(|i| still(i, f64::from(i - 1) * 2.0 * RADIUS, 0.0)));
    let laws = Laws {
        ball_ball: BallBallLaw::IDEAL,
        ..Laws::default()
    };
    let shot = released(laws, balls).expect("it ends");
    let t = first_contact(&shot);
    let came = shot.states_at(t.next_down())[0].velocity.x;
    let states = shot.states_at(t + 0.01);
    let left = states[5].velocity.x;
    assert!(
        left > 0.95 * came,
        "the last ball takes the blow: {left} of {came}"
    );
    let rest = states[..5]
        .iter()
        .map(|b| b.velocity.x.abs())
        .fold(0.0, f64::max);
    assert!(rest < 0.05, "the others stay: {rest}");
    assert!(states.iter().all(|b| b.position.y == 0.0), "in line");
}

#[test]
fn balls_on_edges_end() {
    let table = Table::nine_foot();
    let mut starts = Vec::new();
    for pocket in table.pockets() {
        let inward = -pocket.center.normalize();
        starts.push(pocket.center + inward * pocket.radius_m);
        starts.push(pocket.center + inward * (pocket.radius_m + 1e-12));
    }
    for jaw in table.jaws() {
        let inward = (-jaw.center).normalize();
        starts.push(jaw.center + inward * (jaw.radius_m + RADIUS));
    }
    let ends = (
        0.5 * table.length_m() - RADIUS,
        0.5 * table.width_m() - RADIUS,
    );
    starts.push(DVec2::new(ends.0, 0.3));
    starts.push(DVec2::new(0.3, -ends.1));
    let mut played = 0;
    for start in starts {
        for speed in [0.0, 1e-6, 0.3, 6.0] {
            for turn in 0..8 {
                let way = DVec2::from_angle(f64::from(turn) * PI / 4.0);
                let state = ball(0, start.x, start.y, (speed * way).extend(0.0), DVec3::ZERO);
                let world = World::with_laws(table.clone(), Laws::default(), vec![state]);
                // On the edge itself round-off decides whether a ball may lie there.
                let Ok(world) = world else { continue };
                let shot = world.release().expect("it ends");
                assert!(shot.events().len() < 2000, "{} events", shot.events().len());
                assert_energy_never_grows(&shot);
                played += 1;
            }
        }
    }
    assert!(played > 200, "only {played} could lie there");
}

#[test]
fn a_graze_is_a_contact_or_none() {
    for beyond in [-1e-6, -1e-9, -1e-12, 0.0, 1e-12, 1e-9, 1e-6] {
        let offset = 2.0 * RADIUS + beyond;
        let balls = vec![
            ball(0, -0.5, offset, 5.0 * DVec3::X, DVec3::ZERO),
            still(1, 0.0, 0.0),
        ];
        let shot = released(Laws::default(), balls).expect("it ends");
        let touched = shot
            .events()
            .iter()
            .any(|e| matches!(e.kind, EventKind::BallBall { .. }));
        if beyond.abs() > 1e-10 {
            assert_eq!(touched, beyond < 0.0, "{beyond} m beyond a touch");
        }
        assert_energy_never_grows(&shot);
        let moved = shot.final_states()[1].position.truncate().length();
        assert!(
            moved < 0.02,
            "a graze by {beyond} moves the ball by {moved} m"
        );
    }
}

#[test]
fn far_from_the_origin_is_as_near_it() {
    let play = |at: DVec2| {
        let balls = vec![
            ball(0, at.x - 0.3, at.y + 0.01, 2.0 * DVec3::X, DVec3::Z * 30.0),
            still(1, at.x, at.y),
        ];
        let shot = released(Laws::default(), balls).expect("it ends");
        shot.final_states()
            .into_iter()
            .map(move |b| b.position - at.extend(0.0))
            .collect::<Vec<_>>()
    };
    let near = play(DVec2::ZERO);
    for at in [DVec2::new(40.0, -20.0), DVec2::new(-80.0, 80.0)] {
        for (far, near) in play(at).iter().zip(&near) {
            assert!(far.distance(*near) < 1e-9, "{far} at {at} and {near}");
        }
    }
}

#[test]
fn an_hour_idle_changes_nothing() {
    let table = Table::nine_foot();
    let rack = table.rack_eight(3);
    let world = World::new(table, rack).expect("valid");
    let shot = world.release().expect("it rests");
    assert_eq!(shot.duration_secs(), 0.0);
    assert_eq!(shot.states_at(3600.0), world.balls());
}

#[test]
fn an_hour_of_shots_stays_in_order() {
    let table = Table::nine_foot();
    let rack = table.rack_eight(8);
    let mut world = World::new(table.clone(), rack).expect("valid");
    let (mut played_secs, mut shots) = (0.0, 0u32);
    while played_secs < 3600.0 {
        let fresh = |b: &BallState| b.number != 0 && b.phase.is_on_table();
        if !world.balls().iter().any(fresh) {
            world = World::new(table.clone(), table.rack_eight(shots)).expect("valid");
        }
        if world
            .balls()
            .iter()
            .any(|b| b.number == 0 && !b.phase.is_on_table())
        {
            let places = (0..40).map(|i| -0.635 + 0.03 * f64::from(i));
            let free = places.map(|x| world.place(0, x, 0.1)).find(Result::is_ok);
            assert!(free.is_some(), "the cue ball lies somewhere");
        }
        let turn = 2.4 * f64::from(shots);
        let stroke = Stroke {
            side: 0.4 * (1.7 * turn).sin(),
            vertical: 0.4 * (0.9 * turn).cos(),
            ..Stroke::straight(turn, 0.5 + 4.0 * (1.0 + turn.sin()))
        };
        let shot = world.strike(stroke).expect("it ends");
        world.adopt(&shot);
        played_secs += shot.duration_secs();
        shots += 1;
        assert_apart(&world.balls());
        let at_rest = |b: &BallState| b.velocity == DVec3::ZERO && b.spin == DVec3::ZERO;
        assert!(world.balls().iter().all(at_rest));
    }
    assert!(shots > 200, "{shots} shots");
}

#[test]
fn absurd_worlds_are_rejected() {
    let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0];
    for value in bad {
        let cloths = [
            Cloth {
                sliding_friction: value,
                ..Cloth::default()
            },
            Cloth {
                rolling_friction: value,
                ..Cloth::default()
            },
            Cloth {
                spin_friction_m: value,
                ..Cloth::default()
            },
            Cloth {
                gravity_m_s2: value,
                ..Cloth::default()
            },
        ];
        for cloth in cloths {
            let laws = Laws {
                cloth,
                ..Laws::default()
            };
            let error = World::with_laws(Table::nine_foot(), laws, Vec::new()).expect_err("absurd");
            assert!(error.to_string().contains(&format!("{value}")), "{error}");
        }
        let ball_ball = BallBallLaw {
            restitution: value,
            ..BallBallLaw::default()
        };
        let laws = Laws {
            ball_ball,
            ..Laws::default()
        };
        assert!(World::with_laws(Table::nine_foot(), laws, Vec::new()).is_err());
    }
    for vector in [DVec3::splat(f64::NAN), DVec3::X * f64::INFINITY] {
        for state in [
            ball(0, 0.0, 0.0, vector, DVec3::ZERO),
            ball(0, 0.0, 0.0, DVec3::ZERO, vector),
        ] {
            let world = World::with_laws(Table::nine_foot(), Laws::default(), vec![state]);
            assert!(matches!(world, Err(Error::Layout(_))));
        }
    }
}

#[test]
fn absurd_engines_and_frames_are_rejected() {
    let table = Table::nine_foot();
    let rack = table.rack_eight(1);
    let mut world = World::new(table, rack).expect("valid");
    let stroke = Stroke::straight(0.0, 1.0);
    for frame_secs in [f64::NAN, 0.0, -1.0] {
        let error = world
            .strike_in_frames(stroke, frame_secs, &mut || {})
            .expect_err("absurd");
        assert!(matches!(error, Error::Engine(_)), "{error}");
    }
    for (steps_per_sec, solver_iterations) in [(0, 4), (u32::MAX, 4), (240, 0), (240, u32::MAX)] {
        let rapier = Rapier {
            solver_iterations,
            ..Rapier::at(steps_per_sec)
        };
        world.set_engine(Engine::Rapier(rapier));
        assert!(matches!(world.strike(stroke), Err(Error::Engine(_))));
        assert!(matches!(
            carom_billiards::physics::predict(&world, stroke),
            Err(Error::Engine(_))
        ));
    }
}

#[test]
fn the_bound_on_events_is_an_error() {
    // Spin in place for over an hour: no game has it, and it must be said rather than cut off.
    let start = ball(0, 0.0, 0.0, DVec3::ZERO, DVec3::Z * 1e5);
    let error = released(Laws::default(), vec![start]).expect_err("it would take 2.5 hours");
    assert!(matches!(error, Error::Endless { .. }), "{error}");
    assert!(error.to_string().contains("did not come to rest"));
}

#[test]
fn plain_rapier_plays_a_whole_game_of_shots() {
    let table = Table::nine_foot();
    for engine in ["rapier-60", "rapier-240"] {
        let mut world = World::new(table.clone(), table.rack_eight(2)).expect("valid");
        world.set_engine(engine.parse().expect("an engine"));
        let stroke = Stroke::straight(0.002, 8.0);
        let shot = world.strike(stroke).expect("it ends");
        let meets = |e: &Event| matches!(e.kind, EventKind::BallBall { .. });
        assert!(
            shot.events().iter().filter(|e| meets(e)).count() > 5,
            "{engine}"
        );
        assert!(shot.duration_secs() > 2.0 && shot.duration_secs() < 60.0);
        let again = world.strike(stroke).expect("it ends");
        assert_eq!(
            shot.final_states(),
            again.final_states(),
            "{engine}: the same bits"
        );
        let rack = world.balls();
        world.adopt(&shot);
        let way = |(a, b): &(BallState, BallState)| a.position.distance(b.position);
        let moved = rack
            .into_iter()
            .zip(world.balls())
            .filter(|pair| way(pair) > 0.1)
            .count();
        assert!(moved > 8, "{engine}: the rack bursts: {moved} balls moved");
        let line = carom_billiards::physics::predict(&world, Stroke::straight(2.0, 2.0));
        let lies = world.balls()[0].phase.is_on_table();
        assert_eq!(line.is_ok(), lies, "{engine}: the next shot can be aimed");
    }
}

#[test]
fn a_recorded_shot_is_read_back_to_the_bit() {
    let table = Table::nine_foot();
    for engine in [Engine::Exact, Engine::Rapier(Rapier::at(240))] {
        let mut world = World::new(table.clone(), table.rack_eight(4)).expect("valid");
        world.set_engine(engine);
        let stroke = Stroke {
            side: 0.3,
            vertical: 0.1,
            elevation_rad: 0.1,
            ..Stroke::straight(0.01, 8.0)
        };
        let shot = world.strike(stroke).expect("valid");
        let mut recording = Recording::of(&table, "a break", shot);
        let next = world.strike(Stroke::straight(0.2, 1.0)).expect("valid");
        recording.clips.push(Clip {
            title: "a soft one".to_owned(),
            shot: next,
        });
        recording.clips.push(Clip {
            title: String::new(),
            shot: world.release().expect("valid"),
        });
        let bytes = recording.to_bytes().expect("small enough");
        assert!(bytes.len() < 5_000_000, "{} bytes", bytes.len());
        let read = Recording::from_bytes(&bytes).expect("as written");
        assert_eq!(read.table, recording.table);
        assert_eq!(read.clips.len(), 3);
        assert!(
            read.to_bytes().expect("as read") == bytes,
            "{engine}: other bytes"
        );
        for (read, take) in read.clips.iter().zip(&recording.clips) {
            assert_eq!(read.title, take.title);
            assert_eq!(read.shot.events(), take.shot.events());
            for step in 0..500 {
                let t = take.shot.duration_secs() * f64::from(step) / 499.0;
                let (read, shot) = (read.shot.states_at(t), take.shot.states_at(t));
                assert_eq!(read, shot, "{engine} at {t}");
            }
        }
    }
}

#[test]
fn damaged_recordings_are_rejected_with_a_sentence() {
    let world = World::new(Table::nine_foot(), Table::nine_foot().rack_eight(4)).expect("valid");
    let shot = world.strike(Stroke::straight(0.3, 1.0)).expect("valid");
    let recording = Recording::of(world.table(), "a shot", shot);
    let good = recording.to_bytes().expect("small enough");
    let words = |bytes: &[u8]| match Recording::from_bytes(bytes) {
        Ok(_) => "read".to_owned(),
        Err(error) => error.to_string(),
    };
    assert!(words(b"a picture").contains("does not begin"));
    assert!(words(&good[..12]).contains("ends within its version"));
    assert!(words(&good[..good.len() - 1]).contains("cut off or damaged"));
    assert!(words(&[&good[..], b"x"].concat()).contains("1 bytes follow its end"));
    let mut newer = good.clone();
    newer[11] = 9;
    assert!(words(&newer).contains("its version is 9, this program reads 2"));
    // Whatever byte is wrong: a sentence or another valid shot, never a panic.
    for (place, wrong) in (11..good.len()).flat_map(|i| [(i, 0xffu8), (i, 0x7f), (i, 0)]) {
        let mut bytes = good.clone();
        bytes[place] = wrong;
        if let Ok(read) = Recording::from_bytes(&bytes) {
            for (take, t) in read.clips.iter().zip([0.0, 0.5, 1e9]) {
                assert_eq!(take.shot.poses_at(t).len(), take.shot.final_states().len());
            }
        }
    }
    for (title, words) in [
        ("x".repeat(401), "401 bytes"),
        ("a\nb".to_owned(), "one line"),
    ] {
        let mut wrong = recording.clone();
        wrong.clips[0].title = title;
        let error = wrong.to_bytes().expect_err("the title").to_string();
        assert!(error.contains(words), "{error}");
    }
    let empty = Recording {
        clips: Vec::new(),
        ..recording
    };
    let error = empty.to_bytes().expect_err("no shots").to_string();
    assert!(error.contains("0 shots"), "{error}");
    let missing = Recording::load(std::path::Path::new("no/such/shot")).expect_err("missing");
    assert!(missing.to_string().contains("no/such/shot"), "{missing}");
}

#[test]
fn final_states_have_the_stored_bits() {
    let table = Table::nine_foot();
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    for seed in 0..6 {
        let world = World::new(table.clone(), table.rack_eight(seed)).expect("valid");
        let stroke = Stroke {
            side: 0.1 * f64::from(seed) - 0.25,
            vertical: 0.2,
            ..Stroke::straight(0.003 * f64::from(seed), 4.0 + f64::from(seed))
        };
        for state in world.strike(stroke).expect("valid").final_states() {
            for value in state.position.to_array() {
                // FNV-1a over the bits.
                for byte in value.to_bits().to_le_bytes() {
                    hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
                }
            }
        }
    }
    assert_eq!(
        hash, FINAL_STATES,
        "the physics changed, or this build computes other bits. If it was meant to change: \
         0x{hash:016x}"
    );
}

/// Of [`final_states_have_the_stored_bits`], in debug and in release.
const FINAL_STATES: u64 = 0x064f_65f6_c44b_9a2a;
