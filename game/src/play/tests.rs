//! The game as a player drives it: intents and time in, balls, camera and sentences out.

use std::sync::Arc;

use carom_billiards::physics::AimContact;
use carom_tracer::Camera;

use super::cue::SWING_SECS;
use super::*;
use crate::camera::{CameraIntent, CameraView, Projection, wrap_rad};
use crate::input::{Intent, MatchIntent, StrokeIntent};

/// Applies an intent; the contact of a stroke is 0.2 s later.
fn apply(game: &mut Game, intent: Intent, now_secs: f64) {
    game.set_framing(Framing::whole(FILM));
    match intent {
        Intent::Aim(intent) => game.change_aim(intent, now_secs),
        Intent::Stroke(intent) => game.stroke(intent, now_secs, 0.2),
        Intent::Camera(intent) => game.look(intent, now_secs),
        Intent::Match(intent) => game.decide(intent, now_secs),
        other => panic!("{other:?} is not for the game"),
    }
}

const FILM: DVec2 = DVec2::new(1280.0, 720.0);

/// Position of a ball at a moment.
fn ball(game: &Game, number: u8, moment_secs: f64) -> DVec3 {
    let poses = game.poses(moment_secs);
    poses
        .iter()
        .find(|pose| pose.number == number)
        .unwrap()
        .position
}

fn strike(game: &mut Game, power: f64, now_secs: f64) {
    for intent in [
        Intent::Stroke(StrokeIntent::BeginPull),
        Intent::Stroke(StrokeIntent::Pull(power)),
        Intent::Stroke(StrokeIntent::Release),
    ] {
        apply(game, intent, now_secs);
    }
}

/// Advances the game to the end of the present shot, and returns the time.
fn watch(game: &mut Game, mut now_secs: f64) -> f64 {
    while game.shot_clock(now_secs).is_some() {
        now_secs += 0.1;
        game.tick(now_secs, 0.1);
    }
    now_secs
}

#[test]
fn a_stroke_plays_moves_balls_and_ends() {
    let mut game = Game::new(1).unwrap();
    let before = game.poses(0.0);
    strike(&mut game, 0.9, 5.0);
    let clock = game.shot_clock(5.0).unwrap();
    let end = clock.end_secs;
    assert!(clock.now_secs <= -SWING_SECS.start && end > 1.0);
    assert_eq!(game.poses(-0.05), before, "nothing moves before the blow");
    let now = watch(&mut game, 5.0);
    assert!((now - 5.0 - end) < 1.0);
    assert_ne!(game.poses(0.0), before);
}

#[test]
fn a_shot_that_is_skipped_ends_as_one_that_is_watched() {
    let [mut watched, mut skipped] = [1, 1].map(|seed| Game::new(seed).unwrap());
    for game in [&mut watched, &mut skipped] {
        strike(game, 0.9, 5.0);
    }
    watch(&mut watched, 5.0);
    let seen = skipped.viewpoint(1.0);
    let now = 6.0 - skipped.shot_clock(5.0).unwrap().now_secs;
    apply(&mut skipped, Intent::Match(MatchIntent::Skip), now);
    assert_eq!(skipped.shot_clock(now), None);
    assert_eq!(skipped.poses(0.0), watched.poses(0.0));
    assert_eq!(skipped.viewpoint(0.0), seen, "the camera does not jump");
    apply(&mut skipped, Intent::Stroke(StrokeIntent::BeginCharge), now);
    apply(&mut skipped, Intent::Match(MatchIntent::Skip), now);
    assert!(skipped.is_moving(), "a stroke that is begun goes on");
}

