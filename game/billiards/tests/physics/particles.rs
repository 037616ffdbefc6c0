//! Shots through sand, snow, jelly and water.

use std::sync::Arc;

use carom_billiards::physics::{
    AimContact, BallState, EventKind, Laws, ParticleBed, ParticleMaterial, ParticlePatch,
    ParticlePrecision, Phase, Recording, Shot, Stroke, Table, World, predict,
};
use glam::DVec3;

fn strip(material: ParticleMaterial, columns: std::ops::Range<i16>) -> Vec<ParticlePatch> {
    let squares = columns.flat_map(|column| (-3..3).map(move |row| (column, row)));
    let patch = |(column, row)| ParticlePatch {
        material,
        column,
        row,
    };
    squares.map(patch).collect()
}

/// The cue ball on the left of a strip across the middle of the table.
fn world(patches: &[ParticlePatch]) -> World {
    let table = Table::nine_foot();
    let balls = vec![BallState::at_rest(0, -0.15, 0.0, &table.cue_ball())];
    let mut world = World::with_laws(table.clone(), Laws::of(&table), balls.clone()).unwrap();
    if !patches.is_empty() {
        let bed = ParticleBed::new(&table, &balls, patches, ParticlePrecision::Coarse).unwrap();
        world.set_particles(Some(Arc::new(bed)));
    }
    world
}

fn end(shot: &Shot) -> DVec3 {
    shot.final_states()[0].position
}

#[test]
fn balls_plough_through_sand_and_are_slower_behind_more_of_it() {
    let stroke = Stroke::straight(0.0, 1.5);
    let speeds = [0, 1, 3, 6].map(|columns| {
        let world = world(&strip(ParticleMaterial::Sand, 0..columns));
        let shot = world.strike(stroke).unwrap();
        let speed = |secs| shot.states_at(secs)[0].velocity.length();
        // Over its mass: it may hop over sand and fall.
        let energy = |secs| {
            let ball = shot.states_at(secs)[0];
            let kinetic_j = ball.body.kinetic_energy_j(ball.velocity, ball.spin);
            kinetic_j / ball.body.mass_kg + 9.81 * ball.position.z
        };
        // Nothing drives it on its way through.
        let times = (1..15).map(|step| f64::from(step) / 60.0);
        let rises = times.map(|secs| energy(secs) - energy(secs - 1.0 / 60.0));
        let most = rises.fold(f64::MIN, f64::max);
        assert!(most < 0.02, "{columns}: {most} J/kg");
        speed(0.4)
    });
    assert!(
        speeds.windows(2).all(|pair| pair[1] < 0.95 * pair[0]),
        "{speeds:?}"
    );
    assert!(speeds[3] < 0.5 * speeds[0], "{speeds:?}");
}

#[test]
fn a_shot_through_particles_has_the_same_bits_again_and_leaves_its_groove() {
    let mut world = world(&strip(ParticleMaterial::Sand, 0..3));
    let stroke = Stroke::straight(0.0, 1.0);
    let (shot, again) = (world.strike(stroke).unwrap(), world.strike(stroke).unwrap());
    assert_eq!(shot.final_states(), again.final_states());
    assert_eq!(shot.particles(), again.particles());
    let before = world.particles().unwrap().centers();
    world.adopt(&shot);
    let after = world.particles().unwrap().centers();
    let moved = before
        .iter()
        .zip(&after)
        .filter(|(a, b)| a.distance(**b) > 5e-3)
        .count();
    assert!(moved > before.len() / 20, "{moved} of {}", before.len());
    // What was drawn last is what lies there, to what a place on the lattice can differ.
    let track = shot.particles().unwrap();
    let [min, max] = track.bounds();
    let places = track.places_at(shot.duration_secs() + 1.0);
    for (place, center) in places.iter().zip(&after) {
        let shown = min + place.as_vec3() / 65_535.0 * (max - min);
        assert!(shown.distance(*center) < 3e-4, "{shown} {center}");
    }
}

#[test]
fn particles_far_away_change_nothing() {
    let stroke = Stroke::straight(0.4, 2.0);
    let with = world(&strip(ParticleMaterial::Snow, -40..-38))
        .strike(stroke)
        .unwrap();
    let without = world(&[]).strike(stroke).unwrap();
    for secs in [0.1, 1.0, 3.0] {
        let apart = with.poses_at(secs)[0]
            .position
            .distance(without.poses_at(secs)[0].position);
        assert!(apart < 1e-6, "{secs} s: {apart} m");
    }
    assert!(without.particles().is_none());
}

