//! `carom-farm cloud up`: creates a farm on EC2, from the price estimate to nodes that have joined.

use std::net::{Ipv4Addr, SocketAddr};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, anyhow};
use carom_farm::health::http_get;
use carom_farm::net::{self, EnrolmentEvent, EnrolmentService, JoinUrl, NodeAddress};

use super::inventory::write_nodes;
use super::plan::Plan;
use super::programs::{Architecture, NodeProgram};
use super::stack::{Machine, Stack, list, text};
use super::{NodesFile, StackArgs, confirm};
use crate::commands::authority::AuthorityArgs;
use crate::commands::{Failure, authority, inputs};

/// Show what a farm on EC2 costs, create it, and admit its nodes
///
/// Machines are spot instances, of the types that are cheapest and likeliest to stay; each ends when it has been idle, and all at
/// the end of --for. Run again, it changes the number of machines. Nodes join at this machine by UDP port 4434, which must be
/// reachable at --host.
#[derive(clap::Args)]
pub(super) struct UpArgs {
    #[command(flatten)]
    stack: StackArgs,
    #[command(flatten)]
    authority: AuthorityArgs,
    /// Run this many machines with a GPU
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(..=500))]
    gpu: u32,
    /// Run this many machines with 16 CPU threads
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=500))]
    cpu: u32,
    /// Keep this share of them, in per cent, as machines on demand, which EC2 does not take back
    #[arg(long, default_value_t = 0, value_name = "PERCENT", value_parser = clap::value_parser!(u32).range(..=100))]
    on_demand: u32,
    /// End all machines after this time: 30m, 8h, 2d
    #[arg(long = "for", default_value = "8h", value_parser = inputs::duration)]
    time: Duration,
    /// End a machine that has had no work for this many minutes
    #[arg(long, default_value_t = 30, value_name = "MINUTES", value_parser = clap::value_parser!(u32).range(5..))]
    idle_minutes: u32,
    /// Run this program carom-farm for Linux; repeat for both x86-64 and arm64 [default: this one]
    #[arg(long, value_name = "FILE")]
    program: Vec<PathBuf>,
    /// Let only this address reach the nodes [default: that of this machine on the internet, as checkip.amazonaws.com sees it]
    #[arg(long)]
    player: Option<Ipv4Addr>,
    /// Listen for nodes that join on this address
    #[arg(long, default_value = "0.0.0.0:4434", value_name = "HOST:PORT", value_parser = inputs::listen_address)]
    listen: SocketAddr,
    /// Tell nodes this name or address of this machine [default: as --player]
    #[arg(long)]
    host: Option<String>,
    /// Let nodes join at another machine, by what `carom-farm token` prints there
    #[arg(long, value_name = "URL", conflicts_with_all = ["listen", "host", "dir"])]
    join: Option<JoinUrl>,
    /// Stay until all machines end, admit those that come in place of spot instances that were taken back, and keep
    /// --nodes-file up to date
    #[arg(long)]
    stay: bool,
    /// Wait this long for nodes to join
    #[arg(long, default_value = "20m", value_parser = inputs::duration)]
    wait: Duration,
    /// Tell this address by mail when the account's month costs half of --budget-dollars, or is going to cost all of it
    #[arg(long, value_name = "ADDRESS")]
    alarm_email: Option<String>,
    /// The budget of the account's month
    #[arg(long, default_value_t = 50, value_name = "DOLLARS", value_parser = clap::value_parser!(u32).range(1..))]
    budget_dollars: u32,
    #[command(flatten)]
    nodes: NodesFile,
    /// Do not ask
    #[arg(long)]
    yes: bool,
}

pub(super) fn run(args: &UpArgs) -> Result<(), Failure> {
    let programs = NodeProgram::open(&args.program)?;
    let stack = args.stack.open();
    let account = stack.aws.json(&["sts", "get-caller-identity"])?;
    let end = SystemTime::now() + args.time;
    println!(
        "Farm {} in the account {}:",
        stack.name,
        text(&account["Account"])
    );
    show_price(args, &programs, &stack)?;
    let player = args.player.map_or_else(own_address, Ok)?;
    println!(
        "  all machines end at {}; only {player} reaches the nodes",
        net::utc(end)
    );
    if args.alarm_email.is_none() {
        println!("  no budget alarm: --alarm-email ADDRESS sets one");
    }
    confirm("Go on?", args.yes)?;
    let new_nodes = new_nodes(args, &stack.machines()?);
    let enrolment = Enrolment::open(args, player, new_nodes)?;
    println!("Creating it: this takes some minutes.");
    stack.apply(&parameters(
        args,
        &programs,
        &stack,
        player,
        end,
        &enrolment.url,
    )?)?;
    NodeProgram::upload(&programs, &stack)?;
    if enrolment.is_open() {
        println!("Waiting for {new_nodes} nodes to join.");
    }
    let absent = enrolment.wait(new_nodes);
    write_nodes(&args.nodes.nodes_file, &stack.machines()?)?;
    let name = &stack.name;
    if absent > 0 {
        return Err(anyhow!(
            "{absent} of {new_nodes} nodes have not joined: see `carom-farm cloud logs --name {name}`; the \
             machines go on and cost: `carom-farm cloud down --name {name}`"
        )
        .into());
    }
    println!(
        "Next: carom --node file:{}",
        args.nodes.nodes_file.display()
    );
    println!("Later: carom-farm cloud down --name {name}");
    while args.stay && enrolment.is_open() {
        thread::sleep(STAY_PERIOD);
        match stack.machines() {
            Ok(machines) => write_nodes(&args.nodes.nodes_file, &machines)?,
            Err(why) => eprintln!("carom-farm: {why}"), // asked again
        }
    }
    Ok(())
}

