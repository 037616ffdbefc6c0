//! Why a connection did not come about or ended, as a sentence that says what to do.

use quinn::ConnectionError;
use rustls::{CertificateError, Error};

use crate::net::credentials::Role;
use crate::net::endpoint::code;

/// Why this program's own certificate would be refused by its peers.
pub(crate) fn own_certificate(why: &Error, role: Role) -> String {
    let noun = role.noun();
    let Error::InvalidCertificate(why) = why else {
        return format!("the certificate cannot be used: {why}");
    };
    match why {
        CertificateError::Expired | CertificateError::ExpiredContext { .. } => {
            format!("the certificate has expired: {}", renewal(role))
        }
        CertificateError::NotValidYet | CertificateError::NotValidYetContext { .. } => {
            "the certificate is not valid yet: is this machine's clock right?".into()
        }
        CertificateError::InvalidPurpose
        | CertificateError::InvalidPurposeContext { .. }
        | CertificateError::ApplicationVerificationFailure => {
            format!("the certificate does not have the role of a {noun}")
        }
        CertificateError::UnknownIssuer | CertificateError::BadSignature => {
            "the certificate is of another farm than the ca.pem beside it".into()
        }
        why => format!("the certificate cannot be used: {why}"),
    }
}

/// Why a connection failed or ended, seen from `us`.
pub(crate) fn connection(why: &ConnectionError, us: Role) -> String {
    let peer = match us {
        Role::Player => Role::Node,
        Role::Node => Role::Player,
    };
    match why {
        ConnectionError::TransportError(error) => match alert(error.code.into()) {
            Some(alert) => certificate_of(alert, peer, "its"),
            None => format!("the connection broke: {error}"),
        },
        ConnectionError::ConnectionClosed(close) => match alert(close.error_code.into()) {
            Some(alert) => format!(
                "the {} refused us: {}",
                peer.noun(),
                certificate_of(alert, us, "our")
            ),
            None if close.error_code == quinn_proto::TransportErrorCode::CONNECTION_REFUSED => {
                format!("the {} accepts no connection now", peer.noun())
            }
            None => format!("the {} broke the connection: {close}", peer.noun()),
        },
        ConnectionError::ApplicationClosed(close) => application(close, peer),
        ConnectionError::TimedOut => format!("the {} no longer answers", peer.noun()),
        ConnectionError::Reset => format!("the {} has been restarted", peer.noun()),
        ConnectionError::VersionMismatch => {
            format!("the {} speaks another version of QUIC", peer.noun())
        }
        ConnectionError::LocallyClosed => "we closed the connection".into(),
        ConnectionError::CidsExhausted => "the connection ran out of identifiers".into(),
    }
}

/// TLS alerts are QUIC's errors 0x100 to 0x1ff (RFC 9001, 4.8).
fn alert(code: u64) -> Option<u8> {
    (code >> 8 == 1).then_some((code & 0xff) as u8)
}

/// What is wrong with the certificate of `holder`; alert numbers are from RFC 8446, 6.
fn certificate_of(alert: u8, holder: Role, whose: &str) -> String {
    match alert {
        116 => format!("{whose} side showed no certificate"),
        45 => format!("{whose} certificate has expired: {}", renewal(holder)),
        48 | 51 => format!("{whose} certificate is of another farm"),
        43 | 49 => {
            let noun = holder.noun();
            format!("{whose} certificate does not have the role of a {noun}")
        }
        42 | 44 | 46 => format!("{whose} certificate is not usable"),
        70 | 120 => "the two speak different protocols: update the older one".into(),
        alert => format!("the TLS handshake failed with alert {alert}"),
    }
}

fn application(close: &quinn::ApplicationClose, peer: Role) -> String {
    let noun = peer.noun();
    // The peer is authenticated, but a terminal is not its canvas.
    let reason: String = String::from_utf8_lossy(&close.reason)
        .chars()
        .filter(|c| !c.is_control())
        .take(REASON_CHARS_MAX)
        .collect();
    match close.error_code {
        code::DONE => format!("the {noun} has closed the connection"),
        code::FULL => format!("the {noun} serves as many players as it may"),
        code::DRAINING => format!("the {noun} is shutting down"),
        _ if reason.is_empty() => format!("the {noun} has closed the connection"),
        _ => format!("the {noun} has closed the connection: {reason}"),
    }
}

const REASON_CHARS_MAX: usize = 200;

fn renewal(role: Role) -> &'static str {
    match role {
        Role::Node => "make a new one with `carom-farm add NAME --renew` and copy it to the node",
        Role::Player => "make a new farm with `carom-farm init` in another folder",
    }
}