#[test]
fn a_stroke_that_is_given_up_leaves_the_table_alone() {
    let mut game = Game::new(1).unwrap();
    for intent in [
        Intent::Stroke(StrokeIntent::BeginPull),
        Intent::Stroke(StrokeIntent::Pull(1.0)),
        Intent::Stroke(StrokeIntent::Cancel),
        Intent::Stroke(StrokeIntent::Release),
    ] {
        apply(&mut game, intent, 1.0);
    }
    strike(&mut game, 0.5 * super::stroke_input::PULL_MIN, 1.0);
    assert_eq!(game.shot_clock(1.0), None);
}

#[test]
fn escape_gives_up_a_stroke_first_and_then_quits() {
    let mut game = Game::new(1).unwrap();
    apply(&mut game, Intent::Stroke(StrokeIntent::BeginCharge), 1.0);
    assert!(game.escape());
    assert!(!game.escape());
}

#[test]
fn aiming_at_a_point_turns_the_cue_to_it() {
    let mut game = Game::new(1).unwrap();
    let target = DVec3::new(0.3, 0.4, game.cue_ball().unwrap().z);
    game.set_framing(Framing::whole(FILM));
    let projection = game.projection(0.0);
    let point = projection.film_from_world(target).unwrap();
    apply(&mut game, Intent::Aim(AimIntent::AimAt(point)), 0.0);
    let way = (target - game.cue_ball().unwrap()).truncate();
    // The camera's place is rounded to f32.
    assert!(wrap_rad(game.aim.bearing_rad - way.to_angle()).abs() < 1e-5);
}

#[test]
fn each_view_sees_what_it_is_for() {
    let mut game = Game::new(1).unwrap();
    let seen = |camera: &Camera, p: DVec3| {
        let film = Projection::new(camera, FILM.x, FILM.y).film_from_world(p);
        film.is_some_and(|film| film.cmpge(DVec2::ZERO).all() && film.cmple(FILM).all())
    };
    assert!(seen(&game.camera(0.0), game.cue_ball().unwrap()));
    for bearing in [0.0, 0.5, 1.57, 3.0, -2.0] {
        game.aim.bearing_rad = bearing;
        strike(&mut game, 0.1, 0.0);
        for corner in [
            (-1.27, -0.635),
            (1.27, -0.635),
            (1.27, 0.635),
            (-1.27, 0.635),
        ] {
            let corner = DVec3::new(corner.0, corner.1, 0.0);
            assert!(seen(&game.camera(5.0), corner), "{corner} from {bearing}");
        }
        game.rack();
    }
}

/// Switches to a view, and lets the camera come to rest.
fn look_from(game: &mut Game, view: CameraView, now_secs: f64) {
    while game.views.view() != view {
        apply(game, Intent::Camera(CameraIntent::NextView), now_secs);
    }
    (0..200).for_each(|_| game.tick(now_secs, 0.02));
}

#[test]
fn cameras_glide_and_cut_with_reduced_motion() {
    let mut game = Game::new(1).unwrap();
    let behind = game.viewpoint(0.0);
    apply(&mut game, Intent::Camera(CameraIntent::Overhead), 0.0);
    assert_eq!(game.take_notice().as_deref(), Some("View: from above"));
    game.tick(0.0, 0.02);
    let above = Viewpoint::overhead(game.table(), &Framing::whole(FILM));
    let under_way = game.viewpoint(0.0);
    assert!(under_way != behind && under_way != above && game.is_moving());
    (0..200).for_each(|_| game.tick(0.0, 0.02));
    assert_eq!(game.viewpoint(0.0), above);
    assert!(!game.is_moving());
    game.set_instant_camera(true);
    apply(&mut game, Intent::Camera(CameraIntent::Overhead), 0.0);
    game.tick(0.0, 0.02);
    assert_eq!(game.viewpoint(0.0), behind);
}

