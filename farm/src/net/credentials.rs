//! The certificate and key of one side, loaded and checked before any socket is opened.

use std::fmt;
use std::path::{Path, PathBuf};

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, UnixTime};

use crate::Error;
use crate::net::certificate;
use crate::net::peer::Role;

/// A certificate with its key, and the authority that must have issued it and those of its peers.
pub struct Credentials {
    pub(crate) authority: CertificateDer<'static>,
    pub(crate) certificate: CertificateDer<'static>,
    pub(crate) key: PrivateKeyDer<'static>,
    role: Role,
    name: String,
}

/// The file of the authority's certificate, in every folder.
pub(crate) const AUTHORITY_FILE: &str = "ca.pem";

impl Credentials {
    /// Reads `ca.pem` and the role's certificate and key from `dir`.
    ///
    /// # Errors
    /// [`Error::CredentialsMissing`], [`Error::CredentialsFile`] or [`Error::CredentialsPem`] if a
    /// file cannot be read, [`Error::Certificate`] if a peer would refuse the certificate.
    pub fn load(dir: &Path, role: Role) -> Result<Self, Error> {
        let certificate_path = dir.join(role.certificate_file());
        let authority = read_certificate(&dir.join(AUTHORITY_FILE), role)?;
        let certificate = read_certificate(&certificate_path, role)?;
        let key_path = dir.join(role.key_file());
        let key = PrivateKeyDer::from_pem_slice(&read(&key_path, role)?)
            .map_err(|error| not_pem(&key_path, "private key", &error))?;
        warn_if_shared(&key_path);
        Self::new(authority, certificate, key, role).map_err(|error| match error {
            Error::Certificate { fault, .. } => Error::Certificate {
                path: Some(certificate_path),
                fault,
            },
            error => error,
        })
    }

    /// Credentials that are in memory already, as DER.
    ///
    /// # Errors
    /// [`Error::Certificate`] if a peer would refuse the certificate.
    pub fn new(
        authority: CertificateDer<'static>,
        certificate: CertificateDer<'static>,
        key: PrivateKeyDer<'static>,
        role: Role,
    ) -> Result<Self, Error> {
        let refused = |fault| Error::Certificate { path: None, fault };
        let name = certificate::common_name(&certificate).map_err(refused)?;
        certificate::verify_own(&authority, &certificate, role, UnixTime::now())
            .map_err(refused)?;
        Ok(Self {
            authority,
            certificate,
            key,
            role,
            name,
        })
    }

    /// The role that the certificate grants.
    pub fn role(&self) -> Role {
        self.role
    }

    /// The holder's name, from the certificate's subject.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Everything but the key.
impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("role", &self.role)
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

fn read_certificate(path: &Path, role: Role) -> Result<CertificateDer<'static>, Error> {
    CertificateDer::from_pem_slice(&read(path, role)?)
        .map_err(|error| not_pem(path, "certificate", &error))
}

fn read(path: &Path, role: Role) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => Error::CredentialsMissing {
            path: path.to_path_buf(),
            advice: role.creation_advice(),
        },
        _ => Error::CredentialsFile {
            path: path.to_path_buf(),
            source,
        },
    })
}

fn not_pem(path: &Path, item: &'static str, error: &dyn fmt::Display) -> Error {
    Error::CredentialsPem {
        path: path.to_path_buf(),
        item,
        reason: error.to_string(),
    }
}

/// A warning, not an error: copying a folder often loses the mode, and containers mount secrets
/// with modes of their own.
fn warn_if_shared(key: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let shared = |path: &PathBuf| {
            std::fs::metadata(path).is_ok_and(|file| file.permissions().mode() & 0o077 != 0)
        };
        let path = key.to_path_buf();
        if shared(&path) {
            tracing::warn!(
                "{}: other users can read this key; run chmod 600",
                path.display()
            );
        }
    }
    #[cfg(not(unix))]
    let _ = key;
}
