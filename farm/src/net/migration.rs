//! Migration of connections whose player's address changes, because a NAT assigns another port or the player
//! changes its network.
//!
//! quinn continues at the new address, and sends little there before it has validated it (RFC 9000, 8.2 and
//! 9.3). But it answers each packet from a forged address with a datagram of 1,200 bytes, a path challenge or
//! response, so that a player could make a node flood others. The number of these frames is therefore charged
//! to the player's account, and a connection that exceeds it is closed.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use quinn::Connection;

use crate::Error;
use crate::net::close_code;
use crate::net::player_account::PlayerAccount;

/// Interval of the checks, of a few microseconds each: in a tenth of a second a core answers some ten
/// thousand forged packets, with 12 MB.
const PERIOD: Duration = Duration::from_millis(100);

/// Reports each new address of a connection. Closes it and returns the error if the address changes too
/// often; otherwise never returns.
pub(crate) async fn watch(
    connection: &Connection,
    account: &PlayerAccount,
    moved: impl Fn(SocketAddr),
) -> Error {
    let (mut address, mut probes) = (connection.remote_address(), path_probes(connection));
    loop {
        tokio::time::sleep(PERIOD).await;
        let now = connection.remote_address();
        if std::mem::replace(&mut address, now) != now {
            moved(now);
        }
        let before = std::mem::replace(&mut probes, path_probes(connection));
        if probes > before && !account.spend_path_probes(Instant::now(), probes - before) {
            let why = Error::MovesTooOften;
            connection.close(close_code::PROTOCOL, why.to_string().as_bytes());
            return why;
        }
    }
}

/// Number of path challenges and responses sent so far: two per change of address.
fn path_probes(connection: &Connection) -> u64 {
    let sent = connection.stats().frame_tx;
    sent.path_challenge + sent.path_response
}
