//! Link of the coordinator to a node: commands in, events out, with one interface over memory and QUIC.
//!
//! ```text
//! coordinator ──LinkCommand──▶ link ──Packet──▶ NodeConnection, in this process or behind a socket
//!             ◀──LinkEvent──        ◀─Packet───
//! ```
//!
//! A link keeps connecting to its node until it is dropped. Each attempt begins with
//! [`LinkEvent::Connecting`], followed by [`ClientEvent::Welcome`] if it succeeds, and ends with
//! [`LinkEvent::Lost`]; commands for an earlier connection are dropped. Packets become events, and pixels
//! are decoded, on the link's own thread: [`crate::net::NodeLink`] over QUIC,
//! [`crate::memory_link::MemoryLink`] in this process. Events are passed on in batches, as waking a thread
//! for each took longer than decoding it. Over memory, session and packets are the same except that pixels
//! are not encoded: a single machine uses the code path of a farm.

use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_protocol::session::{ClientEvent, ClientSession, Packet, SceneStatus};
use carom_protocol::{
    EncodedScene, FrameId, PrecisionRange, Reason, Refusal, RefusalReason, RequestId, TraceRequest,
};

/// Command to a node; each is a call of [`ClientSession`].
#[derive(Clone, Debug)]
pub enum LinkCommand {
    /// [`ClientSession::set_scene`].
    Scene(Arc<EncodedScene>),
    /// [`ClientSession::trace`].
    Trace(Box<TraceRequest>),
    /// [`ClientSession::cancel_before`].
    CancelBefore(FrameId),
    /// [`ClientSession::cancel_request`].
    CancelRequest(RequestId),
    /// [`ClientSession::ping`].
    Ping(u64),
    /// [`ClientSession::leave`].
    Leave,
}

/// Event of a node's link.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkEvent {
    /// An attempt to connect begins.
    Connecting,
    /// A decoded event of the session. The first of a connection is [`ClientEvent::Welcome`].
    Session(ClientEvent),
    /// Time that decoding the tiles of the next event took, by the client's clock.
    Decoded {
        /// Request that the tiles belong to.
        request: RequestId,
        /// Duration from packet to pixels.
        took: Duration,
    },
    /// The connection is lost, with all its requests and scenes.
    Lost {
        /// Reason, as a sentence.
        why: String,
        /// Pause before the next attempt; absent if there is none.
        retry: Option<Duration>,
    },
}

/// One connection to a node: commands and packets in, packets and events out.
pub struct LinkSession<F> {
    session: ClientSession,
    precision: PrecisionRange,
    /// Events that have not been passed on.
    events: Vec<LinkEvent>,
    /// Time that decoding these took.
    decoding: Duration,
    hand_on: F,
}

impl<F: FnMut(Vec<LinkEvent>)> LinkSession<F> {
    /// The session of a new connection, with its greeting queued. sRGB tiles come with the given precision,
    /// unless a request demands exact ones. `hand_on` receives events in batches of at least one.
    pub fn new(precision: PrecisionRange, hand_on: F) -> Self {
        Self {
            session: ClientSession::new(),
            precision,
            events: Vec::new(),
            decoding: Duration::ZERO,
            hand_on,
        }
    }

    /// Encodes a command into packets. A request that cannot be sent is refused here, as the node would.
    pub fn command(&mut self, command: LinkCommand) {
        let session = &mut self.session;
        let done = match command {
            LinkCommand::Scene(scene) => session.set_scene(&scene).map(|status| {
                if status == SceneStatus::Transferring {
                    let (hash, bytes, of) = (scene.hash(), 0, scene.bytes() as u64);
                    let coming = ClientEvent::SceneComing { hash, bytes, of };
                    self.events.push(LinkEvent::Session(coming));
                }
            }),
            LinkCommand::CancelBefore(frame) => session.cancel_before(frame),
            LinkCommand::CancelRequest(run) => session.cancel_request(run),
            LinkCommand::Ping(number) => session.ping(number),
            LinkCommand::Leave => session.leave(),
            LinkCommand::Trace(request) => return self.trace(*request),
        };
        if let Err(why) = done {
            tracing::warn!("{why}");
        }
    }

    /// Handles a packet from the node. Its events are passed on by [`LinkSession::flush`], which must
    /// follow when no more packets are available, or here once much has been decoded.
    ///
    /// # Errors
    /// The protocol rule that the node broke: the connection must end.
    pub fn handle(&mut self, packet: Packet) -> Result<(), carom_protocol::Error> {
        let begun = Instant::now();
        for event in self.session.handle(packet)? {
            if let ClientEvent::Tiles { request, .. } = event {
                let took = begun.elapsed();
                self.decoding += took;
                self.events.push(LinkEvent::Decoded { request, took });
            }
            self.events.push(LinkEvent::Session(event));
        }
        if self.decoding >= DECODING_MAX {
            self.flush();
        }
        Ok(())
    }

    /// Passes on the collected events, if any.
    pub fn flush(&mut self) {
        self.decoding = Duration::ZERO;
        if !self.events.is_empty() {
            (self.hand_on)(std::mem::take(&mut self.events));
        }
    }

    /// The next packet to send.
    pub fn poll_transmit(&mut self) -> Option<Packet> {
        self.session.poll_transmit()
    }

