//! Directory in a bucket of a NATS server (JetStream key-value store), in which nodes register themselves.
//!
//! A node writes its record every [`REGISTRATION_PERIOD`]; a node whose record is older than [`LIFETIME`] has
//! gone. Ages are counted from a record's arrival here, so that no clocks are compared.

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use async_nats::connection::State;
use async_nats::jetstream::kv::{Entry, Operation, Store};
use async_nats::jetstream::stream::{self, DiscardPolicy, StorageType};
use async_nats::{Client, ConnectOptions, jetstream};
use carom_protocol::limits::{NODE_RECORD_BYTES_MAX, NODE_RECORDS_MAX};
use futures_util::StreamExt as _;
use tokio::runtime::Runtime;
use tokio::task::JoinHandle;

use super::{Directory, ListedNode, NodeRecord, Registry};
use crate::Error;
use crate::lock::lock;
use crate::net::runtime;

/// Address of a bucket: `nats://host:port/bucket`, or with `tls://`; before the host may be `user:password@`
/// or `token@`.
#[derive(Clone, PartialEq, Eq)]
pub struct NatsBucket {
    server: String,
    bucket: String,
}

/// Writes the address without user, password or token.
impl fmt::Display for NatsBucket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (scheme, rest) = self.server.split_once("://").unwrap_or_default();
        let host = rest.rsplit('@').next().unwrap_or_default();
        write!(f, "{scheme}://{host}/{}", self.bucket)
    }
}

impl fmt::Debug for NatsBucket {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl FromStr for NatsBucket {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_');
        let (server, bucket) = text.rsplit_once('/').unwrap_or((text, ""));
        let is_server = server
            .split_once("://")
            .is_some_and(|(_, host)| !host.is_empty());
        if !is_server || bucket.is_empty() || bucket.len() > 64 || !bucket.chars().all(plain) {
            return Err(Error::NodeAddress {
                text: "nats://…".into(), // it may hold a password
                fault: "it must be nats://HOST:PORT/BUCKET, the bucket of letters, digits, `-` and `_`",
            });
        }
        Ok(Self {
            server: server.to_owned(),
            bucket: bucket.to_owned(),
        })
    }
}

impl NatsBucket {
    fn fault(&self, why: impl fmt::Display) -> Error {
        Error::directory(self, why)
    }

    async fn open(&self) -> Result<(Client, Store), Error> {
        let options = ConnectOptions::new()
            .connection_timeout(PATIENCE)
            .name("carom");
        let client = options.connect(&self.server).await;
        let client = client.map_err(|why| self.fault(why))?;
        let context = jetstream::new(client.clone());
        // The first to arrive creates it; one with other settings is used as it is. Not by
        // `create_key_value`, whose request servers before 2.10 do not answer.
        let made = context.get_or_create_stream(self.stream()).await;
        made.map_err(|why| self.fault(why))?;
        let store = context.get_key_value(&self.bucket).await;
        let store = store.map_err(|why| self.fault(why))?;
        Ok((client, store))
    }
}

impl NatsBucket {
    /// The bucket as a stream (ADR-8 of NATS): the last value of each key for [`LIFETIME`], in memory.
    fn stream(&self) -> stream::Config {
        stream::Config {
            name: format!("KV_{}", self.bucket),
            description: Some("Nodes of a Carom farm".into()),
            subjects: vec![format!("$KV.{}.>", self.bucket)],
            max_messages_per_subject: 1,
            max_age: LIFETIME,
            max_message_size: NODE_RECORD_BYTES_MAX as i32,
            storage: StorageType::Memory,
            discard: DiscardPolicy::New,
            allow_rollup: true,
            deny_delete: true,
            allow_direct: true,
            num_replicas: 1,
            ..stream::Config::default()
        }
    }
}

/// A runtime with a thread for the connection to a server.
fn runtime(bucket: &NatsBucket) -> Result<Runtime, Error> {
    runtime::own_thread("carom-nats").map_err(|why| bucket.fault(why))
}

async fn in_time<T>(
    bucket: &NatsBucket,
    answer: impl Future<Output = Result<T, Error>>,
) -> Result<T, Error> {
    let answer = tokio::time::timeout(PATIENCE, answer).await;
    answer.unwrap_or_else(|_| Err(bucket.fault("no answer")))
}

/// Directory of the nodes in a bucket.
pub struct NatsDirectory {
    bucket: NatsBucket,
    runtime: Runtime,
    watch: Option<BucketWatch>,
}

/// Watch of a bucket over one connection.
struct BucketWatch {
    client: Client,
    task: JoinHandle<()>,
    records: Arc<Mutex<Records>>,
}

/// The newest record of each key, with the time of its arrival.
type Records = BTreeMap<String, (NodeRecord, Instant)>;

impl NatsDirectory {
    /// A directory that connects at the first query.
    ///
    /// # Errors
    /// [`Error::Directory`] if the system can start no thread.
    pub fn new(bucket: NatsBucket) -> Result<Self, Error> {
        Ok(Self {
            runtime: runtime(&bucket)?,
            bucket,
            watch: None,
        })
    }

    async fn watch(bucket: &NatsBucket) -> Result<BucketWatch, Error> {
        let (client, store) = bucket.open().await?;
        let entries = store.watch_with_history(">").await;
        let mut entries = entries.map_err(|why| bucket.fault(why))?;
        let records = Arc::<Mutex<Records>>::default();
        let heard = Arc::clone(&records);
        let task = tokio::spawn(async move {
            while let Some(Ok(entry)) = entries.next().await {
                take(&mut lock(&heard), &entry);
            }
        });
        // The existing records arrive at once.
        tokio::time::sleep(SNAPSHOT_TIME).await;
        Ok(BucketWatch {
            client,
            task,
            records,
        })
    }
}

