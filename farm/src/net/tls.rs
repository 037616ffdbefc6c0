//! TLS 1.3 configurations of both sides, which authenticate each other by the farm's own authority and
//! nothing else.

use std::fmt::Display;
use std::sync::Arc;

use quinn::crypto::rustls::{QuicClientConfig, QuicServerConfig};
use rustls::client::danger::ServerCertVerifier;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use rustls::server::danger::ClientCertVerifier;

use crate::Error;
use crate::net::certificate::provider;
use crate::net::credentials::Credentials;

/// ALPN name of the protocol of players and nodes; another version of the transport gets another name.
pub(crate) const ALPN: &[u8] = b"carom/1";
/// Server name that clients send. Certificates state roles, not hosts, so it is never checked.
pub(crate) const SERVER_NAME: &str = "node.carom";

/// The configuration of the connecting side, with ALPN `protocol`; it presents `own`, or no certificate.
///
/// # Errors
/// [`Error::KeyPair`] if the key does not belong to the certificate.
pub(crate) fn client(
    verifier: impl ServerCertVerifier + 'static,
    own: Option<&Credentials>,
    protocol: &[u8],
) -> Result<QuicClientConfig, Error> {
    let builder = rustls::ClientConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&rustls::version::TLS13])
        .map_err(unusable)?
        .dangerous()
        .with_custom_certificate_verifier(Arc::new(verifier));
    let mut config = match own {
        None => builder.with_no_client_auth(),
        Some(own) => builder
            .with_client_auth_cert(vec![own.certificate.clone()], own.key.clone_key())
            .map_err(unusable)?,
    };
    config.alpn_protocols = vec![protocol.to_vec()];
    // A request in early data could be replayed.
    config.enable_early_data = false;
    config.resumption = rustls::client::Resumption::disabled();
    QuicClientConfig::try_from(config).map_err(unusable)
}

/// The configuration of the accepting side, with ALPN `protocol`; it presents `certificate`.
///
/// # Errors
/// [`Error::KeyPair`] if the key does not belong to the certificate.
pub(crate) fn server(
    verifier: impl ClientCertVerifier + 'static,
    certificate: &CertificateDer<'static>,
    key: PrivateKeyDer<'static>,
    protocol: &[u8],
) -> Result<QuicServerConfig, Error> {
    let mut config = rustls::ServerConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&rustls::version::TLS13])
        .map_err(unusable)?
        .with_client_cert_verifier(Arc::new(verifier))
        .with_single_cert(vec![certificate.clone()], key)
        .map_err(unusable)?;
    config.alpn_protocols = vec![protocol.to_vec()];
    config.max_early_data_size = 0;
    // No resumption, so that each handshake verifies the certificate and its dates anew.
    config.send_tls13_tickets = 0;
    config.session_storage = Arc::new(rustls::server::NoServerSessionStorage {});
    QuicServerConfig::try_from(config).map_err(unusable)
}

/// Converts the TLS library's error about an unusable certificate or key.
pub(crate) fn unusable(error: impl Display) -> Error {
    Error::KeyPair(error.to_string())
}
