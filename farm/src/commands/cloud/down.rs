//! `carom-farm cloud down`: deletes a farm and checks for leftovers.

use anyhow::anyhow;

use super::{StackArgs, confirm};
use crate::commands::Failure;

/// Delete everything of the farm: machines, disks, security group, bucket, roles
///
/// The exit code is 0 if nothing is left.
#[derive(clap::Args)]
pub(super) struct DownArgs {
    #[command(flatten)]
    stack: StackArgs,
    /// Do not ask
    #[arg(long)]
    yes: bool,
}

pub(super) fn run(args: &DownArgs) -> Result<(), Failure> {
    let stack = args.stack.open();
    let name = &stack.name;
    if stack.status()?.is_some() {
        let running = stack.machines()?.len();
        confirm(
            &format!("Delete the farm {name} with {running} machines?"),
            args.yes,
        )?;
        if let Some(bucket) = stack.output("Bucket")? {
            // CloudFormation does not delete a bucket unless it is empty.
            let url = format!("s3://{bucket}");
            stack
                .aws
                .done(&["s3", "rm", "--only-show-errors", "--recursive", &url])?;
        }
        stack.delete()?;
    } else {
        println!("There is no farm {name} here.");
    }
    let machines = stack.machines()?.into_iter().map(|machine| machine.id);
    let left: Vec<String> = machines.chain(stack.leftovers()?).collect();
    if left.is_empty() {
        println!("Nothing of the farm {name} is left.");
        return Ok(());
    }
    let left = left.join(", ");
    Err(
        anyhow!("still there with the tag carom:farm={name}: {left}; run this again in a minute")
            .into(),
    )
}
