//! The tables that ship with the game, and the options in which each can be had.

use crate::{Result, TableFault};

use super::{
    cloth::TableSpeed,
    table::Table,
    table_spec::{PocketSpec, TableSpec},
};

/// Width of the pockets of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum PocketSize {
    /// 7 % narrower: 4 1/4 inches instead of 4 9/16 in the corners of a 9-foot table
    Tight,
    /// As the table's rules have it
    #[default]
    Standard,
    /// 10 % wider: 5 inches in the corners of a 9-foot table
    Wide,
}

/// Options of a table that ships with the game. They are part of the table's name, and so of the files
/// of matches and shots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TableOptions {
    /// Size of the pockets; without effect on a table that has none.
    pub pockets: PocketSize,
    /// Speed of the cloth.
    pub speed: TableSpeed,
}

impl PocketSize {
    const ALL: [Self; 3] = [Self::Tight, Self::Standard, Self::Wide];

    /// Width relative to the standard.
    fn factor(self) -> f64 {
        match self {
            Self::Tight => 0.93,
            Self::Standard => 1.0,
            Self::Wide => 1.1,
        }
    }
}

impl TableOptions {
    /// Every combination.
    pub fn all() -> impl Iterator<Item = Self> {
        PocketSize::ALL.into_iter().flat_map(|pockets| {
            let speeds = TableSpeed::ALL.into_iter();
            speeds.map(move |speed| Self { pockets, speed })
        })
    }

    /// Suffix of the options in a table's name.
    fn suffix(self) -> String {
        let pockets = match self.pockets {
            PocketSize::Tight => ", tight pockets",
            PocketSize::Standard => "",
            PocketSize::Wide => ", wide pockets",
        };
        let cloth = match self.speed {
            TableSpeed::Slow => ", slow cloth",
            TableSpeed::Standard => "",
            TableSpeed::Fast => ", fast cloth",
        };
        format!("{pockets}{cloth}")
    }
}

impl Table {
    /// A table that ships with the game, by the name of its file in `assets/tables`.
    ///
    /// # Errors
    /// [`crate::Error::Table`] with the existing names, for an unknown one.
    pub fn built_in(name: &str) -> Result<Self> {
        match BUILT_IN.iter().find(|(known, _)| *known == name) {
            Some((_, json)) => Self::parse(json),
            None => {
                let names: Vec<&str> = Self::built_in_names().collect();
                Err(TableFault::Unknown {
                    name: name.to_owned(),
                    known: names.join(", "),
                }
                .into())
            }
        }
    }

    /// The table that ships with the game under this display name, which includes its options.
    pub fn named(name: &str) -> Option<Self> {
        specs().find_map(|spec| {
            let suffix = name.strip_prefix(&spec.name)?;
            let options = TableOptions::all().find(|options| options.suffix() == suffix)?;
            let table = spec.build_with(options).ok()?;
            (table.name() == name).then_some(table)
        })
    }

    /// This table with other options; unchanged if it does not ship with the game.
    pub fn with_options(&self, options: TableOptions) -> Self {
        let spec = specs().find(|spec| {
            let suffix = self.name().strip_prefix(&spec.name);
            suffix.is_some_and(|suffix| suffix.is_empty() || suffix.starts_with(", "))
        });
        let built = spec.and_then(|spec| spec.build_with(options).ok());
        built.unwrap_or_else(|| self.clone())
    }

    /// Names for [`Table::built_in`].
    pub fn built_in_names() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(name, _)| *name)
    }

    /// A 9-foot pool table: 2.54 × 1.27 m between noses, six pockets.
    pub fn nine_foot() -> Self {
        Self::built_in("nine_foot").expect("the built-in tables are valid: a test reads them")
    }
}

impl TableSpec {
    /// Builds the table with options, which become part of its name.
    fn build_with(mut self, mut options: TableOptions) -> Result<Table> {
        if self.corner_pockets.is_none() {
            options.pockets = PocketSize::Standard;
        }
        self.name += &options.suffix();
        let factor = options.pockets.factor();
        let resized = |pocket: PocketSpec| PocketSpec {
            mouth_m: factor * pocket.mouth_m,
            radius_m: factor * pocket.radius_m,
            ..pocket
        };
        self.corner_pockets = self.corner_pockets.map(resized);
        self.side_pockets = self.side_pockets.map(resized);
        Ok(self.build()?.with_speed(options.speed))
    }
}

/// Specifications of the tables that ship with the game.
fn specs() -> impl Iterator<Item = TableSpec> {
    let tables = BUILT_IN.iter();
    tables.filter_map(|(_, json)| TableSpec::parse(json).ok())
}

const BUILT_IN: [(&str, &str); 5] = [
    (
        "seven_foot",
        include_str!("../../../../assets/tables/seven_foot.json"),
    ),
    (
        "eight_foot",
        include_str!("../../../../assets/tables/eight_foot.json"),
    ),
    (
        "nine_foot",
        include_str!("../../../../assets/tables/nine_foot.json"),
    ),
    (
        "snooker",
        include_str!("../../../../assets/tables/snooker.json"),
    ),
    (
        "carom",
        include_str!("../../../../assets/tables/carom.json"),
    ),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::Laws;

    #[test]
    fn every_table_with_every_option_is_found_by_its_name() {
        for name in Table::built_in_names() {
            let plain = Table::built_in(name).unwrap();
            let mut names = std::collections::BTreeSet::new();
            for options in TableOptions::all() {
                let table = plain.with_options(options);
                assert_eq!(Table::named(table.name()).as_ref(), Some(&table));
                assert_eq!(table.with_options(TableOptions::default()), plain);
                names.insert(table.name().to_owned());
            }
            let has_pockets = !plain.pockets().is_empty();
            assert_eq!(names.len(), if has_pockets { 9 } else { 3 }, "{names:?}");
        }
        for unknown in [
            "9-foot pool table, ",
            "9-foot pool table, odd",
            "",
            "Carom table, tight pockets",
        ] {
            assert_eq!(Table::named(unknown), None, "{unknown}");
        }
    }

    #[test]
    fn options_change_the_mouths_and_the_resistance_alone() {
        let plain = Table::nine_foot();
        let options = TableOptions {
            pockets: PocketSize::Tight,
            speed: TableSpeed::Fast,
        };
        let table = plain.with_options(options);
        let mouth_m = |table: &Table| {
            let noses = table.noses();
            // The first side runs from a corner to the middle: what is missing of half the length is half of each mouth.
            table.length_m()
                - noses
                    .iter()
                    .map(|nose| (nose.to() - nose.from()).x.abs())
                    .sum::<f64>()
                    / 2.0
        };
        assert!(mouth_m(&table) < mouth_m(&plain) - 0.01);
        assert_eq!(table.length_m(), plain.length_m());
        let (laws, standard) = (Laws::of(&table), Laws::of(&plain));
        assert_eq!(standard, Laws::default());
        assert_eq!(
            laws.cloth.rolling_friction,
            0.75 * standard.cloth.rolling_friction
        );
        assert_eq!(laws.cloth.sliding_friction, standard.cloth.sliding_friction);
    }
}
