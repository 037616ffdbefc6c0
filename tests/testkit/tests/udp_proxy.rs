//! Laws of the UDP proxy: packets pass as its links have it.

use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use carom_testkit::{link_emulator::LinkConfig, udp_proxy::UdpProxy};

fn echo() -> (UdpSocket, SocketAddr) {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let address = socket.local_addr().unwrap();
    (socket, address)
}

#[test]
fn packets_come_back_through_it_not_before_their_time() {
    let (server, address) = echo();
    let config = LinkConfig {
        delay: Duration::from_millis(5),
        ..LinkConfig::default()
    };
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let proxy = UdpProxy::start(any, address, config, 1).unwrap();
    let client = UdpSocket::bind(any).unwrap();
    client.connect(proxy.local_addr()).unwrap();
    let mut buffer = [0; 16];
    for packet in [b"one", b"two"] {
        let sent = Instant::now();
        client.send(packet).unwrap();
        let (length, from) = server.recv_from(&mut buffer).unwrap();
        server.send_to(&buffer[..length], from).unwrap();
        let length = client.recv(&mut buffer).unwrap();
        assert_eq!(&buffer[..length], packet);
        assert!(sent.elapsed() >= 2 * config.delay);
    }
    assert_eq!(proxy.counts().lost, 0);
}

#[test]
fn a_path_that_cannot_be_is_refused() {
    let any = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
    let config = LinkConfig {
        loss: 2.0,
        ..LinkConfig::default()
    };
    let refused = UdpProxy::start(any, any, config, 1).err().unwrap();
    assert!(refused.to_string().contains("loss is 2"), "{refused}");
}
