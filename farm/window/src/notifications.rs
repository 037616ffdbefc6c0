//! Notifications about the farm: a sentence when something changes, and a permanent one while there is no
//! picture. Nothing waits for either.
//!
//! | situation | reaction | notification |
//! |---|---|---|
//! | no GPU | the CPU traces, more coarsely while things move | once, with the number of its threads |
//! | no nodes configured | this machine traces | none: the default |
//! | slow node | its share of the tiles shrinks | after seconds, with the factor; again on recovery |
//! | lost node | others trace its tiles, the link reconnects | once, with the reason; again when it is back |
//! | all nodes lost | local tracing; without a local tracer the last picture stays | once; the latter stays |
//! | slow network | pictures are requested earlier, precision falls | once, with the round-trip time |
//! | two nodes' pixels differ | a third traces the tile, the minority is dropped | if there is no third |
//! | another version, UDP blocked | as a lost node | with advice in the reason |

use carom_farm::{NodeState, NodeStatus};
use carom_text::text;
use carom_tracer::DeviceKind;

use crate::speed_history::SpeedHistory;

/// Source of notifications, which remembers what has been reported.
#[derive(Clone, Debug, Default)]
pub struct FarmNotifier {
    seen: Vec<NodeNotice>,
    /// Whether latency is irrelevant to what the user sees.
    ignores_latency: bool,
    /// Whether the user has been told that there is no GPU.
    told_of_cpu: bool,
}

#[derive(Clone, Debug, Default)]
struct NodeNotice {
    /// Last known availability; `None` at first.
    standing: Option<Availability>,
    was_ready: bool,
    speeds: SpeedHistory,
    slow: bool,
    far: bool,
    doubted: bool,
    /// Time of the last notification about this node.
    said_secs: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Availability {
    Ready,
    Lost,
}

impl FarmNotifier {
    /// A notifier for an application that shows frames as they arrive and requests none ahead of time.
    pub fn without_latency() -> Self {
        Self {
            ignores_latency: true,
            ..Self::default()
        }
    }

    /// The news about `nodes` at `now_secs`, one sentence each.
    pub fn observe(&mut self, nodes: &[NodeStatus], now_secs: f64) -> Vec<String> {
        let ignores_latency = self.ignores_latency;
        self.seen.resize_with(nodes.len(), NodeNotice::default);
        let mut notes = Vec::new();
        notes.extend(self.cpu_only(nodes));
        for (node, seen) in nodes.iter().zip(&mut self.seen) {
            let speed = Some(node.msamples_per_sec);
            let speed = speed.filter(|speed| node.state.is_ready() && *speed > 0.0);
            seen.speeds.add(now_secs, speed);
        }
        let medians = self.seen.iter().filter_map(|seen| seen.speeds.median());
        let fastest = medians.fold(0.0, f64::max);
        let others = |index: usize| {
            let ready =
                |(other, node): (usize, &NodeStatus)| other != index && node.state.is_ready();
            nodes.iter().enumerate().any(ready)
        };
        for (index, (node, seen)) in nodes.iter().zip(&mut self.seen).enumerate() {
            let again = seen
                .said_secs
                .is_some_and(|said| now_secs - said < QUIET_SECS);
            let note = seen
                .changed(node, others(index))
                // Not evaluated while notes are suppressed, so that slowness that persists is reported
                // afterwards.
                .or_else(|| (!again).then(|| seen.slowed(node, fastest)).flatten())
                .or_else(|| seen.distanced(node).filter(|_| !ignores_latency))
                .or_else(|| seen.doubted(node));
            if let Some(note) = note.filter(|_| !again) {
                seen.said_secs = Some(now_secs);
                notes.push(note);
            }
        }
        notes
    }

