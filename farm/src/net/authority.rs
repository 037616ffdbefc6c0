//! A farm's own certificate authority: created once, kept by the player, never on a node.

use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rcgen::{
    BasicConstraints, Certificate, CertificateParams, DistinguishedName, DnType,
    ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose, SanType,
};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};

use crate::Error;
use crate::net::credentials::{AUTHORITY_FILE, Credentials};
use crate::net::peer::Role;

const DAY: Duration = Duration::from_secs(24 * 3600);
/// The authority and the player's certificate outlive any farm: whoever can replace the one on
/// the player's disk can replace the other, so that a shorter life would protect nothing.
const AUTHORITY_LIFE: Duration = Duration::from_secs(10 * 365 * 24 * 3600);
/// A node's key lies on a rented machine that others will rent next.
const NODE_LIFE: Duration = Duration::from_secs(30 * 24 * 3600);
/// Certificates begin a day early: clocks of fresh machines are often wrong by a time zone.
const EARLY: Duration = DAY;
/// Bytes of a node's name: a host name's label has as many.
const NAME_BYTES_MAX: usize = 63;

const AUTHORITY_KEY_FILE: &str = "ca.key";

/// A certificate and its key as PEM text.
pub struct IssuedCertificate {
    /// The certificate.
    pub certificate_pem: String,
    /// The private key: never printed, written with mode 0600.
    pub key_pem: String,
}

/// The farm's authority with its key.
pub struct Authority {
    certificate_pem: String,
    issuer: Issuer<'static, KeyPair>,
}

/// Creates a farm in `dir`: `ca.pem`, `ca.key`, `player.pem`, `player.key`.
///
/// # Errors
/// [`Error::FarmExists`], or [`Error::CredentialsFile`] if the folder cannot be written.
pub fn create_farm(dir: &Path) -> Result<(), Error> {
    for file in [AUTHORITY_FILE, AUTHORITY_KEY_FILE] {
        let path = dir.join(file);
        if path.exists() {
            return Err(Error::FarmExists { path });
        }
    }
    fs::create_dir_all(dir).map_err(|source| io(dir, source))?;
    let authority = Authority::generate()?;
    let player = authority.issue(Role::Player, "player", lasting(AUTHORITY_LIFE))?;
    save(dir, Role::Player, &authority, &player)?;
    // Last, because it is what makes the folder a farm: an interrupted start can be repeated.
    write_private(
        &dir.join(AUTHORITY_KEY_FILE),
        &authority.issuer.key().serialize_pem(),
    )
}

/// Creates a node's folder `out` (absent: `dir/nodes/NAME`) with `ca.pem`, `node.pem` and
/// `node.key`, valid for 30 days, and returns it.
///
/// # Errors
/// [`Error::NodeName`]; [`Error::CredentialsMissing`] if `dir` holds no farm; [`Error::NodeExists`]
/// unless `renew` is set; [`Error::AuthorityExposed`]; [`Error::CredentialsFile`] if the folder
/// cannot be written.
pub fn add_node(dir: &Path, name: &str, out: Option<&Path>, renew: bool) -> Result<PathBuf, Error> {
    check_name(name)?;
    let authority = Authority::load(dir)?;
    let out = out.map_or_else(|| dir.join("nodes").join(name), Path::to_path_buf);
    let key = out.join(Role::Node.key_file());
    if key.exists() && !renew {
        return Err(Error::NodeExists { path: key });
    }
    if out.join(AUTHORITY_KEY_FILE).exists() {
        return Err(Error::AuthorityExposed { folder: out });
    }
    fs::create_dir_all(&out).map_err(|source| io(&out, source))?;
    let issued = authority.issue(Role::Node, name, lasting(NODE_LIFE))?;
    save(&out, Role::Node, &authority, &issued)?;
    Ok(out)
}

impl Authority {
    /// Creates an authority with a P-256 key, in memory.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the system gives no randomness.
    pub fn generate() -> Result<Self, Error> {
        let key = KeyPair::generate().map_err(|error| not_created(&error))?;
        let mut params = CertificateParams::default();
        let validity = lasting(AUTHORITY_LIFE);
        params.not_before = validity.start.into();
        params.not_after = validity.end.into();
        // Each farm's name differs, so that a stranger's certificate can be distinguished from a
        // forged one.
        let digest = params.key_identifier(&key);
        let id: String = digest
            .iter()
            .take(8)
            .map(|byte| format!("{byte:02x}"))
            .collect();
        params.distinguished_name = subject(&format!("Carom farm {id}"));
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let certificate = params
            .self_signed(&key)
            .map_err(|error| not_created(&error))?;
        Ok(Self {
            certificate_pem: certificate.pem(),
            issuer: Issuer::new(params, key),
        })
    }

