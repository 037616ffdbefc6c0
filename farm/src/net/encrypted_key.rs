//! Private keys encrypted by a passphrase (PKCS #8), which only the program that keeps a farm's authority
//! needs: part of the feature `cli`.

use zeroize::Zeroizing;

/// Label of an encrypted key in a PEM file (RFC 7468, 11).
pub(crate) const ENCRYPTED_KEY: &str = "ENCRYPTED PRIVATE KEY";

/// Reason why a key cannot be decrypted.
#[cfg_attr(
    not(feature = "cli"),
    expect(dead_code, reason = "nothing is decrypted without the feature")
)]
pub(super) enum KeyFault {
    Format(String),
    Passphrase,
}

/// Encrypts a key in PKCS #8 DER; returns PEM text.
#[cfg(feature = "cli")]
pub(super) fn encrypt(der: &[u8], passphrase: &str) -> Result<String, String> {
    use pkcs8::{LineEnding, PrivateKeyInfoRef};

    let encrypted = PrivateKeyInfoRef::try_from(der)
        .and_then(|key| key.encrypt(passphrase))
        .map_err(|error| error.to_string())?;
    let pem = encrypted.to_pem(ENCRYPTED_KEY, LineEnding::LF);
    Ok(pem.map_err(|error| error.to_string())?.to_string())
}

/// Decrypts a key in PEM text; returns PKCS #8 DER.
#[cfg(feature = "cli")]
pub(super) fn decrypt(pem: &str, passphrase: &str) -> Result<Zeroizing<Vec<u8>>, KeyFault> {
    use pkcs8::{EncryptedPrivateKeyInfoRef, SecretDocument};

    let (_, document) =
        SecretDocument::from_pem(pem).map_err(|error| KeyFault::Format(error.to_string()))?;
    let key = EncryptedPrivateKeyInfoRef::try_from(document.as_bytes())
        .map_err(|error| KeyFault::Format(error.to_string()))?
        .decrypt(passphrase)
        .map_err(|_| KeyFault::Passphrase)?;
    Ok(Zeroizing::new(key.as_bytes().to_vec()))
}

#[cfg(not(feature = "cli"))]
pub(super) fn encrypt(_der: &[u8], _passphrase: &str) -> Result<String, String> {
    Err(ABSENT.to_owned())
}

#[cfg(not(feature = "cli"))]
pub(super) fn decrypt(_pem: &str, _passphrase: &str) -> Result<Zeroizing<Vec<u8>>, KeyFault> {
    Err(KeyFault::Format(ABSENT.to_owned()))
}

#[cfg(not(feature = "cli"))]
const ABSENT: &str = "keys under a passphrase need the feature `cli` of carom-farm";
