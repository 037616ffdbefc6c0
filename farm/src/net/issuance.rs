//! Log of the certificates that a farm's authority has issued, one JSON object per line.

use std::collections::HashMap;
use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Write as _};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rustls::pki_types::CertificateDer;
use rustls::pki_types::pem::PemObject as _;
use serde::{Deserialize, Serialize};

use crate::Error;
use crate::net::certificate_fields;
use crate::net::credential_files::{file_error, write_whole};
use crate::net::deny_list::{DENY_LIST_FILE, DenyList};
use crate::net::peer::{CertificateFault, Role};

/// Record of an issued certificate.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct IssuanceRecord {
    /// The holder's name.
    pub name: String,
    /// The role that it grants.
    pub role: Role,
    /// The certificate's serial number, in hexadecimal.
    pub serial: String,
    /// SHA-256 of the public key in hexadecimal, by which a deny list identifies it.
    pub key_id: String,
    /// Beginning of its validity, in seconds since 1970.
    pub not_before_unix_secs: u64,
    /// End of its validity, in seconds since 1970.
    pub not_after_unix_secs: u64,
}

/// Log and deny list in the folder of an authority.
#[derive(Debug)]
pub(crate) struct IssuanceLog {
    dir: PathBuf,
}

/// Time after a certificate's expiry for which its revoked key is remembered: the clock here may be ahead of
/// a node's, or be set back.
const CLOCK_ERROR_MAX: Duration = Duration::from_secs(366 * 86_400);
const LOG_FILE: &str = "issued.jsonl";
/// Locked while log or deny list is changed.
const LOCK_FILE: &str = "issued.lock";

impl IssuanceRecord {
    fn of(certificate: &[u8], role: Role) -> Result<Self, CertificateFault> {
        let parsed = certificate_fields::parse(certificate)?;
        let validity = parsed.validity();
        Ok(Self {
            name: certificate_fields::common_name(certificate)?,
            role,
            serial: certificate_fields::hexadecimal(parsed.raw_serial()),
            key_id: certificate_fields::key_id(certificate)?,
            not_before_unix_secs: validity.not_before.timestamp().unsigned_abs(),
            not_after_unix_secs: validity.not_after.timestamp().unsigned_abs(),
        })
    }

    /// The last day of its validity, as `2026-12-24`.
    pub fn last_day(&self) -> String {
        certificate_fields::day(self.not_after_unix_secs)
    }

    fn lasts_until(&self, time: SystemTime) -> bool {
        let time = time.duration_since(SystemTime::UNIX_EPOCH);
        // A clock that has not been set may show a time before 1970, before the end of every certificate.
        time.map_or(true, |time| time.as_secs() <= self.not_after_unix_secs)
    }
}

impl IssuanceLog {
    /// The log of the authority in `dir`. If it has none, it begins with the certificates found in the
    /// folder, as for farms created by versions without a log.
    ///
    /// # Errors
    /// [`Error::CredentialsFile`] if the folder cannot be read or written.
    pub(crate) fn open(dir: &Path) -> Result<Self, Error> {
        let log = Self {
            dir: dir.to_path_buf(),
        };
        if log.path().exists() {
            return Ok(log);
        }
        let player = (Role::Player, dir.join(Role::Player.certificate_file()));
        let nodes = std::fs::read_dir(dir.join("nodes")).into_iter().flatten();
        let nodes = nodes
            .flatten()
            .map(|node| (Role::Node, node.path().join(Role::Node.certificate_file())));
        for (role, path) in std::iter::once(player).chain(nodes) {
            let Ok(certificate) = CertificateDer::from_pem_file(&path) else {
                continue;
            };
            log.append(&certificate, role)?;
        }
        Ok(log)
    }

