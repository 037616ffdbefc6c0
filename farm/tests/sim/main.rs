//! Laws of the coordinator and its balancers on virtual time. Every run follows from its seed.

mod acceptance;
mod drain;
mod extensions;
mod fairness;
mod faults;
mod samples;
mod spot_checks;
mod states;

use carom_farm::Algorithm::{self, Ab, Equal, Naive, WaterFilling};
use carom_farm::balancer::{CostModel, water_fill};
use carom_farm::{Balancing, FrameStats, NodeState};
use carom_testkit::simulator::{FarmPlan, NodeChange, NodePlan, SimulationReport, run};
use carom_tracer::ImageSize;

/// More virtual time than any run here needs.
const SECS_MAX: f64 = 600.0;
const FOREVER: f64 = 1e6;
/// When the simulator submits the first frame.
const SUBMITTED_SECS: f64 = 0.5;

fn plan(nodes: Vec<NodePlan>, algorithm: Algorithm, frames: u64) -> FarmPlan {
    FarmPlan {
        balancing: algorithm.hedged(),
        nodes,
        frames,
        ..FarmPlan::default()
    }
}

/// Five nodes on a local network, the fastest 40 times as fast as the slowest.
fn unequal() -> Vec<NodePlan> {
    let node = |(round_trip_secs, msamples_per_sec): (f64, f64)| NodePlan {
        jitter_secs: 1e-4,
        ..NodePlan::new(round_trip_secs, msamples_per_sec)
    };
    [
        (3e-4, 2.0),
        (1e-3, 0.8),
        (2e-3, 0.4),
        (5e-4, 0.1),
        (1e-3, 0.05),
    ]
    .map(node)
    .into()
}

/// The earliest finish that anyone who knows all could reach.
fn ideal_secs(nodes: &[NodePlan], size: ImageSize) -> f64 {
    let line = |node: &NodePlan| CostModel::new(node.round_trip_secs, 1e-6 / node.msamples_per_sec);
    let lines: Vec<CostModel> = nodes.iter().map(line).collect();
    water_fill(size.pixels() as f64, &lines).finish_secs
}

fn checked(plan: &FarmPlan) -> SimulationReport {
    let report = run(plan, SECS_MAX);
    assert_eq!(
        report.frames.len() as u64,
        plan.frames,
        "frames were lost after {} s: {plan:?}, {:?}",
        report.secs,
        report.nodes
    );
    let order = report.frames.iter().enumerate();
    assert!(
        order
            .into_iter()
            .all(|(index, frame)| frame.id.0 == index as u64)
    );
    assert_eq!(report.wrong_frames, 0, "seed {}", plan.seed);
    assert_eq!(report.warnings, [""; 0], "seed {}", plan.seed);
    for frame in &report.frames {
        let delivered: u32 = frame.stats.tiles_by_node.iter().sum();
        assert_eq!(delivered, report.tiles_per_frame * frame.stats.passes);
        check_deliveries(&frame.stats);
    }
    report
}

/// Each tile is of one node in each pass, in the order of arrival.
fn check_deliveries(stats: &FrameStats) {
    let mut came = vec![0; stats.tile_work.len()];
    let mut last_secs = 0.0;
    for delivery in &stats.deliveries {
        let tiles = &mut came[delivery.tiles.first as usize..delivery.tiles.end() as usize];
        if stats.passes == 1 {
            let fresh = tiles.iter().filter(|times| **times == 0);
            assert_eq!(fresh.count(), delivery.fresh_tiles as usize);
        }
        tiles.iter_mut().for_each(|times| *times += 1);
        assert!(last_secs <= delivery.arrived_secs, "{delivery:?}");
        last_secs = delivery.arrived_secs;
    }
    let lacks = |times: &u32| *times < stats.passes;
    assert!(!came.iter().any(lacks), "a tile is of nobody");
    assert_eq!(last_secs, stats.makespan_secs);
    assert!(stats.lost_tiles <= stats.reissued_tiles);
    assert!((0.0..=stats.makespan_secs).contains(&stats.ideal_secs()));
}

