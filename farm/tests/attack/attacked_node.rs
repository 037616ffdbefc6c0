//! A node as a process of its own, and what the system says of it.

use std::io::{BufRead, BufReader};
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use tempfile::TempDir;

/// A `carom-farm node` of a farm of its own; killed when dropped.
pub(crate) struct AttackedNode {
    child: Child,
    pub(crate) folder: TempDir,
    pub(crate) address: String,
    /// Where the farm's player believes another node to be.
    pub(crate) rogue_address: String,
    /// The farm's authority, if it admits nodes.
    enrolment: Option<Child>,
}

/// What a process has of the system.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Resources {
    /// The most memory that it has had so far, in MiB.
    pub(crate) memory_mib: u64,
    pub(crate) descriptors: usize,
    pub(crate) threads: u64,
}

impl AttackedNode {
    pub(crate) fn start() -> Self {
        Self::start_with("unlimited", &[])
    }

    /// A node that may open so many files, as `ulimit -n` has it.
    pub(crate) fn start_limited(descriptors: &str) -> Self {
        Self::start_with(descriptors, &[])
    }

    /// A node that keeps little memory for scenes: a player may have half of it.
    pub(crate) fn start_small() -> Self {
        Self::start_with("unlimited", &["--scene-memory", "96"])
    }

    /// A node beside an authority that admits others, whose address is in the file `enrolment`.
    pub(crate) fn start_with_enrolment() -> Self {
        let mut node = Self::start();
        let mut child = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
            .args(["token", "--listen", "127.0.0.1:0", "--host", "127.0.0.1"])
            .current_dir(node.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let url = lines
            .by_ref()
            .map(Result::unwrap)
            .find_map(|line| Some(line.strip_prefix("carom-farm join farm://")?.to_owned()))
            .expect("a token");
        std::thread::spawn(move || lines.for_each(drop));
        let (address, _) = url.split_once('#').expect("a token behind the address");
        std::fs::write(node.path().join("enrolment"), address).unwrap();
        node.enrolment = Some(child);
        node
    }

    fn start_with(descriptors: &str, options: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        carom_farm(folder.path(), &["init"]);
        carom_farm(folder.path(), &["add-node", "oak"]);
        carom_farm(folder.path(), &["add-node", "birch"]);
        carom_farm(folder.path(), &["add-player", "mallory"]);
        // Core dumps are the node's own business, whatever its user's limits.
        let limit = match descriptors {
            "unlimited" => "ulimit -c unlimited; ".to_owned(),
            most => format!("ulimit -n {most}; "),
        };
        let mut child = Command::new("sh")
            .args(["-c", &format!("{limit}exec \"$0\" \"$@\" 2>node.log")])
            .arg(env!("CARGO_BIN_EXE_carom-farm"))
            .args(["node", "--listen", "127.0.0.1:0", "--backend", "cpu"])
            .args(["--threads", "1", "--credentials", ".carom/nodes/oak"])
            .args(["--asset-cache", "assets"])
            .args(options)
            .current_dir(folder.path())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let said = |line: &String| line.starts_with("listening");
        let listening = lines.by_ref().map(Result::unwrap).find(said);
        let listening = listening.expect("the node listens");
        let address = listening.rsplit(' ').next().unwrap().to_owned();
        std::thread::spawn(move || lines.for_each(drop));
        let free = UdpSocket::bind("127.0.0.1:0").unwrap();
        let rogue_address = free.local_addr().unwrap().to_string();
        Self {
            child,
            folder,
            address,
            rogue_address,
            enrolment: None,
        }
    }

    pub(crate) fn path(&self) -> &Path {
        self.folder.path()
    }

    /// What the node has written to its log.
    pub(crate) fn log(&self) -> String {
        std::fs::read_to_string(self.path().join("node.log")).unwrap()
    }

    /// Its environment, as others of its user see it.
    pub(crate) fn environment(&self) -> String {
        let bytes = std::fs::read(format!("/proc/{}/environ", self.child.id()));
        String::from_utf8_lossy(&bytes.unwrap_or_default()).into_owned()
    }

    /// The most bytes of a core dump of it.
    pub(crate) fn core_bytes_max(&self) -> u64 {
        let limits = std::fs::read_to_string(format!("/proc/{}/limits", self.child.id())).unwrap();
        let mut lines = limits.lines();
        let line = lines
            .find(|line| line.starts_with("Max core file size"))
            .unwrap();
        let soft = line.split_whitespace().nth(4).unwrap();
        soft.parse().unwrap_or(u64::MAX)
    }

    /// What it has now.
    ///
    /// # Panics
    /// If it has ended.
    pub(crate) fn resources(&mut self) -> Resources {
        assert_eq!(self.child.try_wait().unwrap(), None, "{}", self.log());
        let process = format!("/proc/{}", self.child.id());
        let status = std::fs::read_to_string(format!("{process}/status")).unwrap();
        let field = |name: &str| -> u64 {
            let line = status.lines().find(|line| line.starts_with(name)).unwrap();
            line.split_whitespace().nth(1).unwrap().parse().unwrap()
        };
        Resources {
            memory_mib: field("VmHWM:") >> 10,
            descriptors: std::fs::read_dir(format!("{process}/fd")).unwrap().count(),
            threads: field("Threads:"),
        }
    }

    /// Stops it, or lets it go on.
    pub(crate) fn signal(&self, signal: &str) {
        let pid = self.child.id().to_string();
        assert!(
            Command::new("kill")
                .args([signal, &pid])
                .status()
                .unwrap()
                .success()
        );
    }
}

impl Drop for AttackedNode {
    fn drop(&mut self) {
        for child in self.enrolment.iter_mut().chain([&mut self.child]) {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn carom_farm(folder: &Path, args: &[&str]) {
    let output = Command::new(env!("CARGO_BIN_EXE_carom-farm"))
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{args:?}: {output:?}");
}
