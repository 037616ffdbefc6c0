//! Subcommands, one file each: they turn arguments into calls of the library and results into lines.

mod add;
mod animation_frames;
mod authority;
mod bench;
mod cloud;
mod compare;
mod doctor;
mod failure;
mod init;
mod inputs;
mod join;
mod log_line;
mod node;
mod node_monitor;
mod output_file;
mod render;
mod render_summary;
mod revoke;
mod status;
mod token;
mod top;

use carom_farm::logging::LogFormat;
use carom_farm::net::Role;
use clap::Subcommand;

pub(crate) use failure::Failure;

/// The subcommands.
#[derive(Subcommand)]
pub(crate) enum FarmCommand {
    Init(init::InitArgs),
    Token(token::TokenArgs),
    Join(join::JoinArgs),
    /// Create a node's key and certificate, valid for 30 days, in a folder to copy to the node
    ///
    /// A running node shows a renewed certificate within an hour of its being copied there. Nodes that
    /// `join` renew themselves.
    AddNode(add::AddArgs),
    /// Create a person's key and certificate, valid for 90 days, in a folder to hand over
    AddPlayer(add::AddArgs),
    Revoke(revoke::RevokeArgs),
    Doctor(doctor::DoctorArgs),
    Node(node::NodeArgs),
    Cloud(cloud::CloudArgs),
    Render(render::RenderArgs),
    Status(status::StatusArgs),
    Top(top::TopArgs),
    Bench(bench::Args),
    Compare(compare::CompareArgs),
}

impl FarmCommand {
    pub(crate) fn run(self, log: LogFormat) -> Result<(), Failure> {
        match self {
            Self::Init(args) => init::run(&args),
            Self::Token(args) => token::run(&args),
            Self::Join(args) => join::run(&args),
            Self::AddNode(args) => add::run(Role::Node, &args),
            Self::AddPlayer(args) => add::run(Role::Player, &args),
            Self::Revoke(args) => revoke::run(&args),
            Self::Doctor(args) => doctor::run(&args),
            Self::Node(args) => node::run(&args, log),
            Self::Cloud(args) => cloud::run(&args),
            Self::Render(args) => render::run(&args),
            Self::Status(args) => status::run(&args),
            Self::Top(args) => top::run(&args),
            Self::Bench(args) => bench::run(&args),
            Self::Compare(args) => compare::run(&args),
        }
    }
}