#[test]
fn views_chosen_in_a_shot_start_from_what_is_seen() {
    for instant_camera in [false, true] {
        let mut game = Game::new(1).unwrap();
        game.set_instant_camera(instant_camera);
        strike(&mut game, 0.9, 0.0);
        let contact = -game.shot_clock(0.0).unwrap().now_secs;
        let above = Viewpoint::overhead(game.table(), &Framing::whole(FILM));
        let now = contact + 2.5;
        let clock = game.shot_clock(now).unwrap().now_secs;
        let before = game.viewpoint(clock);
        apply(&mut game, Intent::Camera(CameraIntent::Overhead), now);
        assert_eq!(game.viewpoint(clock), before, "no jump");
        let soon = game.viewpoint(2.8);
        assert!(
            soon != before && instant_camera == (soon == above),
            "{soon:?}"
        );
        assert_eq!(game.viewpoint(4.0), above);
    }
}

#[test]
fn after_the_ball_the_camera_has_it_in_the_middle() {
    let mut game = Game::new(1).unwrap();
    look_from(&mut game, CameraView::Follow, 0.0);
    strike(&mut game, 0.35, 0.0);
    for moment in [0.3, 0.5] {
        let cue_ball = ball(&game, 0, moment);
        let projection = game.projection(moment);
        let film = projection.film_from_world(cue_ball).unwrap();
        let off = (film - 0.5 * FILM).abs();
        assert!(off.cmplt(0.25 * FILM).all(), "{film} at {moment} s");
    }
}

#[test]
fn the_pocket_view_is_of_the_pocket_played_to() {
    let mut game = Game::new(1).unwrap();
    look_from(&mut game, CameraView::Pocket, 0.0);
    let table = game.table().clone();
    for (index, pocket) in table.pockets().iter().enumerate() {
        let from = game.cue_ball().unwrap().truncate();
        game.aim.bearing_rad = (pocket.center - from).to_angle();
        let stroke = game.aim.stroke(LINE_POWER);
        let met = physics::predict(game.world(), stroke).unwrap().contact;
        if !matches!(met, AimContact::Ball { .. }) {
            assert_eq!(game.pocket_ahead(), Some(index));
        }
    }
    let place = game.pocket_ahead().unwrap();
    (0..200).for_each(|_| game.tick(0.0, 0.02));
    assert_eq!(
        game.viewpoint(0.0),
        Viewpoint::from_pocket(&table.pockets()[place])
    );
}

#[test]
fn a_pocketed_cue_ball_comes_back_where_there_is_room() {
    let mut game = Game::new(1).unwrap();
    let head = game.table().head_spot();
    // The left head corner is straight ahead at this bearing.
    game.aim.bearing_rad = (DVec2::new(-1.282, 0.647) - head).to_angle();
    strike(&mut game, 0.35, 0.0);
    watch(&mut game, 0.0);
    let banner = game.match_view().banner.clone();
    assert!(banner.is_some_and(|banner| banner.contains("cue ball is lost")));
    assert!(game.cue_ball().unwrap().truncate().distance(head) < 1e-9);
    assert!(game.ball_in_hand().is_some(), "the player has it in hand");
    apply(&mut game, Intent::Match(MatchIntent::Put), 99.0);
    assert!(game.ball_in_hand().is_none() && game.may_play());
}

#[test]
fn raised_cues_jump_and_are_level_after_the_shot() {
    let mut game = Game::new(1).unwrap();
    for _ in 0..100 {
        apply(&mut game, Intent::Aim(AimIntent::Elevate(0.1)), 0.0);
    }
    assert_eq!(
        game.cue(0.0).unwrap().elevation_rad,
        Stroke::ELEVATION_MAX_RAD
    );
    apply(
        &mut game,
        Intent::Aim(AimIntent::Elevate(0.7 - Stroke::ELEVATION_MAX_RAD)),
        0.0,
    );
    strike(&mut game, 0.6, 1.0);
    let heights = (0..50).map(|i| ball(&game, 0, 0.01 * f64::from(i)).z);
    assert!(heights.fold(0.0, f64::max) > 0.08, "the cue ball flies");
    watch(&mut game, 1.0);
    assert_eq!(game.cue(99.0).unwrap().elevation_rad, 0.0);
}

