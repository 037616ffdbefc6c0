//! `carom-farm cloud status` and `cloud logs`: the machines of a farm, and their console output.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

use anyhow::Context as _;
use carom_farm::WholeFile;
use serde_json::json;

use super::stack::{Machine, Stack, list, text};
use super::{NodesFile, StackArgs};
use crate::commands::Failure;

#[derive(clap::Args)]
pub(super) struct StatusArgs {
    #[command(flatten)]
    stack: StackArgs,
    #[command(flatten)]
    nodes: NodesFile,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn status(args: &StatusArgs) -> Result<(), Failure> {
    let stack = args.stack.open();
    let state = stack.status()?;
    let machines = stack.machines()?;
    if args.json {
        let row = |machine: &Machine| {
            json!({"id": machine.id, "type": machine.kind, "state": machine.state, "spot": machine.is_spot,
                "address": machine.address})
        };
        let rows: Vec<_> = machines.iter().map(row).collect();
        println!("{}", json!({"stack": state, "machines": rows}));
    } else {
        let state = state.as_deref().unwrap_or("not there");
        println!("farm {}: {state}, {} machines", stack.name, machines.len());
        machines.iter().for_each(print);
    }
    write_nodes(&args.nodes.nodes_file, &machines)
}

fn print(machine: &Machine) {
    let Machine {
        id, kind, state, ..
    } = machine;
    let market = if machine.is_spot { "spot" } else { "on demand" };
    let address = machine.address.as_deref().unwrap_or("no address");
    println!("{id} {kind:<12} {state:<10} {market:<9} {address}");
}

/// Writes the addresses of running machines.
pub(super) fn write_nodes(path: &Path, machines: &[Machine]) -> Result<(), Failure> {
    let mut text = String::new();
    for machine in machines.iter().filter(|machine| machine.state == "running") {
        if let Some(address) = &machine.address {
            let _ = writeln!(text, "{address}:4433");
        }
    }
    // Atomically, since games reread the file each second.
    WholeFile::replace(path, |file| file.write_all(text.as_bytes()))
        .with_context(|| format!("{}", path.display()))?;
    Ok(())
}

pub(super) fn logs(stack: &Stack) -> Result<(), Failure> {
    if stack.status()?.is_none() {
        return Err(Failure::Input(format!(
            "there is no farm {} in this region",
            stack.name
        )));
    }
    let name = ["--stack-name", &stack.name];
    let resources = [&["cloudformation", "describe-stack-resources"], &name[..]].concat();
    let resources = stack.aws.json(&resources)?;
    let groups = list(&resources["StackResources"])
        .filter(|it| it["ResourceType"] == "AWS::AutoScaling::AutoScalingGroup");
    for group in groups.map(|it| text(&it["PhysicalResourceId"])) {
        let args = [
            "autoscaling",
            "describe-scaling-activities",
            "--auto-scaling-group-name",
            &group,
        ];
        match stack.aws.json(&args) {
            Ok(activities) => {
                let failed =
                    list(&activities["Activities"]).filter(|it| it["StatusCode"] == "Failed");
                failed.for_each(|it| println!("{group}: {}", text(&it["StatusMessage"])));
            }
            Err(why) => eprintln!("carom-farm: {why}"),
        }
    }
    for machine in stack.machines()? {
        println!("=== {} ({}, {})", machine.id, machine.kind, machine.state);
        let args = [
            "ec2",
            "get-console-output",
            "--latest",
            "--instance-id",
            &machine.id,
        ];
        match stack.aws.json(&args) {
            Ok(console) => println!("{}", text(&console["Output"]).trim_end()),
            Err(why) => eprintln!("carom-farm: {why}"),
        }
    }
    Ok(())
}
