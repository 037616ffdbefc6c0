//! Scale of a registry: messages, bytes and CPU time of nodes that register in a NATS server and of a farm that
//! watches them. `.ci/registry-scale 1000` starts a server and runs this.

use std::error::Error;
use std::time::{Duration, Instant};

use carom_farm::directory::{
    Directory, NatsBucket, NatsDirectory, NatsRegistry, NodeRecord, Registry as _,
};
use carom_farm::health::http_get;

type Failure = Box<dyn Error + Send + Sync>;

/// Counters of the server.
#[derive(Clone, Copy)]
struct ServerCount {
    messages: f64,
    bytes: f64,
    cpu_secs: f64,
}

impl ServerCount {
    /// By the server's monitoring port, and by the system (proc(5): `utime` and `stime` in hundredths).
    fn now(monitor: &str, process: u32) -> Result<Self, Failure> {
        let text = http_get(&format!("{monitor}/varz"), Duration::from_secs(5))?;
        let counts: serde_json::Value = serde_json::from_str(&text)?;
        let sum = |names: [&str; 2]| names.iter().filter_map(|name| counts[name].as_f64()).sum();
        let stat = std::fs::read_to_string(format!("/proc/{process}/stat"))?;
        let after_name = stat.rsplit(')').next().unwrap_or_default();
        let ticks = after_name.split_whitespace().skip(11).take(2);
        let ticks: f64 = ticks.filter_map(|it| it.parse::<f64>().ok()).sum();
        Ok(Self {
            messages: sum(["in_msgs", "out_msgs"]),
            bytes: sum(["in_bytes", "out_bytes"]),
            cpu_secs: ticks / 100.0,
        })
    }
}

/// Registers nodes from `first` on, every `step`th, each in its own connection, until `end`.
fn register(bucket: &NatsBucket, nodes: Vec<usize>, end: Instant) -> Result<(), Failure> {
    let registry = |_: &usize| NatsRegistry::new(bucket.clone());
    let mut registries: Vec<NatsRegistry> = nodes.iter().map(registry).collect::<Result<_, _>>()?;
    let period = registries[0].period();
    let mut due = Instant::now();
    while Instant::now() < end {
        for (place, (node, registry)) in nodes.iter().zip(&mut registries).enumerate() {
            let at = due + period.mul_f64(place as f64 / nodes.len() as f64);
            std::thread::sleep(at.saturating_duration_since(Instant::now()));
            registry.register(&NodeRecord {
                address: format!("10.{}.{}.{}:4433", node >> 16, node >> 8 & 255, node & 255),
                fingerprint: "0123456789abcdef0123456789abcdef".into(),
                device: "NVIDIA L4".into(),
                msamples_per_sec: 120.0,
                ..NodeRecord::default()
            })?;
        }
        due += period;
    }
    Ok(())
}

fn main() -> Result<(), Failure> {
    let usage = "registry_scale NATS-URL MONITOR-URL SERVER-PROCESS NODES";
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [url, monitor, process, nodes] = &args[..] else {
        return Err(usage.into());
    };
    let (bucket, process, nodes): (NatsBucket, u32, usize) =
        (url.parse()?, process.parse()?, nodes.parse()?);
    let end = Instant::now() + FILLING + WINDOW;
    let threads: Vec<_> = (0..THREADS)
        .map(|first| (first..nodes).step_by(THREADS).collect::<Vec<_>>())
        .filter(|nodes| !nodes.is_empty())
        .map(|nodes| {
            let bucket = bucket.clone();
            std::thread::spawn(move || register(&bucket, nodes, end))
        })
        .collect();
    let mut directory = NatsDirectory::new(bucket)?;
    std::thread::sleep(FILLING);
    let asked = Instant::now();
    let listed = directory.nodes()?.len();
    println!(
        "{listed} of {nodes} nodes listed {:.0} ms after a farm asks first",
        1e3 * asked.elapsed().as_secs_f64()
    );
    let (before, begun) = (ServerCount::now(monitor, process)?, Instant::now());
    std::thread::sleep(end.saturating_duration_since(begun));
    let after = ServerCount::now(monitor, process)?;
    let secs = begun.elapsed().as_secs_f64();
    println!(
        "the server: {:.0} messages/s, {:.0} kB/s, {:.3} CPU s/s",
        (after.messages - before.messages) / secs,
        1e-3 * (after.bytes - before.bytes) / secs,
        (after.cpu_secs - before.cpu_secs) / secs
    );
    for thread in threads {
        thread.join().map_err(|_| "a registrant has failed")??;
    }
    let (died, mut left) = (Instant::now(), listed);
    while left > 0 && died.elapsed() < Duration::from_secs(60) {
        std::thread::sleep(directory.period());
        left = directory.nodes()?.len();
    }
    println!(
        "{left} nodes listed {:.0} s after all have died",
        died.elapsed().as_secs_f64()
    );
    if listed < nodes || left > 0 {
        return Err("the directory does not list who is there".into());
    }
    Ok(())
}

/// Threads that register: each waits for the server's answers.
const THREADS: usize = 16;
/// Until all have connected and registered.
const FILLING: Duration = Duration::from_secs(15);
/// Duration of the measurement.
const WINDOW: Duration = Duration::from_secs(20);