#[test]
fn a_tip_set_too_far_out_miscues_and_says_so() {
    let mut game = Game::new(1).unwrap();
    apply(
        &mut game,
        Intent::Aim(AimIntent::MoveTip(DVec2::new(-0.3, -2.0))),
        0.0,
    );
    strike(&mut game, 0.4, 1.0);
    assert!(game.take_notice().unwrap().starts_with("Miscue"));
}

#[test]
fn soft_shots_have_most_of_the_way() {
    assert!(cue_speed_m_s(0.5) < 0.3 * CUE_SPEED_M_S_MAX);
    assert_eq!(cue_speed_m_s(1.0), CUE_SPEED_M_S_MAX);
}

#[test]
fn a_strike_is_the_shot_that_was_previewed() {
    let mut game = Game::new(1).unwrap();
    game.set_aids(AimAids::Full);
    for intent in [
        Intent::Aim(AimIntent::SetPower(0.55)),
        Intent::Aim(AimIntent::Turn(0.01)),
    ] {
        apply(&mut game, intent, 0.0);
    }
    let ways = game.shot_preview(0.0).unwrap().ways.clone();
    apply(&mut game, Intent::Stroke(StrokeIntent::Strike), 0.0);
    let end = game.shot_clock(0.0).unwrap().end_secs;
    let poses = game.poses(end);
    for way in ways {
        let pose = poses.iter().find(|pose| pose.number == way.number).unwrap();
        assert_eq!(way.path.last(), Some(&pose.position), "ball {}", way.number);
    }
    assert!(
        game.shot_preview(0.0).is_none(),
        "nothing is foreseen during a shot"
    );
}

#[test]
fn a_swing_strikes_where_the_cue_meets_the_ball() {
    let mut game = Game::new(1).unwrap();
    let swing = |game: &mut Game, intent, at| apply(game, intent, at);
    swing(&mut game, Intent::Stroke(StrokeIntent::BeginSwing), 1.0);
    for step in 0..10 {
        swing(
            &mut game,
            Intent::Stroke(StrokeIntent::Swing(0.01)),
            1.0 + 0.01 * f64::from(step),
        );
    }
    assert!(game.cue(1.1).unwrap().gap_m > 0.1 && game.shot_clock(1.1).is_none());
    for step in 0..10 {
        swing(
            &mut game,
            Intent::Stroke(StrokeIntent::Swing(-0.02)),
            1.2 + 0.01 * f64::from(step),
        );
    }
    let (_, shot) = game.fresh_shot().unwrap();
    let struck = shot.events().iter().find_map(|event| match event.kind {
        physics::EventKind::Strike { speed_m_s } => Some(speed_m_s),
        _ => None,
    });
    // Two centimetres in each hundredth of a second.
    assert!((struck.unwrap() - 2.0).abs() < 0.2, "{struck:?}");
}

#[test]
fn letting_go_of_a_swing_does_not_strike() {
    let mut game = Game::new(1).unwrap();
    for intent in [
        Intent::Stroke(StrokeIntent::BeginSwing),
        Intent::Stroke(StrokeIntent::Swing(0.2)),
        Intent::Stroke(StrokeIntent::Release),
    ] {
        apply(&mut game, intent, 1.0);
    }
    assert!(game.shot_clock(1.0).is_none());
    assert!(!game.cue(1.0).unwrap().is_drawn);
}

