//! Enrolment service of a farm's authority: admits nodes that present its token, and renews certificates.

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use quinn::{Connection, Endpoint, Incoming};
use rustls::pki_types::CertificateDer;
use tokio::runtime::Runtime;
use tokio::sync::Notify;

use crate::Error;
use crate::lock::lock;
use crate::net::address::NodeAddress;
use crate::net::certificate::PeerVerifier;
use crate::net::enrolment::{ALPN, ANSWER_TIMEOUT, REQUEST_BYTES_MAX};
use crate::net::enrolment_messages::{Certified, EnrolmentAnswer, EnrolmentRequest, broken};
use crate::net::farm_folder::AuthorityFolder;
use crate::net::handshakes::Handshakes;
use crate::net::join_url::JoinUrl;
use crate::net::peer::{CertificateFault, Role};
use crate::net::signals::Signals;
use crate::net::{
    certificate_fields, close_code, connection_error, endpoint, listener, runtime, tls,
};
use crate::token_bucket::TokenBucket;

/// Event of the service, for its operator.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum EnrolmentEvent {
    /// A node has joined.
    Joined {
        /// Its name.
        name: String,
        /// Number of nodes that may still join.
        uses_left: u32,
    },
    /// A node's certificate was renewed.
    Renewed {
        /// Its name.
        name: String,
    },
    /// A request or connection was refused.
    Refused {
        /// The address of the peer.
        from: SocketAddr,
        /// The reason.
        why: String,
    },
}

/// Enrolment service with its open socket.
pub struct EnrolmentService {
    runtime: Runtime,
    endpoint: Endpoint,
    signals: Signals,
    state: Arc<EnrolmentState>,
}

/// State shared by all connections.
struct EnrolmentState {
    folder: AuthorityFolder,
    /// SHA-256 of the secret: the time to compare hashes tells an attacker nothing about the secret.
    secret_hash: String,
    uses_left: Mutex<u32>,
    /// Notified when the last use is spent.
    spent: Notify,
    handshakes: Handshakes,
}

impl EnrolmentService {
    /// Opens the socket, and creates a token for `uses` nodes.
    ///
    /// # Errors
    /// [`Error::KeyPair`] if the authority is unusable, [`Error::Socket`] if the address is in use or does
    /// not belong to this machine.
    pub fn bind(
        address: SocketAddr,
        folder: AuthorityFolder,
        url_address: NodeAddress,
        uses: u32,
    ) -> Result<(Self, JoinUrl), Error> {
        let failed = Error::socket(address);
        let authority = folder.authority.certificate()?;
        let config = server_config(&folder, &authority)?;
        let runtime = runtime::own_thread("carom-net").map_err(failed)?;
        let handshakes = Handshakes::default();
        let (endpoint, signals) = {
            let _inside = runtime.enter();
            let endpoint = endpoint::open_server(address, config, &handshakes);
            (
                endpoint.map_err(failed)?,
                Signals::listen().map_err(failed)?,
            )
        };
        let port = endpoint.local_addr().map_err(failed)?.port();
        let url = JoinUrl::new(url_address.with_port(port), &authority)?;
        let secret = url.secret.as_deref().unwrap_or_default();
        let state = EnrolmentState {
            folder,
            secret_hash: certificate_fields::sha256(secret.as_bytes()),
            uses_left: Mutex::new(uses),
            spent: Notify::new(),
            handshakes,
        };
        let service = Self {
            runtime,
            endpoint,
            signals,
            state: Arc::new(state),
        };
        Ok((service, url))
    }

    /// Serves until `time` has passed, until Ctrl-C or SIGTERM, or until the last use is spent.
    pub fn serve(
        self,
        time: Duration,
        events: impl Fn(EnrolmentEvent) + Clone + Send + Sync + 'static,
    ) {
        let Self {
            runtime,
            endpoint,
            mut signals,
            state,
        } = self;
        runtime.block_on(async {
            let until = tokio::time::Instant::from_std(Instant::now() + time);
            tokio::select! {
                () = accept(&endpoint, &state, events) => {}
                () = state.spent.notified() => {}
                () = signals.recv() => {}
                () = tokio::time::sleep_until(until) => {}
            }
            // The last answer may still be on its way.
            let _ = tokio::time::timeout(ANSWER_TIMEOUT, endpoint.wait_idle()).await;
        });
    }
}

fn server_config(
    folder: &AuthorityFolder,
    authority: &CertificateDer<'static>,
) -> Result<quinn::ServerConfig, Error> {
    let denied = Arc::new(folder.log.deny_list());
    let nodes = PeerVerifier::new(authority, Role::Node, denied).map_err(tls::unusable)?;
    let crypto = tls::server(nodes.optional(), authority, folder.authority.key(), ALPN)?;
    Ok(endpoint::enrolment_server_config(crypto))
}