    /// Excludes other processes and threads from changing log and deny list, until the file is dropped.
    ///
    /// # Errors
    /// [`Error::CredentialsFile`] if the lock cannot be taken.
    pub(crate) fn lock(&self) -> Result<File, Error> {
        let path = self.dir.join(LOCK_FILE);
        let mut options = OpenOptions::new();
        let file = options.append(true).create(true).open(&path);
        let locked = file.and_then(|file| file.lock().map(|()| file));
        locked.map_err(file_error(&path))
    }

    /// The validity of the certificate of a key that expires last.
    ///
    /// # Errors
    /// As [`IssuanceLog::records`].
    pub(crate) fn latest_validity(&self, key_id: &str) -> Result<Option<Range<SystemTime>>, Error> {
        let records = self.records()?.into_iter();
        let of_key = records.filter(|record| record.key_id == key_id);
        let latest = of_key.max_by_key(|record| record.not_after_unix_secs);
        let time = |unix_secs| SystemTime::UNIX_EPOCH + Duration::from_secs(unix_secs);
        Ok(
            latest
                .map(|record| time(record.not_before_unix_secs)..time(record.not_after_unix_secs)),
        )
    }

    /// Records a certificate before it is handed to its holder, so that no valid one is unrecorded.
    ///
    /// # Errors
    /// [`Error::CredentialsFile`] if the file cannot be written.
    pub(crate) fn append(&self, certificate: &[u8], role: Role) -> Result<(), Error> {
        let record = IssuanceRecord::of(certificate, role)
            .map_err(|fault| Error::Certificate { path: None, fault })?;
        let path = self.path();
        let mut line = serde_json::to_vec(&record).map_err(|why| file_error(&path)(why.into()))?;
        line.push(b'\n');
        let mut options = OpenOptions::new();
        let file = options.append(true).create(true).open(&path);
        file.and_then(|mut file| {
            file.write_all(&line)?;
            file.sync_all()
        })
        .map_err(file_error(&path))
    }

    /// All issued certificates, the oldest first. A damaged line is reported and skipped: it must not prevent
    /// other certificates from being revoked.
    ///
    /// # Errors
    /// [`Error::CredentialsFile`] if the file cannot be read.
    pub(crate) fn records(&self) -> Result<Vec<IssuanceRecord>, Error> {
        let path = self.path();
        let bytes = match std::fs::read(&path) {
            Err(why) if why.kind() == ErrorKind::NotFound => Vec::new(),
            bytes => bytes.map_err(file_error(&path))?,
        };
        let mut records = Vec::new();
        for (index, line) in bytes.split_inclusive(|&byte| byte == b'\n').enumerate() {
            let (whole, is_damaged) = records_of_line(line);
            records.extend(whole);
            if is_damaged {
                tracing::warn!("{}", damage(&path, index + 1, line.ends_with(b"\n")));
            }
        }
        Ok(records)
    }

    /// The certificates of `name` that are valid and not revoked.
    ///
    /// # Errors
    /// As [`IssuanceLog::records`].
    pub(crate) fn current(&self, name: &str) -> Result<Vec<IssuanceRecord>, Error> {
        self.lasting_until(name, SystemTime::now())
    }

    fn lasting_until(&self, name: &str, time: SystemTime) -> Result<Vec<IssuanceRecord>, Error> {
        let denied = self.deny_list_text()?;
        let mut records = self.records()?;
        records.retain(|record| {
            let is_denied = denied.contains(&record.key_id);
            record.name == name && record.lasts_until(time) && !is_denied
        });
        Ok(records)
    }

    /// Puts the keys of `name` on the deny list, and returns their records. Certificates that have expired
    /// within the last year are included: by the clocks of other machines they may be valid.
    ///
    /// # Errors
    /// [`Error::NothingToRevoke`] if `name` has no such certificate; as [`IssuanceLog::records`].
    pub(crate) fn revoke(&self, name: &str) -> Result<Vec<IssuanceRecord>, Error> {
        self.revoke_at(name, SystemTime::now())
    }

