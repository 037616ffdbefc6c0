//! Codec of messages, in postcard's format.
//!
//! A decoder trusts no length on the wire. The number of bytes is checked against [`crate::limits`]
//! before anything else; lists grow only as their elements are read; bytes after the message are an
//! error; and a decoded message has passed [`ToNode::validate`] or [`ToClient::validate`].

use carom_tracer::Scene;
use postcard::de_flavors::{Flavor, Slice};
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::error::{Error, Reason, SCENE_HASH};
use crate::limits::{
    CONTROL_BYTES_MAX, MANIFEST_BYTES_MAX, SCENE_MESSAGE_BYTES_MAX, TILES_BYTES_MAX,
    TO_NODE_BYTES_MAX, TRACE_BYTES_MAX,
};
use crate::message::{RequestId, SceneHash, ToClient, ToNode, VERSION};

impl SceneHash {
    /// The hash under which nodes keep `scene`. Scenes whose numbers are equal bit for bit have equal hashes.
    ///
    /// # Panics
    /// Never: a scene is plain data, which postcard always can write.
    pub fn of(scene: &Scene) -> Self {
        Self::of_bytes(&encode_scene(scene))
    }

    pub(crate) fn of_bytes(scene: &[u8]) -> Self {
        Self(*blake3::hash(scene).as_bytes())
    }
}

/// The encoded bytes of a scene.
pub(crate) fn encode_scene(scene: &Scene) -> Vec<u8> {
    postcard::to_stdvec(scene).expect("plain data")
}

/// Decodes a scene, without checking that it can be drawn.
pub(crate) fn decode_scene(bytes: &[u8]) -> Result<Scene, Error> {
    decode("scene", bytes)
}

/// The encoded [`ToNode::Scene`] around a scene's bytes, which are encoded once for all nodes.
pub(crate) fn scene_message(hash: SceneHash, scene: &[u8]) -> Vec<u8> {
    [&[SCENE_VARIANT], &hash.0[..], scene].concat()
}

/// Encodes `message`.
///
/// # Errors
/// [`Error::Unsendable`] if the node would refuse the message: see [`ToNode::validate`] and the sizes in
/// [`crate::limits`].
pub fn encode_to_node(message: &ToNode) -> Result<Vec<u8>, Error> {
    let what = to_node_kind(message);
    encode(message, what, message.validate(), to_node_bytes_max)
}

/// Encodes `message`.
///
/// # Errors
/// [`Error::Unsendable`] if the client would refuse the message: see [`ToClient::validate`] and the sizes
/// in [`crate::limits`].
pub fn encode_to_client(message: &ToClient) -> Result<Vec<u8>, Error> {
    let what = to_client_kind(message);
    encode(message, what, message.validate(), to_client_bytes_max)
}

/// Decodes a message to a node. A scene's hash has been verified, but not that the scene can be drawn.
///
/// # Errors
/// [`Error::TooLarge`], [`Error::Malformed`], or [`Error::Version`] for a greeting of another
/// version, whatever follows the version in it.
pub fn decode_to_node(bytes: &[u8]) -> Result<ToNode, Error> {
    let max = to_node_bytes_max(bytes);
    let message: ToNode = decode_message("message to a node", bytes, max)?;
    let what = to_node_kind(&message);
    message
        .validate()
        .map_err(|reason| Error::malformed(what, reason))?;
    match &message {
        // The hash is of the received bytes, so that the scene need not be encoded again to verify it.
        ToNode::Scene { hash, .. } if SceneHash::of_bytes(&bytes[SCENE_OFFSET..]) != *hash => {
            Err(Error::malformed(what, SCENE_HASH))
        }
        _ => Ok(message),
    }
}

