//! `carom-farm revoke`: revokes the certificates of a node or player.

use carom_farm::net;

use crate::commands::Failure;
use crate::commands::authority::AuthorityArgs;

/// Withdraw all certificates of a node or player
///
/// Its keys are written to revoked.txt in the authority's folder. Programs that use this folder follow
/// by themselves, and within an hour nodes that have joined and reach a running `carom-farm token`;
/// into other folders of credentials copy revoked.txt. Running programs read it again within two
/// seconds, and close connections of revoked peers.
#[derive(clap::Args)]
pub(crate) struct RevokeArgs {
    /// The name in the certificates
    name: String,
    #[command(flatten)]
    authority: AuthorityArgs,
}

pub(crate) fn run(args: &RevokeArgs) -> Result<(), Failure> {
    let dir = &args.authority.dir;
    for record in net::revoke(dir, &args.name)? {
        println!(
            "Revoked: {} {}, valid until {}, key {}",
            record.role,
            record.name,
            record.last_day(),
            record.key_id
        );
    }
    println!(
        "Copy {}/revoked.txt into the credentials folder of each node that has not joined by token.",
        dir.display()
    );
    Ok(())
}