    fn revoke_at(&self, name: &str, now: SystemTime) -> Result<Vec<IssuanceRecord>, Error> {
        let _lock = self.lock()?;
        let long_ago = now - CLOCK_ERROR_MAX;
        let revoked = self.lasting_until(name, long_ago)?;
        if revoked.is_empty() {
            let mut known: Vec<String> = self.records()?.into_iter().map(|one| one.name).collect();
            known.sort_unstable();
            known.dedup();
            return Err(Error::NothingToRevoke {
                name: name.to_owned(),
                known,
            });
        }
        let mut text = self.without_expired(&self.deny_list_text()?, long_ago)?;
        for record in &revoked {
            if !text.contains(&record.key_id) {
                text.push_str(&format!("{} {} {name}\n", record.key_id, record.role));
            }
        }
        write_whole(&self.deny_list_path(), &text)?;
        Ok(revoked)
    }

    /// A deny list without the keys whose certificates expired long ago and which nobody accepts any more:
    /// nodes download the whole list, which must not grow for ever.
    fn without_expired(&self, deny_list: &str, long_ago: SystemTime) -> Result<String, Error> {
        let mut is_current: HashMap<String, bool> = HashMap::new();
        for record in self.records()? {
            let current = record.lasts_until(long_ago);
            *is_current.entry(record.key_id).or_default() |= current;
        }
        let counts = |line: &&str| {
            let key_id = line.split_whitespace().next();
            // A key without a record was added by hand.
            key_id.is_none_or(|key_id| is_current.get(key_id).copied().unwrap_or(true))
        };
        let lines = deny_list.lines().filter(counts);
        Ok(lines.map(|line| format!("{line}\n")).collect())
    }

    /// The text of the deny list's file; empty without one.
    ///
    /// # Errors
    /// [`Error::CredentialsFile`] if it cannot be read.
    pub(crate) fn deny_list_text(&self) -> Result<String, Error> {
        let path = self.deny_list_path();
        match std::fs::read_to_string(&path) {
            Err(why) if why.kind() == ErrorKind::NotFound => Ok(String::new()),
            text => text.map_err(file_error(&path)),
        }
    }

    pub(crate) fn deny_list(&self) -> DenyList {
        DenyList::in_folder(&self.dir)
    }

    fn deny_list_path(&self) -> PathBuf {
        self.dir.join(DENY_LIST_FILE)
    }

    fn path(&self) -> PathBuf {
        self.dir.join(LOG_FILE)
    }
}

/// The records in a line, and whether it contains anything else. A record whose writing was interrupted has
/// no line end, so the next record follows it in the same line.
fn records_of_line(line: &[u8]) -> (Vec<IssuanceRecord>, bool) {
    let line = line.trim_ascii();
    if line.is_empty() {
        return (Vec::new(), false);
    }
    if let Ok(record) = serde_json::from_slice(line) {
        return (vec![record], false);
    }
    let mut whole = Vec::new();
    let mut is_damaged = !line.starts_with(b"{");
    // Records are flat and names contain no brace, so each brace begins a record.
    for part in line.split(|&byte| byte == b'{').skip(1) {
        match serde_json::from_slice(&[b"{", part].concat()) {
            Ok(record) => whole.push(record),
            Err(_) => is_damaged = true,
        }
    }
    (whole, is_damaged)
}

