//! Folders of a farm: the authority's, made by `init`, and those of its nodes and players.
//!
//! ```text
//! .carom   ca.pem ca.key issued.jsonl revoked.txt   the authority; its key may be encrypted
//!          player.pem player.key                    the player of this machine
//!          nodes/NAME    ca.pem node.pem node.key   to copy to a node
//!          players/NAME  ca.pem player.pem player.key
//! ```

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rustls::pki_types::CertificateDer;

use crate::Error;
use crate::net::authority::{
    AUTHORITY_KEY_FILE, Authority, IssuedCertificate, lasting, read_authority,
};
use crate::net::certificate_fields;
use crate::net::credential_files::{create_private_dir, file_error, write_private, write_whole};
use crate::net::credentials::{self, AUTHORITY_FILE};
use crate::net::deny_list::DENY_LIST_FILE;
use crate::net::issuance::{IssuanceLog, IssuanceRecord};
use crate::net::peer::Role;

/// Maximum bytes of a name: as in a label of a host name.
const NAME_BYTES_MAX: usize = 63;

/// The folder of a farm's authority, opened with its key.
#[derive(Debug)]
pub struct AuthorityFolder {
    dir: PathBuf,
    pub(crate) authority: Authority,
    pub(crate) log: IssuanceLog,
}

/// Creates a farm in `dir`: `ca.pem`, `ca.key`, and the player `player` of this machine.
///
/// # Errors
/// As [`AuthorityFolder::create`].
pub fn create_farm(dir: &Path) -> Result<(), Error> {
    AuthorityFolder::create(dir, None, Some(FIRST_PLAYER)).map(drop)
}

/// Name of the first player of a farm.
pub const FIRST_PLAYER: &str = "player";

/// Creates the folder of a node, as [`AuthorityFolder::add`] with an authority whose key is not encrypted.
///
/// # Errors
/// As [`AuthorityFolder::open`] and [`AuthorityFolder::add`].
pub fn add_node(dir: &Path, name: &str, out: Option<&Path>, renew: bool) -> Result<PathBuf, Error> {
    check_name(name)?;
    AuthorityFolder::open(dir, None)?.add(Role::Node, name, out, renew)
}

/// Puts all valid certificates of `name` on the deny list of the authority in `dir`, and returns them. Needs
/// no key.
///
/// # Errors
/// [`Error::CredentialsMissing`] if `dir` holds no authority; [`Error::NothingToRevoke`];
/// [`Error::CredentialsFile`].
pub fn revoke(dir: &Path, name: &str) -> Result<Vec<IssuanceRecord>, Error> {
    read_authority(&dir.join(AUTHORITY_FILE))?;
    IssuanceLog::open(dir)?.revoke(name)
}

impl AuthorityFolder {
    /// Creates an authority in a new or empty folder, with its key encrypted if there is a passphrase, and
    /// beside it a player called `player`. The folder appears completely or not at all.
    ///
    /// # Errors
    /// [`Error::FarmExists`], or [`Error::CredentialsFile`] if the folder cannot be written.
    pub fn create(
        dir: &Path,
        passphrase: Option<&str>,
        player: Option<&str>,
    ) -> Result<Self, Error> {
        for file in [AUTHORITY_FILE, AUTHORITY_KEY_FILE] {
            let path = dir.join(file);
            if path.exists() {
                return Err(Error::FarmExists(path));
            }
        }
        if dir.exists() {
            // Fails unless the folder is empty.
            fs::remove_dir(dir).map_err(file_error(dir))?;
        }
        let mut staged = dir.file_name().unwrap_or_default().to_owned();
        staged.push(".init");
        let staged = dir.with_file_name(staged);
        if staged.exists() {
            // Left by an `init` that was killed; nobody uses it.
            fs::remove_dir_all(&staged).map_err(file_error(&staged))?;
        }
        create_private_dir(&staged)?;
        let authority = Authority::generate()?;
        write_private(
            &staged.join(AUTHORITY_KEY_FILE),
            &authority.key_pem(passphrase)?,
        )?;
        write_whole(&staged.join(AUTHORITY_FILE), authority.certificate_pem())?;
        let folder = Self {
            log: IssuanceLog::open(&staged)?,
            dir: staged.clone(),
            authority,
        };
        if let Some(player) = player {
            folder.add(Role::Player, player, Some(&staged), false)?;
        }
        fs::rename(&staged, dir).map_err(file_error(dir))?;
        Ok(Self {
            dir: dir.to_path_buf(),
            log: IssuanceLog::open(dir)?,
            authority: folder.authority,
        })
    }

