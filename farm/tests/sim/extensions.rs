//! Laws of the examples' own balancer, directory and tracer, in the simulator.

#![expect(
    dead_code,
    unreachable_pub,
    reason = "the examples are programs of their own: their `main` is not called here"
)]

use std::sync::Arc;
use std::time::Duration;

use carom_farm::directory::{Directory, ListedNode};
use carom_farm::{Algorithm, NodeState};
use carom_testkit::simulator::{
    Extensions, FarmPlan, NodePlan, SimulationReport, node_address, run, run_with,
};
use carom_tracer::{CpuTracer, ImageSize};

use super::{SECS_MAX, plan, unequal};

#[path = "../../examples/own_balancer.rs"]
mod own_balancer;
#[path = "../../examples/own_directory.rs"]
mod own_directory;
#[path = "../../examples/own_tracer.rs"]
mod own_tracer;

fn tiles(report: &SimulationReport) -> Vec<u64> {
    report.nodes.iter().map(|node| node.tiles).collect()
}

#[test]
fn the_own_balancer_learns_speeds() {
    let plan = plan(unequal(), Algorithm::Own, 60);
    let balancer = Some(Box::new(own_balancer::MyBalancer::default()) as Box<_>);
    let extensions = Extensions {
        balancer,
        ..Extensions::default()
    };
    let own = run_with(&plan, SECS_MAX, extensions);
    let equal = super::plan(unequal(), Algorithm::Equal, 60);
    let equal = run(&equal, SECS_MAX);
    assert_eq!(own.wrong_frames, 0);
    let [own, equal] = [own, equal].map(|report| report.mean_secs(30..60));
    println!("equal shares {equal:.3} s, own {own:.3} s");
    assert!(own < 0.5 * equal, "{own} {equal}");
}

#[test]
fn the_own_directory_says_who_traces() {
    let folder = tempfile::tempdir().unwrap();
    let listed = [1, 3];
    for index in listed {
        let file = folder.path().join(format!("machine-{index}"));
        std::fs::write(file, node_address(index)).unwrap();
    }
    let folder = folder.path().to_owned();
    let directory = Some(Box::new(own_directory::MyDirectory { folder }) as Box<_>);
    let extensions = Extensions {
        directory,
        ..Extensions::default()
    };
    let report = run_with(&equal_nodes(5), SECS_MAX, extensions);
    assert_eq!((report.frames.len(), report.wrong_frames), (60, 0));
    for (index, tiles) in tiles(&report).into_iter().enumerate() {
        assert_eq!(tiles > 0, listed.contains(&index), "node {index}: {tiles}");
    }
}

/// Lists one node more each time it is asked.
struct Growing(usize);

impl Directory for Growing {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, carom_farm::Error> {
        self.0 += 1;
        let addresses = (0..self.0).map(|index| node_address(index).parse());
        addresses
            .map(|address| address.map(ListedNode::at))
            .collect()
    }

    fn period(&self) -> Duration {
        Duration::from_secs(1)
    }
}

#[test]
fn nodes_that_a_directory_lists_later_take_their_share() {
    let plan = FarmPlan {
        frames: 200,
        ..equal_nodes(3)
    };
    let extensions = Extensions {
        directory: Some(Box::new(Growing(0))),
        ..Extensions::default()
    };
    let report = run_with(&plan, SECS_MAX, extensions);
    // In the first half second of the frames there is one.
    let alone = report.frames[4].stats.makespan_secs;
    let together = report.mean_secs(190..200);
    assert!(together < 0.4 * alone, "{together} of {alone} s");
    let idle = |state: &NodeState| matches!(state, NodeState::Starting);
    assert!(!report.nodes.iter().any(|node| idle(&node.state)));
}

#[test]
fn the_own_tracer_gives_one_picture_however_it_is_divided() {
    let plan = FarmPlan {
        size: ImageSize::new(48, 32),
        samples: 4,
        ..equal_nodes(3)
    };
    let device = CpuTracer::new().unwrap();
    let tracer = Arc::new(own_tracer::MyTracer { device });
    let extensions = Extensions {
        tracer: Some(tracer),
        ..Extensions::default()
    };
    let report = run_with(&plan, SECS_MAX, extensions);
    assert_eq!((report.frames.len(), report.wrong_frames), (60, 0));
    assert!(tiles(&report).iter().all(|tiles| *tiles > 0));
}

fn equal_nodes(count: usize) -> FarmPlan {
    plan(
        vec![NodePlan::new(1e-3, 0.5); count],
        Algorithm::WaterFilling,
        60,
    )
}
