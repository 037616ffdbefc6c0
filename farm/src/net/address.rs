//! Address of a node: a host and a port, resolved anew for each connection.

use std::fmt;
use std::net::{Ipv6Addr, SocketAddr};
use std::str::FromStr;

use crate::Error;

/// Address as `host:port`; the host is a name, an IPv4 address or an IPv6 address in brackets.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct NodeAddress {
    host: String,
    port: u16,
}

/// Maximum length of a domain name in bytes.
const HOST_BYTES_MAX: usize = 253;

impl NodeAddress {
    /// The same host at another port.
    #[must_use]
    pub fn with_port(self, port: u16) -> Self {
        Self { port, ..self }
    }

    /// Resolves the host to its socket addresses, by the system's resolver.
    #[cfg(feature = "net")]
    pub(crate) async fn resolve(&self) -> Result<Vec<SocketAddr>, Error> {
        let found = tokio::net::lookup_host((self.host.as_str(), self.port)).await;
        let addresses: Vec<SocketAddr> = found
            .map_err(|source| Error::NameResolution {
                host: self.host.clone(),
                source,
            })?
            .collect();
        if addresses.is_empty() {
            return Err(Error::NameWithoutAddress(self.host.clone()));
        }
        Ok(addresses)
    }
}

impl From<SocketAddr> for NodeAddress {
    fn from(address: SocketAddr) -> Self {
        Self {
            host: address.ip().to_string(),
            port: address.port(),
        }
    }
}

impl FromStr for NodeAddress {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let refused = |fault| Error::NodeAddress {
            text: text.to_owned(),
            fault,
        };
        let (host, port) = text
            .rsplit_once(':')
            .ok_or_else(|| refused("it must be host:port"))?;
        let port: u16 = match port.parse() {
            Ok(port) if port > 0 => port,
            _ => return Err(refused("its port must be a number from 1 to 65535")),
        };
        let host = match host.strip_prefix('[') {
            Some(rest) => {
                let inner = rest.strip_suffix(']').unwrap_or_default();
                if inner.parse::<Ipv6Addr>().is_err() {
                    return Err(refused("the brackets must hold an IPv6 address"));
                }
                inner
            }
            None if host.contains(':') => {
                return Err(refused("an IPv6 address must be in brackets"));
            }
            None => host,
        };
        let plain = |c: char| c.is_ascii_alphanumeric() || matches!(c, '-' | '_' | '.' | ':');
        if host.is_empty() || host.len() > HOST_BYTES_MAX || !host.chars().all(plain) {
            return Err(refused("its host must be a name or an address"));
        }
        Ok(Self {
            host: host.to_owned(),
            port,
        })
    }
}

impl fmt::Display for NodeAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.host.contains(':') {
            write!(f, "[{}]:{}", self.host, self.port)
        } else {
            write!(f, "{}:{}", self.host, self.port)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_is_the_inverse_of_parsing() {
        for text in [
            "oak:4433",
            "10.0.0.7:1",
            "[::1]:65535",
            "a.b-c_d.example:80",
        ] {
            assert_eq!(text.parse::<NodeAddress>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn malformed_addresses_are_refused_with_the_rule() {
        let long = format!("{}:1", "a".repeat(HOST_BYTES_MAX + 1));
        for text in [
            "",
            "oak",
            ":1",
            "oak:",
            "oak:0",
            "oak:65536",
            "oak:-1",
            "::1:80",
            "[::1:80",
            "[oak]:1",
            "a b:1",
            "https://oak:1",
            "o\0k:1",
            &long,
        ] {
            let error = text.parse::<NodeAddress>().unwrap_err().to_string();
            assert!(error.contains("is not a node address"), "{text}: {error}");
        }
    }
}
