//! Certificate and key of one side, loaded and verified before any socket is opened.

use std::fmt;
use std::path::Path;
use std::sync::Arc;
use std::time::SystemTime;

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, UnixTime};
use zeroize::{Zeroize, Zeroizing};

use crate::Error;
use crate::net::credential_files::{check_private, file_error};
use crate::net::deny_list::DenyList;
use crate::net::peer::{CertificateFault, Role};
use crate::net::{certificate, certificate_fields};

/// A certificate with its key, and the authority that must have issued it and its peers' certificates.
pub struct Credentials {
    pub(crate) authority: CertificateDer<'static>,
    pub(crate) certificate: CertificateDer<'static>,
    pub(crate) key: PrivateKeyDer<'static>,
    /// Keys that are no longer trusted.
    pub(crate) denied: Arc<DenyList>,
    role: Role,
    name: String,
}

/// Name of the file with the authority's certificate, in every folder.
pub(crate) const AUTHORITY_FILE: &str = "ca.pem";

impl Credentials {
    /// Reads `ca.pem` and the role's certificate and key from `dir`. The deny list there is reread whenever
    /// it changes.
    ///
    /// # Errors
    /// file cannot be read, [`Error::KeyExposed`] if every user can read the key,
    /// [`Error::Certificate`] if a peer would refuse the certificate.
    pub fn load(dir: &Path, role: Role) -> Result<Self, Error> {
        let certificate_path = dir.join(role.certificate_file());
        let authority = read_certificate(&dir.join(AUTHORITY_FILE), role)?;
        let certificate = read_certificate(&certificate_path, role)?;
        let key_path = dir.join(role.key_file());
        let key = PrivateKeyDer::from_pem_slice(&Zeroizing::new(read(&key_path, role)?))
            .map_err(not_pem(&key_path, "private key"))?;
        check_private(&key_path)?;
        let denied = Arc::new(DenyList::in_folder(dir));
        Self::with_deny_list(authority, certificate, key, role, denied).map_err(|error| match error
        {
            Error::Certificate { fault, .. } => Error::Certificate {
                path: Some(certificate_path),
                fault,
            },
            error => error,
        })
    }

    /// Credentials from DER in memory.
    ///
    /// # Errors
    /// [`Error::Certificate`] if a peer would refuse the certificate.
    pub fn new(
        authority: CertificateDer<'static>,
        certificate: CertificateDer<'static>,
        key: PrivateKeyDer<'static>,
        role: Role,
    ) -> Result<Self, Error> {
        Self::with_deny_list(authority, certificate, key, role, Arc::default())
    }

    fn with_deny_list(
        authority: CertificateDer<'static>,
        certificate: CertificateDer<'static>,
        key: PrivateKeyDer<'static>,
        role: Role,
        denied: Arc<DenyList>,
    ) -> Result<Self, Error> {
        let refused = |fault| Error::Certificate { path: None, fault };
        let name = certificate_fields::common_name(&certificate).map_err(refused)?;
        certificate::verify_own(&authority, &certificate, role, &denied, UnixTime::now())
            .map_err(refused)?;
        Ok(Self {
            authority,
            certificate,
            key,
            denied,
            role,
            name,
        })
    }

    /// The role that the certificate grants.
    pub fn role(&self) -> Role {
        self.role
    }

    /// SHA-256 of the farm's certificate in hexadecimal, which identifies a farm.
    pub fn farm_fingerprint(&self) -> String {
        certificate_fields::sha256(&self.authority)
    }

    /// The period in which the certificate is valid.
    ///
    /// # Errors
    /// [`Error::Certificate`] if the certificate cannot be parsed.
    pub fn validity(&self) -> Result<std::ops::Range<SystemTime>, Error> {
        certificate_fields::validity(&self.certificate)
            .map_err(|fault| Error::Certificate { path: None, fault })
    }

    /// Whether two thirds of the certificate's validity are over, so that it should be renewed.
    pub fn is_due(&self) -> bool {
        let now = SystemTime::now();
        self.validity().is_ok_and(|validity| is_due(&validity, now))
    }

    /// Checks that peers would accept the certificate `pem` in place of this one.
    ///
    /// # Errors
    /// [`Error::Certificate`] if it is no certificate, or peers would refuse it at the time of this machine's
    /// clock.
    pub(crate) fn check_successor(&self, pem: &str) -> Result<(), Error> {
        let successor = CertificateDer::from_pem_slice(pem.as_bytes());
        successor
            .map_err(|error| CertificateFault::Unusable(error.to_string()))
            .and_then(|successor| {
                let now = UnixTime::now();
                certificate::verify_own(&self.authority, &successor, self.role, &self.denied, now)
            })
            .map_err(|fault| Error::Certificate { path: None, fault })
    }

    /// The last day of the certificate, as `2026-12-24`.
    ///
    /// # Errors
    /// As [`Credentials::validity`].
    pub fn last_day(&self) -> Result<String, Error> {
        let end = self.validity()?.end.duration_since(SystemTime::UNIX_EPOCH);
        Ok(certificate_fields::day(end.unwrap_or_default().as_secs()))
    }

    /// The holder's name, from the certificate's subject.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Whether the last third of a certificate's validity has begun.
pub(crate) fn is_due(validity: &std::ops::Range<SystemTime>, now: SystemTime) -> bool {
    let life = validity.end.duration_since(validity.start);
    life.is_ok_and(|life| now >= validity.end - life / 3)
}

/// Wipes the key from memory.
impl Drop for Credentials {
    fn drop(&mut self) {
        self.key.zeroize();
    }
}

/// Prints no key.
impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("role", &self.role)
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

fn read_certificate(path: &Path, role: Role) -> Result<CertificateDer<'static>, Error> {
    CertificateDer::from_pem_slice(&read(path, role)?).map_err(not_pem(path, "certificate"))
}

fn read(path: &Path, role: Role) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => Error::CredentialsMissing {
            path: path.to_path_buf(),
            advice: role.creation_advice(),
        },
        _ => file_error(path)(source),
    })
}

/// Converts the parser's error about a file that does not hold an `item`.
pub(crate) fn not_pem<E: fmt::Display>(path: &Path, item: &'static str) -> impl Fn(E) -> Error {
    move |error| Error::CredentialsPem {
        path: path.to_path_buf(),
        item,
        reason: error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn certificates_are_due_after_two_thirds() {
        let start = SystemTime::UNIX_EPOCH;
        let day = |n: u64| start + Duration::from_secs(n * 24 * 3600);
        let validity = start..day(30);
        assert!(!is_due(&validity, day(19)));
        assert!(is_due(&validity, day(20)));
        assert!(is_due(&validity, day(31)));
        // With clocks set back and forward, and with an inverted validity.
        let validity = day(20_000)..day(20_030);
        assert!(!is_due(&validity, day(20_025 - 365)) && !is_due(&validity, start));
        assert!(is_due(&validity, day(20_005 + 365)));
        assert!(!is_due(&(day(30)..start), day(20)));
    }
}
