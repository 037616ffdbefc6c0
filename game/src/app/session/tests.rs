use carom_billiards::physics::TableOptions;
use carom_billiards::rules::RuleSet;
use carom_farm::LocalNode;
use carom_farm::quality::Resolution;

use super::*;
use crate::camera::CameraView;
use crate::play::free_table;
use crate::play::practice::PracticeLayout;
use crate::ui::new_game::NewGame;

fn session() -> GameSession {
    let config = FarmConfig {
        local: LocalNode::None,
        ..FarmConfig::default()
    };
    let contest = free_table(TableScene::table(), 1).unwrap();
    GameSession::new(config, contest, TableStyle::default()).unwrap()
}

#[test]
fn practice_leaves_the_camera_and_takes_no_stroke() {
    let mut session = session();
    session.toggle_practice();
    assert!(!session.is_game());
    session.stroke(StrokeIntent::BeginPull, 0.0);
    assert!(!session.game.escape(), "a stroke was begun");
    let before = session.viewpoint(0.0);
    session.look(CameraIntent::Overhead, 0.0);
    for step in 1..100 {
        session.advance_simulation(0.05 * f64::from(step));
    }
    assert_ne!(session.viewpoint(5.0), before);
    assert!(session.escape() && session.is_game());
}

#[test]
fn escape_closes_pages_before_strokes() {
    let mut session = session();
    session.stroke(StrokeIntent::BeginPull, 0.0);
    session.toggle_practice();
    assert!(session.escape() && session.is_game());
    assert!(session.escape());
    assert!(!session.escape());
}

#[test]
fn a_resolution_is_a_share_of_the_window_and_of_nothing_else() {
    let mut session = session();
    session.resize(ImageSize::new(1280, 720));
    for (resolution, width) in [
        (Resolution::Full, 1280),
        (Resolution::ThreeQuarters, 960),
        (Resolution::Half, 640),
    ] {
        session.apply(&Settings {
            resolution,
            ..Settings::default()
        });
        assert_eq!(session.pipeline.scheduler().sharpest().width, width);
        assert_eq!(session.pixels, ImageSize::new(1280, 720), "screenshots");
    }
    session.resize(ImageSize::new(0, 0));
    assert_eq!(session.pipeline.scheduler().sharpest().pixels(), 0);
}

#[test]
fn a_table_that_is_laid_is_seen_from_above_and_the_game_as_before() {
    let mut session = session();
    for (first, laid) in [
        (CameraView::Shooter, CameraView::Overhead),
        (CameraView::Follow, CameraView::Follow),
    ] {
        while session.game.view() != first {
            session.look(CameraIntent::NextView, 0.0);
        }
        for expected in [laid, first] {
            session.toggle_practice();
            session.advance_simulation(0.1);
            assert_eq!(session.game.view(), expected);
        }
    }
}

#[test]
fn a_match_waits_while_its_player_practises() {
    let games = RuleSet::ALL.iter().chain(&RuleSet::DRILLS);
    for rules in games.filter(|&&rules| rules != RuleSet::Free) {
        let mut session = session();
        let config = NewGame {
            rules: *rules,
            ..NewGame::default()
        };
        session
            .begin(config.begin(1, TableOptions::default()).unwrap())
            .unwrap();
        let objects = session.table_scene.scene().objects.len();
        let before = session.game.world().balls();
        session.toggle_practice();
        let Mode::Practice(practice) = session.modes.mode() else {
            panic!("no practice table");
        };
        let laid = practice.table_layout().unwrap();
        session.play_from(laid.clone()).unwrap();
        let is_free =
            |session: &GameSession| session.game.contest().referee().rules() == RuleSet::Free;
        assert!(
            is_free(&session) && session.has_interrupted_match(),
            "{rules:?}"
        );
        assert_eq!(session.game.world().balls(), laid.balls);
        assert_eq!(session.table_scene.scene().objects.len(), objects);

        // Racking during practice restores the layout and leaves the match unchanged.
        session.modes.close();
        session
            .game
            .lay(&PracticeLayout {
                balls: laid.balls[..1].to_vec(),
                particles: None,
            })
            .unwrap();
        session.decide(MatchIntent::Rack, 0.0);
        assert_eq!(session.game.world().balls(), laid.balls);
        let waiting = InterruptedMatch::contest(session.interrupted.as_ref(), &session.game);
        assert_eq!(
            (waiting.referee().rules(), waiting.action_count()),
            (*rules, 0)
        );
        session.resume_match();
        assert_eq!(session.game.world().balls(), before);
        assert!(!is_free(&session) && !session.has_interrupted_match());
    }
}
