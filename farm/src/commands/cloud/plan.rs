//! Price estimate of a farm on EC2, shown before anything is created.

use std::collections::BTreeMap;

use serde_json::Value;

use super::aws_cli::AwsCli;
use super::programs::Architecture;
use super::stack::{list, text};
use crate::commands::Failure;

/// A machine type of the template.
pub(super) struct MachineType {
    name: &'static str,
    architecture: Architecture,
    is_gpu: bool,
    /// On-demand price in us-east-1 for Linux, of January 2026: `farm/deploy/README.md` names the list. Other
    /// regions cost up to 1.6 times as much.
    dollars_per_hour: f64,
}

const fn machine(
    name: &'static str,
    architecture: Architecture,
    is_gpu: bool,
    dollars_per_hour: f64,
) -> MachineType {
    MachineType {
        name,
        architecture,
        is_gpu,
        dollars_per_hour,
    }
}

/// The machine types in `farm.yaml`.
const TYPES: [MachineType; 9] = [
    machine("g6.xlarge", Architecture::X86, true, 0.805),
    machine("g5.xlarge", Architecture::X86, true, 1.006),
    machine("g4dn.xlarge", Architecture::X86, true, 0.526),
    machine("g5g.xlarge", Architecture::Arm, true, 0.420),
    machine("c7i.4xlarge", Architecture::X86, false, 0.714),
    machine("c7a.4xlarge", Architecture::X86, false, 0.821),
    machine("c6i.4xlarge", Architecture::X86, false, 0.680),
    machine("c8g.4xlarge", Architecture::Arm, false, 0.638),
    machine("c7g.4xlarge", Architecture::Arm, false, 0.580),
];

/// Price of a public IPv4 address and 20 GB of gp3.
const ADDRESS_AND_DISK_DOLLARS_PER_HOUR: f64 = 0.005 + 20.0 * 0.08 / 730.0;
/// Price of traffic to the internet for the first 10 TB of a month; 100 GB of each month are free.
const EGRESS_DOLLARS_PER_GB: f64 = 0.09;
/// Traffic of 1280×720 at 60 frames a second with motion: 50 Mbit/s.
const GB_PER_HOUR: f64 = 22.5;

/// Number of machines, and the time for which they are wanted.
pub(super) struct Plan<'a> {
    pub(super) gpu_nodes: u32,
    pub(super) cpu_nodes: u32,
    pub(super) on_demand_percent: u32,
    pub(super) architectures: &'a [Architecture],
    pub(super) hours: f64,
}

/// Current prices of each type in dollars per hour: the lowest and the highest of all zones.
type SpotPrices = BTreeMap<String, (f64, f64)>;

