//! One party's certificate and key, loaded and checked before any socket is opened.

use std::fmt;
use std::path::{Path, PathBuf};

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, UnixTime};
use x509_parser::extensions::GeneralName;
use x509_parser::prelude::{FromDer, X509Certificate};

use crate::Error;
use crate::net::{connection_error, tls};

/// What a certificate entitles its holder to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Role {
    /// Asks nodes for pictures.
    Player,
    /// Traces for players.
    Node,
}

impl Role {
    /// The URI in the certificate's subject alternative names that grants the role.
    pub const fn uri(self) -> &'static str {
        match self {
            Self::Player => "carom://role/player",
            Self::Node => "carom://role/node",
        }
    }

    /// The role in a sentence.
    pub const fn noun(self) -> &'static str {
        match self {
            Self::Player => "player",
            Self::Node => "node",
        }
    }

    pub(crate) const fn certificate_file(self) -> &'static str {
        match self {
            Self::Player => "player.pem",
            Self::Node => "node.pem",
        }
    }

    pub(crate) const fn key_file(self) -> &'static str {
        match self {
            Self::Player => "player.key",
            Self::Node => "node.key",
        }
    }
}

/// A certificate with its key, and the authority that it and its peers are measured by.
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
    /// [`Error::Credentials`] with the file and what to do, if one is missing or unreadable, or
    /// if the certificate is not of this authority, not of this role or not valid today: what a
    /// peer would refuse is refused here first.
    pub fn load(dir: &Path, role: Role) -> Result<Self, Error> {
        let certificate_path = dir.join(role.certificate_file());
        let authority = certificate(&dir.join(AUTHORITY_FILE), role)?;
        let certificate = certificate(&certificate_path, role)?;
        let key_path = dir.join(role.key_file());
        let key = PrivateKeyDer::from_pem_slice(&read(&key_path, role)?)
            .map_err(|why| unreadable(&key_path, "private key", &why))?;
        warn_if_shared(&key_path);
        Self::new(authority, certificate, key, role)
            .map_err(|why| Error::Credentials(format!("{}: {why}", certificate_path.display())))
    }

    /// Checks credentials that are in memory already, as DER.
    ///
    /// # Errors
    /// A sentence, as [`Credentials::load`] gives it.
    pub fn new(
        authority: CertificateDer<'static>,
        certificate: CertificateDer<'static>,
        key: PrivateKeyDer<'static>,
        role: Role,
    ) -> Result<Self, String> {
        let name = common_name(&certificate)?;
        tls::verify_chain(&authority, &certificate, role, UnixTime::now())
            .map_err(|why| connection_error::own_certificate(&why, role))?;
        Ok(Self {
            authority,
            certificate,
            key,
            role,
            name,
        })
    }

    /// What the certificate entitles to.
    pub fn role(&self) -> Role {
        self.role
    }

    /// The holder's name, from the certificate's subject.
    pub fn name(&self) -> &str {
        &self.name
    }
}

/// Without the key.
impl fmt::Debug for Credentials {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Credentials")
            .field("role", &self.role)
            .field("name", &self.name)
            .finish_non_exhaustive()
    }
}

/// Whether a certificate names exactly the role: no certificate has two.
pub(crate) fn grants(certificate: &[u8], role: Role) -> bool {
    let Ok((_, parsed)) = X509Certificate::from_der(certificate) else {
        return false;
    };
    let Ok(Some(names)) = parsed.subject_alternative_name() else {
        return false;
    };
    let mut roles = names
        .value
        .general_names
        .iter()
        .filter_map(|name| match name {
            GeneralName::URI(uri) if uri.starts_with("carom://role/") => Some(*uri),
            _ => None,
        });
    roles.next() == Some(role.uri()) && roles.next().is_none()
}

/// The common name of a certificate's subject.
pub(crate) fn common_name(certificate: &[u8]) -> Result<String, String> {
    let (_, parsed) = X509Certificate::from_der(certificate)
        .map_err(|why| format!("this is no X.509 certificate: {why}"))?;
    let name = parsed.subject().iter_common_name().next();
    Ok(name
        .and_then(|name| name.as_str().ok())
        .unwrap_or_default()
        .to_owned())
}

fn certificate(path: &Path, role: Role) -> Result<CertificateDer<'static>, Error> {
    CertificateDer::from_pem_slice(&read(path, role)?)
        .map_err(|why| unreadable(path, "certificate", &why))
}

fn read(path: &Path, role: Role) -> Result<Vec<u8>, Error> {
    std::fs::read(path).map_err(|why| {
        let advice = match (why.kind(), role) {
            (std::io::ErrorKind::NotFound, Role::Player) => {
                ": make the farm's credentials with `carom-farm init`, or name their folder"
            }
            (std::io::ErrorKind::NotFound, Role::Node) => {
                ": make the node's credentials with `carom-farm add NAME` where the farm's \
                 authority is, and copy that folder here"
            }
            _ => "",
        };
        Error::Credentials(format!("{}: {why}{advice}", path.display()))
    })
}

fn unreadable(path: &Path, what: &str, why: &dyn fmt::Display) -> Error {
    Error::Credentials(format!(
        "{}: this holds no PEM {what}: {why}",
        path.display()
    ))
}

/// Copying a folder often loses the mode; containers mount secrets as they please: no refusal.
fn warn_if_shared(key: &Path) {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        let shared = |path: &PathBuf| {
            std::fs::metadata(path).is_ok_and(|file| file.permissions().mode() & 0o077 != 0)
        };
        let path = key.to_path_buf();
        if shared(&path) {
            tracing::warn!("{} can be read by others: chmod 600 it", path.display());
        }
    }
    #[cfg(not(unix))]
    let _ = key;
}
