//! Programs for nodes by architecture, and the bucket from which machines download them.

use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use super::stack::Stack;
use crate::commands::Failure;

/// Instruction set architecture of a machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Architecture {
    X86,
    Arm,
}

/// A `carom-farm` program for Linux.
pub(super) struct NodeProgram {
    path: PathBuf,
    pub(super) architecture: Architecture,
}

impl NodeProgram {
    /// Opens the programs at `paths`, or this one if there are none.
    ///
    /// # Errors
    /// If one is not a program for Linux, or two are for one architecture.
    pub(super) fn open(paths: &[PathBuf]) -> Result<Vec<Self>, Failure> {
        let own = || {
            std::env::current_exe().map_err(|why| Failure::Input(format!("this program: {why}")))
        };
        let paths = match paths {
            [] => vec![own()?],
            paths => paths.to_vec(),
        };
        let mut programs: Vec<Self> = Vec::new();
        for path in paths {
            let architecture = architecture(&path)
                .map_err(|why| Failure::Input(format!("--program {}: {why}", path.display())))?;
            if programs
                .iter()
                .any(|program| program.architecture == architecture)
            {
                return Err(Failure::Input(format!(
                    "--program {}: another program for the same architecture is named",
                    path.display()
                )));
            }
            programs.push(Self { path, architecture });
        }
        Ok(programs)
    }

    /// The value of the template's parameter `Architectures`.
    pub(super) fn parameter(programs: &[Self]) -> &'static str {
        match programs {
            [
                Self {
                    architecture: Architecture::X86,
                    ..
                },
            ] => "x86_64",
            [
                Self {
                    architecture: Architecture::Arm,
                    ..
                },
            ] => "arm64",
            _ => "both",
        }
    }

    /// Uploads the programs, their systemd unit and the setup script to the stack's bucket.
    pub(super) fn upload(programs: &[Self], stack: &Stack) -> Result<(), Failure> {
        let bucket = stack.output("Bucket")?.unwrap_or_default();
        for Self { path, architecture } in programs {
            let name = match architecture {
                Architecture::X86 => "carom-farm-x86_64",
                Architecture::Arm => "carom-farm-aarch64",
            };
            let to = format!("s3://{bucket}/{name}");
            let from = path.display().to_string();
            stack
                .aws
                .done(&["s3", "cp", "--only-show-errors", &from, &to])?;
        }
        for (name, text) in [("carom-farm.service", UNIT), ("node-setup.sh", SETUP)] {
            let to = format!("s3://{bucket}/{name}");
            stack
                .aws
                .done_with(&["s3", "cp", "--only-show-errors", "-", &to], text)?;
        }
        Ok(())
    }
}

/// The systemd unit of nodes.
const UNIT: &str = include_str!("../../../deploy/systemd/carom-farm.service");
/// The script that sets a machine up as a node.
const SETUP: &str = include_str!("../../../deploy/aws/node-setup.sh");

/// The architecture in an ELF header (System V ABI): `e_machine` is 62 for x86-64 and 183 for AArch64.
fn architecture(path: &Path) -> Result<Architecture, String> {
    let mut head = [0; 20];
    File::open(path)
        .and_then(|mut file| file.read_exact(&mut head))
        .map_err(|why| why.to_string())?;
    let is_elf = head.starts_with(b"\x7fELF");
    match u16::from_le_bytes([head[18], head[19]]) {
        62 if is_elf => Ok(Architecture::X86),
        183 if is_elf => Ok(Architecture::Arm),
        _ => Err("this is no program for Linux on x86-64 or arm64".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn program(folder: &Path, name: &str, machine: u8) -> PathBuf {
        let mut head = [0; 64];
        head[..4].copy_from_slice(b"\x7fELF");
        head[18] = machine;
        let path = folder.join(name);
        std::fs::write(&path, head).unwrap();
        path
    }

    #[test]
    fn architectures_are_read_from_programs() {
        let folder = tempfile::tempdir().unwrap();
        let [x86, arm, other] = [("x86", 62), ("arm", 183), ("s390", 22)]
            .map(|(name, machine)| program(folder.path(), name, machine));
        let both = NodeProgram::open(&[x86.clone(), arm]).unwrap();
        assert_eq!(NodeProgram::parameter(&both), "both");
        assert_eq!(NodeProgram::parameter(&both[1..]), "arm64");
        assert_eq!(NodeProgram::parameter(&both[..1]), "x86_64");
        for paths in [
            vec![other],
            vec![x86.clone(), x86],
            vec![folder.path().join("absent")],
        ] {
            assert!(matches!(NodeProgram::open(&paths), Err(Failure::Input(_))));
        }
    }
}