    fn trace(&mut self, mut request: TraceRequest) {
        if request.precision != PrecisionRange::EXACT {
            request.precision = self.precision;
        }
        let (frame, id) = (request.frame, request.id);
        if let Err(why) = self.session.trace(request) {
            let why = match why {
                // The node has evicted the scene, and its chunks are being sent, which has been reported.
                carom_protocol::Error::Unsendable { reason, .. }
                    if reason == Reason::SCENE_NOT_HELD =>
                {
                    RefusalReason::Busy
                }
                why => RefusalReason::Invalid(why.to_string()),
            };
            let refusal = Refusal { request: id, why };
            let event = ClientEvent::RequestRefused { frame, refusal };
            self.events.push(LinkEvent::Session(event));
        }
    }
}

/// Decoding time of a batch after which it is passed on at once.
const DECODING_MAX: Duration = Duration::from_micros(200);

#[cfg(test)]
mod tests {
    use carom_protocol::limits::SCENES_KEPT_MAX;
    use carom_protocol::session::{NodeEvent, NodeSession};
    use carom_protocol::{CodedParticles, NodeInfo, NodeLoad, PixelFormat};
    use carom_tracer::{
        DeviceInfo, DeviceKind, ImageSize, Material, RenderSettings, Scene, SceneUpdate, Sphere,
        TileGrid, TileRange,
    };

    use super::*;

    fn node() -> NodeSession {
        let device = DeviceInfo {
            kind: DeviceKind::Cpu,
            name: String::new(),
            width: 1,
            threads: 1,
        };
        NodeSession::new(NodeInfo {
            name: "oak".into(),
            instance: 0,
            device,
        })
    }

    /// A scene of `objects` objects: with 12,000 it is sent in chunks.
    fn scene(objects: usize) -> Arc<EncodedScene> {
        let mut scene = Scene::new();
        for _ in 0..objects {
            scene.add(Sphere::new(1.0), Material::grey(0.5));
        }
        EncodedScene::new(&scene).unwrap()
    }

    #[test]
    fn requests_of_a_scene_whose_place_others_had_wait_until_it_is_there_again() {
        let mut node = node();
        let mut events = Vec::new();
        let mut link = LinkSession::new(PrecisionRange::EXACT, |new| events.extend(new));
        let mut talk = |link: &mut LinkSession<_>| {
            loop {
                if let Some(packet) = link.poll_transmit() {
                    node.handle(packet).unwrap();
                } else if let Some(packet) = node.poll_transmit() {
                    link.handle(packet).unwrap();
                } else {
                    return link.flush();
                }
            }
        };
        let long = scene(12_000);
        assert!(!long.chunks().is_empty());
        talk(&mut link);
        for scene in [Arc::clone(&long)]
            .into_iter()
            .chain((1..=SCENES_KEPT_MAX).map(scene))
        {
            link.command(LinkCommand::Scene(scene));
            talk(&mut link);
        }
        let request = |id| {
            LinkCommand::Trace(Box::new(TraceRequest {
                frame: FrameId(1),
                id: RequestId(id),
                scene: long.hash(),
                update: SceneUpdate::default(),
                grid: TileGrid::new(ImageSize::new(8, 8), 8),
                tiles: TileRange { first: 0, count: 1 },
                settings: RenderSettings::default(),
                format: PixelFormat::LinearF16,
                precision: PrecisionRange::EXACT,
                references: Vec::new(),
                particles: CodedParticles::default(),
            }))
        };
        link.command(LinkCommand::Scene(Arc::clone(&long)));
        link.command(request(1));
        link.flush();
        talk(&mut link);
        link.command(request(2));
        assert!(link.poll_transmit().is_some());
        drop(link);
        let of_long = events.into_iter().filter_map(|event| match event {
            LinkEvent::Session(ClientEvent::SceneComing { hash, bytes, .. }) => {
                (hash == long.hash()).then(|| bytes.to_string())
            }
            LinkEvent::Session(ClientEvent::SceneReady(hash)) => {
                (hash == long.hash()).then(|| "ready".to_owned())
            }
            LinkEvent::Session(ClientEvent::RequestRefused { refusal, .. }) => {
                Some(format!("{:?}", refusal.why))
            }
            _ => None,
        });
        let of_long: Vec<String> = of_long.collect();
        let middle = of_long.iter().position(|event| event == "ready").unwrap() + 1;
        let again = &of_long[middle..];
        assert_eq!(again[..2], ["0", "Busy"], "{of_long:?}");
        assert_eq!(again.last().unwrap(), "ready", "{of_long:?}");
        assert_eq!(again.iter().filter(|event| *event == "Busy").count(), 1);
    }

    #[test]
    fn events_are_handed_on_together() {
        let mut node = node();
        let mut handed = Vec::new();
        let mut link = LinkSession::new(PrecisionRange::EXACT, |events| handed.push(events));
        for ping in 0..3 {
            while let Some(packet) = link.poll_transmit() {
                if let Some(NodeEvent::Ping(number)) = node.handle(packet).unwrap() {
                    node.pong(number, NodeLoad::default());
                }
            }
            while let Some(packet) = node.poll_transmit() {
                link.handle(packet).unwrap();
            }
            link.command(LinkCommand::Ping(ping));
        }
        link.flush();
        link.flush();
        let [events] = &handed[..] else {
            panic!("{handed:?}");
        };
        let load = NodeLoad::default();
        let pong = |number| LinkEvent::Session(ClientEvent::Pong { number, load });
        assert!(matches!(
            events[0],
            LinkEvent::Session(ClientEvent::Welcome(_))
        ));
        assert_eq!(events[1..], [pong(0), pong(1)]);
    }
}