    /// Reads `ca.pem` and `ca.key`.
    ///
    /// # Errors
    /// [`Error::CredentialsMissing`], [`Error::CredentialsFile`] or [`Error::CredentialsPem`].
    pub fn load(dir: &Path) -> Result<Self, Error> {
        let certificate_path = dir.join(AUTHORITY_FILE);
        let certificate_pem = read(&certificate_path)?;
        let key_path = dir.join(AUTHORITY_KEY_FILE);
        let key = KeyPair::from_pem(&read(&key_path)?)
            .map_err(|error| not_pem(&key_path, "private key", &error))?;
        let issuer = Issuer::from_ca_cert_pem(&certificate_pem, key)
            .map_err(|error| not_pem(&certificate_path, "certificate", &error))?;
        Ok(Self {
            certificate_pem,
            issuer,
        })
    }

    /// The authority's certificate as PEM text.
    pub fn certificate_pem(&self) -> &str {
        &self.certificate_pem
    }

    /// Creates a key and issues its certificate.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the system gives no randomness.
    pub fn issue(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
    ) -> Result<IssuedCertificate, Error> {
        let key = KeyPair::generate().map_err(|error| not_created(&error))?;
        let certificate = self
            .sign(role, name, validity, &key)
            .map_err(|error| not_created(&error))?;
        Ok(IssuedCertificate {
            certificate_pem: certificate.pem(),
            key_pem: key.serialize_pem(),
        })
    }

    /// Issues credentials that are ready for an endpoint and never on a disk.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`], or [`Error::Certificate`] if it is not valid now.
    pub fn credentials(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
    ) -> Result<Credentials, Error> {
        let issued = self.issue(role, name, validity)?;
        let certificate = |pem: &str| {
            CertificateDer::from_pem_slice(pem.as_bytes()).map_err(|error| not_created(&error))
        };
        let key = PrivateKeyDer::from_pem_slice(issued.key_pem.as_bytes());
        Credentials::new(
            certificate(&self.certificate_pem)?,
            certificate(&issued.certificate_pem)?,
            key.map_err(|error| not_created(&error))?,
            role,
        )
    }

    fn sign(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
        key: &KeyPair,
    ) -> Result<Certificate, rcgen::Error> {
        let mut params = CertificateParams::default();
        params.not_before = validity.start.into();
        params.not_after = validity.end.into();
        params.distinguished_name = subject(name);
        params.subject_alt_names = vec![SanType::URI(role.uri().try_into()?)];
        params.is_ca = IsCa::ExplicitNoCa;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![match role {
            Role::Player => ExtendedKeyUsagePurpose::ClientAuth,
            Role::Node => ExtendedKeyUsagePurpose::ServerAuth,
        }];
        params.use_authority_key_identifier_extension = true;
        params.signed_by(key, &self.issuer)
    }
}

fn check_name(name: &str) -> Result<(), Error> {
    let first_is_plain = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if first_is_plain && name.len() <= NAME_BYTES_MAX && name.chars().all(plain) {
        return Ok(());
    }
    Err(Error::NodeName {
        name: name.to_owned(),
        length_max: NAME_BYTES_MAX,
    })
}

fn subject(name: &str) -> DistinguishedName {
    let mut subject = DistinguishedName::new();
    subject.push(DnType::CommonName, name);
    subject
}

fn lasting(life: Duration) -> std::ops::Range<SystemTime> {
    let now = SystemTime::now();
    now - EARLY..now + life
}

fn save(
    dir: &Path,
    role: Role,
    authority: &Authority,
    issued: &IssuedCertificate,
) -> Result<(), Error> {
    let write = |file: &str, text: &str| {
        let path = dir.join(file);
        fs::write(&path, text).map_err(|source| io(&path, source))
    };
    let key = dir.join(role.key_file());
    if key.exists() {
        fs::remove_file(&key).map_err(|source| io(&key, source))?;
    }
    write_private(&key, &issued.key_pem)?;
    write(role.certificate_file(), &issued.certificate_pem)?;
    write(AUTHORITY_FILE, &authority.certificate_pem)
}

