//! quinn's connection errors as [`Error`]s that say who is at fault and what to do.

use quinn::ConnectionError;

use crate::Error;
use crate::net::close_code;
use crate::net::peer::{CertificateFault, DisconnectReason, Role};

/// The error of a connection that failed or ended, seen from the side with role `own`.
pub(crate) fn connection(error: &ConnectionError, own: Role) -> Error {
    let peer = own.peer();
    let disconnected = |reason| Error::Disconnected { peer, reason };
    match error {
        ConnectionError::TransportError(error) => match tls_alert(error.code.into()) {
            Some(alert) => match certificate_fault(alert, peer) {
                Some(fault) => Error::PeerCertificate { fault },
                None => handshake(alert),
            },
            None => Error::ConnectionBroken {
                reason: error.to_string(),
            },
        },
        ConnectionError::ConnectionClosed(close) => match tls_alert(close.error_code.into()) {
            Some(alert) => match certificate_fault(alert, own) {
                Some(fault) => Error::CertificateRefused { by: peer, fault },
                None => handshake(alert),
            },
            None if close.error_code == quinn_proto::TransportErrorCode::CONNECTION_REFUSED => {
                disconnected(DisconnectReason::Refusing)
            }
            None => disconnected(DisconnectReason::Broken(close.to_string())),
        },
        ConnectionError::ApplicationClosed(close) => disconnected(application_reason(close)),
        ConnectionError::TimedOut => disconnected(DisconnectReason::TimedOut),
        ConnectionError::Reset => disconnected(DisconnectReason::Restarted),
        ConnectionError::VersionMismatch => disconnected(DisconnectReason::QuicVersion),
        ConnectionError::LocallyClosed => Error::ConnectionClosed,
        ConnectionError::CidsExhausted => Error::ConnectionBroken {
            reason: "it ran out of connection identifiers".into(),
        },
    }
}

/// TLS alerts are QUIC's errors 0x100 to 0x1ff (RFC 9001, 4.8).
fn tls_alert(code: u64) -> Option<u8> {
    (code >> 8 == 1).then_some((code & 0xff) as u8)
}

/// The fault of the certificate of `holder` that a TLS alert reports (RFC 8446, 6.2).
fn certificate_fault(alert: u8, holder: Role) -> Option<CertificateFault> {
    Some(match alert {
        116 => CertificateFault::Missing,
        45 => CertificateFault::Expired(holder),
        48 | 51 => CertificateFault::OtherFarm,
        43 | 49 => CertificateFault::WrongRole(holder),
        44 => CertificateFault::Revoked,
        42 | 46 => CertificateFault::Unusable(format!("TLS alert {alert}")),
        _ => return None,
    })
}

/// The error of a handshake that fails over something other than a certificate.
fn handshake(alert: u8) -> Error {
    match alert {
        70 | 120 => Error::ProtocolMismatch,
        alert => Error::Handshake { alert },
    }
}

fn application_reason(close: &quinn::ApplicationClose) -> DisconnectReason {
    match close.error_code {
        close_code::DONE => DisconnectReason::Closed(String::new()),
        close_code::FULL => DisconnectReason::Full,
        close_code::DRAINING => DisconnectReason::Draining,
        // The peer is authenticated, but its text must not control a terminal.
        _ => DisconnectReason::Closed(
            String::from_utf8_lossy(&close.reason)
                .chars()
                .filter(|c| !c.is_control())
                .take(REASON_CHARS_MAX)
                .collect(),
        ),
    }
}

const REASON_CHARS_MAX: usize = 200;