#[test]
fn the_cue_stays_above_what_is_in_its_way() {
    let mut game = Game::new(1).unwrap();
    let cue_ball = game.table().cue_ball().radius_m;
    let x = -0.5 * game.table().length_m() + cue_ball + 0.001;
    game.contest.place(DVec2::new(x, 0.0)).unwrap();
    apply(&mut game, Intent::Aim(AimIntent::Turn(0.0)), 0.0);
    let least = game.aim().elevation_rad;
    assert!(least > 0.1, "{least}");
    apply(&mut game, Intent::Aim(AimIntent::Elevate(-1.0)), 0.0);
    assert_eq!(game.aim().elevation_rad, least);
    apply(&mut game, Intent::Aim(AimIntent::Elevate(0.1)), 0.0);
    assert!((game.aim().elevation_rad - least - 0.1).abs() < 1e-9);
    apply(
        &mut game,
        Intent::Aim(AimIntent::Turn(std::f64::consts::PI)),
        0.0,
    );
    apply(&mut game, Intent::Aim(AimIntent::CenterTip), 0.0);
    assert!(
        game.aim().elevation_rad < 0.01,
        "with nothing behind it the cue lies level"
    );
}

#[test]
fn strokes_under_way_keep_their_aim() {
    let mut game = Game::new(1).unwrap();
    apply(&mut game, Intent::Stroke(StrokeIntent::BeginPull), 0.0);
    let aim = game.aim();
    for intent in [
        Intent::Aim(AimIntent::MoveTip(DVec2::new(0.2, 0.1))),
        Intent::Aim(AimIntent::Elevate(0.3)),
        Intent::Aim(AimIntent::Turn(0.4)),
        Intent::Aim(AimIntent::SetPower(0.9)),
    ] {
        apply(&mut game, intent, 0.0);
    }
    assert_eq!(game.aim(), aim);
}

fn eight(players: &str) -> Game {
    let players = Player::list(players).unwrap();
    Game::of(Match::new(MatchConfig::new(RuleSet::Eight, players, 3).unwrap()).unwrap())
}

/// Advances the game until it is a person's turn, and returns the time.
fn wait(game: &mut Game, mut now_secs: f64) -> f64 {
    while !game.may_play() && game.contest().at_table().is_some() {
        now_secs += 0.1;
        game.tick(now_secs, 0.1);
        std::thread::yield_now();
    }
    now_secs
}

#[test]
fn the_computer_plays_and_undo_takes_back_both_shots() {
    let mut game = eight("Ada,ai:easy");
    let before = game.contest().ball_positions();
    strike(&mut game, 0.05, 0.0);
    let mut now = watch(&mut game, 0.0);
    assert!(game.match_view().is_foul, "{:?}", game.match_view().banner);
    assert_eq!(game.contest().referee().turn(), 1);
    assert!(!game.may_play());
    let bearing = game.aim.bearing_rad;
    apply(&mut game, Intent::Aim(AimIntent::Turn(0.3)), now);
    apply(&mut game, Intent::Stroke(StrokeIntent::Strike), now);
    assert_eq!(game.aim.bearing_rad, bearing, "it is not the person's turn");
    assert!(game.shot_clock(now).is_none());
    let mut seen = false;
    while game.contest().turns().len() < 2 {
        now += 0.1;
        game.tick(now, 0.1);
        let words = game.intention().unwrap_or_default();
        seen |= words.starts_with("Computer (easy) will ") && game.cue(now).is_some();
        std::thread::yield_now();
    }
    assert!(
        seen,
        "its cue and what it intends are seen before it strikes"
    );
    now = wait(&mut game, now);
    apply(&mut game, Intent::Match(MatchIntent::Undo), now);
    assert_eq!(game.contest().referee().turn(), 0);
    assert_eq!(game.contest().ball_positions(), before);
    assert!(game.contest().turns().is_empty() && game.may_play());
}