#[test]
fn efficiency_tells_a_good_division_from_a_bad_one() {
    let mean = |algorithm: Algorithm, value: fn(&FrameStats) -> f64| {
        let frames = checked(&plan(unequal(), algorithm, 100)).frames;
        frames[40..]
            .iter()
            .map(|frame| value(&frame.stats))
            .sum::<f64>()
            / 60.0
    };
    let [equal, filled] =
        [Equal, WaterFilling].map(|a| mean(a, |stats| stats.ideal_secs() / stats.makespan_secs));
    assert!(filled > 0.85, "water-filling: {filled}");
    assert!(equal < 0.4, "equal: {equal}");
    // What the frames say of themselves is what someone says who knows all.
    let ideal = ideal_secs(&unequal(), ImageSize::new(240, 160));
    for algorithm in [Equal, WaterFilling] {
        let said = mean(algorithm, FrameStats::ideal_secs);
        assert!(
            (0.85..1.15).contains(&(said / ideal)),
            "{algorithm:?}: {said} for {ideal}"
        );
    }
}

#[test]
fn tiles_of_a_node_that_dies_count_as_lost() {
    let (mut lost, mut of_node) = (0, 0);
    // At whatever moments of a frame, it is working at some of them.
    for at_secs in [1.001, 1.003, 1.005, 1.007, 1.009] {
        let mut nodes = unequal();
        nodes[0] = nodes[0].clone().with(at_secs, NodeChange::Die);
        let report = checked(&plan(nodes, WaterFilling, 100));
        let frames = report.frames.iter();
        lost += frames
            .map(|frame| u64::from(frame.stats.lost_tiles))
            .sum::<u64>();
        of_node += report.nodes[0].lost_tiles;
    }
    // Some may have been asked of another node before it was known.
    assert!(0 < lost && lost <= of_node, "{lost} of {of_node}");
}

#[test]
fn no_frame_is_lost_or_wrong_whatever_happens_to_the_nodes() {
    for seed in 0..5u64 {
        let chance = |what: u64| (seed * 7 + what * 13) % 11;
        let at = |what: u64| 0.5 + chance(what) as f64 * 0.2;
        let mut nodes = unequal();
        for node in &mut nodes {
            node.jitter_secs = 1e-3;
        }
        nodes[0] = nodes[0].clone().with(at(0), NodeChange::Silent);
        nodes[1] = nodes[1].clone().with(at(1), NodeChange::Slow(8.0));
        nodes[2] = nodes[2]
            .clone()
            .with(at(2), NodeChange::Die)
            .with(at(2) + 0.5, NodeChange::Join);
        nodes[2].changes.insert(0, (0.0, NodeChange::Join));
        nodes[3] = nodes[3].clone().with(at(3), NodeChange::Fail);
        nodes.push(NodePlan::new(1e-3, 1.0).with(at(4), NodeChange::Join));
        nodes[4].streams = false;
        for (index, balancing) in Balancing::all().enumerate() {
            checked(&FarmPlan {
                seed,
                frames_in_flight: 1 + index % 4,
                balancing,
                ..plan(nodes.clone(), WaterFilling, 60)
            });
        }
    }
}

#[test]
fn a_run_follows_from_its_seed() {
    let frames = |seed| {
        let plan = FarmPlan {
            seed,
            ..plan(unequal(), WaterFilling, 50)
        };
        checked(&plan)
            .frames
            .into_iter()
            .map(|frame| frame.stats)
            .collect::<Vec<_>>()
    };
    assert_eq!(frames(3), frames(3));
    assert_ne!(frames(3), frames(4));
}

#[test]
fn water_filling_is_near_the_ideal_and_equal_is_far_from_it() {
    let plan_of = |balancing: Balancing| FarmPlan {
        balancing,
        ..plan(unequal(), WaterFilling, 160)
    };
    let ideal = ideal_secs(&unequal(), plan_of(Equal.hedged()).size);
    let mean = |balancing| checked(&plan_of(balancing)).mean_secs(80..160) / ideal;
    let balancers = [
        Equal.unhedged(),
        Naive.unhedged(),
        Ab.unhedged(),
        WaterFilling.hedged(),
    ];
    let [equal, naive, ab, filling] = balancers.map(mean);
    println!("over the ideal: equal {equal:.2} naive {naive:.2} AB {ab:.2} filling {filling:.2}");
    assert!(filling < 1.15, "{filling}");
    assert!(filling < 0.5 * equal, "{filling} against {equal}");
    assert!(ab < 1.5, "{ab}");
    assert!(naive < 1.5, "{naive}");
}