    fn cpu_only(&mut self, nodes: &[NodeStatus]) -> Option<String> {
        let [node] = nodes else {
            return None;
        };
        let device = &node.info.as_ref()?.device;
        if self.told_of_cpu || device.kind != DeviceKind::Cpu || node.address != LOCAL {
            return None;
        }
        self.told_of_cpu = true;
        let threads = device.threads;
        Some(text!("farm-cpu-only", threads = threads))
    }
}

impl NodeNotice {
    fn changed(&mut self, node: &NodeStatus, others: bool) -> Option<String> {
        let (standing, why) = match &node.state {
            NodeState::Ready | NodeState::Rendering => (Availability::Ready, ""),
            NodeState::Lost { why, .. } => (Availability::Lost, why.as_str()),
            _ => return None,
        };
        if self.standing.replace(standing) == Some(standing) {
            return None;
        }
        let name = name(node);
        let others = if others { "yes" } else { "no" };
        let note = match (standing, self.was_ready) {
            (Availability::Ready, false) => None,
            (Availability::Ready, true) => Some(text!("node-again", name = name)),
            (Availability::Lost, true) => {
                Some(text!("node-lost", name = name, why = why, others = others))
            }
            (Availability::Lost, false) => Some(text!(
                "node-unusable",
                name = name,
                why = why,
                others = others
            )),
        };
        self.was_ready |= standing == Availability::Ready;
        note
    }

    fn slowed(&mut self, node: &NodeStatus, fastest: f64) -> Option<String> {
        let share = self.speeds.median()? / fastest.max(1e-9);
        let was_slow = self.slow;
        // Two thresholds, so that a speed near one of them is not reported again and again.
        self.slow = share < if was_slow { SLOW_ENDS } else { SLOW };
        match (was_slow, self.slow) {
            (false, true) => {
                let times = format!("{:.0}", 1.0 / share);
                Some(text!("node-slow", name = name(node), times = times))
            }
            (true, false) => Some(text!("node-slow-ends", name = name(node))),
            _ => None,
        }
    }

    fn doubted(&mut self, node: &NodeStatus) -> Option<String> {
        let was_doubted = std::mem::replace(&mut self.doubted, node.doubt.is_some());
        let doubt = node.doubt.as_ref().filter(|_| !was_doubted)?;
        Some(text!(
            "node-doubted",
            name = name(node),
            doubt = doubt.to_string()
        ))
    }

    fn distanced(&mut self, node: &NodeStatus) -> Option<String> {
        let secs = node.round_trip?.as_secs_f64();
        let was_far = self.far;
        self.far = secs > if was_far { FAR_ENDS_SECS } else { FAR_SECS };
        (self.far && !was_far).then(|| {
            let round_trip_ms = format!("{:.0}", secs * 1e3);
            text!("node-far", name = name(node), ms = round_trip_ms)
        })
    }
}

/// The reason why no node produces pictures, if none does: shown until one does.
pub fn standing(nodes: &[NodeStatus]) -> Option<String> {
    if nodes.iter().any(|node| node.state.is_ready()) {
        return None;
    }
    let lost = nodes.iter().filter_map(|node| match &node.state {
        NodeState::Lost { why, .. } => Some(format!("{} ({why})", name(node))),
        _ => None,
    });
    let lost: Vec<String> = lost.collect();
    if lost.is_empty() || lost.len() < nodes.len() {
        return Some(sending(nodes).unwrap_or_else(|| text!("farm-waiting").to_owned()));
    }
    Some(text!("farm-no-node", nodes = lost.join("; ")))
}

/// Progress of the node that has most of a long scene which nodes are being sent.
fn sending(nodes: &[NodeStatus]) -> Option<String> {
    let progress = nodes.iter().filter_map(|node| match node.state {
        NodeState::Syncing { bytes, of } if of > 0 => Some((bytes, of)),
        _ => None,
    });
    let (bytes, of) = progress.max()?;
    let (bytes, of) = (megabytes(bytes), megabytes(of));
    Some(text!("farm-sending", bytes = bytes, of = of))
}

/// One line about the farm: the nodes that produce the pictures, with their devices.
pub fn line(nodes: &[NodeStatus]) -> String {
    if let Some(sentence) = standing(nodes) {
        return sentence;
    }
    let ready = |node: &&NodeStatus| node.state.is_ready();
    let names = nodes.iter().filter(ready).map(|node| {
        let device = node
            .info
            .as_ref()
            .map_or("", |info| info.device.name.as_str());
        match node.address.as_str() {
            LOCAL => text!("node-local-device", device = device),
            address => format!("{address} ({device})"),
        }
    });
    let names: Vec<String> = names.collect();
    let (ready, all) = (names.len(), nodes.len());
    text!(
        "farm-nodes",
        ready = ready,
        all = all,
        names = names.join(", ")
    )
}

/// Formats bytes as megabytes with one decimal.
pub(crate) fn megabytes(bytes: u64) -> String {
    format!("{:.1}", bytes as f64 / 1e6)
}

fn name(node: &NodeStatus) -> &str {
    let name = node.info.as_ref().map_or("", |info| info.name.as_str());
    match (node.address.as_str(), name) {
        (LOCAL, _) => text!("node-local"),
        (address, "") => address,
        (_, name) => name,
    }
}

/// Address of the node inside the program.
const LOCAL: &str = "local";
/// Speed relative to the fastest node below which a node is reported as slow, and above which no longer.
const SLOW: f64 = 0.125;
const SLOW_ENDS: f64 = 0.25;
/// Round-trip time in seconds above which moving pictures are noticeably delayed, and below which no longer.
const FAR_SECS: f64 = 0.2;
const FAR_ENDS_SECS: f64 = 0.1;
/// Minimum time between notifications about one node.
const QUIET_SECS: f64 = 10.0;

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use carom_farm::NodeInfo;
    use carom_tracer::DeviceInfo;