fn damage(path: &Path, line: usize, has_end: bool) -> String {
    let path = path.display();
    if has_end {
        return format!(
            "{path}, line {line} is damaged and passed over: a certificate that only it names cannot \
             be revoked by its name; restore the line from a copy, or delete it"
        );
    }
    format!(
        "{path}, line {line} was cut off while it was written, before anybody had its certificate: it \
         is passed over, and can be deleted"
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::farm_folder::{FIRST_PLAYER, add_node, create_farm, revoke};

    #[test]
    fn a_damaged_record_keeps_nobody_from_being_revoked() {
        let dir = tempfile::tempdir().unwrap();
        let farm = dir.path();
        create_farm(farm).unwrap();
        let path = farm.join(LOG_FILE);
        let torn = |text: &str| {
            let mut file = OpenOptions::new().append(true).open(&path).unwrap();
            file.write_all(text.as_bytes()).unwrap();
        };
        // An interrupted append, with the next record in the same line.
        torn(r#"{"name":"el"#);
        add_node(farm, "oak", None, false).unwrap();
        torn("\0\0\n\n{\"name\":\"ash\",\"role\"");
        let log = IssuanceLog::open(farm).unwrap();
        let records = log.records().unwrap();
        let names: Vec<&str> = records.iter().map(|record| record.name.as_str()).collect();
        assert_eq!(names, [FIRST_PLAYER, "oak"]);
        for name in names {
            assert_eq!(revoke(farm, name).unwrap().len(), 1, "{name}");
        }
        add_node(farm, "elm", None, false).unwrap();
        assert_eq!(revoke(farm, "elm").unwrap().len(), 1);
        let line = |of: &str| damage(Path::new("issued.jsonl"), 3, of.ends_with('\n'));
        assert!(line("{").contains("issued.jsonl, line 3 was cut off"));
        assert!(line("{\n").contains("issued.jsonl, line 3 is damaged"));
    }

    #[test]
    fn revoked_keys_are_forgotten_a_year_after_they_expired() {
        let dir = tempfile::tempdir().unwrap();
        let farm = dir.path();
        create_farm(farm).unwrap();
        let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        let now = now.unwrap().as_secs();
        let mut log = OpenOptions::new()
            .append(true)
            .open(farm.join(LOG_FILE))
            .unwrap();
        let days_ago = [(30, "month"), (364, "year"), (400, "longer")];
        for (days, key_id) in days_ago {
            let record = IssuanceRecord {
                name: "elm".to_owned(),
                role: Role::Node,
                serial: "01".to_owned(),
                key_id: key_id.to_owned(),
                not_before_unix_secs: 0,
                not_after_unix_secs: now - days * 86_400,
            };
            writeln!(log, "{}", serde_json::to_string(&record).unwrap()).unwrap();
        }
        let list = farm.join(DENY_LIST_FILE);
        std::fs::write(&list, "month node elm\nyear node elm\nlonger node elm\n").unwrap();
        add_node(farm, "oak", None, false).unwrap();
        revoke(farm, "oak").unwrap();
        let left = std::fs::read_to_string(&list).unwrap();
        assert!(
            left.starts_with("month node elm\nyear node elm\n"),
            "{left}"
        );
        assert_eq!(left.lines().count(), 3, "{left}");
    }

    #[test]
    fn a_clock_that_is_set_neither_keeps_anybody_from_being_revoked_nor_forgets_who_was() {
        let dir = tempfile::tempdir().unwrap();
        let farm = dir.path();
        create_farm(farm).unwrap();
        let log = IssuanceLog::open(farm).unwrap();
        let now = SystemTime::now();
        let year = Duration::from_secs(365 * 86_400);
        let clocks = [
            ("oak", now),
            ("elm", now + year),
            ("ash", now - year),
            ("yew", SystemTime::UNIX_EPOCH),
            ("fir", now),
        ];
        for (name, clock) in clocks {
            add_node(farm, name, None, false).unwrap();
            assert_eq!(log.revoke_at(name, clock).unwrap().len(), 1, "{name}");
        }
        assert_eq!(log.deny_list_text().unwrap().lines().count(), clocks.len());
    }

    #[test]
    fn records_of_one_line_are_both_read() {
        let record = r#"{"name":"oak","role":"node","serial":"01","key_id":"02","not_before_unix_secs":1,"not_after_unix_secs":2}"#;
        let (records, is_damaged) = records_of_line(format!("{record}{record}\n").as_bytes());
        assert_eq!((records.len(), is_damaged), (2, false));
        let (records, is_damaged) = records_of_line(format!("{{\"na{record}").as_bytes());
        assert_eq!((records.len(), is_damaged), (1, true));
        assert_eq!(records_of_line(b" \r\n"), (Vec::new(), false));
    }
}
