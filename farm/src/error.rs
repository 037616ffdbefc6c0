//! Errors of a farm: each variant names who is at fault and carries the faulty values.

use std::fmt;
use std::io;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use carom_tracer::text::{SENTENCE_BYTES_MAX, printable};

use crate::config_fault::ConfigFault;
use crate::coordinator::FrameRefusal;
use crate::net::peer::{CertificateFault, DisconnectReason, HANDSHAKE_TIMEOUT, NoPlace, Role};
use crate::node_status::NodeStatus;

/// Result with [`Error`] as the default error.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Error of the public API. A failing node is not an error: its work is reassigned, and
/// [`crate::Farm::nodes`] states why.
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The scene, the update or the settings are invalid, or the local device fails.
    #[error(transparent)]
    Tracer(#[from] carom_tracer::Error),
    /// The configuration cannot be read, or a value of it is out of range.
    #[error(transparent)]
    Config(#[from] ConfigFault),
    /// A name is not in a closed set: the names of the set.
    #[error("it must be {0}")]
    Choice(&'static str),
    /// No balancer has this name.
    #[error(
        "there is no balancer `{name}`: it must be one of {known}, with `{hedged}` at the end for \
         one that asks again for late tiles"
    )]
    UnknownBalancer {
        /// The name.
        name: String,
        /// The names of all algorithms.
        known: String,
        /// Suffix of the names of hedged balancers.
        hedged: &'static str,
    },
    /// Remote nodes were named in a build without networking.
    #[error(
        "nodes elsewhere cannot be called: this program was built without carom-farm's feature `net`"
    )]
    NoNetwork,
    /// A socket could not be opened.
    #[error("{address}: {}", socket_reason(source))]
    Socket {
        /// The address.
        address: String,
        /// The system's reason.
        source: io::Error,
    },
    /// A file of the credentials does not exist.
    #[error("{} does not exist: {advice}", path.display())]
    CredentialsMissing {
        /// The file.
        path: PathBuf,
        /// The command that creates it.
        advice: &'static str,
    },
    /// A file or folder of the credentials cannot be read or written.
    #[error("{}: {source}", path.display())]
    CredentialsFile {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file of the credentials does not contain what its name says.
    #[error("{}: this is not a PEM {item}: {reason}", path.display())]
    CredentialsPem {
        /// The file.
        path: PathBuf,
        /// `certificate` or `private key`.
        item: &'static str,
        /// The parser's reason.
        reason: String,
    },
    /// A key is readable by every user of the machine.
    #[error(
        "{}: every user of this machine can read this key (its mode is {mode:o}, 600 is right): run \
         `chmod 600 {}`, and renew it if somebody may have",
        path.display(),
        path.display()
    )]
    KeyExposed {
        /// The key.
        path: PathBuf,
        /// The permissions of its file.
        mode: u32,
    },
    /// This side's own certificate does not fit its role.
    #[error("{}the certificate {fault}", prefix(path.as_deref()))]
    Certificate {
        /// Its file; absent if it is in memory only.
        path: Option<PathBuf>,
        /// The fault that a peer would refuse it for.
        fault: CertificateFault,
    },
    /// A certificate and a key do not belong together, or TLS cannot use them.
    #[error("the certificate and its key cannot be used: {0}")]
    KeyPair(String),
    /// A certificate cannot be created.
    #[error("cannot create a certificate: {0}")]
    CertificateCreation(String),
    /// The folder for a new farm already holds one.
    #[error(
        "{} exists: this folder already holds a farm, and a new authority would lock out all its \
         nodes. Choose another folder with --dir, or delete the old farm yourself",
        _0.display()
    )]
    FarmExists(PathBuf),
    /// The name of a new node or player, or its folder, is in use.
    #[error("{evidence}: {advice}")]
    MemberExists {
        /// Its key or certificate.
        evidence: String,
        /// What the refused command can do instead.
        advice: &'static str,
    },
    /// No valid certificate has this name.
    #[error(
        "`{}` has no valid certificate to revoke: certificates were issued to {}",
        name.escape_debug(),
        known.join(", ")
    )]
    NothingToRevoke {
        /// The name.
        name: String,
        /// The names in the record.
        known: Vec<String>,
    },
    /// The authority's key is encrypted, and no passphrase was given.
    #[error("{} is encrypted: a passphrase is needed", _0.display())]
    PassphraseMissing(PathBuf),
    /// The authority's key cannot be decrypted.
    #[error("{}: the passphrase is wrong", _0.display())]
    PassphraseWrong(PathBuf),
    /// A `farm://host:port#token` cannot be parsed.
    #[error("this is not a farm's address: {0}, as `carom-farm token` prints it")]
    JoinUrl(&'static str),
    /// The holder of the authority refuses to certify this node.
    #[error("the farm's authority refused: {}", printable(_0, SENTENCE_BYTES_MAX))]
    EnrolmentRefused(String),
    /// The folder for a new node holds the farm's authority.
    #[error(
        "{} holds the farm's authority, which no node may see: choose another folder with --out",
        _0.display()
    )]
    AuthorityExposed(PathBuf),
    /// A node's or player's name is not usable as a folder and in a certificate.
    #[error(
        "`{}` is not a valid name: use 1 to {length_max} letters, digits, `-`, `_` or `.`, \
         starting with a letter or digit",
        printable(&name.escape_debug().to_string(), SENTENCE_BYTES_MAX)
    )]
    MemberName {
        /// The name.
        name: String,
        /// The longest name that is accepted.
        length_max: usize,
    },
    /// A node's address cannot be parsed.
    #[error("`{}` is not a node address: {fault}, as in `oak.example:4433`", text.escape_debug())]
    NodeAddress {
        /// The text.
        text: String,
        /// The rule that it breaks.
        fault: &'static str,
    },
    /// The name of a node's host cannot be resolved.
    #[error("cannot resolve the name `{host}`: {source}")]
    NameResolution {
        /// The name.
        host: String,
        /// The system's reason.
        source: io::Error,
    },
    /// The name of a node's host has no address.
    #[error("the name `{0}` has no address")]
    NameWithoutAddress(String),
    /// A directory cannot list its nodes.
    #[error("{directory}: {}", printable(reason, SENTENCE_BYTES_MAX))]
    Directory {
        /// The directory, as given.
        directory: String,
        /// The reason.
        reason: String,
    },
    /// Nothing answers at a node's address.
    #[error(
        "{0} does not answer: check that the node is running and that firewalls let its UDP \
         port through"
    )]
    NoAnswer(SocketAddr),
    /// Another link of this farm is connected to the node at this address, under another name.
    #[error("{address} is the same node as {node}: name it once")]
    SameNode {
        /// The address that both names led to.
        address: SocketAddr,
        /// The other name.
        node: String,
    },
    /// A node's address cannot be connected to.
    #[error("cannot connect to {address}: {reason}")]
    Unreachable {
        /// The address.
        address: SocketAddr,
        /// The QUIC library's reason.
        reason: String,
    },
    /// No address of a node's host led to a connection: one error for each.
    #[error("{}", join(_0))]
    NoAddressConnects(Vec<Error>),
    /// The peer's certificate is not accepted.
    #[error("its certificate {0}")]
    PeerCertificate(CertificateFault),
    /// The peer does not accept this side's certificate.
    #[error("the {by} refused the connection: our certificate {fault}")]
    CertificateRefused {
        /// The other side.
        by: Role,
        /// The fault.
        fault: CertificateFault,
    },
    /// The two sides have no common application protocol.
    #[error("the two sides speak different protocols: update the older one")]
    ProtocolMismatch,
    /// The TLS handshake failed for a reason other than a certificate.
    #[error("the TLS handshake failed with alert {0}")]
    Handshake(u8),
    /// The handshake took too long.
    #[error(
        "the handshake was not done within {} s: the path loses packets, or the other side has no time; it \
         may call again",
        HANDSHAKE_TIMEOUT.as_secs()
    )]
    HandshakeTimeout,
    /// A player opened the control stream but did not send the greeting.
    #[error(
        "the player sent no greeting within {} s: call again, with a program of this protocol's version",
        HANDSHAKE_TIMEOUT.as_secs()
    )]
    NoGreeting,
    /// The handshake was evicted in favour of handshakes from other addresses.
    #[error(
        "its handshake gave way to others: too many are under way, most of them from its address"
    )]
    HandshakeEvicted,
    /// A player connected but opened no control stream.
    #[error(
        "the player opened no control stream within {} s: call again, with a program of this protocol's \
         version",
        HANDSHAKE_TIMEOUT.as_secs()
    )]
    NoControlStream,
    /// The address of a player's connection changed more often than a NAT or a roaming user would change
    /// it.
    #[error("its address changes too often")]
    MovesTooOften,
    /// A player was refused because the node has no place for it.
    #[error("refused: {0}")]
    NodeFull(NoPlace),
    /// The peer ended the connection, or is gone.
    #[error("the {peer} {reason}")]
    Disconnected {
        /// The other side.
        peer: Role,
        /// Its reason.
        reason: DisconnectReason,
    },
    /// The connection failed on this side.
    #[error("the connection broke: {}", printable(_0, SENTENCE_BYTES_MAX))]
    ConnectionBroken(String),
    /// This side has closed the connection.
    #[error("the connection is closed")]
    ConnectionClosed,
    /// The application has dropped the farm that a link belongs to.
    #[error("the farm has shut down")]
    FarmClosed,
    /// The peer broke a rule of the session.
    #[error(transparent)]
    Protocol(#[from] carom_protocol::Error),
    /// The peer ended the control stream without closing the connection.
    #[error("the control stream ended")]
    ControlStreamEnded,
    /// A stream failed in a way that QUIC does not allow.
    #[error(
        "the stream of {content} broke: {}",
        printable(reason, SENTENCE_BYTES_MAX)
    )]
    Stream {
        /// `control messages` or `tiles`.
        content: &'static str,
        /// The QUIC library's reason.
        reason: String,
    },
    /// The peer sent a datagram or stream that forward error correction cannot use.
    #[error("tiles cannot be decoded: {0}")]
    ErrorCorrection(String),
    /// A task of this process panicked.
    #[error("a task failed: {0}")]
    Task(String),
    /// As many frames are in flight as the configuration allows: take one first.
    #[error("{in_flight} frames are in flight already: take one with poll_frame first")]
    FramesInFlight {
        /// Number of frames in flight.
        in_flight: usize,
    },
    /// No node is connected.
    #[error("no node has answered for {} s: {}", since.as_secs(), states(nodes, *since))]
    NoNodes {
        /// Duration of that state.
        since: Duration,
        /// The nodes, with the reason of each.
        nodes: Vec<NodeStatus>,
    },
    /// Every node refuses a frame.
    #[error(
        "no node traces frame {}: {}. Change what is asked for, or add a node that takes it",
        _0.frame.0,
        _0.reasons()
    )]
    FrameRefused(FrameRefusal),
    /// The system cannot start a thread.
    #[error("the system gives no thread: {0}")]
    Thread(io::Error),
    /// A thread of a render has panicked.
    #[error("the thread of a render has ended: its panic was reported above")]
    RenderThread,
    /// A render was cancelled.
    #[error("the render was cancelled after {samples_done} samples per pixel")]
    Cancelled {
        /// Samples per pixel that had arrived.
        samples_done: u32,
    },
    /// The name of a picture's file has an unsupported extension.
    #[error("{}: the name must end in {ENDINGS}", _0.display())]
    PictureFormat(PathBuf),
    /// A file of a render cannot be read or written.
    #[error("{}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A film was cancelled.
    #[error("the film was cancelled after {frames_done} of {frames} frames")]
    FilmCancelled {
        /// Finished frames.
        frames_done: u32,
        /// Frames of its range.
        frames: u32,
    },
    /// A folder holds frames of another, unfinished film.
    #[error(
        "{} holds {held} frames of an unfinished film of another kind ({other}): its own command \
         goes on with it; delete the folder, or name another, for this one ({own})",
        folder.display()
    )]
    UnfinishedFilm {
        /// The folder.
        folder: PathBuf,
        /// Number of frames that it holds.
        held: usize,
        /// Description of their film.
        other: String,
        /// Description of the requested film.
        own: String,
    },
    /// A folder holds a frame that belongs to no film there.
    #[error(
        "{} is in the way, and no film has put it there: move it away, or name another folder",
        _0.display()
    )]
    ForeignFrame(PathBuf),
    /// A frame of a film cannot be read.
    #[error("{} is damaged: delete it and render the film again: {reason}", path.display())]
    FilmFrame {
        /// The file.
        path: PathBuf,
        /// Its fault.
        reason: String,
    },
    /// The name of a film's file has an unsupported extension.
    #[error(
        "{}: the name of a film must end in .y4m (then `ffmpeg -i film.y4m film.mp4` makes other \
         kinds of it) or in .png for an animation",
        _0.display()
    )]
    FilmFormat(PathBuf),
    /// A text is not a range of frames.
    #[error(
        "`{}` is no range of frames: give the first and the last, counted from 0, as in 0-9",
        _0.escape_debug()
    )]
    FrameRange(String),
    /// A film ends before a range of its frames begins.
    #[error("a film of {frames} frames has none in a range that begins with frame {first}")]
    NoFrameOfRange {
        /// First frame of the range, counted from 0.
        first: u32,
        /// Number of frames of the film.
        frames: u32,
    },
    /// A film has more frames than a folder may hold.
    #[error("a film of {frames} frames is too long: at most {max} are traced at once")]
    FilmLength {
        /// Number of its frames.
        frames: usize,
        /// The maximum.
        max: u32,
    },
    /// The file that a render would resume from belongs to another one, or is damaged.
    #[error("{}: {reason}; delete it, or choose another name", path.display())]
    Resume {
        /// The file.
        path: PathBuf,
        /// Its fault.
        reason: String,
    },
    /// No scene has been set.
    #[error("no scene is set: call set_scene first")]
    NoScene,
}