    use super::*;

    fn node(address: &str, state: NodeState) -> NodeStatus {
        let mut node = NodeStatus::new(address);
        (node.state, node.msamples_per_sec) = (state, 10.0);
        node
    }

    fn lost(why: &str) -> NodeState {
        NodeState::Lost {
            why: why.to_owned(),
            retry_secs: None,
        }
    }

    fn told(lookout: &mut FarmNotifier, nodes: &[NodeStatus], now_secs: f64) -> String {
        lookout.observe(nodes, now_secs).join("\n")
    }

    #[test]
    fn a_farm_that_works_is_not_spoken_of() {
        let mut lookout = FarmNotifier::default();
        let nodes = [
            node("local", NodeState::Ready),
            node("attic:1", NodeState::Ready),
        ];
        for now in 0..5 {
            assert_eq!(told(&mut lookout, &nodes, f64::from(now)), "");
        }
        assert_eq!(standing(&nodes), None);
    }

    #[test]
    fn without_a_gpu_the_threads_are_named_once() {
        let mut lookout = FarmNotifier::default();
        let mut local = node("local", NodeState::Ready);
        local.info = Some(NodeInfo {
            name: String::new(),
            instance: 0,
            device: DeviceInfo {
                kind: DeviceKind::Cpu,
                name: "some processor".to_owned(),
                width: 8,
                threads: 2,
            },
        });
        assert!(told(&mut lookout, &[local.clone()], 0.0).contains("2 threads"));
        assert_eq!(told(&mut lookout, &[local], 9.0), "");
    }

    #[test]
    fn loss_and_return_of_a_node_are_each_told_once() {
        let mut lookout = FarmNotifier::default();
        let farm = |state: NodeState| [node("local", NodeState::Ready), node("attic:1", state)];
        told(&mut lookout, &farm(NodeState::Ready), 0.0);
        let said = told(&mut lookout, &farm(lost("it no longer answers")), 1.0);
        assert_eq!(
            said,
            "Lost attic:1 (it no longer answers): other nodes take over its tiles"
        );
        assert_eq!(
            told(&mut lookout, &farm(lost("it no longer answers")), 2.0),
            ""
        );
        assert_eq!(told(&mut lookout, &farm(NodeState::Starting), 3.0), "");
        assert_eq!(
            told(&mut lookout, &farm(NodeState::Ready), 20.0),
            "attic:1 is connected again"
        );
    }

    #[test]
    fn nodes_whose_pixels_differ_are_told_of_once() {
        let mut lookout = FarmNotifier::default();
        let mut attic = node("attic:1", NodeState::Ready);
        assert_eq!(told(&mut lookout, &[attic.clone()], 0.0), "");
        attic.doubt = Some("its pixels differ from those of oak:1".to_owned());
        let said = told(&mut lookout, &[attic.clone()], 20.0);
        let expected = "attic:1: its pixels differ from those of oak:1, and one of them is wrong";
        assert_eq!(said, expected);
        assert_eq!(told(&mut lookout, &[attic], 40.0), "");
    }