/// Applies an entry. Anyone with access to the bucket can write records: malformed and too many ones are
/// ignored.
fn take(records: &mut Records, entry: &Entry) {
    if entry.operation != Operation::Put {
        records.remove(&entry.key);
        return;
    }
    if entry.value.len() > NODE_RECORD_BYTES_MAX {
        return;
    }
    let Ok(record) = serde_json::from_slice::<NodeRecord>(&entry.value) else {
        tracing::debug!("a record of {} is malformed", entry.key.escape_debug());
        return;
    };
    if records.len() < NODE_RECORDS_MAX || records.contains_key(&entry.key) {
        records.insert(entry.key.clone(), (record, Instant::now()));
    }
}

impl Directory for NatsDirectory {
    fn nodes(&mut self) -> Result<Vec<ListedNode>, Error> {
        let bucket = &self.bucket;
        // Put back only if it works; otherwise the next query connects anew.
        let watch = match self.watch.take() {
            Some(watch) if watch.task.is_finished() => {
                return Err(bucket.fault("the bucket is gone"));
            }
            Some(watch) => watch,
            None => self
                .runtime
                .block_on(in_time(bucket, Self::watch(bucket)))?,
        };
        if watch.client.connection_state() != State::Connected {
            watch.task.abort();
            return Err(bucket.fault("the server does not answer"));
        }
        let nodes = {
            let mut records = lock(&watch.records);
            records.retain(|_, (_, came)| came.elapsed() < LIFETIME);
            let listed = |(record, _): &(NodeRecord, Instant)| {
                Some(ListedNode {
                    address: record.address.parse().ok()?,
                    record: Some(record.clone()),
                })
            };
            records.values().filter_map(listed).collect()
        };
        self.watch = Some(watch);
        Ok(nodes)
    }

    fn period(&self) -> Duration {
        LOOK_PERIOD
    }
}

/// Registry of a node's own entry in a bucket.
pub struct NatsRegistry {
    bucket: NatsBucket,
    runtime: Runtime,
    store: Option<Store>,
}

impl NatsRegistry {
    /// A registry that connects with the first record.
    ///
    /// # Errors
    /// [`Error::Directory`] if the system can start no thread.
    pub fn new(bucket: NatsBucket) -> Result<Self, Error> {
        Ok(Self {
            runtime: runtime(&bucket)?,
            bucket,
            store: None,
        })
    }

    fn run(&mut self, record: &NodeRecord, is_leaving: bool) -> Result<(), Error> {
        // Put back only after success, so that a failure leads to a new connection.
        let (bucket, store) = (&self.bucket, self.store.take());
        let written = async {
            let store = match store {
                Some(store) => store,
                None => bucket.open().await?.1,
            };
            let key = key(&record.address);
            if is_leaving {
                let deleted = store.delete(&key).await;
                deleted.map_err(|why| bucket.fault(why))?;
            } else {
                let text = serde_json::to_vec(record).map_err(|why| bucket.fault(why))?;
                let put = store.put(&key, text.into()).await;
                put.map_err(|why| bucket.fault(why))?;
            }
            Ok(store)
        };
        self.store = Some(self.runtime.block_on(in_time(bucket, written))?);
        Ok(())
    }
}

impl Registry for NatsRegistry {
    fn register(&mut self, record: &NodeRecord) -> Result<(), Error> {
        self.run(record, false)
    }

    fn leave(&mut self, record: &NodeRecord) -> Result<(), Error> {
        self.run(record, true)
    }

    fn period(&self) -> Duration {
        REGISTRATION_PERIOD
    }
}

/// The key of an address; characters that keys may not contain become `_`.
fn key(address: &str) -> String {
    let plain = |c: char| match c {
        'a'..='z' | 'A'..='Z' | '0'..='9' | '-' | '_' => c,
        _ => '_',
    };
    address.chars().map(plain).collect()
}

/// Period in which a node writes its record: 1,000 nodes send 200 messages a second.
const REGISTRATION_PERIOD: Duration = Duration::from_secs(5);
/// Lifetime of a record, which survives the loss of two writes.
const LIFETIME: Duration = Duration::from_secs(16);
/// Period in which a farm evaluates what its watch has received.
const LOOK_PERIOD: Duration = Duration::from_secs(1);
/// Maximum wait for a server.
const PATIENCE: Duration = Duration::from_secs(5);
/// Wait from the beginning of a watch for the existing records: 1,000 take some 50 ms.
const SNAPSHOT_TIME: Duration = Duration::from_millis(200);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn passwords_of_a_bucket_are_not_shown() {
        let bucket: NatsBucket = "nats://me:secret@oak:4222/farm".parse().unwrap();
        assert_eq!(bucket.to_string(), "nats://oak:4222/farm");
        assert_eq!(format!("{bucket:?}"), "nats://oak:4222/farm");
        for text in [
            "nats://oak",
            "nats://",
            "nats:///farm",
            "nats://me:secret@oak/a b",
            "nats://oak/",
        ] {
            let why = text.parse::<NatsBucket>().unwrap_err().to_string();
            assert!(why.contains("/BUCKET") && !why.contains("secret"), "{why}");
        }
    }

    #[test]
    fn addresses_become_keys() {
        assert_eq!(key("10.0.0.7:4433"), "10_0_0_7_4433");
        assert_eq!(key("[::1]:80"), "___1__80");
    }
}
