//! CloudFormation stack with all resources of a farm, and its machines.

use anyhow::anyhow;
use serde_json::{Value, json};

use super::aws_cli::AwsCli;
use crate::commands::Failure;

/// The template that describes all resources.
pub(super) const TEMPLATE: &str = include_str!("../../../deploy/aws/farm.yaml");
/// The tag that all resources of a farm have.
const TAG: &str = "carom:farm";

/// Parses a farm's name, which is that of its stack.
pub(super) fn name(text: &str) -> Result<String, &'static str> {
    let begins = text.starts_with(|c: char| c.is_ascii_alphabetic());
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '-';
    match begins && text.len() <= 32 && text.chars().all(plain) {
        true => Ok(text.to_owned()),
        false => Err("it must be a letter, then letters, digits or -, at most 32 in all"),
    }
}

/// Stack of a farm, which may or may not exist.
pub(super) struct Stack {
    pub(super) aws: AwsCli,
    pub(super) name: String,
}

/// A machine that is not terminated.
pub(super) struct Machine {
    pub(super) id: String,
    pub(super) kind: String,
    pub(super) state: String,
    pub(super) is_spot: bool,
    /// Name of its Auto Scaling group.
    group: String,
    pub(super) address: Option<String>,
}

impl Machine {
    /// Whether it belongs to the template's group of that name.
    pub(super) fn is_of(&self, group: &str) -> bool {
        self.group.contains(group)
    }
}

fn tag(resource: &Value, key: &str) -> String {
    let tag = list(&resource["Tags"]).find(|tag| tag["Key"] == key);
    tag.map(|tag| text(&tag["Value"])).unwrap_or_default()
}

impl Stack {
    pub(super) const fn new(aws: AwsCli, name: String) -> Self {
        Self { aws, name }
    }

    /// The stack's status, such as `CREATE_COMPLETE`; `None` if it does not exist.
    pub(super) fn status(&self) -> Result<Option<String>, Failure> {
        let stack = self.describe()?;
        Ok(stack.map(|stack| text(&stack["StackStatus"])))
    }

    /// The value of an output of the stack.
    pub(super) fn output(&self, key: &str) -> Result<Option<String>, Failure> {
        let stack = self.describe()?.unwrap_or_default();
        let output = list(&stack["Outputs"]).find(|output| output["OutputKey"] == key);
        Ok(output.map(|output| text(&output["OutputValue"])))
    }

    fn describe(&self) -> Result<Option<Value>, Failure> {
        let args = ["cloudformation", "describe-stacks", "--stack-name"];
        match self.aws.json(&[&args[..], &[&self.name]].concat()) {
            Ok(stacks) => Ok(stacks["Stacks"].get(0).cloned()),
            Err(Failure::Run(why)) if why.to_string().contains("does not exist") => Ok(None),
            Err(why) => Err(why),
        }
    }

    /// Creates or updates the stack, and waits until that is complete.
    pub(super) fn apply(&self, parameters: &[(&str, String)]) -> Result<(), Failure> {
        let pair =
            |(key, value): &(&str, String)| json!({"ParameterKey": key, "ParameterValue": value});
        let input = json!({
            "StackName": self.name,
            "TemplateBody": TEMPLATE,
            "Capabilities": ["CAPABILITY_IAM"],
            "Parameters": parameters.iter().map(pair).collect::<Vec<_>>(),
            "Tags": [{"Key": TAG, "Value": self.name}],
        });
        let (verb, waited) = match self.status()?.as_deref() {
            None => ("create-stack", "stack-create-complete"),
            // A stack whose creation was rolled back cannot be updated, only deleted.
            Some(status) if status.ends_with("_COMPLETE") && !status.starts_with("ROLLBACK") => {
                ("update-stack", "stack-update-complete")
            }
            Some(status) => {
                let name = &self.name;
                return Err(Failure::Input(format!(
                    "the farm {name} is in the state {status}: run `carom-farm cloud down --name {name}`, or wait"
                )));
            }
        };
        self.aws.json_from(&["cloudformation", verb], &input)?;
        self.wait(waited)
    }

    /// Deletes the stack and waits until that is complete.
    pub(super) fn delete(&self) -> Result<(), Failure> {
        let name = ["--stack-name", &self.name];
        self.aws
            .done(&[&["cloudformation", "delete-stack"], &name[..]].concat())?;
        self.wait("stack-delete-complete")
    }

    fn wait(&self, what: &str) -> Result<(), Failure> {
        let args = ["cloudformation", "wait", what, "--stack-name", &self.name];
        self.aws.done(&args).map_err(|why| match self.faults() {
            Ok(faults) if !faults.is_empty() => {
                Failure::Run(anyhow!("{}: {}", self.name, faults.join("; ")))
            }
            _ => why,
        })
    }

    /// The reasons why resources could not be created or deleted.
    fn faults(&self) -> Result<Vec<String>, Failure> {
        let args = ["cloudformation", "describe-stack-events", "--stack-name"];
        let events = self.aws.json(&[&args[..], &[&self.name]].concat())?;
        let failed = list(&events["StackEvents"])
            .filter(|event| text(&event["ResourceStatus"]).ends_with("_FAILED"));
        let sentence = |event: &Value| {
            let reason = text(&event["ResourceStatusReason"]);
            format!("{}: {reason}", text(&event["LogicalResourceId"]))
        };
        Ok(failed.map(sentence).collect())
    }

    /// The machines that are not terminated, found by their tag, so including any that the stack does not
    /// know.
    pub(super) fn machines(&self) -> Result<Vec<Machine>, Failure> {
        let filter = format!("Name=tag:{TAG},Values={}", self.name);
        let states =
            "Name=instance-state-name,Values=pending,running,stopping,stopped,shutting-down";
        let args = ["ec2", "describe-instances", "--filters", &filter, states];
        let reservations = self.aws.json(&args)?;
        let machine = |instance: &Value| Machine {
            id: text(&instance["InstanceId"]),
            kind: text(&instance["InstanceType"]),
            state: text(&instance["State"]["Name"]),
            is_spot: instance["InstanceLifecycle"] == "spot",
            group: tag(instance, "aws:autoscaling:groupName"),
            address: instance["PublicIpAddress"].as_str().map(str::to_owned),
        };
        let instances = list(&reservations["Reservations"]).flat_map(|it| list(&it["Instances"]));
        Ok(instances.map(machine).collect())
    }

    /// Other tagged resources that remain: volumes, security groups and launch templates.
    pub(super) fn leftovers(&self) -> Result<Vec<String>, Failure> {
        let filter = format!("Name=tag:{TAG},Values={}", self.name);
        let kinds = [
            ("describe-volumes", "Volumes", "VolumeId"),
            ("describe-security-groups", "SecurityGroups", "GroupId"),
            (
                "describe-launch-templates",
                "LaunchTemplates",
                "LaunchTemplateId",
            ),
        ];
        let mut left = Vec::new();
        for (command, kind, id) in kinds {
            let found = self.aws.json(&["ec2", command, "--filters", &filter])?;
            left.extend(list(&found[kind]).map(|it| text(&it[id])));
        }
        Ok(left)
    }
}

/// The elements of a JSON array; none for any other value.
pub(super) fn list(value: &Value) -> impl Iterator<Item = &Value> {
    value.as_array().into_iter().flatten()
}

/// A JSON string; empty for any other value.
pub(super) fn text(value: &Value) -> String {
    value.as_str().unwrap_or_default().to_owned()
}
