//! Recorder of pictures' records to files on a thread, so that no frame waits for a disk.

use std::fmt::Write as _;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};

use carom_text::text;

use super::frame_record::{FrameRecord, NodeRecord};

/// Recorder to CSV, with a row per node and picture, and to JSON lines, with one per picture.
#[derive(Debug)]
pub struct Recorder {
    queue: Option<SyncSender<Arc<FrameRecord>>>,
    thread: Option<JoinHandle<()>>,
    state: Arc<Mutex<RecorderState>>,
}

/// State of a recording.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecorderState {
    /// Location of the files, for the user.
    pub place: String,
    /// Pictures written to the files.
    pub written: u64,
    /// Pictures left out because the disk was too slow.
    pub left_out: u64,
    /// The reason why it has stopped, if it has.
    pub failure: Option<String>,
}

/// The two output files.
struct RecordFiles<W> {
    csv: W,
    lines: W,
}

impl Recorder {
    /// Begins two new files in `folder`, which is created if missing. Errors are reported by
    /// [`Recorder::state`].
    pub fn start(folder: &Path) -> Self {
        match create(folder) {
            Ok((place, files)) => Self::into(place, files),
            Err(why) => Self {
                queue: None,
                thread: None,
                state: Arc::new(Mutex::new(RecorderState {
                    failure: Some(text!(
                        "stats-recording-no-file",
                        folder = folder.display().to_string(),
                        why = why.to_string()
                    )),
                    ..RecorderState::default()
                })),
            },
        }
    }

    fn into<W: Write + Send + 'static>(place: String, files: RecordFiles<W>) -> Self {
        let (queue, records) = sync_channel(QUEUE_MAX);
        let state = Arc::new(Mutex::new(RecorderState {
            place,
            ..RecorderState::default()
        }));
        let of_thread = Arc::clone(&state);
        let write = move || write_all(&records, files, &of_thread);
        let thread = thread::Builder::new()
            .name("carom-recorder".into())
            .spawn(write);
        let thread = match thread {
            Ok(thread) => Some(thread),
            Err(why) => {
                change(&state, |state| state.failure = Some(why.to_string()));
                None
            }
        };
        Self {
            queue: Some(queue),
            thread,
            state,
        }
    }

    /// Queues a picture's record for the thread; never blocks.
    pub fn write(&mut self, record: Arc<FrameRecord>) {
        let Some(queue) = &self.queue else {
            return;
        };
        if let Err(TrySendError::Full(_)) = queue.try_send(record) {
            change(&self.state, |state| state.left_out += 1);
        }
    }

    /// The state of the recording.
    pub fn state(&self) -> RecorderState {
        self.state
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }
}

impl Drop for Recorder {
    /// Waits until all queued records are in the files.
    fn drop(&mut self) {
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a panic has been reported where it happened
        }
    }
}

/// Creates two files with the first number that is unused in the folder.
fn create(folder: &Path) -> io::Result<(String, RecordFiles<BufWriter<File>>)> {
    fs::create_dir_all(folder)?;
    for number in 1..=FILES_MAX {
        let path = |ending: &str| folder.join(format!("stats_{number:04}.{ending}"));
        let csv = match File::create_new(path("csv")) {
            Err(why) if why.kind() == io::ErrorKind::AlreadyExists => continue,
            created => BufWriter::new(created?),
        };
        let lines = BufWriter::new(File::create(path("jsonl"))?);
        let file = path("csv").display().to_string();
        let place = text!("stats-recording-files", file = file);
        return Ok((place, RecordFiles { csv, lines }));
    }
    Err(io::Error::other(text!(
        "stats-recording-full",
        count = FILES_MAX
    )))
}

fn write_all<W: Write>(
    records: &Receiver<Arc<FrameRecord>>,
    mut files: RecordFiles<W>,
    state: &Mutex<RecorderState>,
) {
    let mut header = writeln!(files.csv, "{}", header());
    while let Ok(record) = records.recv() {
        // A failure to write the header is reported with the first record.
        let written = std::mem::replace(&mut header, Ok(())).and_then(|()| files.write(&record));
        if let Err(why) = written {
            change(state, |state| state.failure = Some(why.to_string()));
            return;
        }
        change(state, |state| state.written += 1);
    }
    if let Err(why) = files.csv.flush().and_then(|()| files.lines.flush()) {
        tracing::error!("the recording of the statistics is incomplete: {why}");
        change(state, |state| state.failure = Some(why.to_string()));
    }
}