    /// Opens the authority in `dir`.
    ///
    /// # Errors
    /// [`Error::CredentialsMissing`], [`Error::CredentialsFile`] or [`Error::CredentialsPem`];
    /// [`Error::PassphraseMissing`] if the key is encrypted and `passphrase` is absent,
    /// [`Error::PassphraseWrong`].
    pub fn open(dir: &Path, passphrase: Option<&str>) -> Result<Self, Error> {
        let authority = Authority::open(dir, passphrase)?;
        Ok(Self {
            dir: dir.to_path_buf(),
            log: IssuanceLog::open(dir)?,
            authority,
        })
    }

    /// The certificate of the authority as PEM text.
    pub fn certificate_pem(&self) -> &str {
        self.authority.certificate_pem()
    }

    /// Creates or renews a folder with the authority's certificate, a key and its certificate, and returns
    /// it. Without `out` it is `nodes/NAME` or `players/NAME`, except for the player of this folder, who is
    /// renewed in it.
    ///
    /// # Errors
    /// [`Error::MemberName`]; [`Error::MemberExists`] if the name has a valid certificate or the
    /// folder a key, unless `renew` is set; [`Error::AuthorityExposed`] for a node in the
    /// authority's folder; [`Error::CredentialsFile`] if the folder cannot be written.
    pub fn add(
        &self,
        role: Role,
        name: &str,
        out: Option<&Path>,
        renew: bool,
    ) -> Result<PathBuf, Error> {
        check_name(name)?;
        let _lock = self.log.lock()?;
        let out = match out {
            Some(out) => out.to_path_buf(),
            None if self.holds_player(role, name) => self.dir.clone(),
            None => self.dir.join(format!("{role}s")).join(name),
        };
        if !renew {
            self.check_new(role, name, ADD_ADVICE)?;
            let path = out.join(role.key_file());
            if path.exists() {
                return Err(Error::MemberExists {
                    evidence: format!("{} exists", path.display()),
                    advice: ADD_ADVICE,
                });
            }
        }
        if role == Role::Node && out.join(AUTHORITY_KEY_FILE).exists() {
            return Err(Error::AuthorityExposed(out));
        }
        if !out.exists() {
            create_private_dir(&out)?;
        }
        let issued = self.authority.issue(role, name, lasting(role.life()))?;
        // Recorded before the key is written, so that no usable certificate is unrecorded.
        self.log.append(&issued.certificate_der()?, role)?;
        save(&out, role, self.certificate_pem(), &issued)?;
        let denied = self.log.deny_list_text()?;
        if out != self.dir && !denied.is_empty() {
            write_whole(&out.join(DENY_LIST_FILE), &denied)?;
        }
        Ok(out)
    }

    /// Certifies the key of a new node, which is kept elsewhere, and returns the certificate as PEM text.
    ///
    /// # Errors
    /// [`Error::MemberName`], [`Error::MemberExists`], [`Error::CertificateCreation`] if the text is no
    /// signing request, [`Error::CredentialsFile`].
    pub(crate) fn admit(&self, name: &str, request_pem: &str) -> Result<String, Error> {
        let role = Role::Node;
        let _lock = self.log.lock()?;
        check_name(name)?;
        self.check_new(role, name, JOIN_ADVICE)?;
        let issued = self
            .authority
            .sign_request(role, name, lasting(role.life()), request_pem)?;
        self.log.append(issued.der(), role)?;
        Ok(issued.pem())
    }

