//! Fields of X.509 certificates: names, key fingerprints, validity.

use std::ops::Range;
use std::path::Path;
use std::time::{Duration, SystemTime};

use carom_protocol::limits::NODE_NAME_BYTES_MAX;
use carom_tracer::text::printable;
use quinn::Connection;
use ring::digest;
use ring::error::Unspecified;
use ring::rand::{SecureRandom as _, SystemRandom};
use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use x509_parser::prelude::{FromDer as _, X509Certificate};
use x509_parser::time::ASN1Time;

use crate::net::peer::CertificateFault;

/// The certificate that the peer has presented.
pub(crate) fn peer_certificate(connection: &Connection) -> Option<CertificateDer<'static>> {
    let chain = connection.peer_identity()?;
    let chain = chain.downcast::<Vec<CertificateDer<'static>>>().ok()?;
    chain.into_iter().next()
}

/// The common name of a certificate's subject, made printable.
pub(crate) fn common_name(certificate: &[u8]) -> Result<String, CertificateFault> {
    let parsed = parse(certificate)?;
    let name = parsed.subject().iter_common_name().next();
    let name = name.and_then(|name| name.as_str().ok()).unwrap_or_default();
    Ok(printable(name, NODE_NAME_BYTES_MAX))
}

/// The common name in a PEM file; `None` if the file does not exist or holds something else.
pub(crate) fn common_name_of_file(path: &Path) -> Option<String> {
    common_name(&CertificateDer::from_pem_file(path).ok()?).ok()
}

/// SHA-256 of a certificate's public key, in hexadecimal.
pub(crate) fn key_id(certificate: &[u8]) -> Result<String, CertificateFault> {
    Ok(sha256(parse(certificate)?.public_key().raw))
}

/// The validity of a certificate.
pub(crate) fn validity(certificate: &[u8]) -> Result<Range<SystemTime>, CertificateFault> {
    let parsed = parse(certificate)?;
    let time = |time: ASN1Time| {
        SystemTime::UNIX_EPOCH + Duration::from_secs(time.timestamp().unsigned_abs())
    };
    Ok(time(parsed.validity().not_before)..time(parsed.validity().not_after))
}

/// Formats a day as `2026-12-24`.
pub(crate) fn day(unix_secs: u64) -> String {
    let time = i64::try_from(unix_secs).map(ASN1Time::from_timestamp);
    match time {
        Ok(Ok(time)) => time.to_datetime().date().to_string(),
        _ => "the end of time".to_owned(),
    }
}

/// Formats a moment as `2026-12-24T18:00:00Z`.
pub fn utc(time: SystemTime) -> String {
    let since = time.duration_since(SystemTime::UNIX_EPOCH);
    let secs = since.map_or(0, |since| since.as_secs());
    let (hour, minute, second) = (secs / 3600 % 24, secs / 60 % 60, secs % 60);
    format!("{}T{hour:02}:{minute:02}:{second:02}Z", day(secs))
}

/// SHA-256 in hexadecimal.
pub(crate) fn sha256(bytes: &[u8]) -> String {
    hexadecimal(digest::digest(&digest::SHA256, bytes).as_ref())
}

pub(crate) fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Cryptographically secure random bytes; fails if the system provides none.
pub(crate) fn random<const N: usize>() -> Result<[u8; N], Unspecified> {
    let mut bytes = [0; N];
    SystemRandom::new().fill(&mut bytes)?;
    Ok(bytes)
}

pub(crate) fn parse(certificate: &[u8]) -> Result<X509Certificate<'_>, CertificateFault> {
    let parsed = X509Certificate::from_der(certificate);
    let (_, parsed) = parsed.map_err(|error| CertificateFault::Unusable(error.to_string()))?;
    Ok(parsed)
}
