//! The rules of the games, free of physics: what happened goes in, a verdict in words comes out.
//!
//! ```text
//! ShotReport (contacts, cushions, pockets, where the balls lie) ─┐
//! Call (ball and pocket, safety, push-out) ──────────────────────┼─▶ Referee ─▶ Verdict
//! RuleInfo (the game's row of the table of rules) ───────────────┘   (turn,      (fouls, words, balls to
//!                                                                     scores)     be put back, next turn)
//! ```
//! The common part of the games is a table with a row for each ([`RuleInfo`]); each game's own file
//! holds the rest. Sources: "WPA" is The Rules of Play of the World Pool-Billiard Association,
//! effective 15 March 2016; "WPBSA" the Official Rules of the Game of Snooker, section 3; "UMB" the
//! World Rules of Carom Billiard of the Union Mondiale de Billard, 1 January 1989. They are cited by
//! section.
//!
//! Rules that need an arbiter's opinion are left out: a deliberate foul, snooker's "miss", slow play.

mod ball_group;
mod call;
mod drills;
mod eight;
mod foul;
mod free;
mod layout;
mod nine;
mod rack;
mod rack_state;
mod referee;
mod report;
mod ruleset;
mod snooker;
mod spots;
mod standard_fouls;
mod straight;
#[cfg(test)]
mod test_shots;
mod three_cushion;
mod verdict;

pub use ball_group::BallGroup;
pub use call::{Call, infer};
pub use foul::Foul;
pub(crate) use free::capital;
pub(crate) use layout::place_of;
pub use layout::{BallPosition, BallPositions, PlacementArea, TableLayout};
pub use rack::rack;
pub use referee::{Referee, apply_moves};
pub use report::{ShotEvent, ShotReport};
pub use ruleset::{Calls, RuleInfo, RuleSet};
pub use verdict::{Choice, Verdict};