#[test]
fn a_far_node_is_left_out_of_frames_that_are_over_before_it_answers() {
    let mut nodes = vec![NodePlan::new(1e-3, 4.0), NodePlan::new(1e-3, 4.0)];
    nodes.push(NodePlan::new(0.2, 40.0));
    let report = checked(&plan(nodes, WaterFilling, 100));
    let far: u32 = report.frames[50..]
        .iter()
        .map(|frame| frame.stats.tiles_by_node[2])
        .sum();
    assert_eq!(far, 0);
}

#[test]
fn duplicates_are_few_while_nothing_happens() {
    let report = checked(&plan(unequal(), WaterFilling, 300));
    let share = report.duplicate_share();
    println!("duplicates: {:.2} %", 100.0 * share);
    assert!(share < 0.02, "{share}");
}

#[test]
fn a_node_that_slows_down_is_given_less_within_ten_frames() {
    let mut nodes = unequal();
    let ideal_before = ideal_secs(&nodes, plan(Vec::new(), Equal, 0).size);
    nodes[0] = nodes[0].clone().with(2.0, NodeChange::Slow(4.0));
    let report = checked(&plan(nodes.clone(), WaterFilling, 200));
    nodes[0].msamples_per_sec /= 4.0;
    let ideal_after = ideal_secs(&nodes, plan(Vec::new(), Equal, 0).size);
    let slowed = |index: &usize| report.frames[*index].stats.makespan_secs > 1.5 * ideal_before;
    let change = (20..200).find(slowed).expect("the change shows");
    let after = report.mean_secs(change + 10..change + 40);
    assert!(after < 1.2 * ideal_after, "{after} against {ideal_after}");
}

#[test]
fn the_frame_in_which_a_node_vanishes_is_at_most_twice_as_long() {
    for change in [NodeChange::Die, NodeChange::Silent, NodeChange::Fail] {
        for victim in 0..3 {
            let mut nodes = unequal();
            nodes[victim] = nodes[victim].clone().with(2.0, change);
            if change == NodeChange::Die {
                nodes[victim].changes.insert(0, (0.0, NodeChange::Join));
            }
            let report = checked(&plan(nodes.clone(), WaterFilling, 150));
            nodes.remove(victim);
            let ideal_without = ideal_secs(&nodes, plan(Vec::new(), Equal, 0).size);
            let worst = report.worst_secs(20..150);
            println!("{change:?} of {victim}: worst {:.2}", worst / ideal_without);
            assert!(
                worst < 2.0 * ideal_without,
                "{change:?} of {victim}: {worst}"
            );
            let after = report.mean_secs(120..150);
            assert!(
                after < 1.2 * ideal_without,
                "{change:?} of {victim}: {after}"
            );
        }
    }
}

#[test]
fn a_node_that_joins_is_used_fully_within_ten_frames() {
    let mut nodes = unequal();
    nodes.push(NodePlan::new(1e-3, 8.0).with(2.0, NodeChange::Join));
    let report = checked(&plan(nodes.clone(), WaterFilling, 250));
    let joined = |frame: &carom_farm::Frame| frame.stats.tiles_by_node.get(5) > Some(&0);
    let first = report.frames.iter().position(joined).expect("it gets work");
    let ideal = ideal_secs(&nodes, plan(Vec::new(), Equal, 0).size);
    let after = report.mean_secs(first + 10..first + 40);
    assert!(after < 1.25 * ideal, "{after} against {ideal}");
}

/// A slow node is there at once, as the local one is, and one that is 100 times as fast joins when the
/// first frame has been asked for.
#[test]
fn a_slow_node_that_is_ready_first_keeps_no_frame() {
    for joins_secs in [0.0, 0.02, 0.1, 0.5] {
        let slow = NodePlan::new(1e-4, 0.02);
        let fast = NodePlan::new(1e-3, 2.0).with(SUBMITTED_SECS + joins_secs, NodeChange::Join);
        let plan = plan(vec![slow.clone(), fast.clone()], WaterFilling, 3);
        let report = checked(&plan);
        // Nobody could do better than the fast node alone, once it is there, and the slow one.
        let alone = joins_secs + ideal_secs(&[slow, fast], plan.size);
        let first = report.frames[0].stats.makespan_secs;
        assert!(
            first <= 2.0 * alone,
            "{first} s, of {alone}, joining after {joins_secs}"
        );
    }
}