impl<W: Write> RecordFiles<W> {
    /// Writes and flushes a whole picture, so that the files can be read at any time.
    fn write(&mut self, record: &FrameRecord) -> io::Result<()> {
        self.csv.write_all(rows(record).as_bytes())?;
        let line = serde_json::to_string(record)?;
        self.lines.write_all(line.as_bytes())?;
        self.lines.write_all(b"\n")?;
        self.csv.flush()?;
        self.lines.flush()
    }
}

fn change(state: &Mutex<RecorderState>, change: impl FnOnce(&mut RecorderState)) {
    change(&mut state.lock().unwrap_or_else(PoisonError::into_inner));
}

/// A column of the CSV file: its name and its value.
type CsvColumn = (&'static str, fn(&FrameRecord, &NodeRecord) -> String);

fn header() -> String {
    let names = COLUMNS.map(|(name, _)| name);
    format!("{},{}", "node", names.join(","))
}

fn rows(record: &FrameRecord) -> String {
    let mut rows = String::new();
    for (index, node) in record.nodes.iter().enumerate() {
        let values = COLUMNS.map(|(_, value)| value(record, node));
        // Writing to a string cannot fail.
        let _ = writeln!(rows, "{index},{}", values.join(","));
    }
    rows
}

/// A name as a quoted CSV field, since it may contain a comma.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

fn number(value: f64) -> String {
    format!("{value:.6}")
}

#[rustfmt::skip]
const COLUMNS: [CsvColumn; 32] = [
    ("name", |_, node| quoted(&node.name)),
    ("frame", |record, _| record.frame.to_string()),
    ("at_secs", |record, _| number(record.at_secs)),
    ("width", |record, _| record.width.to_string()),
    ("height", |record, _| record.height.to_string()),
    ("samples", |record, _| record.samples.to_string()),
    ("balancing", |record, _| record.balancing.to_string()),
    ("makespan_secs", |record, _| number(record.makespan_secs)),
    ("ideal_secs", |record, _| number(record.ideal_secs)),
    ("frame_payload_bytes", |record, _| record.payload_bytes.to_string()),
    ("frame_raw_bytes", |record, _| record.raw_bytes.to_string()),
    ("reissued_tiles", |record, _| record.reissued_tiles.to_string()),
    ("lost_tiles", |record, _| record.lost_tiles.to_string()),
    ("tiles", |_, node| node.tiles.to_string()),
    ("share", |_, node| number(node.share)),
    ("response_secs", |_, node| number(node.response_secs)),
    ("predicted_secs", |_, node| node.predicted_secs.map_or(String::new(), number)),
    ("busy_secs", |_, node| number(node.busy_secs)),
    ("request_secs", |_, node| number(node.split.request_secs)),
    ("network_secs", |_, node| number(node.split.network_secs)),
    ("queue_secs", |_, node| number(node.split.queue_secs)),
    ("trace_secs", |_, node| number(node.split.trace_secs)),
    ("encode_secs", |_, node| number(node.split.encode_secs)),
    ("decode_secs", |_, node| number(node.split.decode_secs)),
    ("payload_bytes", |_, node| node.payload_bytes.to_string()),
    ("late_tiles", |_, node| node.late_tiles.to_string()),
    ("duplicate_tiles", |_, node| node.duplicate_tiles.to_string()),
    ("a_secs", |_, node| number(node.fixed_secs)),
    ("a_error_secs", |_, node| number(node.fixed_error_secs)),
    ("msamples_per_sec", |_, node| number(node.msamples_per_sec)),
    ("speed_error", |_, node| number(node.speed_error)),
    ("efficiency", |record, _| number(record.efficiency())),
];

/// Maximum number of records that wait for the disk: four seconds at 60 pictures a second.
const QUEUE_MAX: usize = 256;
const FILES_MAX: u32 = 9999;

#[cfg(test)]
mod tests {
    use std::sync::mpsc::Sender;
    use std::sync::mpsc::channel;

    use super::*;

    /// A writer that fails like a full disk after a number of bytes.
    struct SlowDisk {
        left: usize,
    }

    impl Write for SlowDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.left = self
                .left
                .checked_sub(bytes.len())
                .ok_or(io::ErrorKind::StorageFull)?;
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    /// A writer that blocks until it is released.
    struct StuckDisk {
        go: Receiver<()>,
        begun: Sender<()>,
    }

    impl Write for StuckDisk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.begun.send(());
            let _ = self.go.recv();
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    fn record(frame: u64) -> Arc<FrameRecord> {
        let mut node = carom_farm::NodeStatus::new("a, \"b\"");
        node.state = carom_farm::NodeState::Ready;
        (node.fixed_secs, node.fixed_error_secs) = (0.003, 0.001);
        (node.msamples_per_sec, node.speed_error, node.tiles) = (12.0, 0.1, 5);
        let seen = super::super::frame_record::FrameSample {
            frame,
            at_secs: 1.5,
            size: carom_tracer::ImageSize::new(64, 32),
            samples: 4,
            stats: carom_farm::FrameStats {
                makespan_secs: 0.02,
                ..Default::default()
            },
            nodes: &[node],
        };
        Arc::new(FrameRecord::new(seen, &["a, \"b\"".into()]))
    }

    #[test]
    fn what_is_handed_over_is_in_both_files() {
        let folder = tempfile::tempdir().unwrap();
        for run in 1..=2 {
            let mut recorder = Recorder::start(folder.path());
            (0..3).for_each(|frame| recorder.write(record(frame)));
            drop(recorder);
            let read = |ending: &str| {
                fs::read_to_string(folder.path().join(format!("stats_{run:04}.{ending}"))).unwrap()
            };
            let csv = read("csv");
            assert_eq!(csv.lines().count(), 4);
            let header: Vec<&str> = csv.lines().next().unwrap().split(',').collect();
            assert_eq!(header.len(), COLUMNS.len() + 1);
            assert!(
                csv.lines()
                    .nth(1)
                    .unwrap()
                    .starts_with("0,\"a, \"\"b\"\"\",0,1.5"),
                "{csv}"
            );
            let lines = read("jsonl");
            let lines: Vec<serde_json::Value> = lines
                .lines()
                .map(|line| serde_json::from_str(line).unwrap())
                .collect();
            assert_eq!(lines.len(), 3);
            assert_eq!(lines[2]["frame"], 2);
            assert_eq!(lines[2]["nodes"][0]["name"], "a, \"b\"");
            assert_eq!(lines[2]["balancing"], "water_filling_hedged");
        }
    }

    #[test]
    fn a_full_disk_is_told_and_stops_the_recording_alone() {
        let files = RecordFiles {
            csv: SlowDisk { left: 5000 },
            lines: SlowDisk { left: 1 << 20 },
        };
        let mut recorder = Recorder::into("a disk".to_owned(), files);
        (0..200).for_each(|frame| recorder.write(record(frame)));
        recorder.queue = None;
        recorder.thread.take().unwrap().join().unwrap();
        let state = recorder.state();
        assert!(state.failure.unwrap().contains("no storage space"));
        assert!(0 < state.written && state.written < 200);
        recorder.write(record(1));
    }

    #[test]
    fn a_disk_that_hangs_keeps_no_frame_waiting() {
        let ((go, waits), (begins, begun)) = (channel(), channel());
        let stuck = StuckDisk {
            go: waits,
            begun: begins,
        };
        let (never, nothing) = channel();
        drop(never);
        let files = RecordFiles {
            csv: stuck,
            lines: StuckDisk {
                go: nothing,
                begun: channel().0,
            },
        };
        let mut recorder = Recorder::into("a disk".to_owned(), files);
        begun.recv().unwrap();
        // The thread blocks in the header, so each of these is queued or left out immediately.
        (0..QUEUE_MAX as u64 + 50).for_each(|frame| recorder.write(record(frame)));
        assert_eq!(recorder.state().left_out, 50);
        drop(go);
        drop(recorder);
    }

    #[test]
    fn a_folder_that_cannot_be_made_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let mut recorder = Recorder::start(&file.join("sub"));
        recorder.write(record(1));
        assert!(
            recorder
                .state()
                .failure
                .unwrap()
                .contains("cannot create a file")
        );
    }
}
