//! TLS 1.3 configurations of both sides, which authenticate each other by the farm's own
//! authority and by nothing else.

use std::sync::Arc;

use rustls::Error;

use crate::net::certificate::{PeerVerifier, provider};
use crate::net::credentials::Credentials;
use crate::net::peer::Role;

/// The protocol that both ends must offer; another version of the transport is another name.
pub(crate) const ALPN: &[u8] = b"carom/1";
/// The server name that clients send: certificates name roles and not hosts, so it is never
/// checked.
pub(crate) const SERVER_NAME: &str = "node.carom";

/// The configuration of a player's side.
pub(crate) fn client(credentials: &Credentials) -> Result<rustls::ClientConfig, Error> {
    let verifier = Arc::new(PeerVerifier::new(
        &credentials.authority,
        Role::Node,
        Arc::clone(&credentials.denied),
    )?);
    let mut config = rustls::ClientConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .dangerous()
        .with_custom_certificate_verifier(verifier)
        .with_client_auth_cert(
            vec![credentials.certificate.clone()],
            credentials.key.clone_key(),
        )?;
    config.alpn_protocols = vec![ALPN.to_vec()];
    // A request in early data could be replayed.
    config.enable_early_data = false;
    config.resumption = rustls::client::Resumption::disabled();
    Ok(config)
}

/// The configuration of a node's side.
pub(crate) fn server(credentials: &Credentials) -> Result<rustls::ServerConfig, Error> {
    let verifier = Arc::new(PeerVerifier::new(
        &credentials.authority,
        Role::Player,
        Arc::clone(&credentials.denied),
    )?);
    let mut config = rustls::ServerConfig::builder_with_provider(provider())
        .with_protocol_versions(&[&rustls::version::TLS13])?
        .with_client_cert_verifier(verifier)
        .with_single_cert(
            vec![credentials.certificate.clone()],
            credentials.key.clone_key(),
        )?;
    config.alpn_protocols = vec![ALPN.to_vec()];
    config.max_early_data_size = 0;
    // Each handshake checks the certificate and its date anew: no resumption.
    config.send_tls13_tickets = 0;
    config.session_storage = Arc::new(rustls::server::NoServerSessionStorage {});
    Ok(config)
}