/// Decodes a message to a client.
///
/// # Errors
/// [`Error::TooLarge`], [`Error::Malformed`], or [`Error::Version`] for a greeting of another
/// version, whatever follows the version in it.
pub fn decode_to_client(bytes: &[u8]) -> Result<ToClient, Error> {
    let max = to_client_bytes_max(bytes);
    let message: ToClient = decode_message("message to a client", bytes, max)?;
    let what = to_client_kind(&message);
    message
        .validate()
        .map_err(|reason| Error::malformed(what, reason))?;
    Ok(message)
}

/// The request of a tile message, from its first bytes alone; `None` for any other message.
pub fn request_of_tiles(bytes: &[u8]) -> Option<RequestId> {
    let (&TILES_VARIANT, rest) = bytes.split_first()? else {
        return None;
    };
    let (request, _) = postcard::take_from_bytes(rest).ok()?;
    Some(request)
}

/// Whether `bytes` are a scene or a part of one, from the first byte alone: the messages that a
/// [`crate::session::SceneAssembler`] handles.
pub fn is_of_scene(bytes: &[u8]) -> bool {
    matches!(
        bytes.first(),
        Some(&SCENE_VARIANT | MANIFEST_VARIANT..=CHUNKS_SENT_VARIANT)
    )
}

/// Whether `bytes` are a manifest, which begins a scene in chunks, from the first byte alone.
pub fn is_manifest(bytes: &[u8]) -> bool {
    bytes.first() == Some(&MANIFEST_VARIANT)
}

/// Whether `bytes` are a trace request, from the first byte alone.
pub fn is_trace(bytes: &[u8]) -> bool {
    bytes.first() == Some(&TRACE_VARIANT)
}

/// Whether `bytes` begin as the first message of a connection does, in any version.
pub(crate) fn is_hello(bytes: &[u8]) -> bool {
    bytes.first() == Some(&HELLO_VARIANT)
}

/// The name of a message to a node in errors.
pub(crate) fn to_node_kind(message: &ToNode) -> &'static str {
    match message {
        ToNode::Hello { .. } => "greeting",
        ToNode::Scene { .. } => "scene",
        ToNode::Trace(_) => "trace request",
        ToNode::CancelBefore(_) | ToNode::CancelRequest(_) => "cancellation",
        ToNode::Ping(_) => "ping",
        ToNode::Leave => "farewell",
        ToNode::Manifest { .. } => "manifest of a scene",
        ToNode::Chunk { .. } => "chunk",
        ToNode::ChunksSent(_) => "end of a scene",
    }
}

/// The name of a message to a client in errors.
pub(crate) fn to_client_kind(message: &ToClient) -> &'static str {
    match message {
        ToClient::Welcome { .. } => "welcome",
        ToClient::SceneReady(_) | ToClient::SceneRefused { .. } => "answer to a scene",
        ToClient::Tiles(_) => "tile message",
        ToClient::RequestDone(_) => "report",
        ToClient::RequestRefused(_) => "refusal",
        ToClient::Pong { .. } => "pong",
        ToClient::SceneComing { .. } => "progress of a scene",
        ToClient::Leaving => "farewell",
        ToClient::ChunksWanted { .. } => "list of wanted chunks",
    }
}

/// The maximum size in bytes of a message to a node, by its first byte.
fn to_node_bytes_max(bytes: &[u8]) -> usize {
    match bytes.first() {
        Some(&SCENE_VARIANT) => SCENE_OFFSET + SCENE_MESSAGE_BYTES_MAX,
        Some(&TRACE_VARIANT) => TRACE_BYTES_MAX,
        Some(&MANIFEST_VARIANT) => MANIFEST_BYTES_MAX,
        Some(&CHUNK_VARIANT) => TO_NODE_BYTES_MAX,
        _ => CONTROL_BYTES_MAX,
    }
}

/// The maximum size in bytes of a message to a client, by its first byte.
fn to_client_bytes_max(bytes: &[u8]) -> usize {
    match bytes.first() {
        Some(&TILES_VARIANT) => TILES_BYTES_MAX,
        _ => CONTROL_BYTES_MAX,
    }
}

