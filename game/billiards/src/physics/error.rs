//! What can go wrong in the simulation, and whose fault it is.

/// The simulation's result.
pub type Result<T> = std::result::Result<T, Error>;

/// Each variant says who is at fault.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The player's stroke is out of range: a sentence with the value and the range.
    #[error("this stroke cannot be played: {0}")]
    Stroke(String),
    /// The table's author broke a rule: a sentence with the place and the rule.
    #[error("the table cannot be used: {0}")]
    Table(String),
    /// Balls are placed where none can be.
    #[error("the balls cannot lie like this: {0}")]
    Layout(String),
    /// A law's constant makes no physical sense.
    #[error("the laws of the table cannot hold: {0}")]
    Laws(String),
    /// The setting of what moves the balls is out of range: a sentence with the value and the range.
    #[error("the physics cannot be set so: {0}")]
    Engine(String),
    /// A file of a recorded shot cannot be written or read: a sentence with what is wrong.
    #[error("this recorded shot cannot be used: {0}")]
    Recording(String),
    /// The simulation did not come to rest within its limits: our fault.
    #[error(
        "the shot did not come to rest: {events} contacts and phase changes in the second before \
         {time_secs} s"
    )]
    Endless {
        /// Simulated time at which it was given up.
        time_secs: f64,
        /// Events within the last simulated second.
        events: u32,
    },
}