#[test]
fn jelly_throws_a_ball_back_and_stands_again() {
    let world = world(&strip(ParticleMaterial::Jelly, 0..2));
    let shot = world.strike(Stroke::straight(0.0, 1.2)).unwrap();
    let slowest = (0..120).map(|step| shot.states_at(f64::from(step) / 60.0)[0].velocity.x);
    assert!(
        slowest.fold(f64::MAX, f64::min) < -0.1,
        "it does not come back"
    );
    assert!(end(&shot).x < -0.1, "{}", end(&shot));
    let track = shot.particles().unwrap();
    let [min, max] = track.bounds();
    let (first, last) = (track.places_at(0.0), track.places_at(60.0));
    let size = (max - min) / 65_535.0;
    let ways = first
        .iter()
        .zip(&last)
        .map(|(a, b)| ((b.as_vec3() - a.as_vec3()) * size).length());
    let farthest = ways.fold(0.0, f32::max);
    assert!(farthest < 0.02, "{farthest} m");
}

#[test]
fn balls_at_rest_among_particles_stay() {
    for material in ParticleMaterial::ALL {
        let table = Table::nine_foot();
        let balls = vec![
            BallState::at_rest(0, -0.4, 0.3, &table.cue_ball()),
            BallState::at_rest(1, 0.03, 0.0, &table.ball()),
        ];
        let patches = strip(material, -2..4);
        let mut world = World::with_laws(table.clone(), Laws::of(&table), balls.clone()).unwrap();
        let bed = ParticleBed::new(&table, &balls, &patches, ParticlePrecision::Coarse).unwrap();
        world.set_particles(Some(Arc::new(bed)));
        let shot = world.strike(Stroke::straight(1.5, 0.2)).unwrap();
        let moved = shot.final_states()[1].position.distance(balls[1].position);
        assert!(moved < 0.02, "{material:?}: {moved} m");
    }
}

#[test]
fn recorded_particles_come_back_as_they_were() {
    let world = world(&strip(ParticleMaterial::Water, 0..2));
    let shot = world.strike(Stroke::straight(0.0, 0.8)).unwrap();
    let recording = Recording::of(world.table(), "splash", shot.clone());
    let bytes = recording.to_bytes().unwrap();
    let read = Recording::from_bytes(&bytes).unwrap().clips.remove(0).shot;
    let (was, is) = (shot.particles().unwrap(), read.particles().unwrap());
    for secs in [0.0, 0.31, 0.6, 2.0] {
        assert_eq!(was.places_at(secs), is.places_at(secs), "{secs} s");
    }
    assert_eq!((was.patches(), was.groups()), (is.patches(), is.groups()));
    // Broken ones are told from right ones, or at least read without harm.
    for cut in (0..bytes.len()).step_by(997) {
        assert!(Recording::from_bytes(&bytes[..cut]).is_err());
        let mut broken = bytes.clone();
        broken[cut] ^= 0x55;
        if let Ok(read) = Recording::from_bytes(&broken)
            && let Some(track) = read.clips[0].shot.particles()
        {
            assert!(track.places_at(0.5).len() <= ParticleBed::PARTICLES_MAX);
        }
    }
    let still = Recording::of(
        world.table(),
        "none",
        world.without_particles().release().unwrap(),
    );
    let bytes = still.to_bytes().unwrap();
    assert_eq!(
        bytes[b"carom shot\n".len()],
        2,
        "files without particles are as ever"
    );
}

#[test]
fn patches_that_no_table_has_are_refused_with_a_sentence() {
    let table = Table::nine_foot();
    let refused = |patches: &[ParticlePatch]| {
        let bed = ParticleBed::new(&table, &[], patches, ParticlePrecision::Standard);
        bed.unwrap_err().to_string()
    };
    assert!(refused(&[]).contains("there are none"));
    let far = strip(ParticleMaterial::Sand, 60..61);
    assert!(
        refused(&far).contains("not on the cloth"),
        "{}",
        refused(&far)
    );
    let wide: Vec<_> = strip(ParticleMaterial::Jelly, -40..40);
    assert!(
        refused(&wide).contains("more than 32000"),
        "{}",
        refused(&wide)
    );
    let mut mixed = strip(ParticleMaterial::Marbles, 0..2);
    mixed.extend(strip(ParticleMaterial::Sand, 4..6));
    assert!(
        refused(&mixed).contains("go through each other"),
        "{}",
        refused(&mixed)
    );
}

