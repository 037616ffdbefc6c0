//! Deny list: the keys whose certificates are no longer accepted, in a file that is reread when it changes.

use std::collections::HashSet;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, SystemTime};

use quinn::Connection;

use crate::Error;
use crate::lock::lock;
use crate::net::peer::CertificateFault;
use crate::net::{certificate_fields, close_code};

/// Name of the file in a folder of credentials: on each line a key id and a name.
pub(crate) const DENY_LIST_FILE: &str = "revoked.txt";
/// Maximum time until a peer whose certificate has been revoked is disconnected.
const PERIOD: Duration = Duration::from_secs(2);

/// Keys that a farm no longer trusts.
#[derive(Debug, Default)]
pub(crate) struct DenyList {
    /// Absent for credentials that are on no disk; nothing is denied then.
    path: Option<PathBuf>,
    state: Mutex<DeniedKeys>,
}

#[derive(Debug, Default)]
struct DeniedKeys {
    /// Modification time and length of the file when it was last read.
    version: Option<(SystemTime, u64)>,
    key_ids: HashSet<String>,
}

impl DenyList {
    /// The list in a folder of credentials; without the file it is empty.
    pub(crate) fn in_folder(folder: &Path) -> Self {
        Self {
            path: Some(folder.join(DENY_LIST_FILE)),
            state: Mutex::default(),
        }
    }

    /// Whether the certificate's key is on the list in its present version.
    pub(crate) fn denies(&self, certificate: &[u8]) -> bool {
        let Some(path) = &self.path else {
            return false;
        };
        let Ok(key_id) = certificate_fields::key_id(certificate) else {
            return true; // no list can name the key of what is no certificate
        };
        let mut state = lock(&self.state);
        state.refresh(path);
        state.key_ids.contains(&key_id)
    }

    /// Closes a connection once its peer's key is on the list, and returns the error; otherwise never
    /// returns.
    pub(crate) async fn close_if_denied(&self, connection: &Connection) -> Error {
        let Some(certificate) = certificate_fields::peer_certificate(connection) else {
            return std::future::pending().await;
        };
        while !self.denies(&certificate) {
            tokio::time::sleep(PERIOD).await;
        }
        connection.close(close_code::REVOKED, b"your certificate has been revoked");
        Error::PeerCertificate(CertificateFault::Revoked)
    }
}

impl DeniedKeys {
    fn refresh(&mut self, path: &Path) {
        // Stamped before it is read, so that a change in between is noticed the next time.
        let version = std::fs::metadata(path).and_then(|file| Ok((file.modified()?, file.len())));
        let text = match version {
            Ok(version) if self.version == Some(version) => return,
            Ok(version) => std::fs::read_to_string(path).map(|text| (Some(version), text)),
            Err(why) if why.kind() == ErrorKind::NotFound => Ok((None, String::new())),
            Err(why) => Err(why),
        };
        match text {
            Ok((version, text)) => {
                let first_words = text
                    .lines()
                    .filter_map(|line| line.split_whitespace().next());
                self.key_ids = first_words.map(str::to_owned).collect();
                self.version = version;
            }
            // On an error the last list stays in force, so that nobody who was denied is accepted.
            Err(why) => tracing::warn!("{}: {why}", path.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_that_changes_is_read_whatever_the_clock_says() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(DENY_LIST_FILE);
        let year = Duration::from_secs(365 * 86_400);
        let now = SystemTime::now();
        let mut denied = DeniedKeys::default();
        for (key, written) in [
            ("one", now),
            ("two", now + year),
            ("six", now - year),
            ("ten", now),
        ] {
            std::fs::write(&path, format!("{key} node oak\n")).unwrap();
            let file = std::fs::File::options().write(true).open(&path).unwrap();
            file.set_modified(written).unwrap();
            denied.refresh(&path);
            assert!(denied.key_ids.contains(key), "{key}");
        }
    }
}
