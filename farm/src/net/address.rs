//! Where a node is: a host and a port, resolved anew at each call.

use std::fmt;
use std::net::{Ipv6Addr, SocketAddr};
use std::str::FromStr;

/// `host:port`; the host is a name, an IPv4 address or an IPv6 address in brackets.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct NodeAddress {
    host: String,
    port: u16,
}

/// The longest name of the domain name system.
const HOST_BYTES_MAX: usize = 253;

impl NodeAddress {
    /// Asks the system for the host's addresses.
    pub(crate) async fn resolve(&self) -> Result<Vec<SocketAddr>, String> {
        let found = tokio::net::lookup_host((self.host.as_str(), self.port)).await;
        let addresses: Vec<SocketAddr> = found
            .map_err(|why| format!("the name `{}` could not be resolved: {why}", self.host))?
            .collect();
        if addresses.is_empty() {
            return Err(format!("the name `{}` has no address", self.host));
        }
        Ok(addresses)
    }
}

impl FromStr for NodeAddress {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = |why: &str| {
            format!(
                "`{}` is no node: {why}, as in `oak.example:4433`",
                text.escape_debug()
            )
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
                    return Err(refused("what is in brackets must be an IPv6 address"));
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
    fn what_is_printed_is_what_was_parsed() {
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
    fn anything_else_is_refused_with_the_rule() {
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
            let why = text.parse::<NodeAddress>().unwrap_err();
            assert!(why.contains("is no node"), "{text}: {why}");
        }
    }
}