    /// Certifies the key of the certificate `shown` again, and returns the certificate as PEM text.
    ///
    /// # Errors
    /// [`Error::EnrolmentRefused`] if the request is for another key, if the key has been revoked, or if the
    /// latest certificate of the key is not in its last third; [`Error::CertificateCreation`] if the text is
    /// no signing request; [`Error::CredentialsFile`].
    pub(crate) fn renew(
        &self,
        shown: &CertificateDer<'_>,
        request_pem: &str,
    ) -> Result<String, Error> {
        let refused = |sentence: String| Err(Error::EnrolmentRefused(sentence));
        let role = Role::Node;
        let name = certificate_fields::common_name(shown).map_err(Error::PeerCertificate)?;
        let key_id = certificate_fields::key_id(shown).map_err(Error::PeerCertificate)?;
        let _lock = self.log.lock()?;
        // The handshake has checked it, but before this lock was held.
        if self.log.deny_list_text()?.contains(&key_id) {
            return refused(format!("the certificate of {name} has been revoked"));
        }
        let shown_days = certificate_fields::validity(shown).map_err(Error::PeerCertificate)?;
        let recorded = self.log.latest_validity(&key_id)?;
        let latest = recorded.filter(|days| days.end > shown_days.end);
        let latest = latest.unwrap_or(shown_days);
        if !credentials::is_due(&latest, SystemTime::now()) {
            let days = latest.end.duration_since(latest.start).unwrap_or_default();
            return refused(format!(
                "{name} has a certificate of {} days that is not in its last third: it can be renewed then",
                days.as_secs() / (24 * 3600)
            ));
        }
        let issued = self
            .authority
            .sign_request(role, &name, lasting(role.life()), request_pem)?;
        if certificate_fields::key_id(issued.der()).map_err(Error::PeerCertificate)? != key_id {
            return refused(format!(
                "a renewal is of the key that {name} has: another key joins with a token of its own"
            ));
        }
        self.log.append(issued.der(), role)?;
        Ok(issued.pem())
    }

    /// Checks that nobody holds the name, since two holders could not be distinguished or revoked separately.
    fn check_new(&self, role: Role, name: &str, advice: &'static str) -> Result<(), Error> {
        let current = self.log.current(name)?;
        match current.iter().rfind(|record| record.role == role) {
            Some(record) => Err(Error::MemberExists {
                evidence: format!(
                    "{role} {name} has a certificate until {}",
                    record.last_day()
                ),
                advice,
            }),
            None => Ok(()),
        }
    }

    /// Whether the player of this folder, made by `init`, has this name.
    fn holds_player(&self, role: Role, name: &str) -> bool {
        let certificate = self.dir.join(role.certificate_file());
        role == Role::Player
            && certificate_fields::common_name_of_file(&certificate).as_deref() == Some(name)
    }
}

/// Checks the name of a node or player.
///
/// # Errors
/// [`Error::MemberName`] if it is not allowed.
#[doc(hidden)]
pub fn check_name(name: &str) -> Result<(), Error> {
    let first_is_plain = name.starts_with(|c: char| c.is_ascii_alphanumeric());
    let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.');
    if first_is_plain && name.len() <= NAME_BYTES_MAX && name.chars().all(plain) {
        return Ok(());
    }
    Err(Error::MemberName {
        name: name.to_owned(),
        length_max: NAME_BYTES_MAX,
    })
}

/// Writes a key, its certificate and the authority's certificate to a folder.
fn save(
    dir: &Path,
    role: Role,
    authority_pem: &str,
    issued: &IssuedCertificate,
) -> Result<(), Error> {
    let key = dir.join(role.key_file());
    if key.exists() {
        fs::remove_file(&key).map_err(file_error(&key))?;
    }
    write_private(&key, &issued.key_pem)?;
    write_whole(&dir.join(AUTHORITY_FILE), authority_pem)?;
    write_whole(&dir.join(role.certificate_file()), &issued.certificate_pem)
}

