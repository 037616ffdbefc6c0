//! Clients with arbitrary certificates and arbitrary messages.

use std::net::SocketAddr;
use std::sync::Arc;

use carom_farm::net::{Authority, IssuedCertificate, Role};
use carom_protocol::framing;
use carom_protocol::session::{ClientEvent, ClientSession, Packet};
use quinn::crypto::rustls::QuicClientConfig;
use quinn::{Connection, ConnectionError, Endpoint, RecvStream, SendStream};
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::CryptoProvider;
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName, UnixTime};
use rustls::{DigitallySignedStruct, Error, SignatureScheme};

use crate::greeter::{any_port, today};

/// A verifier that accepts any node: the tests are about what the node accepts.
#[derive(Debug)]
struct Gullible(Arc<CryptoProvider>);

impl ServerCertVerifier for Gullible {
    fn verify_server_cert(
        &self,
        _: &CertificateDer<'_>,
        _: &[CertificateDer<'_>],
        _: &ServerName<'_>,
        _: &[u8],
        _: UnixTime,
    ) -> Result<ServerCertVerified, Error> {
        Ok(ServerCertVerified::assertion())
    }

    fn verify_tls12_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        unreachable!("QUIC is TLS 1.3")
    }

    fn verify_tls13_signature(
        &self,
        _: &[u8],
        _: &CertificateDer<'_>,
        _: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        Ok(HandshakeSignatureValid::assertion())
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.0.signature_verification_algorithms.supported_schemes()
    }
}

/// The TLS configuration of a stranger, with or without a certificate.
pub(crate) fn tls(shown: Option<&IssuedCertificate>, alpn: &[u8]) -> quinn::ClientConfig {
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = rustls::ClientConfig::builder_with_provider(Arc::clone(&provider))
        .with_protocol_versions(&[&rustls::version::TLS13])
        .unwrap()
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(Gullible(provider)));
    let mut config = match shown {
        None => builder.with_no_client_auth(),
        Some(shown) => builder
            .with_client_auth_cert(vec![certificate(&shown.certificate_pem)], key(shown))
            .unwrap(),
    };
    config.alpn_protocols = vec![alpn.to_vec()];
    quinn::ClientConfig::new(Arc::new(QuicClientConfig::try_from(config).unwrap()))
}

pub(crate) fn certificate(pem: &str) -> CertificateDer<'static> {
    CertificateDer::from_pem_slice(pem.as_bytes()).unwrap()
}

pub(crate) fn key(issued: &IssuedCertificate) -> PrivateKeyDer<'static> {
    PrivateKeyDer::from_pem_slice(issued.key_pem.as_bytes()).unwrap()
}

/// A certificate that only its holder has signed.
pub(crate) fn self_signed(role: Role) -> IssuedCertificate {
    let key = rcgen::KeyPair::generate().unwrap();
    let mut params = rcgen::CertificateParams::default();
    params.subject_alt_names = vec![rcgen::SanType::URI(role.uri().try_into().unwrap())];
    params.extended_key_usages = vec![
        rcgen::ExtendedKeyUsagePurpose::ClientAuth,
        rcgen::ExtendedKeyUsagePurpose::ServerAuth,
    ];
    IssuedCertificate {
        certificate_pem: params.self_signed(&key).unwrap().pem(),
        key_pem: key.serialize_pem(),
    }
}

pub(crate) fn block_on<T>(future: impl Future<Output = T>) -> T {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .unwrap();
    runtime.block_on(future)
}

/// An open connection and its control stream.
pub(crate) struct OpenConnection {
    pub(crate) connection: Connection,
    pub(crate) send: SendStream,
    pub(crate) receive: RecvStream,
    pub(crate) endpoint: Endpoint,
}

pub(crate) async fn call(
    address: SocketAddr,
    config: quinn::ClientConfig,
) -> Result<OpenConnection, ConnectionError> {
    let endpoint = Endpoint::client(any_port()).unwrap();
    let connecting = endpoint
        .connect_with(config, address, "node.carom")
        .unwrap();
    let connection = connecting.await?;
    let (send, receive) = connection.open_bi().await?;
    Ok(OpenConnection {
        connection,
        send,
        receive,
        endpoint,
    })
}

/// Connects, sends without waiting for permission, and returns the reason why the node ended it.
pub(crate) fn intrude(
    address: SocketAddr,
    config: quinn::ClientConfig,
    words: &[u8],
) -> ConnectionError {
    block_on(async {
        match call(address, config).await {
            Ok(mut call) => {
                let _ = call.send.write_all(words).await;
                call.connection.closed().await
            }
            Err(why) => why,
        }
    })
}

pub(crate) fn hello() -> Vec<u8> {
    framing::frame(&ClientSession::new().poll_transmit().unwrap().bytes)
}

/// A valid player's session up to the node's greeting.
pub(crate) fn greeting(address: SocketAddr, authority: &Authority) -> ClientEvent {
    let issued = authority.issue(Role::Player, "player", today()).unwrap();
    block_on(async {
        let mut call = call(address, tls(Some(&issued), b"carom/1")).await.unwrap();
        let mut session = ClientSession::new();
        let Packet { channel, bytes, .. } = session.poll_transmit().unwrap();
        call.send.write_all(&framing::frame(&bytes)).await.unwrap();
        let mut deframer = framing::Deframer::new(1 << 16);
        loop {
            let chunk = call
                .receive
                .read_chunk(1 << 16, true)
                .await
                .unwrap()
                .unwrap();
            deframer.push(&chunk.bytes);
            if let Some(bytes) = deframer.next_packet().unwrap() {
                return session
                    .handle(Packet::new(channel, bytes))
                    .unwrap()
                    .remove(0);
            }
        }
    })
}
