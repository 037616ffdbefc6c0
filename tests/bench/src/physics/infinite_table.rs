//! An endless table, and balls on it that are already in motion.

use glam::{DVec2, DVec3};

use carom_billiards::physics::{
    BallBody, BallState, EventKind, Laws, Shot, Table, TableParts, World,
};

/// A table with a square of cushions, ten kilometres apart, so that none is ever reached.
///
/// # Errors
/// None: its parts are valid.
pub fn infinite_table() -> carom_billiards::Result<Table> {
    let half = EDGE_M;
    let corners = [[-half, -half], [half, -half], [half, half], [-half, half]].map(DVec2::from);
    Table::from_parts(TableParts {
        name: "prairie".to_owned(),
        length_m: 2.0 * half,
        width_m: 2.0 * half,
        nose_height_m: 0.0365,
        noses: (0..4).map(|i| [corners[i], corners[(i + 1) % 4]]).collect(),
        jaws: Vec::new(),
        pockets: Vec::new(),
    })
}

/// A pool ball in motion.
pub fn ball(number: u8, x: f64, y: f64, velocity: DVec3, spin: DVec3) -> BallState {
    BallState {
        velocity,
        spin,
        ..BallState::at_rest(number, x, y, &BallBody::default())
    }
}

/// Simulates moving balls on the endless table.
///
/// # Errors
/// Those of the simulation.
pub fn released(laws: Laws, balls: Vec<BallState>) -> carom_billiards::Result<Shot> {
    World::with_laws(infinite_table()?, laws, balls)?.release()
}

/// Simulates one ball from the origin, with the default laws.
///
/// # Errors
/// Those of the simulation.
pub fn single_ball(velocity: DVec3, spin: DVec3) -> carom_billiards::Result<Shot> {
    single_ball_from(ball(0, 0.0, 0.0, velocity, spin))
}

/// Simulates one ball with the default laws.
///
/// # Errors
/// Those of the simulation.
pub fn single_ball_from(ball: BallState) -> carom_billiards::Result<Shot> {
    released(Laws::default(), vec![ball])
}

/// Time in s of the first event of a kind; 0 if there is none.
pub fn first_secs(shot: &Shot, is_kind: impl Fn(&EventKind) -> bool) -> f64 {
    let mut events = shot.events().iter();
    let first = events.find(|event| is_kind(&event.kind));
    first.map_or(0.0, |event| event.time_secs)
}

/// Positions of the cushions: the playing surface ends at plus and minus this on both axes.
pub const EDGE_M: f64 = 5000.0;