fn show_price(args: &UpArgs, programs: &[NodeProgram], stack: &Stack) -> Result<(), Failure> {
    let architectures: Vec<Architecture> = programs.iter().map(|it| it.architecture).collect();
    let plan = Plan {
        gpu_nodes: args.gpu,
        cpu_nodes: args.cpu,
        on_demand_percent: args.on_demand,
        architectures: &architectures,
        hours: args.time.as_secs_f64() / 3600.0,
    };
    let spot = plan.spot_prices(&stack.aws, &net::utc(SystemTime::now()))?;
    println!("{}", plan.price(&spot));
    Ok(())
}

/// The number of machines that will be added to the existing ones.
fn new_nodes(args: &UpArgs, machines: &[Machine]) -> u32 {
    let missing = |group, wanted: u32| {
        let there = machines.iter().filter(|machine| machine.is_of(group));
        wanted.saturating_sub(there.count() as u32)
    };
    missing("GpuGroup", args.gpu) + missing("CpuGroup", args.cpu)
}

/// This machine's public address.
fn own_address() -> Result<Ipv4Addr, Failure> {
    let told = http_get("http://checkip.amazonaws.com/", Duration::from_secs(5));
    let address = told.ok().and_then(|text| text.trim().parse().ok());
    address.ok_or_else(|| {
        Failure::Input(
            "this machine's address on the internet is not known: name it with --player".into(),
        )
    })
}

/// The values of the template's parameters.
fn parameters(
    args: &UpArgs,
    programs: &[NodeProgram],
    stack: &Stack,
    player: Ipv4Addr,
    end: SystemTime,
    url: &JoinUrl,
) -> Result<Vec<(&'static str, String)>, Failure> {
    let filter = ["--filters", "Name=default-for-az,Values=true"];
    let subnets = stack
        .aws
        .json(&[&["ec2", "describe-subnets"], &filter[..]].concat())?;
    let subnets: Vec<_> = list(&subnets["Subnets"]).collect();
    let Some(first) = subnets.first() else {
        return Err(Failure::Input(
            "this region has no default network: run `aws ec2 create-default-vpc`, or name another --region".into(),
        ));
    };
    let ids: Vec<String> = subnets.iter().map(|it| text(&it["SubnetId"])).collect();
    Ok(vec![
        ("Vpc", text(&first["VpcId"])),
        ("Subnets", ids.join(",")),
        ("PlayerCidr", format!("{player}/32")),
        ("JoinUrl", url.to_string()),
        ("GpuNodes", args.gpu.to_string()),
        ("CpuNodes", args.cpu.to_string()),
        ("OnDemandPercent", args.on_demand.to_string()),
        ("Architectures", NodeProgram::parameter(programs).to_owned()),
        ("IdleExit", format!("{}m", args.idle_minutes)),
        ("EndTime", net::utc(end)),
        ("AlarmEmail", args.alarm_email.clone().unwrap_or_default()),
        ("BudgetDollars", args.budget_dollars.to_string()),
    ])
}

/// Enrolment of the nodes, by a service here or by another authority.
struct Enrolment {
    url: JoinUrl,
    /// Thread of the service, which ends with the last use, after its time, or by Ctrl-C.
    service: Option<thread::JoinHandle<()>>,
    joined: Arc<AtomicU32>,
}

impl Enrolment {
    fn open(args: &UpArgs, player: Ipv4Addr, nodes: u32) -> Result<Self, Failure> {
        let joined = Arc::new(AtomicU32::new(0));
        if let Some(url) = args.join.clone() {
            return Ok(Self {
                url,
                service: None,
                joined,
            });
        }
        let (uses, time) = match args.stay {
            true => (USES_MAX, args.time),
            false => (nodes, args.wait),
        };
        let folder = authority::open(&args.authority)?;
        let host = args.host.clone().unwrap_or_else(|| player.to_string());
        let address: NodeAddress = format!("{host}:{}", args.listen.port().max(1)).parse()?;
        let (service, url) = EnrolmentService::bind(args.listen, folder, address, uses)?;
        let count = Arc::clone(&joined);
        let serve = move || {
            service.serve(time, move |event| match event {
                EnrolmentEvent::Joined { name, .. } => {
                    count.fetch_add(1, Ordering::Relaxed);
                    println!("joined: {name}");
                }
                EnrolmentEvent::Renewed { name } => println!("renewed: {name}"),
                EnrolmentEvent::Refused { from, why } => eprintln!("refused {from}: {why}"),
            });
        };
        let service = (uses > 0).then(|| thread::Builder::new().spawn(serve));
        let service = service
            .transpose()
            .context("a thread for nodes that join")?;
        Ok(Self {
            url,
            service,
            joined,
        })
    }

    fn is_open(&self) -> bool {
        self.service.as_ref().is_some_and(|it| !it.is_finished())
    }

    /// Waits until all nodes have joined or the service has ended; returns how many have not joined, 0 if
    /// another authority admits them.
    fn wait(&self, nodes: u32) -> u32 {
        let absent = || nodes.saturating_sub(self.joined.load(Ordering::Relaxed));
        while absent() > 0 && self.is_open() {
            thread::sleep(WAIT_PERIOD);
        }
        if self.service.is_some() { absent() } else { 0 }
    }
}

/// Period of checking for nodes that have joined.
const WAIT_PERIOD: Duration = Duration::from_millis(100);
/// Period of listing the machines while the command stays.
const STAY_PERIOD: Duration = Duration::from_secs(10);
/// Number of machines that may join while it stays.
const USES_MAX: u32 = 10_000;
