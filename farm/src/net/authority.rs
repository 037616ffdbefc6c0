//! Certificate authority of a farm: created once and kept by the farm's owner, never on a node.

use std::path::Path;
use std::time::{Duration, SystemTime};

use rcgen::{
    BasicConstraints, Certificate, CertificateParams, CertificateSigningRequestParams,
    DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
    PublicKeyData, SanType, SerialNumber, SignatureAlgorithm, SigningKey,
};
use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};

use crate::Error;
use crate::net::certificate_fields;
use crate::net::credential_files::{check_private, file_error};
use crate::net::credentials::{AUTHORITY_FILE, Credentials, not_pem};
use crate::net::encrypted_key::{self, ENCRYPTED_KEY, KeyFault};
use crate::net::peer::{AUTHORITY_LIFE, Role};
use zeroize::{Zeroize, Zeroizing};

/// Certificates are valid from a day earlier: clocks of new machines are often wrong by a time zone.
const EARLY: Duration = Duration::from_secs(24 * 3600);
/// Name of the file with the authority's key.
pub(crate) const AUTHORITY_KEY_FILE: &str = "ca.key";
/// Bytes of a serial number, all random; 64 random bits are the minimum (CA/Browser Forum, 7.1).
const SERIAL_BYTES: usize = 16;

/// A certificate and its key as PEM text.
pub struct IssuedCertificate {
    /// The certificate.
    pub certificate_pem: String,
    /// The private key: never printed, written with mode 0600.
    pub key_pem: String,
}

impl IssuedCertificate {
    pub(crate) fn certificate_der(&self) -> Result<CertificateDer<'static>, Error> {
        CertificateDer::from_pem_slice(self.certificate_pem.as_bytes()).map_err(not_created)
    }
}

/// Wipes the key from memory.
impl Drop for IssuedCertificate {
    fn drop(&mut self) {
        self.key_pem.zeroize();
    }
}

/// Certificate authority of a farm, with its key.
pub struct Authority {
    certificate_pem: String,
    issuer: Issuer<'static, WipedKey>,
}

/// Key pair that is wiped from memory when it is dropped. ring holds a copy meanwhile, which is not wiped.
struct WipedKey(KeyPair);

impl Drop for WipedKey {
    fn drop(&mut self) {
        self.0.zeroize();
    }
}

impl PublicKeyData for WipedKey {
    fn der_bytes(&self) -> &[u8] {
        self.0.der_bytes()
    }

    fn algorithm(&self) -> &'static SignatureAlgorithm {
        self.0.algorithm()
    }
}

impl SigningKey for WipedKey {
    fn sign(&self, message: &[u8]) -> Result<Vec<u8>, rcgen::Error> {
        self.0.sign(message)
    }
}

/// Prints no key.
impl std::fmt::Debug for Authority {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Authority").finish_non_exhaustive()
    }
}

impl Authority {
    /// Creates an authority with a P-256 key, in memory.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the system provides no randomness.
    pub fn generate() -> Result<Self, Error> {
        let key = generate_key()?;
        let mut params = CertificateParams::default();
        let validity = lasting(AUTHORITY_LIFE);
        params.not_before = validity.start.into();
        params.not_after = validity.end.into();
        // Each farm has a name of its own, so that a certificate of another farm can be distinguished from a
        // forged one.
        let id = certificate_fields::hexadecimal(&params.key_identifier(&key)[..8]);
        params.distinguished_name = subject(&format!("Carom farm {id}"));
        // Path length 0: it certifies nodes and players, but no further authority.
        params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
        // DigitalSignature, since the authority also signs the handshakes with nodes that join.
        params.key_usages = vec![
            KeyUsagePurpose::KeyCertSign,
            KeyUsagePurpose::CrlSign,
            KeyUsagePurpose::DigitalSignature,
        ];
        let certificate = params.self_signed(&key).map_err(not_created)?;
        Ok(Self {
            certificate_pem: certificate.pem(),
            issuer: Issuer::new(params, key),
        })
    }

    /// Reads `ca.pem` and `ca.key`, which is not encrypted.
    ///
    /// # Errors
    /// As [`super::AuthorityFolder::open`].
    pub fn load(dir: &Path) -> Result<Self, Error> {
        Self::open(dir, None)
    }

    /// Reads `ca.pem` and `ca.key`.
    ///
    /// # Errors
    /// As [`super::AuthorityFolder::open`].
    pub(crate) fn open(dir: &Path, passphrase: Option<&str>) -> Result<Self, Error> {
        let certificate_path = dir.join(AUTHORITY_FILE);
        let certificate_pem = read_authority(&certificate_path)?;
        let key_path = dir.join(AUTHORITY_KEY_FILE);
        let key_pem = Zeroizing::new(read_authority(&key_path)?);
        check_private(&key_path)?;
        let encrypted = key_pem.contains(ENCRYPTED_KEY);
        let key = match (encrypted, passphrase) {
            (false, _) => KeyPair::from_pem(&key_pem)
                .map(WipedKey)
                .map_err(not_pem(&key_path, "private key"))?,
            (true, None) => return Err(Error::PassphraseMissing(key_path)),
            (true, Some(passphrase)) => decrypted(&key_path, &key_pem, passphrase)?,
        };
        let issuer = Issuer::from_ca_cert_pem(&certificate_pem, key)
            .map_err(not_pem(&certificate_path, "certificate"))?;
        Ok(Self {
            certificate_pem,
            issuer,
        })
    }

    /// The authority's certificate as PEM text.
    pub fn certificate_pem(&self) -> &str {
        &self.certificate_pem
    }

