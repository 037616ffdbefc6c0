//! Link of the coordinator to a node: commands in, events out, the same over memory and QUIC.
//!
//! ```text
//! coordinator ──LinkCommand──▶ link ──Packet──▶ NodeConnection, in this process or behind a socket
//!             ◀──LinkEvent──        ◀─Packet───
//! ```
//!
//! A link keeps calling its node until it is dropped. Each connection begins with
//! [`LinkEvent::Connecting`] and, if it is made, [`ClientEvent::Welcome`], and ends with
//! [`LinkEvent::Lost`]; commands that were meant for an earlier connection are dropped. Packets
//! become events, and pixels are decoded, on the link's own thread: [`crate::net::NodeLink`] over
//! QUIC, [`crate::memory_link::MemoryLink`] in this process. Events are handed on together, as they come: to wake a thread for each
//! took more time than to decode it. Over memory the session and the packets are the same, but that
//! pixels pass as they are: playing on one machine takes the path that a farm takes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use carom_protocol::session::{ClientEvent, ClientSession, Packet, SceneStatus};
use carom_protocol::{
    EncodedScene, FrameId, PrecisionRange, Reason, Refusal, RefusalReason, RequestId, TraceRequest,
};

/// What the coordinator asks of a node; each is a call of [`ClientSession`].
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

/// What becomes of a node.
#[derive(Clone, Debug, PartialEq)]
pub enum LinkEvent {
    /// It is being called.
    Connecting,
    /// What it says, decoded. The first of a connection is [`ClientEvent::Welcome`].
    Session(ClientEvent),
    /// How long the tiles of the next event took to decode, by the client's clock.
    Decoded {
        /// Whose tiles.
        request: RequestId,
        /// From packet to pixels.
        took: Duration,
    },
    /// It is gone, with all its runs and scenes; it is called again after a pause.
    Lost {
        /// A sentence.
        why: String,
        /// The pause; absent if it is not called again.
        retry: Option<Duration>,
    },
}

/// One connection to a node: commands and packets in, packets and events out.
pub struct LinkSession<F> {
    session: ClientSession,
    precision: PrecisionRange,
    /// Not handed on yet.
    events: Vec<LinkEvent>,
    /// How long those took to decode.
    decoding: Duration,
    hand_on: F,
}

impl<F: FnMut(Vec<LinkEvent>)> LinkSession<F> {
    /// The session of a connection that has just been made, over which sRGB tiles come as exactly
    /// as `precision` has it, unless a request wants exact ones; its greeting waits to be sent. `hand_on` gets events, one or more.
    pub fn new(precision: PrecisionRange, hand_on: F) -> Self {
        Self {
            session: ClientSession::new(),
            precision,
            events: Vec::new(),
            decoding: Duration::ZERO,
            hand_on,
        }
    }

    /// Puts a command into packets. What cannot be asked is refused here as the node would.
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

    /// Takes a packet from the node. What it says is handed on by [`LinkSession::flush`], which must
    /// follow when no more packets are there, or here when many have been decoded.
    ///
    /// # Errors
    /// What rule the node broke: the connection must end.
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

    /// Hands on what has been heard, if anything.
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
                // Others had its place at the node: its chunks are sent, which has been told.
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

/// Tiles that took so long to decode wait no longer for others.
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

    /// A scene of so many objects: of 12,000 travels in chunks.
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
