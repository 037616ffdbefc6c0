//! The farm's own certificate authority: made once, kept by the player, never on a node.

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
use crate::net::credentials::{AUTHORITY_FILE, Credentials, Role};

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
pub struct Issued {
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

/// Makes a farm in `dir`: `ca.pem`, `ca.key`, `player.pem`, `player.key`.
///
/// # Errors
/// [`Error::Credentials`] if the folder holds a farm already, or cannot be written.
pub fn create_farm(dir: &Path) -> Result<(), Error> {
    for file in [AUTHORITY_FILE, AUTHORITY_KEY_FILE] {
        let path = dir.join(file);
        if path.exists() {
            return Err(Error::Credentials(format!(
                "{} exists: this folder holds a farm already, and a new authority would lock all \
                 its nodes out. Choose another folder with --dir, or remove the old farm yourself",
                path.display()
            )));
        }
    }
    fs::create_dir_all(dir).map_err(|why| io(dir, &why))?;
    let authority = Authority::generate()?;
    let player = authority.issue(Role::Player, "player", lasting(AUTHORITY_LIFE))?;
    save(dir, Role::Player, &authority, &player)?;
    // Last, because it is what makes the folder a farm: an interrupted start can be repeated.
    write_private(
        &dir.join(AUTHORITY_KEY_FILE),
        &authority.issuer.key().serialize_pem(),
    )
}

/// Makes a node's folder `out` (absent: `dir/nodes/NAME`) with `ca.pem`, `node.pem` and
/// `node.key`, valid for 30 days, and returns it.
///
/// # Errors
/// [`Error::Credentials`] if the name is not usable, if `dir` holds no farm, if the folder holds
/// a node already and `renew` is false, or if it cannot be written.
pub fn add_node(dir: &Path, name: &str, out: Option<&Path>, renew: bool) -> Result<PathBuf, Error> {
    check_name(name)?;
    let authority = Authority::load(dir)?;
    let out = out.map_or_else(|| dir.join("nodes").join(name), Path::to_path_buf);
    let key = out.join(Role::Node.key_file());
    if key.exists() && !renew {
        return Err(Error::Credentials(format!(
            "{} exists: give --renew to replace it, or another folder with --out",
            key.display()
        )));
    }
    if out.join(AUTHORITY_KEY_FILE).exists() {
        return Err(Error::Credentials(format!(
            "{} holds a farm's authority, which no node may see: choose another folder with --out",
            out.display()
        )));
    }
    fs::create_dir_all(&out).map_err(|why| io(&out, &why))?;
    let issued = authority.issue(Role::Node, name, lasting(NODE_LIFE))?;
    save(&out, Role::Node, &authority, &issued)?;
    Ok(out)
}

impl Authority {
    /// A new authority with a P-256 key, in memory.
    ///
    /// # Errors
    /// [`Error::Credentials`] if the system gives no randomness.
    pub fn generate() -> Result<Self, Error> {
        let key = KeyPair::generate().map_err(|why| failed(&why))?;
        let mut params = CertificateParams::default();
        let validity = lasting(AUTHORITY_LIFE);
        params.not_before = validity.start.into();
        params.not_after = validity.end.into();
        // Each farm's name differs, so that a stranger's certificate is told from a forged one.
        let digest = params.key_identifier(&key);
        let id: String = digest
            .iter()
            .take(8)
            .map(|byte| format!("{byte:02x}"))
            .collect();
        params.distinguished_name = subject(&format!("Carom farm {id}"));
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
        let certificate = params.self_signed(&key).map_err(|why| failed(&why))?;
        Ok(Self {
            certificate_pem: certificate.pem(),
            issuer: Issuer::new(params, key),
        })
    }

    /// Reads `ca.pem` and `ca.key`.
    ///
    /// # Errors
    /// [`Error::Credentials`] with the file.
    pub fn load(dir: &Path) -> Result<Self, Error> {
        let certificate_path = dir.join(AUTHORITY_FILE);
        let certificate_pem = read(&certificate_path)?;
        let key_path = dir.join(AUTHORITY_KEY_FILE);
        let key = KeyPair::from_pem(&read(&key_path)?)
            .map_err(|why| Error::Credentials(format!("{}: {why}", key_path.display())))?;
        let issuer = Issuer::from_ca_cert_pem(&certificate_pem, key)
            .map_err(|why| Error::Credentials(format!("{}: {why}", certificate_path.display())))?;
        Ok(Self {
            certificate_pem,
            issuer,
        })
    }