impl Plan<'_> {
    fn types(&self, is_gpu: bool) -> impl Iterator<Item = &'static MachineType> {
        let has_program = |it: &&MachineType| self.architectures.contains(&it.architecture);
        TYPES
            .iter()
            .filter(move |it| it.is_gpu == is_gpu)
            .filter(has_program)
    }

    /// Queries the current prices of spot machines.
    pub(super) fn spot_prices(&self, aws: &AwsCli, now: &str) -> Result<SpotPrices, Failure> {
        let mut args = vec!["ec2", "describe-spot-price-history"];
        args.extend(["--product-descriptions", "Linux/UNIX", "--start-time", now]);
        args.push("--instance-types");
        args.extend(
            [true, false]
                .iter()
                .flat_map(|gpu| self.types(*gpu))
                .map(|it| it.name),
        );
        Ok(spot_prices(&aws.json(&args)?))
    }

    /// The maximum price per hour, whichever types are started.
    fn dollars_per_hour_max(&self, spot: &SpotPrices) -> f64 {
        let dearest = |is_gpu: bool, nodes: u32| {
            // With a share on demand, or without a spot price, the on-demand price is the bound.
            let price = |it: &MachineType| match (self.on_demand_percent, spot.get(it.name)) {
                (0, Some((_, dearest))) => *dearest,
                _ => it.dollars_per_hour,
            };
            let machine = self.types(is_gpu).map(price).fold(0.0, f64::max);
            f64::from(nodes) * (machine + ADDRESS_AND_DISK_DOLLARS_PER_HOUR)
        };
        dearest(true, self.gpu_nodes) + dearest(false, self.cpu_nodes)
    }

    /// The estimate as text for a person.
    pub(super) fn price(&self, spot: &SpotPrices) -> String {
        let mut lines = Vec::new();
        for (kind, is_gpu, nodes) in [
            ("GPU", true, self.gpu_nodes),
            ("CPU", false, self.cpu_nodes),
        ] {
            if nodes == 0 {
                continue;
            }
            lines.push(format!("  {nodes} {kind} nodes, each one of:"));
            for it in self.types(is_gpu) {
                let now = match spot.get(it.name) {
                    Some((low, high)) => format!("spot now {low:.3} to {high:.3}"),
                    None => "not offered as spot here".to_owned(),
                };
                let (name, price) = (it.name, it.dollars_per_hour);
                lines.push(format!(
                    "    {name:<12} {now}, on demand about {price:.3} $/h"
                ));
            }
        }
        let hourly = self.dollars_per_hour_max(spot);
        let (total, egress) = (hourly * self.hours, EGRESS_DOLLARS_PER_GB);
        lines.push(format!(
            "  at most {hourly:.3} $/h with addresses and disks, {total:.2} $ in {:.1} h",
            self.hours
        ));
        lines.push(format!(
            "  and {egress:.2} $/GB of pictures: {:.2} $ for an hour of 1280x720 at 60 frames a second",
            egress * GB_PER_HOUR
        ));
        lines.join("\n")
    }
}

fn spot_prices(history: &Value) -> SpotPrices {
    let mut prices = SpotPrices::new();
    for entry in list(&history["SpotPriceHistory"]) {
        let Ok(price) = text(&entry["SpotPrice"]).parse::<f64>() else {
            continue;
        };
        let range = prices.entry(text(&entry["InstanceType"]));
        let (low, high) = range.or_insert((price, price));
        (*low, *high) = (low.min(price), high.max(price));
    }
    prices
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::super::stack::TEMPLATE;
    use super::*;

    #[test]
    fn types_are_those_of_the_template() {
        let named = |it: &MachineType| TEMPLATE.contains(&format!("InstanceType: {},", it.name));
        assert!(TYPES.iter().all(named));
        assert_eq!(TEMPLATE.matches("InstanceType: ").count(), TYPES.len());
    }

    #[test]
    fn the_price_is_that_of_the_dearest_machines() {
        let history = json!({"SpotPriceHistory": [
            {"InstanceType": "g6.xlarge", "SpotPrice": "0.30"},
            {"InstanceType": "g6.xlarge", "SpotPrice": "0.35"},
            {"InstanceType": "g4dn.xlarge", "SpotPrice": "0.20"},
        ]});
        let spot = spot_prices(&history);
        let mut plan = Plan {
            gpu_nodes: 2,
            cpu_nodes: 0,
            on_demand_percent: 0,
            architectures: &[Architecture::X86],
            hours: 8.0,
        };
        // A type without a spot price counts with its on-demand price.
        let extra = ADDRESS_AND_DISK_DOLLARS_PER_HOUR;
        assert!((plan.dollars_per_hour_max(&spot) - 2.0 * (1.006 + extra)).abs() < 1e-9);
        let text = plan.price(&spot);
        assert!(
            text.contains("spot now 0.300 to 0.350") && !text.contains("g5g"),
            "{text}"
        );
        assert!(!text.contains("CPU nodes"), "{text}");
        plan.architectures = &[Architecture::Arm];
        plan.on_demand_percent = 1;
        assert!((plan.dollars_per_hour_max(&spot) - 2.0 * (0.420 + extra)).abs() < 1e-9);
    }
}