#[test]
fn balls_come_to_rest_on_jelly_and_are_struck_from_there() {
    let table = Table::nine_foot();
    let at = DVec3::new(0.09, 0.0, 0.12);
    let balls = vec![
        BallState::at_rest(0, -0.3, 0.3, &table.cue_ball()),
        BallState {
            position: at,
            phase: Phase::Airborne,
            ..BallState::at_rest(1, 0.0, 0.0, &table.ball())
        },
    ];
    let patches = strip(ParticleMaterial::Jelly, 0..6);
    let mut world = World::with_laws(table.clone(), Laws::of(&table), balls.clone()).unwrap();
    let bed = ParticleBed::new(&table, &[], &patches, ParticlePrecision::Coarse).unwrap();
    world.set_particles(Some(Arc::new(bed)));
    let shot = world.strike(Stroke::straight(3.0, 0.2)).unwrap();
    assert!(shot.duration_secs() < 10.0, "{} s", shot.duration_secs());
    let end = shot.final_states()[1];
    assert_eq!((end.phase, end.velocity), (Phase::Airborne, DVec3::ZERO));
    let sunk = 0.045 + end.body.radius_m - end.position.z;
    assert!((0.0..0.01).contains(&sunk), "sunk by {sunk} m");
    let bed = shot.particles().unwrap();
    let [min, max] = bed.bounds();
    let places = bed.places_at(shot.duration_secs());
    let gap = |place: &glam::U16Vec3| {
        let center = min + place.as_vec3() / 65_535.0 * (max - min);
        center.as_dvec3().distance(end.position) - end.body.radius_m - 0.25 * 0.015
    };
    let nearest = places.iter().map(gap).fold(f64::MAX, f64::min);
    assert!(nearest.abs() < 0.001, "{nearest} m between ball and jelly");
    // No bounce is higher than the fall.
    let highest = (20..400).map(|step| shot.states_at(f64::from(step) / 100.0)[1].position.z);
    assert!(highest.fold(f64::MIN, f64::max) < at.z);
    world.adopt(&shot);
    let again = world.strike(Stroke::straight(3.0, 0.2)).unwrap();
    let moved = again.final_states()[1].position.distance(end.position);
    assert!(moved < 1e-3, "what lies on jelly stays: {moved} m");
}

#[test]
fn sand_lifts_a_ball_that_ploughs_into_it() {
    let world = world(&strip(ParticleMaterial::Sand, 0..6));
    let shot = world.strike(Stroke::straight(0.0, 3.0)).unwrap();
    let radius_m = shot.states_at(0.0)[0].body.radius_m;
    let heights = (0..240).map(|step| shot.states_at(f64::from(step) / 240.0)[0].position.z);
    let highest = heights.fold(f64::MIN, f64::max) - radius_m;
    assert!((2e-4..0.08).contains(&highest), "{highest} m");
}

#[test]
fn aim_lines_end_where_particles_begin_and_hold_until_there() {
    let stroke = Stroke::straight(0.02, 2.0);
    let world = world(&strip(ParticleMaterial::Sand, 0..3));
    let line = predict(&world, stroke).unwrap();
    assert_eq!(line.contact, AimContact::Particles);
    let end = line.path[line.path.len() - 1];
    // The ball meets sand 15 mm deep 25 mm before its centre is over it.
    assert!((-0.04..-0.015).contains(&end.x), "{end}");
    let shot = world.strike(stroke).unwrap();
    let nearest = (0..4000).map(|i| {
        shot.states_at(f64::from(i) * 5e-5)[0]
            .position
            .distance(end)
    });
    assert!(nearest.fold(f64::MAX, f64::min) < 5e-4);
    let bed = world.particles().unwrap();
    let free = world.without_particles().strike(stroke).unwrap();
    let known = free.known_until_secs(bed)[0];
    assert!(free.states_at(known)[0].position.distance(end) < 1e-9);
    let (one, other) = (shot.states_at(known)[0], free.states_at(known)[0]);
    let apart = one.position.distance(other.position);
    assert!(
        apart < 1e-3,
        "{apart} m: grains reach a cell beyond their edge"
    );
    let away = predict(&world, Stroke::straight(3.0, 2.0)).unwrap();
    assert_ne!(away.contact, AimContact::Particles);
}

#[test]
fn a_ball_that_is_potted_beyond_sand_is_potted() {
    let table = Table::nine_foot();
    let balls = vec![
        BallState::at_rest(0, 0.9, 0.3, &table.cue_ball()),
        BallState::at_rest(1, 1.0, 0.4, &table.ball()),
    ];
    let patches = strip(ParticleMaterial::Snow, 0..2);
    let mut world = World::with_laws(table.clone(), Laws::of(&table), balls.clone()).unwrap();
    let bed = ParticleBed::new(&table, &balls, &patches, ParticlePrecision::Coarse).unwrap();
    world.set_particles(Some(Arc::new(bed)));
    let way = DVec3::new(1.27, 0.635, 0.0) - balls[0].position;
    let stroke = Stroke::straight(way.y.atan2(way.x), 1.5);
    let (with, without) = (
        world.strike(stroke).unwrap(),
        world.without_particles().strike(stroke).unwrap(),
    );
    let potted = |shot: &Shot| shot.potted().collect::<Vec<_>>();
    assert_eq!(potted(&with), potted(&without));
    let strikes = |shot: &Shot| {
        let is_strike = |kind: EventKind| matches!(kind, EventKind::Strike { .. });
        shot.events()
            .iter()
            .filter(|event| is_strike(event.kind))
            .count()
    };
    assert_eq!((strikes(&with), strikes(&without)), (1, 1));
}
