//! Conversion of quinn's connection errors into [`Error`]s that state who is at fault and what to do.

use carom_tracer::text::printable;
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
                Some(fault) => Error::PeerCertificate(fault),
                None => handshake(alert),
            },
            None => Error::ConnectionBroken(printable(&error.to_string(), REASON_BYTES_MAX)),
        },
        ConnectionError::ConnectionClosed(close) => match tls_alert(close.error_code.into()) {
            Some(alert) => match certificate_fault(alert, own) {
                Some(fault) => Error::CertificateRefused { by: peer, fault },
                None => handshake(alert),
            },
            None if close.error_code == quinn_proto::TransportErrorCode::CONNECTION_REFUSED => {
                disconnected(DisconnectReason::Refusing)
            }
            None => disconnected(DisconnectReason::Broken(printable(
                &close.to_string(),
                REASON_BYTES_MAX,
            ))),
        },
        ConnectionError::ApplicationClosed(close) => disconnected(application_reason(close)),
        ConnectionError::TimedOut => disconnected(DisconnectReason::TimedOut),
        ConnectionError::Reset => disconnected(DisconnectReason::Restarted),
        ConnectionError::VersionMismatch => disconnected(DisconnectReason::QuicVersion),
        ConnectionError::LocallyClosed => Error::ConnectionClosed,
        ConnectionError::CidsExhausted => {
            Error::ConnectionBroken("it ran out of connection identifiers".into())
        }
    }
}

/// The TLS alert in a QUIC error code: codes 0x100 to 0x1ff (RFC 9001, 4.8).
fn tls_alert(code: u64) -> Option<u8> {
    (code >> 8 == 1).then_some((code & 0xff) as u8)
}

/// The fault of the certificate of `holder` that a TLS alert reports (RFC 8446, 6.2).
fn certificate_fault(alert: u8, holder: Role) -> Option<CertificateFault> {
    Some(match alert {
        // certificate_required
        116 => CertificateFault::Missing,
        // certificate_expired, which rustls also sends for a certificate that is not valid yet.
        45 => CertificateFault::OutsideItsDays(holder),
        // unknown_ca and decrypt_error
        48 | 51 => CertificateFault::OtherFarm,
        // unsupported_certificate and access_denied
        43 | 49 => CertificateFault::WrongRole(holder),
        // certificate_revoked
        44 => CertificateFault::Revoked,
        // bad_certificate and certificate_unknown
        42 | 46 => CertificateFault::Unusable(format!("TLS alert {alert}")),
        _ => return None,
    })
}

/// The error of a handshake that failed for another reason than a certificate.
fn handshake(alert: u8) -> Error {
    match alert {
        // protocol_version and no_application_protocol
        70 | 120 => Error::ProtocolMismatch,
        alert => Error::Handshake(alert),
    }
}

fn application_reason(close: &quinn::ApplicationClose) -> DisconnectReason {
    let reason = || printable(&String::from_utf8_lossy(&close.reason), REASON_BYTES_MAX);
    match close.error_code {
        close_code::DONE => DisconnectReason::Closed(String::new()),
        close_code::DRAINING => DisconnectReason::Draining,
        close_code::FULL => DisconnectReason::Full(reason()),
        _ => DisconnectReason::Closed(reason()),
    }
}

const REASON_BYTES_MAX: usize = 200;

#[cfg(test)]
mod tests {
    use quinn::{ApplicationClose, ConnectionClose, VarInt};
    use quinn_proto::{TransportError, TransportErrorCode};

    use super::*;

    #[test]
    fn no_close_reason_controls_a_terminal() {
        let hostile = "\u{1b}]0;owned\u{7}\u{9b}2J\r\n\u{202e}oak".repeat(500);
        let transport = |error_code| {
            ConnectionError::ConnectionClosed(ConnectionClose {
                error_code,
                frame_type: None,
                reason: hostile.clone().into(),
            })
        };
        let mut local = TransportError::from(TransportErrorCode::PROTOCOL_VIOLATION);
        local.reason.clone_from(&hostile);
        let closes = [
            transport(TransportErrorCode::PROTOCOL_VIOLATION),
            transport(TransportErrorCode::CONNECTION_REFUSED),
            transport(TransportErrorCode::crypto(80)),
            ConnectionError::ApplicationClosed(ApplicationClose {
                error_code: VarInt::from_u32(3),
                reason: hostile.clone().into(),
            }),
            ConnectionError::TransportError(local),
        ];
        for close in closes {
            let sentence = connection(&close, Role::Player).to_string();
            assert_eq!(printable(&sentence, 300), sentence, "{close:?}");
        }
    }
}