/// Encodes a message unless its validation failed or its bytes are too many.
fn encode(
    message: &impl Serialize,
    what: &'static str,
    valid: Result<(), Reason>,
    bytes_max: fn(&[u8]) -> usize,
) -> Result<Vec<u8>, Error> {
    let unsendable = |reason: Reason| Error::unsendable(what, reason);
    valid.map_err(unsendable)?;
    let bytes = postcard::to_stdvec(message);
    let bytes = bytes.map_err(|why| unsendable(why.to_string().into()))?;
    let max = bytes_max(&bytes);
    match bytes.len() > max {
        true => Err(unsendable(Reason::too_long(bytes.len(), max))),
        false => Ok(bytes),
    }
}

/// Decodes a message of at most `max` bytes.
fn decode_message<T: DeserializeOwned>(
    what: &'static str,
    bytes: &[u8],
    max: usize,
) -> Result<T, Error> {
    if bytes.len() > max {
        let (bytes, max) = (bytes.len() as u64, max as u64);
        return Err(Error::TooLarge { what, bytes, max });
    }
    check_version(what, bytes)?;
    decode(what, bytes)
}

/// Checks a greeting's version before the rest is decoded, whose layout may differ in another version.
/// All variants have numbers of one byte. The same number as a varint of two bytes, which postcard would
/// accept, would bypass the check and is refused.
fn check_version(what: &'static str, bytes: &[u8]) -> Result<(), Error> {
    if bytes.first().is_some_and(|&variant| variant >= 0x80) {
        return Err(Error::malformed(what, UNKNOWN_MESSAGE));
    }
    let Some((&HELLO_VARIANT, rest)) = bytes.split_first() else {
        return Ok(());
    };
    match postcard::take_from_bytes::<u16>(rest) {
        Ok((theirs, _)) if theirs != VERSION => Err(Error::Version {
            theirs,
            ours: VERSION,
        }),
        _ => Ok(()),
    }
}

fn decode<T: DeserializeOwned>(what: &'static str, bytes: &[u8]) -> Result<T, Error> {
    let malformed = |error: postcard::Error| Error::malformed(what, error.to_string());
    let mut deserializer = postcard::Deserializer::from_flavor(BoundedSlice(Slice::new(bytes)));
    let value = T::deserialize(&mut deserializer).map_err(malformed)?;
    let rest = deserializer.finalize().map_err(malformed)?;
    if rest.is_empty() {
        return Ok(value);
    }
    let rule = format!("{} bytes follow its end", rest.len());
    Err(Error::malformed(what, rule))
}

/// A slice that reports no remaining length. Postcard passes a list's announced length on as serde's
/// size hint if at least as many bytes are left, and serde reserves up to 1 MiB by it: 36 times the
/// message for poses. Against 0 remaining bytes every announced length is implausible and no hint is
/// passed on, so that lists grow only by what has been read.
struct BoundedSlice<'de>(Slice<'de>);

impl<'de> Flavor<'de> for BoundedSlice<'de> {
    type Remainder = &'de [u8];
    type Source = &'de [u8];

    fn pop(&mut self) -> postcard::Result<u8> {
        self.0.pop()
    }

    fn size_hint(&self) -> Option<usize> {
        Some(0)
    }

    fn try_take_n(&mut self, count: usize) -> postcard::Result<&'de [u8]> {
        self.0.try_take_n(count)
    }

    fn finalize(self) -> postcard::Result<&'de [u8]> {
        self.0.finalize()
    }
}

