//! The players of a match.

use std::fmt;
use std::str::FromStr;

use carom_text::text;
use serde::{Deserialize, Serialize};

use crate::PlayersFault;
use crate::ai::Level;

/// A player of a match.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Player {
    /// A person, by name.
    Human(String),
    /// The computer.
    Computer(Level),
}

impl Player {
    /// The person at the screen.
    pub fn you() -> Self {
        Self::Human(text!("player-you").to_owned())
    }

    /// Display name.
    pub fn name(&self) -> String {
        match self {
            Self::Human(name) => name.clone(),
            Self::Computer(level) => text!("player-computer", level = level.display_text()),
        }
    }

    /// The computer's level; none for a person.
    pub fn level(&self) -> Option<Level> {
        match self {
            Self::Human(_) => None,
            Self::Computer(level) => Some(*level),
        }
    }

    /// Reads the players of a match: a number of people (`2`), or names separated by commas, of which
    /// `ai`, `ai:easy`, `ai:medium`, `ai:hard` and `ai:expert` are the computer and `me` is the person
    /// at the screen. One computer alone plays against that person.
    ///
    /// # Errors
    /// The fault of the list.
    pub fn list(text: &str) -> Result<Vec<Self>, PlayersFault> {
        if let Ok(people) = text.parse::<usize>() {
            return match people {
                1..=PLAYERS_MAX => Ok((1..=people)
                    .map(|i| Self::Human(text!("player-numbered", number = i)))
                    .collect()),
                _ => Err(PlayersFault::Count {
                    players: people,
                    max: PLAYERS_MAX,
                }),
            };
        }
        let mut players: Vec<Self> = text.split(',').map(str::parse).collect::<Result<_, _>>()?;
        if let [Self::Computer(_)] = players[..] {
            players.insert(0, Self::you());
        }
        if players.len() > PLAYERS_MAX {
            return Err(PlayersFault::TooMany {
                players: players.len(),
                max: PLAYERS_MAX,
            });
        }
        Ok(players)
    }
}

impl FromStr for Player {
    type Err = PlayersFault;

    fn from_str(text: &str) -> Result<Self, PlayersFault> {
        let text = text.trim();
        if text == "ai" {
            return Ok(Self::Computer(Level::default()));
        }
        if text == "me" {
            return Ok(Self::you());
        }
        if let Some(level) = text.strip_prefix("ai:") {
            let level = Level::ALL.into_iter().find(|known| known.key() == level);
            return level
                .map(Self::Computer)
                .ok_or_else(|| PlayersFault::UnknownLevel(text.to_owned()));
        }
        let fits = (1..=NAME_LETTERS_MAX).contains(&text.chars().count());
        if !fits || text.chars().any(char::is_control) {
            return Err(PlayersFault::Name {
                text: text.to_owned(),
                max: NAME_LETTERS_MAX,
            });
        }
        Ok(Self::Human(text.to_owned()))
    }
}

impl fmt::Display for Player {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.name())
    }
}

const PLAYERS_MAX: usize = 2;
const NAME_LETTERS_MAX: usize = 24;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn players_are_read_from_a_number_or_from_names() {
        let human = |name: &str| Player::Human(name.to_owned());
        assert_eq!(
            Player::list("2").unwrap(),
            [human("Player 1"), human("Player 2")]
        );
        assert_eq!(
            Player::list("ai:hard").unwrap(),
            [human("You"), Player::Computer(Level::Hard)]
        );
        assert_eq!(
            Player::list("Ada, ai").unwrap(),
            [human("Ada"), Player::Computer(Level::Medium)]
        );
        for wrong in ["0", "3", "ai:perfect", "", "a,b,c"] {
            assert!(Player::list(wrong).is_err(), "{wrong}");
        }
    }
}
