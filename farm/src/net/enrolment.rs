//! Enrolment of nodes: a node generates a key, and the farm's authority certifies it over a connection on
//! which the node recognises the authority by its fingerprint.
//!
//! One request and one answer ([`crate::net::enrolment_messages`]). A new node presents the token's secret;
//! one that renews its certificate presents that certificate. The authority signs the handshake with its own
//! key, so that nobody else can receive the secret.

use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use quinn::{Connection, ConnectionError};
use rcgen::{CertificateParams, KeyPair};
use rustls::client::danger::{HandshakeSignatureValid, ServerCertVerified, ServerCertVerifier};
use rustls::crypto::CryptoProvider;
use rustls::pki_types::{CertificateDer, ServerName, UnixTime};
use rustls::{CertificateError, DigitallySignedStruct, SignatureScheme};
use zeroize::Zeroizing;

use crate::Error;
use crate::net::authority::not_created;
use crate::net::certificate::provider;
use crate::net::credential_files::{create_private_dir, file_error, write_private, write_whole};
use crate::net::credentials::{AUTHORITY_FILE, Credentials};
use crate::net::deny_list::DENY_LIST_FILE;
use crate::net::enrolment_messages::{Certified, EnrolmentAnswer, EnrolmentRequest, broken};
use crate::net::join_url::{JoinUrl, fingerprint};
use crate::net::peer::Role;
use crate::net::{close_code, connection_error, endpoint, runtime, tls};

/// ALPN name of the enrolment protocol; another version gets another name.
pub(crate) const ALPN: &[u8] = b"carom-join/1";
/// Maximum bytes of an answer: a deny list of forty thousand keys.
const ANSWER_BYTES_MAX: usize = 4 << 20;
/// Maximum bytes of a request.
pub(crate) const REQUEST_BYTES_MAX: usize = 16 << 10;
/// Maximum time from the request to its answer.
pub(crate) const ANSWER_TIMEOUT: Duration = Duration::from_secs(5);
/// Name of the file in which a node stores the address for renewals.
const URL_FILE: &str = "farm.url";

/// Generates a key in `folder` and has it certified as that of a node called `name`; returns the credentials.
/// The key never leaves the folder.
///
/// # Errors
/// [`Error::MemberExists`] if the folder is already a node's; [`Error::JoinUrl`] without a secret;
/// an error of the connection; [`Error::EnrolmentRefused`]; [`Error::CredentialsFile`].
pub fn join(url: &JoinUrl, name: &str, folder: &Path) -> Result<Credentials, Error> {
    let role = Role::Node;
    let certificate_path = folder.join(role.certificate_file());
    if certificate_path.exists() {
        return Err(Error::MemberExists {
            evidence: format!("{} is a node's already", certificate_path.display()),
            advice: "a node that has joined renews its certificate while it runs; to join anew, choose \
                     another folder with --credentials",
        });
    }
    let no_secret = Error::JoinUrl("its token must be 64 hexadecimal digits");
    let secret = url.secret.clone().ok_or(no_secret)?;
    let key = KeyPair::generate().map_err(not_created)?;
    let request = EnrolmentRequest::Join {
        secret,
        name: name.to_owned(),
        request_pem: request_pem(&key)?,
    };
    let runtime = runtime::waiting_thread().map_err(Error::socket(&url.address))?;
    let answer = runtime.block_on(ask(url, None, &request))?;
    if !folder.exists() {
        create_private_dir(folder)?;
    }
    let key_path = folder.join(role.key_file());
    if key_path.exists() {
        // Left by a join that was killed: no certificate exists for it.
        std::fs::remove_file(&key_path).map_err(file_error(&key_path))?;
    }
    write_private(&key_path, &Zeroizing::new(key.serialize_pem()))?;
    write_whole(&folder.join(AUTHORITY_FILE), &answer.authority_pem)?;
    let kept = url.without_secret().to_string();
    write_whole(&folder.join(URL_FILE), &kept)?;
    answer.save(folder)?;
    Credentials::load(folder, role)
}