#[test]
fn balls_in_hand_are_put_down_only_where_they_may_lie() {
    let mut game = eight("2");
    let from = game.cue_ball().unwrap().truncate();
    apply(&mut game, Intent::Match(MatchIntent::PickUp), 0.0);
    // Away from the camera, over the head string.
    for _ in 0..40 {
        apply(
            &mut game,
            Intent::Aim(AimIntent::MoveTip(DVec2::new(0.0, 0.1))),
            0.0,
        );
    }
    let ball_in_hand = game.ball_in_hand().unwrap().clone();
    assert!(
        ball_in_hand.at.x > from.x + 1.0 && ball_in_hand.verdict.is_err(),
        "{ball_in_hand:?}"
    );
    apply(&mut game, Intent::Match(MatchIntent::Put), 0.0);
    assert!(game.ball_in_hand().is_some() && game.take_notice().is_some());
    for _ in 0..44 {
        apply(
            &mut game,
            Intent::Aim(AimIntent::MoveTip(DVec2::new(0.025, -0.1))),
            0.0,
        );
    }
    assert_eq!(game.ball_in_hand().unwrap().verdict, Ok(()));
    apply(&mut game, Intent::Stroke(StrokeIntent::Strike), 0.0);
    let there = game.cue_ball().unwrap().truncate();
    assert!(game.ball_in_hand().is_none() && there.x < from.x - 0.1 && there.y < from.y - 0.1);
    apply(&mut game, Intent::Match(MatchIntent::PickUp), 0.0);
    apply(
        &mut game,
        Intent::Aim(AimIntent::MoveTip(DVec2::new(0.1, 0.0))),
        0.0,
    );
    assert!(game.escape());
    assert_eq!(
        game.cue_ball().unwrap().truncate(),
        there,
        "given up, it lies as before"
    );
}

#[test]
fn calls_go_round_and_never_hinder_the_stroke() {
    let mut game = eight("2");
    strike(&mut game, 0.9, 0.0);
    let mut now = watch(&mut game, 0.0);
    while game.contest().referee().is_break() || !game.contest().referee().options().is_empty() {
        let choice = game.contest().referee().options().first().copied();
        match choice {
            Some(choice) => {
                apply(&mut game, Intent::Match(MatchIntent::Choose(choice)), now);
            }
            None => {
                strike(&mut game, 0.9, now);
                now = watch(&mut game, now);
            }
        }
    }
    if game.ball_in_hand().is_some() {
        apply(&mut game, Intent::Match(MatchIntent::Put), now);
    }
    assert!(game.contest().referee().wants_call());
    let mut words = Vec::new();
    for _ in 0..8 {
        apply(&mut game, Intent::Match(MatchIntent::NextCall), now);
        words.push(
            game.match_view()
                .call
                .as_ref()
                .map(|call| call.words.clone()),
        );
    }
    assert_eq!(words[6].as_deref(), Some("a safety"));
    assert_eq!(words[7], None, "{words:?}");
    assert!(
        words[0]
            .as_ref()
            .is_some_and(|words| words.contains("head")),
        "{words:?}"
    );
    strike(&mut game, 0.3, now);
    assert!(
        game.shot_clock(now).is_some(),
        "uncalled, it is struck all the same"
    );
}

#[test]
fn a_skipped_aim_strikes_as_one_that_is_watched() {
    let [mut watched, mut skipped] = [1, 1].map(|_| eight("Ada,ai:easy"));
    let mut blows_secs = Vec::new();
    for (game, skips) in [(&mut watched, false), (&mut skipped, true)] {
        strike(game, 0.05, 0.0);
        let mut now = watch(game, 0.0);
        while game.intention().is_none() {
            now += 0.01;
            game.tick(now, 0.01);
            std::thread::yield_now();
        }
        let planned_secs = now;
        if skips {
            apply(game, Intent::Match(MatchIntent::Skip), now);
        }
        while game.shot().is_none() {
            now += 0.01;
            game.tick(now, 0.01);
        }
        blows_secs.push(now - planned_secs);
    }
    assert!(blows_secs[0] > 2.0, "it can be followed: {blows_secs:?}");
    assert!(blows_secs[1] < 0.05, "it is skipped: {blows_secs:?}");
    let ends = [&watched, &skipped].map(|game| game.shot().map(|shot| shot.final_states()));
    assert_eq!(ends[0], ends[1]);
}