    /// The authority's key as PEM text, in PKCS #8, encrypted by scrypt and AES-256 (RFC 8018) if there is
    /// a passphrase.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the system provides no randomness.
    pub(crate) fn key_pem(&self, passphrase: Option<&str>) -> Result<Zeroizing<String>, Error> {
        let WipedKey(key) = self.issuer.key();
        let Some(passphrase) = passphrase else {
            return Ok(Zeroizing::new(key.serialize_pem()));
        };
        encrypted_key::encrypt(key.serialized_der(), passphrase)
            .map(Zeroizing::new)
            .map_err(not_created)
    }

    /// Creates a key and issues its certificate.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the system provides no randomness.
    pub fn issue(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
    ) -> Result<IssuedCertificate, Error> {
        let key = generate_key()?;
        let certificate = self.sign(role, name, validity, &key)?;
        Ok(IssuedCertificate {
            certificate_pem: certificate.pem(),
            key_pem: key.0.serialize_pem(),
        })
    }

    /// Issues a certificate for a key that is kept elsewhere, whose holder has signed the request. Everything
    /// in the request but its key is ignored.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the text is no certificate request.
    #[doc(hidden)]
    pub fn sign_request(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
        request_pem: &str,
    ) -> Result<Certificate, Error> {
        let request =
            CertificateSigningRequestParams::from_pem(request_pem).map_err(not_created)?;
        self.sign(role, name, validity, &request.public_key)
    }

    /// Issues credentials for immediate use by an endpoint, without writing them to a disk.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`], or [`Error::Certificate`] if the certificate is not valid now.
    pub fn credentials(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
    ) -> Result<Credentials, Error> {
        let issued = self.issue(role, name, validity)?;
        let key = PrivateKeyDer::from_pem_slice(issued.key_pem.as_bytes());
        Credentials::new(
            self.certificate()?,
            issued.certificate_der()?,
            key.map_err(not_created)?,
            role,
        )
    }

    pub(crate) fn certificate(&self) -> Result<CertificateDer<'static>, Error> {
        CertificateDer::from_pem_slice(self.certificate_pem.as_bytes()).map_err(not_created)
    }

    pub(crate) fn key(&self) -> PrivateKeyDer<'static> {
        PrivateKeyDer::Pkcs8(self.issuer.key().0.serialize_der().into())
    }

    fn sign(
        &self,
        role: Role,
        name: &str,
        validity: std::ops::Range<SystemTime>,
        key: &impl PublicKeyData,
    ) -> Result<Certificate, Error> {
        let serial: [u8; SERIAL_BYTES] = certificate_fields::random().map_err(not_created)?;
        let mut params = CertificateParams::default();
        params.serial_number = Some(SerialNumber::from_slice(&serial));
        params.not_before = validity.start.into();
        params.not_after = validity.end.into();
        params.distinguished_name = subject(name);
        let uri = role.uri().try_into().map_err(not_created)?;
        params.subject_alt_names = vec![SanType::URI(uri)];
        params.is_ca = IsCa::ExplicitNoCa;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![match role {
            Role::Player => ExtendedKeyUsagePurpose::ClientAuth,
            Role::Node => ExtendedKeyUsagePurpose::ServerAuth,
        }];
        params.use_authority_key_identifier_extension = true;
        let signed = params.signed_by(key, &self.issuer);
        signed.map_err(not_created)
    }
}

pub(crate) fn read_authority(path: &Path) -> Result<String, Error> {
    std::fs::read_to_string(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => Error::CredentialsMissing {
            path: path.to_path_buf(),
            advice: "create the farm's authority with `carom-farm init`, or name its folder with \
                     --dir",
        },
        _ => file_error(path)(source),
    })
}

fn generate_key() -> Result<WipedKey, Error> {
    let key = KeyPair::generate().map(WipedKey);
    key.map_err(not_created)
}

fn decrypted(path: &Path, key_pem: &str, passphrase: &str) -> Result<WipedKey, Error> {
    let key = encrypted_key::decrypt(key_pem, passphrase).map_err(|fault| match fault {
        KeyFault::Format(error) => not_pem(path, "private key")(error),
        KeyFault::Passphrase => Error::PassphraseWrong(path.to_path_buf()),
    })?;
    KeyPair::try_from(key.as_slice())
        .map(WipedKey)
        .map_err(not_pem(path, "private key"))
}

/// The validity of a certificate issued now for `life`.
#[doc(hidden)]
pub fn lasting(life: Duration) -> std::ops::Range<SystemTime> {
    let now = SystemTime::now();
    now - EARLY..now + life
}

fn subject(name: &str) -> DistinguishedName {
    let mut subject = DistinguishedName::new();
    subject.push(DnType::CommonName, name);
    subject
}

pub(crate) fn not_created(error: impl std::fmt::Display) -> Error {
    Error::CertificateCreation(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const DAY: Duration = Duration::from_secs(24 * 3600);

    #[test]
    fn certificates_outside_their_days_are_refused_by_their_holder() {
        let authority = Authority::generate().unwrap();
        let now = SystemTime::now();
        let refused = authority
            .credentials(Role::Node, "oak", now - 3 * DAY..now - DAY)
            .unwrap_err()
            .to_string();
        assert!(refused.contains("expired"), "{refused}");
        let early = authority
            .credentials(Role::Node, "oak", now + DAY..now + 3 * DAY)
            .unwrap_err()
            .to_string();
        assert!(
            early.contains("is not valid yet: check this machine's clock"),
            "{early}"
        );
    }
}