    #[test]
    fn unsteady_nodes_are_told_of_at_most_so_often() {
        let mut lookout = FarmNotifier::default();
        let states = (0..100).map(|i| {
            if i % 2 == 0 {
                NodeState::Ready
            } else {
                lost("it broke")
            }
        });
        let said = states.enumerate().map(|(i, state)| {
            lookout
                .observe(&[node("attic:1", state)], 0.1 * i as f64)
                .len()
        });
        assert!(said.sum::<usize>() <= 2);
    }

    #[test]
    fn losing_all_nodes_names_each_for_as_long() {
        let mut lookout = FarmNotifier::default();
        let nodes = [
            node(
                "attic:1",
                lost("it does not answer: does a firewall let its UDP port through?"),
            ),
            node(
                "cellar:1",
                lost("the peer speaks protocol version 1, this program 2: update the older one"),
            ),
        ];
        let said = told(&mut lookout, &nodes, 0.0);
        assert!(
            said.contains("the last frame stays") && said.contains("Cannot use attic:1"),
            "{said}"
        );
        let stays = standing(&nodes).unwrap();
        for word in [
            "attic:1",
            "UDP port",
            "update the older one",
            "you can keep playing",
        ] {
            assert!(stays.contains(word), "{word} in {stays}");
        }
    }

    #[test]
    fn with_one_still_being_called_the_sentence_waits() {
        let nodes = [
            node("attic:1", lost("x")),
            node("local", NodeState::Starting),
        ];
        assert_eq!(standing(&nodes).unwrap(), "Waiting for the first frame");
    }

    /// A farm in which one node has this speed, and the others speed 10.
    fn farm_with(speed: f64) -> [NodeStatus; 2] {
        let mut slow = node("attic:1", NodeState::Ready);
        slow.msamples_per_sec = speed;
        [node("local", NodeState::Ready), slow]
    }

    #[test]
    fn a_slow_node_is_told_once_with_how_slow_and_withdrawn() {
        let mut lookout = FarmNotifier::default();
        let mut now_secs = 0.0;
        let mut lasting = |speed: f64| {
            let steps = (0..100).map(|_| {
                now_secs += 0.1;
                lookout.observe(&farm_with(speed), now_secs)
            });
            steps.flatten().collect::<Vec<_>>().join("\n")
        };
        assert_eq!(lasting(5.0), "");
        let said = "attic:1 is 20 times slower than the fastest node and gets fewer tiles";
        assert_eq!(lasting(0.5), said);
        assert_eq!(lasting(1.5), "", "not yet fast again");
        assert_eq!(lasting(0.5), "");
        let ended = "attic:1 has caught up with the other nodes and gets more tiles again";
        assert_eq!(lasting(5.0), ended);
        assert_eq!(lasting(5.0), "");
    }

    #[test]
    fn slow_moments_are_not_told() {
        let mut lookout = FarmNotifier::default();
        for step in 0..300 {
            let speed = if step % 20 < 6 { 0.5 } else { 5.0 };
            let now_secs = 0.1 * f64::from(step);
            assert_eq!(told(&mut lookout, &farm_with(speed), now_secs), "");
        }
    }

    #[test]
    fn a_node_that_recovers_at_once_is_withdrawn_once_that_can_be_said() {
        let mut lookout = FarmNotifier::default();
        let mut said = Vec::new();
        for step in 0..200 {
            let speed = if step < 45 { 0.5 } else { 5.0 };
            said.extend(lookout.observe(&farm_with(speed), 0.1 * f64::from(step)));
        }
        let [slow, ended] = said.as_slice() else {
            panic!("{said:?}");
        };
        assert!(slow.contains("20 times slower") && ended.contains("has caught up"));
    }

    #[test]
    fn a_slow_network_is_told_with_its_round_trip() {
        let mut lookout = FarmNotifier::default();
        let mut far = node("attic:1", NodeState::Ready);
        far.round_trip = Some(Duration::from_millis(320));
        assert!(told(&mut lookout, &[far], 0.0).contains("320 ms"));
    }
}