#[test]
fn a_person_is_advised_and_can_let_the_computer_play() {
    let mut game = eight("2");
    apply(&mut game, Intent::Match(MatchIntent::Suggest), 0.0);
    while game.is_thinking() {
        game.tick(1.0, 0.1);
        std::thread::yield_now();
    }
    let notice = game.take_notice().unwrap();
    assert!(notice.contains("m/s"), "{notice}");
    assert!(game.may_play());
    apply(&mut game, Intent::Match(MatchIntent::TakeOver), 1.0);
    assert!(!game.may_play());
    let mut now = 1.0;
    while game.contest().turns().is_empty() {
        now += 0.1;
        game.tick(now, 0.1);
        std::thread::yield_now();
    }
    assert_eq!(game.contest().turns().len(), 1);
}

#[test]
fn the_whole_table_is_seen_once_a_match_is_over() {
    let players = Player::list("Ada").unwrap();
    let config = MatchConfig::new(RuleSet::SpotShots, players, 3).unwrap();
    let mut game = Game::of(
        Match::new(MatchConfig {
            target: 1,
            ..config
        })
        .unwrap(),
    );
    strike(&mut game, 0.05, 0.0);
    let mut now = watch(&mut game, 0.0);
    assert!(game.contest().at_table().is_none(), "a miss ends the drill");
    for _ in 0..100 {
        now += 0.1;
        game.tick(now, 0.1);
    }
    let seen = game.viewpoint(0.0);
    let wanted = Viewpoint::overview(game.table(), 0.0).framed(&game.framing());
    assert!(seen.focus.distance(wanted.focus) < 0.01, "{seen:?}");
    assert!(
        (seen.distance_m - wanted.distance_m).abs() < 0.05,
        "{seen:?}"
    );
}

#[test]
fn a_stroke_into_sand_waits_for_its_shot() {
    use carom_billiards::physics::ParticlePrecision;
    let mut game = Game::new(1).unwrap();
    let trick = super::tricks::TrickTable::SandTrap;
    let (world, _) = trick
        .world(game.table(), ParticlePrecision::Coarse)
        .unwrap();
    game.lay(&PracticeLayout {
        balls: world.balls(),
        particles: world.particles().map(Arc::clone),
    })
    .unwrap();
    let lying = game
        .particles(0.0)
        .clouds(crate::particles::ParticleDetail::Off, glam::Vec3::ONE);
    assert!(!lying.is_empty());
    game.change_aim(AimIntent::SetPower(0.3), 0.0);
    game.stroke(StrokeIntent::Strike, 0.0, 0.0);
    assert!(game.shot().is_none() && game.is_moving() && game.cue(0.0).is_some());
    let mut now_secs = 0.0;
    while game.shot().is_none() {
        std::thread::yield_now();
        now_secs += 0.01;
        game.tick(now_secs, 0.01);
    }
    let end_secs = game.shot_clock(now_secs).unwrap().end_secs;
    let last = game
        .particles(end_secs)
        .clouds(crate::particles::ParticleDetail::Off, glam::Vec3::ONE);
    assert_eq!(
        game.particles(0.0)
            .clouds(crate::particles::ParticleDetail::Off, glam::Vec3::ONE),
        lying
    );
    game.tick(now_secs + end_secs + 1.0, 0.01);
    assert!(game.shot().is_none());
    let left = game
        .particles(0.0)
        .clouds(crate::particles::ParticleDetail::Off, glam::Vec3::ONE);
    let count = |clouds: &[carom_tracer::ParticleCloud]| -> usize {
        clouds.iter().map(|cloud| cloud.places.len()).sum()
    };
    assert_eq!(count(&left), count(&last));
    assert_ne!(left, lying, "the groove stays");
    game.decide(MatchIntent::Undo, now_secs);
    assert_eq!(
        game.particles(0.0)
            .clouds(crate::particles::ParticleDetail::Off, glam::Vec3::ONE),
        lying
    );
}