/// The same as `Display`, as `main` prints the `Debug` form of an error that it returns.
impl fmt::Debug for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Display::fmt(self, f)
    }
}

impl Error {
    /// An error of a socket.
    #[cfg(feature = "net")]
    pub(crate) fn socket(address: impl fmt::Display + Copy) -> impl Fn(io::Error) -> Self + Copy {
        move |source| Self::Socket {
            address: address.to_string(),
            source,
        }
    }

    /// An error of a directory.
    pub(crate) fn directory(name: impl fmt::Display, why: impl fmt::Display) -> Self {
        Self::Directory {
            directory: name.to_string(),
            reason: why.to_string(),
        }
    }

    /// An error of a file of a render.
    pub(crate) fn file(path: &Path) -> impl Fn(io::Error) -> Self + Copy {
        move |source| Self::File {
            path: path.to_path_buf(),
            source,
        }
    }

    /// Whether the caller's arguments, or files that they name, are at fault, so that a retry without a
    /// change is futile.
    pub fn is_invalid_input(&self) -> bool {
        match self {
            Self::Tracer(error) => !matches!(error, carom_tracer::Error::Device { .. }),
            Self::Config(_)
            | Self::Choice(_)
            | Self::NoNetwork
            | Self::UnknownBalancer { .. }
            | Self::CredentialsMissing { .. }
            | Self::CredentialsFile { .. }
            | Self::CredentialsPem { .. }
            | Self::KeyExposed { .. }
            | Self::Certificate { .. }
            | Self::KeyPair(_)
            | Self::CertificateCreation(_)
            | Self::FarmExists(_)
            | Self::MemberExists { .. }
            | Self::NothingToRevoke { .. }
            | Self::PassphraseMissing(_)
            | Self::PassphraseWrong(_)
            | Self::JoinUrl(_)
            | Self::AuthorityExposed(_)
            | Self::MemberName { .. }
            | Self::NodeAddress { .. }
            | Self::PictureFormat(_)
            | Self::UnfinishedFilm { .. }
            | Self::ForeignFrame(_)
            | Self::FilmFormat(_)
            | Self::FrameRange(_)
            | Self::NoFrameOfRange { .. }
            | Self::FilmLength { .. }
            | Self::Resume { .. } => true,
            _ => false,
        }
    }
}

