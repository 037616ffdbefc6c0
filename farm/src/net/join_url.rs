//! Address and token by which a node joins a farm: `farm://host:port#token`.

use std::fmt;
use std::str::FromStr;

use crate::Error;
use crate::net::address::NodeAddress;
use crate::net::certificate_fields;

const SCHEME: &str = "farm://";
/// Bytes of the secret and of the farm's fingerprint: 128 bits each.
const BYTES: usize = 16;

/// Address of a farm's authority, its fingerprint, and the secret for which it admits a node.
#[derive(Clone, PartialEq, Eq)]
pub struct JoinUrl {
    /// The authority's address.
    pub address: NodeAddress,
    /// The secret that a new node must present; absent in the URL that a node keeps after joining.
    pub(crate) secret: Option<String>,
    /// The first half of the farm's fingerprint.
    pub(crate) fingerprint: String,
}

impl JoinUrl {
    /// The URL at which an authority will admit nodes, with a new secret.
    ///
    /// # Errors
    /// [`Error::CertificateCreation`] if the system provides no randomness.
    pub(crate) fn new(address: NodeAddress, authority: &[u8]) -> Result<Self, Error> {
        let secret = certificate_fields::random::<BYTES>();
        let secret = secret.map_err(|error| Error::CertificateCreation(error.to_string()))?;
        Ok(Self {
            address,
            secret: Some(certificate_fields::hexadecimal(&secret)),
            fingerprint: fingerprint(authority),
        })
    }

    /// The URL that a node keeps for the renewal of its certificate.
    pub(crate) fn without_secret(&self) -> Self {
        Self {
            secret: None,
            ..self.clone()
        }
    }
}

/// The first half of SHA-256 of the authority's certificate, in hexadecimal.
pub(crate) fn fingerprint(authority: &[u8]) -> String {
    let mut text = certificate_fields::sha256(authority);
    text.truncate(2 * BYTES);
    text
}

impl FromStr for JoinUrl {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let refused = Error::JoinUrl;
        let rest = text
            .strip_prefix(SCHEME)
            .ok_or_else(|| refused("it must begin with farm://"))?;
        let (address, token) = rest
            .split_once('#')
            .ok_or_else(|| refused("it must end in # and a token"))?;
        let is_hexadecimal = token.bytes().all(|byte| byte.is_ascii_hexdigit());
        let (fingerprint, secret) = match token.split_at_checked(2 * BYTES) {
            Some((fingerprint, "")) => (fingerprint, None),
            Some((fingerprint, secret)) if secret.len() == 2 * BYTES => (fingerprint, Some(secret)),
            _ => ("", None),
        };
        if !is_hexadecimal || fingerprint.is_empty() {
            return Err(refused("its token must be 64 hexadecimal digits"));
        }
        Ok(Self {
            address: address.parse()?,
            secret: secret.map(str::to_owned),
            fingerprint: fingerprint.to_ascii_lowercase(),
        })
    }
}

impl fmt::Display for JoinUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let secret = self.secret.as_deref().unwrap_or_default();
        write!(f, "{SCHEME}{}#{}{secret}", self.address, self.fingerprint)
    }
}

/// Prints no secret.
impl fmt::Debug for JoinUrl {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("JoinUrl")
            .field(&self.without_secret().to_string())
            .finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn join_urls_survive_being_printed() {
        let url = JoinUrl::new("[::1]:4434".parse().unwrap(), b"authority").unwrap();
        assert_eq!(url.to_string().parse::<JoinUrl>().unwrap(), url);
        let kept = url.without_secret();
        assert_eq!(kept.to_string().parse::<JoinUrl>().unwrap(), kept);
        assert!(!format!("{url:?}").contains(url.secret.as_deref().unwrap()));
    }

    #[test]
    fn malformed_join_urls_are_refused_with_the_rule() {
        let token = "0".repeat(64);
        for text in [
            format!("oak:1#{token}"),
            "farm://oak:1".to_owned(),
            format!("farm://oak:1#{token}0"),
            format!("farm://oak:1#{}é", &token[2..]),
            format!("farm://oak:1#{0}é{0}", &token[33..]),
        ] {
            let why = text.parse::<JoinUrl>().unwrap_err().to_string();
            assert!(why.contains("carom-farm token"), "{why}");
        }
    }
}
