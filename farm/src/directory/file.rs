//! Directory in a file with a node per line, which is reread while the farm runs.

use std::fmt::Display;
use std::path::PathBuf;
use std::time::Duration;

use carom_protocol::limits::DIRECTORY_FILE_BYTES_MAX;
use carom_tracer::text::printable;

use super::{Directory, ListedNode};
use crate::Error;
use crate::whole_file::read_limited;

/// Directory in a file of `host:port` lines; empty lines and text after a `#` are ignored.
#[derive(Clone, Debug)]
pub struct FileDirectory {
    path: PathBuf,
}

impl FileDirectory {
    /// The nodes in a file, which need not exist yet.
    pub const fn new(path: PathBuf) -> Self {
        Self { path }
    }

    fn fault(&self, why: impl Display) -> Error {
        Error::directory(format_args!("file:{}", self.path.display()), why)
    }
}

impl Directory for FileDirectory {
    /// All lines or none, since a file that is being written may end within an address.
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        let text = read_limited(&self.path, DIRECTORY_FILE_BYTES_MAX);
        let text = text.map_err(|why| self.fault(why))?;
        let mut nodes = Vec::new();
        for (number, line) in text.lines().enumerate() {
            let line = line.split('#').next().unwrap_or_default().trim();
            if line.is_empty() {
                continue;
            }
            let address = line.parse().map_err(|why: Error| {
                let why = printable(&why.to_string(), REASON_BYTES_MAX);
                self.fault(format!("line {}: {why}", number + 1))
            })?;
            nodes.push(ListedNode::at(address));
        }
        Ok(nodes)
    }

    fn period(&self) -> Duration {
        PERIOD
    }
}

/// Period of reads: a short file takes some microseconds, and a second is soon enough for a person.
const PERIOD: Duration = Duration::from_secs(1);
/// Maximum bytes of a wrong line's fault in an error.
const REASON_BYTES_MAX: usize = 200;

#[cfg(test)]
mod tests {
    use super::*;

    fn listed(text: &[u8]) -> Result<Vec<String>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("nodes.txt");
        std::fs::write(&path, text).unwrap();
        let nodes = FileDirectory::new(path).nodes();
        let texts = |nodes: Vec<ListedNode>| {
            let texts = nodes.iter().map(|node| node.address.to_string());
            texts.collect()
        };
        nodes.map(texts).map_err(|why| why.to_string())
    }

    #[test]
    fn lines_are_nodes_and_the_rest_is_comment() {
        let text = b"# the hall\noak:4433\n\n  10.0.0.7:4433 # a GPU\n[::1]:1";
        let nodes = ["oak:4433", "10.0.0.7:4433", "[::1]:1"];
        assert_eq!(listed(text).unwrap(), nodes);
        assert!(listed(b"").unwrap().is_empty());
    }

    #[test]
    fn a_wrong_line_is_named_and_nothing_of_the_file_is_taken() {
        let why = listed(b"oak:4433\nel\x1b[2Jm\n").unwrap_err();
        assert!(why.contains("nodes.txt: line 2: "), "{why}");
        assert!(!why.contains(char::is_control), "{why}");
        let long = vec![b'#'; DIRECTORY_FILE_BYTES_MAX as usize + 1];
        let why = listed(&long).unwrap_err();
        assert!(why.contains("it has more than"), "{why}");
    }
}