const ADD_ADVICE: &str = "renew it with --renew, or choose another name or folder";
const JOIN_ADVICE: &str = "choose another name with --name, or revoke that one where the authority is with \
                           `carom-farm revoke`";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::credentials::Credentials;

    #[test]
    fn an_existing_farm_is_never_overwritten() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let key = fs::read(dir.path().join(AUTHORITY_KEY_FILE)).unwrap();
        let refused = create_farm(dir.path()).unwrap_err().to_string();
        assert!(refused.contains("already holds a farm"), "{refused}");
        assert_eq!(key, fs::read(dir.path().join(AUTHORITY_KEY_FILE)).unwrap());
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
                refused.to_string().contains("is not a valid name"),
                "{refused}"
            );
        }
        // A joining node may ask for any name: its operator gets a sentence about it, not a page.
        let told = check_name(&"\u{1b}".repeat(16_000))
            .unwrap_err()
            .to_string();
        assert!(told.len() < 2048 && !told.contains('\u{1b}'), "{told}");
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
    fn a_killed_init_can_be_repeated() {
        let parent = tempfile::tempdir().unwrap();
        let dir = parent.path().join("farm");
        let files = [
            "ca.key",
            "ca.pem",
            "issued.jsonl",
            "player.key",
            "player.pem",
        ];
        for written in 0..=files.len() {
            let staged = parent.path().join("farm.init");
            fs::create_dir(&staged).unwrap();
            for file in &files[..written] {
                fs::write(staged.join(file), "half a fi").unwrap();
            }
            create_farm(&dir).unwrap();
            assert!(!staged.exists());
            Credentials::load(&dir, Role::Player).unwrap();
            add_node(&dir, "oak", None, false).unwrap();
            fs::remove_dir_all(&dir).unwrap();
        }
    }

    #[test]
    fn an_encrypted_authority_needs_its_passphrase() {
        let parent = tempfile::tempdir().unwrap();
        let dir = parent.path().join("farm");
        AuthorityFolder::create(&dir, Some("open sesame"), None).unwrap();
        let key = fs::read_to_string(dir.join(AUTHORITY_KEY_FILE)).unwrap();
        assert!(key.contains("ENCRYPTED"), "{key}");
        let without = AuthorityFolder::open(&dir, None).unwrap_err();
        assert!(matches!(without, Error::PassphraseMissing(_)), "{without}");
        let wrong = AuthorityFolder::open(&dir, Some("sesame")).unwrap_err();
        assert!(matches!(wrong, Error::PassphraseWrong(_)), "{wrong}");
        let folder = AuthorityFolder::open(&dir, Some("open sesame")).unwrap();
        let node = folder.add(Role::Node, "oak", None, false).unwrap();
        Credentials::load(&node, Role::Node).unwrap();
    }

    #[test]
    fn every_certificate_is_on_record() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        let folder = AuthorityFolder::open(dir.path(), None).unwrap();
        let bob = folder.add(Role::Player, "bob", None, false).unwrap();
        folder.add(Role::Player, "bob", None, true).unwrap();
        folder.add(Role::Player, FIRST_PLAYER, None, true).unwrap();
        // A second certificate under the same name would be unknown to whoever revokes the name.
        let twice = folder.add(Role::Player, "bob", Some(&dir.path().join("x")), false);
        assert!(twice.unwrap_err().to_string().contains("--renew"));
        let records = folder.log.records().unwrap();
        let names: Vec<&str> = records.iter().map(|record| record.name.as_str()).collect();
        assert_eq!(names, [FIRST_PLAYER, "bob", "bob", FIRST_PLAYER]);
        let days = |record: &IssuanceRecord| {
            (record.not_after_unix_secs - record.not_before_unix_secs) / (24 * 3600)
        };
        assert!(records.iter().all(|record| days(record) == 91));
        let loaded = Credentials::load(&bob, Role::Player).unwrap();
        let key_id = certificate_fields::key_id(&loaded.certificate).unwrap();
        assert_eq!(records[2].key_id, key_id);
        let mut serials: Vec<&str> = records.iter().map(|one| one.serial.as_str()).collect();
        serials.sort_unstable();
        serials.dedup();
        assert_eq!(serials.len(), 4);
    }

    #[test]
    fn farms_without_a_record_get_one_of_their_files() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        add_node(dir.path(), "oak", None, false).unwrap();
        fs::remove_file(dir.path().join("issued.jsonl")).unwrap();
        for name in [FIRST_PLAYER, "oak"] {
            assert_eq!(revoke(dir.path(), name).unwrap().len(), 1);
        }
        let unknown = revoke(dir.path(), "elm").unwrap_err().to_string();
        assert!(unknown.contains("oak"), "{unknown}");
    }

    #[test]
    fn revoked_credentials_are_refused_by_their_own_folder() {
        let dir = tempfile::tempdir().unwrap();
        create_farm(dir.path()).unwrap();
        revoke(dir.path(), FIRST_PLAYER).unwrap();
        let why = Credentials::load(dir.path(), Role::Player).unwrap_err();
        assert!(why.to_string().contains("has been revoked"), "{why}");
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
}