/// Supported extensions of pictures.
#[cfg(feature = "image-io")]
const ENDINGS: &str = ".png, .exr or .jpg";
#[cfg(not(feature = "image-io"))]
const ENDINGS: &str = ".png: this program was built without carom-farm's feature `image-io`";

fn states(nodes: &[NodeStatus], since: Duration) -> String {
    let nodes = nodes.iter();
    let sentences = nodes.map(|node| format!("{} {}", node.address, node.sentence_after(since)));
    let sentences = sentences.collect::<Vec<_>>().join("; ");
    if sentences.is_empty() {
        return "the farm has none".to_owned();
    }
    sentences
}

fn socket_reason(source: &io::Error) -> String {
    match source.kind() {
        io::ErrorKind::AddrInUse => "another program uses this address: end it, or listen \
                                          at another port"
            .to_owned(),
        _ => source.to_string(),
    }
}

fn prefix(path: Option<&Path>) -> String {
    path.map_or_else(String::new, |path| format!("{}: ", path.display()))
}

fn join(errors: &[Error]) -> String {
    let errors: Vec<String> = errors.iter().map(Error::to_string).collect();
    errors.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wait_without_an_answer_ends_with_what_to_check() {
        let nodes = ["oak:4433", "local"].map(NodeStatus::new).to_vec();
        let since = Duration::from_secs(5);
        let why = Error::NoNodes { since, nodes }.to_string();
        assert!(
            why.contains("oak:4433 has not answered for 5 s: check"),
            "{why}"
        );
        assert!(why.contains("firewalls"), "{why}");
        assert!(
            why.contains("local has not opened its device within 5 s"),
            "{why}"
        );
        assert!(!why.contains("is being called"), "{why}");
    }

    #[test]
    fn refusals_name_their_limit_and_what_to_do() {
        for why in [
            Error::HandshakeTimeout,
            Error::NoGreeting,
            Error::NoControlStream,
        ] {
            let why = why.to_string();
            assert!(
                why.contains("within 3 s") && why.contains("call again"),
                "{why}"
            );
        }
    }
}