pub(crate) const UNKNOWN_MESSAGE: &str = "there is no such message";
/// First byte of [`ToNode::Hello`] and [`ToClient::Welcome`].
const HELLO_VARIANT: u8 = 0;
/// First byte of [`ToNode::Scene`].
const SCENE_VARIANT: u8 = 1;
/// Bytes of [`ToNode::Scene`] before the scene: the variant and the hash.
pub(crate) const SCENE_OFFSET: usize = 1 + size_of::<SceneHash>();
/// First byte of [`ToNode::Trace`].
const TRACE_VARIANT: u8 = 2;
/// First byte of [`ToNode::Manifest`].
const MANIFEST_VARIANT: u8 = 7;
/// First byte of [`ToNode::Chunk`].
const CHUNK_VARIANT: u8 = 8;
/// First byte of [`ToNode::ChunksSent`].
const CHUNKS_SENT_VARIANT: u8 = 9;
/// First byte of [`ToClient::Tiles`].
const TILES_VARIANT: u8 = 3;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::{NodeInfo, NodeTimes, TilesDone};
    use carom_tracer::{DeviceInfo, DeviceKind, TileRange};

    fn welcome(version: u16) -> ToClient {
        let device = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: "test".into(),
            width: 8,
            threads: 2,
        };
        let name = "node".into();
        let node = NodeInfo {
            name,
            instance: 0,
            device,
        };
        ToClient::Welcome { version, node }
    }

    fn tiles(pixels: Vec<u8>) -> ToClient {
        ToClient::Tiles(TilesDone {
            request: RequestId(1),
            tiles: TileRange { first: 0, count: 1 },
            busy_micros: 1,
            times: NodeTimes::default(),
            dropped_samples: 0,
            pixels,
        })
    }

    #[test]
    fn first_bytes_are_the_variants() {
        let hello = encode_to_node(&ToNode::Hello { version: VERSION }).unwrap();
        let welcome = encode_to_client(&welcome(VERSION)).unwrap();
        let tiles = encode_to_client(&tiles(vec![7; 300])).unwrap();
        assert_eq!(
            [hello[0], welcome[0], tiles[0]],
            [HELLO_VARIANT, HELLO_VARIANT, TILES_VARIANT]
        );
    }

    #[test]
    fn other_version_is_reported_whatever_follows() {
        let mut bytes = encode_to_client(&welcome(VERSION + 1)).unwrap();
        bytes.truncate(2);
        bytes.extend([0xff; 40]);
        let (theirs, ours) = (VERSION + 1, VERSION);
        assert_eq!(
            decode_to_client(&bytes),
            Err(Error::Version { theirs, ours })
        );
    }

    #[test]
    fn no_encoding_of_a_hello_evades_the_version_check() {
        assert!(decode_to_node(&[0x80, 0, 0]).is_err());
        assert!(decode_to_node(&[0, 0x80, 0]).is_err());
        assert!(decode_to_client(&[0x80, 0, 0, 0, 0, 0, 0, 6]).is_err());
    }

    #[test]
    fn trailing_bytes_are_refused() {
        let mut bytes = encode_to_node(&ToNode::Ping(5)).unwrap();
        assert_eq!(decode_to_node(&bytes), Ok(ToNode::Ping(5)));
        bytes.push(0);
        assert!(matches!(
            decode_to_node(&bytes),
            Err(Error::Malformed { .. })
        ));
    }

    #[test]
    fn only_scenes_their_parts_requests_and_tiles_may_be_large() {
        let mut bytes = vec![0; CONTROL_BYTES_MAX + 1];
        for variant in 0..12 {
            bytes[0] = variant;
            let too_large = |error| matches!(error, Err(Error::TooLarge { .. }));
            let to_node = too_large(decode_to_node(&bytes).map(drop));
            let to_client = too_large(decode_to_client(&bytes).map(drop));
            let large = [
                SCENE_VARIANT,
                TRACE_VARIANT,
                MANIFEST_VARIANT,
                CHUNK_VARIANT,
            ];
            let is_small = !large.contains(&variant);
            assert_eq!(to_node, is_small, "{variant}");
            assert_eq!(to_client, variant != TILES_VARIANT, "{variant}");
        }
    }

    #[test]
    fn messages_a_peer_would_refuse_are_not_sent() {
        let message = tiles(vec![0; TILES_BYTES_MAX]);
        assert!(matches!(
            encode_to_client(&message),
            Err(Error::Unsendable { .. })
        ));
    }
}