    /// The authority's certificate as PEM text.
    pub fn certificate_pem(&self) -> &str {
        &self.certificate_pem
    }

    /// A new key and its certificate.
    ///
    /// # Errors
    /// [`Error::Credentials`] if the system gives no randomness.
    pub fn issue(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
    ) -> Result<Issued, Error> {
        let key = KeyPair::generate().map_err(|why| failed(&why))?;
        let certificate = self
            .sign(role, name, validity, &key)
            .map_err(|why| failed(&why))?;
        Ok(Issued {
            certificate_pem: certificate.pem(),
            key_pem: key.serialize_pem(),
        })
    }

    /// As [`Authority::issue`], checked and ready for an endpoint, never on a disk.
    ///
    /// # Errors
    /// [`Error::Credentials`] also if the certificate is not valid now.
    pub fn credentials(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
    ) -> Result<Credentials, Error> {
        let issued = self.issue(role, name, validity)?;
        let certificate =
            |pem: &str| CertificateDer::from_pem_slice(pem.as_bytes()).map_err(|why| failed(&why));
        let key = PrivateKeyDer::from_pem_slice(issued.key_pem.as_bytes());
        Credentials::new(
            certificate(&self.certificate_pem)?,
            certificate(&issued.certificate_pem)?,
            key.map_err(|why| failed(&why))?,
            role,
        )
        .map_err(Error::Credentials)
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
    Err(Error::Credentials(format!(
        "`{}` cannot be a node's name: it must have 1 to {NAME_BYTES_MAX} letters, digits, `-`, \
         `_` or `.`, and begin with a letter or digit",
        name.escape_debug()
    )))
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

fn save(dir: &Path, role: Role, authority: &Authority, issued: &Issued) -> Result<(), Error> {
    let write = |file: &str, text: &str| {
        let path = dir.join(file);
        fs::write(&path, text).map_err(|why| io(&path, &why))
    };
    let key = dir.join(role.key_file());
    if key.exists() {
        fs::remove_file(&key).map_err(|why| io(&key, &why))?;
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
        .map_err(|why| io(path, &why))
}

fn read(path: &Path) -> Result<String, Error> {
    fs::read_to_string(path).map_err(|why| {
        Error::Credentials(format!(
            "{}: {why}: the farm's authority is made by `carom-farm init`",
            path.display()
        ))
    })
}

fn io(path: &Path, why: &std::io::Error) -> Error {
    Error::Credentials(format!("{}: {why}", path.display()))
}

fn failed(why: &dyn std::fmt::Display) -> Error {
    Error::Credentials(format!("a certificate could not be made: {why}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_farm_is_never_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let key = fs::read(dir.path().join(AUTHORITY_KEY_FILE)).unwrap();
        let refused = create_farm(dir.path()).unwrap_err().to_string();
        assert!(refused.contains("holds a farm already"), "{refused}");
        assert_eq!(key, fs::read(dir.path().join(AUTHORITY_KEY_FILE)).unwrap());
    }

    #[test]
    fn an_interrupted_start_can_be_repeated() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        fs::remove_file(dir.path().join(AUTHORITY_KEY_FILE)).unwrap();
        fs::remove_file(dir.path().join(AUTHORITY_FILE)).unwrap();
        create_farm(dir.path()).unwrap();
        Credentials::load(dir.path(), Role::Player).unwrap();
    }

    #[cfg(unix)]
    #[test]
    fn only_the_owner_reads_keys() {
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
    fn a_node_is_replaced_only_when_asked() {
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
    fn names_that_leave_the_folder_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let long = "a".repeat(NAME_BYTES_MAX + 1);
        for name in [
            "", ".", "..", "a/b", "../oak", "-x", "a b", "ä", "a\0b", &long,
        ] {
            let refused = add_node(dir.path(), name, None, false).unwrap_err();
            assert!(
                refused.to_string().contains("cannot be a node's name"),
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
    fn a_certificate_of_the_other_role_is_refused_before_any_socket_opens() {
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
    fn an_expired_certificate_says_so() {
        let authority = Authority::generate().unwrap();
        let now = SystemTime::now();
        let refused = authority
            .credentials(Role::Node, "oak", now - 3 * DAY..now - DAY)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("expired"), "{refused}");
    }
}