/// Eight equal nodes of unknown speed that are ready one after the other.
#[test]
fn equal_nodes_begin_with_few_tiles_asked_for_again() {
    let node = |index: u32| {
        NodePlan {
            jitter_secs: 1e-4,
            ..NodePlan::new(1e-3, 0.2)
        }
        .with(f64::from(index) * 0.02, NodeChange::Join)
    };
    let plan = plan((0..8).map(node).collect(), WaterFilling, 24);
    let report = checked(&plan);
    let reissued = report.frames.iter().map(|frame| frame.stats.reissued_tiles);
    let reissued: u32 = reissued.sum();
    assert!(reissued < report.tiles_per_frame * 24, "{reissued} tiles");
    let first: u32 = report.frames[0].stats.reissued_tiles;
    assert!(
        first < report.tiles_per_frame,
        "{first} of {} tiles",
        report.tiles_per_frame
    );
}

#[test]
fn the_only_node_is_waited_for_however_slow_it_gets() {
    let node = NodePlan::new(1e-3, 1.0).with(0.7, NodeChange::Slow(200.0));
    let report = checked(&plan(vec![node], WaterFilling, 12));
    let reissued = report.frames.iter().map(|frame| frame.stats.reissued_tiles);
    assert_eq!(reissued.sum::<u32>(), 0, "nobody else has them");
}

/// As the machine itself where it is used for something else besides.
#[test]
fn the_only_node_is_asked_for_no_tile_again() {
    let node = (0..40).fold(NodePlan::new(1e-4, 1.0), |node, step| {
        let slower = if step % 2 == 0 { 4.0 } else { 0.25 };
        node.with(0.7 + 0.05 * f64::from(step), NodeChange::Slow(slower))
    });
    for frames_in_flight in [1, 4] {
        let report = checked(&FarmPlan {
            frames_in_flight,
            ..plan(vec![node.clone()], WaterFilling, 60)
        });
        let reissued = report.frames.iter().map(|frame| frame.stats.reissued_tiles);
        assert_eq!(reissued.sum::<u32>(), 0, "{frames_in_flight} in flight");
    }
}

#[test]
fn a_node_that_claims_to_be_quick_does_not_delay_frames() {
    let mut nodes = unequal();
    nodes[3].honesty = 0.0;
    nodes[4].honesty = 0.0;
    let ideal = ideal_secs(&nodes, plan(Vec::new(), Equal, 0).size);
    let mean = checked(&plan(nodes, WaterFilling, 150)).mean_secs(50..150);
    assert!(mean < 1.3 * ideal, "{mean} against {ideal}");
}

#[test]
fn pipelined_frames_keep_up_with_a_period_that_the_farm_can_hold() {
    // 38,400 samples each 1/60 s are 2.3 million a second, of the 3.35 million that there are;
    // the round trip of 40 ms is longer than two periods.
    let mut nodes = unequal();
    for node in &mut nodes {
        node.round_trip_secs = 0.04;
    }
    let report = checked(&FarmPlan {
        frames_in_flight: 6,
        period_secs: Some(1.0 / 60.0),
        ..plan(nodes, WaterFilling, 400)
    });
    let late = report.worst_secs(100..400);
    assert!(late < 6.0 / 60.0, "{late}");
}

#[test]
fn a_farm_without_any_answer_waits_and_says_why() {
    let node = NodePlan::new(1e-3, 1.0).with(0.51, NodeChange::Silent);
    let report = run(&plan(vec![node], WaterFilling, 100), 60.0);
    assert!(report.frames.len() < 100 && report.wrong_frames == 0);
    assert!(
        matches!(report.nodes[0].state, NodeState::Lost { .. }),
        "{:?}",
        report.nodes
    );
    let absent = NodePlan::new(1e-3, 1.0).with(FOREVER, NodeChange::Join);
    let report = run(&plan(vec![absent], WaterFilling, 1), 60.0);
    assert!(report.frames.is_empty());
    assert_eq!(report.nodes[0].state, NodeState::Starting);
}