/// Asks the authority that a node has joined for its deny list and, once two thirds of the certificate's
/// validity are over, for the next certificate; the list is saved even if that is refused. Does nothing if
/// the folder was not made by a join.
///
/// # Errors
/// [`Error::JoinUrl`] or a file's error if the folder is damaged; an error of the connection;
/// [`Error::EnrolmentRefused`].
pub(crate) async fn renew(credentials: &Credentials, folder: &Path) -> Result<(), Error> {
    let path = folder.join(URL_FILE);
    let url: JoinUrl = match std::fs::read_to_string(&path) {
        Ok(text) => text.trim().parse()?,
        Err(why) if why.kind() == std::io::ErrorKind::NotFound => return Ok(()),
        Err(why) => return Err(file_error(&path)(why)),
    };
    let request_pem = match credentials.is_due() {
        true => {
            let key = KeyPair::try_from(&credentials.key).map_err(not_created)?;
            Some(request_pem(&key)?)
        }
        false => None,
    };
    let request = EnrolmentRequest::Renew { request_pem };
    match ask(&url, Some(credentials), &request).await {
        // Probably the clocks differ: the authority finds the renewal too early. The deny list is fetched all
        // the same.
        Err(refusal @ Error::EnrolmentRefused(_)) if credentials.is_due() => {
            let request = EnrolmentRequest::Renew { request_pem: None };
            if let Ok(answer) = ask(&url, Some(credentials), &request).await {
                answer.save(folder)?;
            }
            Err(refusal)
        }
        answer => answer?.save_renewed(credentials, folder),
    }
}

impl Certified {
    fn save(&self, folder: &Path) -> Result<(), Error> {
        let list = folder.join(DENY_LIST_FILE);
        if list.exists() || !self.deny_list.is_empty() {
            write_whole(&list, &self.deny_list)?;
        }
        match &self.certificate_pem {
            Some(pem) => write_whole(&folder.join(Role::Node.certificate_file()), pem),
            None => Ok(()),
        }
    }

    /// Saves everything, except a certificate that peers would refuse: `current` is kept then.
    fn save_renewed(mut self, current: &Credentials, folder: &Path) -> Result<(), Error> {
        let check = |pem: &String| current.check_successor(pem);
        let checked = self.certificate_pem.as_ref().map_or(Ok(()), check);
        if checked.is_err() {
            self.certificate_pem = None;
        }
        self.save(folder)?;
        checked
    }
}

fn request_pem(key: &KeyPair) -> Result<String, Error> {
    let request = CertificateParams::default().serialize_request(key);
    let pem = request.and_then(|request| request.pem());
    pem.map_err(not_created)
}

/// Sends a request to the authority and returns its answer.
async fn ask(
    url: &JoinUrl,
    credentials: Option<&Credentials>,
    request: &EnrolmentRequest,
) -> Result<Certified, Error> {
    let mut errors = Vec::new();
    for address in url.address.resolve().await? {
        match ask_address(address, client_config(url, credentials)?, request).await {
            // A name may have several addresses, of which the authority listens at one.
            Err(error @ (Error::NoAnswer(_) | Error::Unreachable { .. })) => errors.push(error),
            answer => return answer,
        }
    }
    Err(Error::NoAddressConnects(errors))
}

async fn ask_address(
    address: SocketAddr,
    config: quinn::ClientConfig,
    request: &EnrolmentRequest,
) -> Result<Certified, Error> {
    let endpoint = endpoint::open_client(address).map_err(Error::socket(address))?;
    let connected = endpoint::connect(&endpoint, config, address, Role::Node).await;
    let connection = connected.map_err(refusal)?;
    let answer = tokio::time::timeout(ANSWER_TIMEOUT, exchange(&connection, request)).await;
    let answer = answer.map_err(|_| Error::NoAnswer(address))?;
    let lost = |error| match error {
        ConnectionError::TimedOut => Error::NoAnswer(address),
        error => refusal(connection_error::connection(&error, Role::Node)),
    };
    // The reason why the connection was closed explains a failed exchange better than the stream's error.
    let bytes = answer.map_err(|why| connection.close_reason().map_or(why, lost))?;
    connection.close(close_code::DONE, b"");
    endpoint.wait_idle().await;
    match EnrolmentAnswer::from_json(&bytes)? {
        EnrolmentAnswer::Certified(certified) => Ok(certified),
        EnrolmentAnswer::Refused { sentence } => Err(Error::EnrolmentRefused(sentence)),
    }
}

