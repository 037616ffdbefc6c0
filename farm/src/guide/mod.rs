//! Guide to the library, by subject; each piece of code in it runs as a test.

#[doc = include_str!("scenes.md")]
pub mod scenes {}

#[doc = include_str!("farms.md")]
pub mod farms {}

#[doc = include_str!("stills_and_films.md")]
pub mod stills_and_films {}

#[doc = include_str!("live_pictures.md")]
pub mod live_pictures {}

#[doc = include_str!("extending.md")]
pub mod extending {}

#[doc = include_str!("speed_and_accuracy.md")]
pub mod speed_and_accuracy {}