/// Writes a new file that only its owner can read, from its first byte on.
fn write_private(path: &Path, text: &str) -> Result<(), Error> {
    let mut options = OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options
        .open(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(|source| io(path, source))
}

fn read(path: &Path) -> Result<String, Error> {
    fs::read_to_string(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => Error::CredentialsMissing {
            path: path.to_path_buf(),
            advice: "create the farm's authority with `carom-farm init`",
        },
        _ => io(path, source),
    })
}

fn io(path: &Path, source: std::io::Error) -> Error {
    Error::CredentialsFile {
        path: path.to_path_buf(),
        source,
    }
}

fn not_pem(path: &Path, item: &'static str, error: &rcgen::Error) -> Error {
    Error::CredentialsPem {
        path: path.to_path_buf(),
        item,
        reason: error.to_string(),
    }
}

fn not_created(error: &dyn std::fmt::Display) -> Error {
    Error::CertificateCreation {
        reason: error.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_existing_farm_is_never_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let key = fs::read(dir.path().join(AUTHORITY_KEY_FILE)).unwrap();
        let refused = create_farm(dir.path()).unwrap_err().to_string();
        assert!(refused.contains("already holds a farm"), "{refused}");
        assert_eq!(key, fs::read(dir.path().join(AUTHORITY_KEY_FILE)).unwrap());
    }

    #[test]
    fn an_interrupted_init_can_be_repeated() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        fs::remove_file(dir.path().join(AUTHORITY_KEY_FILE)).unwrap();
        fs::remove_file(dir.path().join(AUTHORITY_FILE)).unwrap();
        create_farm(dir.path()).unwrap();
        Credentials::load(dir.path(), Role::Player).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn keys_are_readable_by_their_owner_only() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let node = add_node(dir.path(), "oak", None, false).unwrap();
        for key in [
            dir.path().join("ca.key"),
            dir.path().join("player.key"),
            node.join("node.key"),
        ] {
            let mode = fs::metadata(&key).unwrap().permissions().mode() & 0o777;
            assert_eq!(mode, 0o600, "{}", key.display());
        }
    }

    #[test]
    fn a_node_is_replaced_only_on_renewal() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let node = add_node(dir.path(), "oak", None, false).unwrap();
        let first = fs::read(node.join("node.key")).unwrap();
        add_node(dir.path(), "oak", None, false).unwrap_err();
        assert_eq!(first, fs::read(node.join("node.key")).unwrap());
        add_node(dir.path(), "oak", None, true).unwrap();
        assert_ne!(first, fs::read(node.join("node.key")).unwrap());
        assert_eq!(Credentials::load(&node, Role::Node).unwrap().name(), "oak");
    }

    #[test]
    fn node_names_cannot_leave_the_folder() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let long = "a".repeat(NAME_BYTES_MAX + 1);
        for name in [
            "", ".", "..", "a/b", "../oak", "-x", "a b", "ä", "a\0b", &long,
        ] {
            let refused = add_node(dir.path(), name, None, false).unwrap_err();
            assert!(
                refused.to_string().contains("is not a valid node name"),
                "{refused}"
            );
        }
    }

    #[test]
    fn a_node_never_receives_the_authoritys_key() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        add_node(dir.path(), "oak", Some(dir.path()), false).unwrap_err();
        let node = add_node(dir.path(), "oak", None, false).unwrap();
        let mut files: Vec<_> = fs::read_dir(node)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        files.sort();
        assert_eq!(files, ["ca.pem", "node.key", "node.pem"]);
    }

    #[test]
    fn loading_refuses_the_other_roles_certificate() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        for ext in ["pem", "key"] {
            let player = dir.path().join(format!("player.{ext}"));
            fs::copy(player, dir.path().join(format!("node.{ext}"))).unwrap();
        }
        let refused = Credentials::load(dir.path(), Role::Node)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("role"), "{refused}");
    }

    #[test]
    fn expired_certificates_are_refused() {
        let authority = Authority::generate().unwrap();
        let now = SystemTime::now();
        let refused = authority
            .credentials(Role::Node, "oak", now - 3 * DAY..now - DAY)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("expired"), "{refused}");
    }
}