async fn exchange(connection: &Connection, request: &EnrolmentRequest) -> Result<Vec<u8>, Error> {
    let (mut send, mut receive) = connection.open_bi().await.map_err(broken)?;
    let bytes = request.to_json()?;
    send.write_all(&bytes).await.map_err(broken)?;
    send.finish().map_err(broken)?;
    let answer = receive.read_to_end(ANSWER_BYTES_MAX).await;
    answer.map_err(broken)
}

/// Rephrases an error, since the other side is an authority and has neither of the roles.
fn refusal(error: Error) -> Error {
    match error {
        Error::CertificateRefused { fault, .. } => {
            Error::EnrolmentRefused(format!("our certificate {fault}"))
        }
        Error::Disconnected { reason, .. } => Error::EnrolmentRefused(format!("it {reason}")),
        error => error,
    }
}

fn client_config(
    url: &JoinUrl,
    credentials: Option<&Credentials>,
) -> Result<quinn::ClientConfig, Error> {
    let verifier = PinnedAuthority {
        fingerprint: url.fingerprint.clone(),
        provider: provider(),
    };
    let crypto = tls::client(verifier, credentials, ALPN)?;
    Ok(quinn::ClientConfig::new(Arc::new(crypto)))
}

/// TLS verifier that accepts only the authority whose certificate has the fingerprint in the token.
#[derive(Debug)]
struct PinnedAuthority {
    fingerprint: String,
    provider: Arc<CryptoProvider>,
}

impl ServerCertVerifier for PinnedAuthority {
    fn verify_server_cert(
        &self,
        certificate: &CertificateDer<'_>,
        _intermediates: &[CertificateDer<'_>],
        _name: &ServerName<'_>,
        _ocsp: &[u8],
        _now: UnixTime,
    ) -> Result<ServerCertVerified, rustls::Error> {
        match fingerprint(certificate) == self.fingerprint {
            true => Ok(ServerCertVerified::assertion()),
            false => Err(CertificateError::UnknownIssuer.into()),
        }
    }

    fn verify_tls12_signature(
        &self,
        _message: &[u8],
        _certificate: &CertificateDer<'_>,
        _signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let reason = rustls::PeerIncompatible::Tls12NotOffered;
        Err(rustls::Error::PeerIncompatible(reason))
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        certificate: &CertificateDer<'_>,
        signed: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, rustls::Error> {
        let algorithms = &self.provider.signature_verification_algorithms;
        rustls::crypto::verify_tls13_signature(message, certificate, signed, algorithms)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        let algorithms = &self.provider.signature_verification_algorithms;
        algorithms.supported_schemes()
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, SystemTime};

    use super::*;
    use crate::net::authority::{Authority, lasting};
    use crate::net::peer::CertificateFault;

    #[test]
    fn a_certificate_that_is_not_valid_yet_replaces_none() {
        const DAY: Duration = Duration::from_secs(86_400);
        let authority = Authority::generate().unwrap();
        let node = authority.credentials(Role::Node, "oak", lasting(30 * DAY));
        let node = node.unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(Role::Node.certificate_file());
        let replace = |validity: std::ops::Range<SystemTime>| {
            let issued = authority.issue(Role::Node, "oak", validity).unwrap();
            let answer = Certified {
                authority_pem: authority.certificate_pem().to_owned(),
                certificate_pem: Some(issued.certificate_pem.clone()),
                deny_list: "key node elm\n".to_owned(),
            };
            let saved = answer.save_renewed(&node, folder.path());
            (issued.certificate_pem.clone(), saved)
        };
        let (good, saved) = replace(lasting(60 * DAY));
        saved.unwrap();
        let deny_list = folder.path().join(DENY_LIST_FILE);
        std::fs::remove_file(&deny_list).unwrap();
        // Issued by an authority whose clock is three days ahead.
        let ahead = SystemTime::now() + 2 * DAY;
        let (_, refused) = replace(ahead..ahead + 30 * DAY);
        assert!(matches!(
            refused,
            Err(Error::Certificate {
                fault: CertificateFault::NotYetValid,
                ..
            })
        ));
        assert_eq!(std::fs::read_to_string(&path).unwrap(), good);
        assert!(deny_list.exists());
    }
}
