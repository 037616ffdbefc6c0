//! Options of the command line for the table.

use carom_billiards::physics::{PocketSize, Table, TableOptions, TableSpeed};
use clap::Args;

/// The table of a game.
#[derive(Clone, Debug, Default, Args)]
pub struct TableArgs {
    /// Table: nine_foot, eight_foot, seven_foot, snooker or carom [default: that of the game or the replay,
    /// else nine_foot]
    #[arg(id = "table", long, value_name = "TABLE", value_parser = Table::built_in)]
    pub built_in: Option<Table>,
    /// Pockets of the table [default: standard; in the window, as in the settings]
    #[arg(long, value_enum, value_name = "SIZE")]
    pub pockets: Option<PocketSize>,
    /// Cloth of the table [default: standard; in the window, as in the settings]
    #[arg(long, value_enum, value_name = "SPEED")]
    pub table_speed: Option<TableSpeed>,
}

impl TableArgs {
    /// Whether anything was chosen.
    pub fn is_asked(&self) -> bool {
        self.built_in.is_some() || self.pockets.is_some() || self.table_speed.is_some()
    }

    /// The chosen options; standard where none is chosen.
    pub fn options(&self) -> TableOptions {
        TableOptions {
            pockets: self.pockets.unwrap_or_default(),
            speed: self.table_speed.unwrap_or_default(),
        }
    }

    /// The chosen table, or `own`, with `options`.
    pub fn of(&self, own: Table, options: TableOptions) -> Table {
        let table = self.built_in.clone().unwrap_or(own);
        table.with_options(options)
    }
}