async fn accept(
    endpoint: &Endpoint,
    state: &Arc<EnrolmentState>,
    events: impl Fn(EnrolmentEvent) + Clone + Send + Sync + 'static,
) {
    let lines = TokenBucket::new(Instant::now(), REFUSALS_TOLD, 1.0 / REFUSAL_SECS);
    let lines = Arc::new(Mutex::new(lines));
    while let Some(incoming) = endpoint.accept().await {
        let Some((incoming, pending)) = listener::screen(incoming, &state.handshakes) else {
            continue;
        };
        let (state, events) = (Arc::clone(state), events.clone());
        let lines = Arc::clone(&lines);
        tokio::spawn(async move {
            let from = incoming.remote_address();
            let served = async {
                tokio::select! {
                    served = state.serve(incoming, &events) => served,
                    () = pending.evicted() => Err(Error::HandshakeEvicted),
                }
            };
            let served = tokio::time::timeout(2 * ANSWER_TIMEOUT, served).await;
            let Err(error) = served.unwrap_or(Err(Error::HandshakeTimeout)) else {
                return;
            };
            // Refusals can be provoked without limit, without any certificate: their events are rate-limited.
            let now = Instant::now();
            let free = lock(&lines).try_take(now);
            let counts = state.handshakes.fail(now);
            let why = match counts {
                Some(counts) if !free => format!("{counts}; the last: {error}"),
                _ if free => error.to_string(),
                _ => return,
            };
            events(EnrolmentEvent::Refused { from, why });
        });
    }
}

/// Refusals reported one by one before those of a minute share an event.
const REFUSALS_TOLD: f64 = 8.0;
/// Seconds until another refusal may be reported on its own.
const REFUSAL_SECS: f64 = 15.0;

impl EnrolmentState {
    /// Answers the single request of a connection.
    async fn serve(
        &self,
        incoming: Incoming,
        events: &impl Fn(EnrolmentEvent),
    ) -> Result<(), Error> {
        let connection = listener::accept(incoming).await?;
        let stream = connection.accept_bi().await;
        let (mut send, mut receive) =
            stream.map_err(|error| connection_error::connection(&error, Role::Node))?;
        let bytes = receive.read_to_end(REQUEST_BYTES_MAX).await;
        let bytes = bytes.map_err(broken)?;
        let request = EnrolmentRequest::from_json(&bytes)?;
        let decided = self.decide(request, &connection);
        let refused = |sentence| EnrolmentAnswer::Refused { sentence };
        let answer = match &decided {
            Ok((answer, _)) => answer.to_json()?,
            Err(Error::EnrolmentRefused(sentence)) => refused(sentence.clone()).to_json()?,
            Err(why) => refused(why.to_string()).to_json()?,
        };
        send.write_all(&answer).await.map_err(broken)?;
        send.finish().map_err(broken)?;
        let refusal = match decided {
            Ok((_, event)) => {
                event.into_iter().for_each(events);
                Ok(())
            }
            Err(why) => Err(why),
        };
        // The node closes the connection once it has the answer.
        let _ = tokio::time::timeout(ANSWER_TIMEOUT, connection.closed()).await;
        connection.close(close_code::DONE, b"");
        refusal
    }

    fn decide(
        &self,
        request: EnrolmentRequest,
        connection: &Connection,
    ) -> Result<(EnrolmentAnswer, Option<EnrolmentEvent>), Error> {
        let (certificate_pem, event) = match request {
            EnrolmentRequest::Join {
                secret,
                name,
                request_pem,
            } => {
                let (pem, uses_left) = self.join(&secret, &name, &request_pem)?;
                (Some(pem), Some(EnrolmentEvent::Joined { name, uses_left }))
            }
            EnrolmentRequest::Renew { request_pem } => {
                let shown = shown_certificate(connection)?;
                match request_pem {
                    Some(pem) => {
                        let name = certificate_fields::common_name(&shown)
                            .map_err(Error::PeerCertificate)?;
                        let pem = self.folder.renew(&shown, &pem)?;
                        (Some(pem), Some(EnrolmentEvent::Renewed { name }))
                    }
                    None => (None, None),
                }
            }
        };
        let certified = Certified {
            authority_pem: self.folder.certificate_pem().to_owned(),
            certificate_pem,
            deny_list: self.folder.log.deny_list_text()?,
        };
        Ok((EnrolmentAnswer::Certified(certified), event))
    }

    /// Admits a node. A use of the token is spent only if a certificate is issued.
    fn join(&self, secret: &str, name: &str, request_pem: &str) -> Result<(String, u32), Error> {
        // Locked throughout, so that concurrent joins cannot exceed the uses.
        let mut uses_left = lock(&self.uses_left);
        if certificate_fields::sha256(secret.as_bytes()) != self.secret_hash || *uses_left == 0 {
            let why = "the token is not valid: ask for another by `carom-farm token`";
            return Err(Error::EnrolmentRefused(why.to_owned()));
        }
        let pem = self.folder.admit(name, request_pem)?;
        *uses_left -= 1;
        if *uses_left == 0 {
            self.spent.notify_one();
        }
        Ok((pem, *uses_left))
    }
}

/// The certificate that a client has presented, already verified by the handshake.
fn shown_certificate(connection: &Connection) -> Result<CertificateDer<'static>, Error> {
    let missing = Error::PeerCertificate(CertificateFault::Missing);
    certificate_fields::peer_certificate(connection).ok_or(missing)
}
