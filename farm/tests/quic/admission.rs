//! Admission to a node, and its resistance to peers that break the rules.

use std::net::UdpSocket;

use carom_farm::net::{Authority, Credentials, NodeServer, Role};
use carom_protocol::framing;
use carom_protocol::session::ClientEvent;
use quinn::{ConnectionError, VarInt};

use crate::greeter::{Greeter, any_port, info, long_ago, today};
use crate::stranger::{
    block_on, call, certificate, greeting, hello, intrude, key, self_signed, tls,
};

#[test]
fn players_without_a_valid_certificate_are_not_heard() {
    let (farm, other) = (
        Authority::generate().unwrap(),
        Authority::generate().unwrap(),
    );
    let node = Greeter::start(&farm);
    let issue = |by: &Authority, role, when| Some(by.issue(role, "player", when).unwrap());
    let strangers = [
        ("none", None),
        ("self-signed", Some(self_signed(Role::Player))),
        ("other farm", issue(&other, Role::Player, today())),
        ("a node", issue(&farm, Role::Node, today())),
        ("expired", issue(&farm, Role::Player, long_ago())),
    ];
    for (who, shown) in &strangers {
        let why = intrude(node.address, tls(shown.as_ref(), b"carom/1"), &hello());
        let ConnectionError::ConnectionClosed(close) = &why else {
            panic!("{who}: {why:?}");
        };
        // RFC 9001, 4.8: a TLS alert.
        assert_eq!(u64::from(close.error_code) >> 8, 1, "{who}: {why:?}");
        assert_eq!(node.heard(), (0, 0), "{who}");
    }
    assert_eq!(greeting(node.address, &farm), ClientEvent::Welcome(info()));
    assert_eq!(node.heard(), (1, 1));
}

#[test]
fn a_node_speaks_no_other_protocol() {
    let farm = Authority::generate().unwrap();
    let node = Greeter::start(&farm);
    let player = farm.issue(Role::Player, "player", today()).unwrap();
    for alpn in [&b"carom/2"[..], b"h3"] {
        let why = intrude(node.address, tls(Some(&player), alpn), &hello());
        assert!(
            matches!(why, ConnectionError::ConnectionClosed(_)),
            "{why:?}"
        );
    }
    assert_eq!(node.heard(), (0, 0));
}

#[test]
fn a_node_survives_datagrams_of_noise() {
    let farm = Authority::generate().unwrap();
    let node = Greeter::start(&farm);
    let socket = UdpSocket::bind(any_port()).unwrap();
    let mut state = 1u64;
    for length in (0..1400).step_by(7) {
        let noise: Vec<u8> = (0..length)
            .map(|_| {
                state = state.wrapping_mul(0x5851_f42d_4c95_7f2d).wrapping_add(1);
                (state >> 56) as u8
            })
            .collect();
        let _ = socket.send_to(&noise, node.address);
        // The same behind headers of QUIC version 1: an Initial, a Handshake, a 0-RTT packet.
        for kind in [0xc0, 0xe0, 0xd0] {
            let mut packet = vec![kind, 0, 0, 0, 1, 8];
            packet.extend_from_slice(&noise);
            packet.resize(packet.len().max(1200), 0);
            let _ = socket.send_to(&packet, node.address);
        }
    }
    assert_eq!(greeting(node.address, &farm), ClientEvent::Welcome(info()));
}

#[test]
fn protocol_violations_end_only_their_own_connection() {
    let farm = Authority::generate().unwrap();
    let node = Greeter::start(&farm);
    let player = farm.issue(Role::Player, "player", today()).unwrap();
    let too_long = u32::MAX.to_le_bytes().to_vec();
    let garbage = framing::frame(&[0xff; 100]);
    let greeted_twice = [hello(), hello()].concat();
    for words in [too_long, garbage, greeted_twice] {
        let why = intrude(node.address, tls(Some(&player), b"carom/1"), &words);
        let ConnectionError::ApplicationClosed(close) = why else {
            panic!("{why:?}");
        };
        assert_eq!(close.error_code, VarInt::from_u32(3));
        assert!(!close.reason.is_empty());
    }
    assert_eq!(greeting(node.address, &farm), ClientEvent::Welcome(info()));
}

#[test]
fn players_get_one_stream_and_no_tile_datagrams() {
    let farm = Authority::generate().unwrap();
    let node = Greeter::start(&farm);
    let player = farm.issue(Role::Player, "player", today()).unwrap();
    block_on(async {
        let mut call = call(node.address, tls(Some(&player), b"carom/1"))
            .await
            .unwrap();
        call.send.write_all(&hello()).await.unwrap();
        // The node has answered, so that its limits are known.
        call.receive.read_chunk(1, true).await.unwrap();
        let opened = tokio::select! {
            biased;
            _ = call.connection.open_uni() => true,
            _ = call.connection.open_bi() => true,
            () = std::future::ready(()) => false,
        };
        assert!(!opened);
        // Tiles are not for nodes.
        let piece = [&[0], &[0; 9][..], b"noise"].concat();
        call.connection.send_datagram(piece.into()).unwrap();
        let ConnectionError::ApplicationClosed(close) = call.connection.closed().await else {
            panic!("the node did not say why it closed");
        };
        assert_eq!(close.error_code, VarInt::from_u32(3));
    });
}

#[test]
fn a_player_that_does_not_greet_loses_its_place() {
    let farm = Authority::generate().unwrap();
    let node = Greeter::start(&farm);
    let player = farm.issue(Role::Player, "player", today()).unwrap();
    // The first bytes of a greeting, whose end never comes.
    let why = intrude(node.address, tls(Some(&player), b"carom/1"), &hello()[..2]);
    let ConnectionError::ApplicationClosed(close) = why else {
        panic!("{why:?}");
    };
    let why = String::from_utf8_lossy(&close.reason);
    assert!(why.contains("no greeting within 3 s: call again"), "{why}");
    // A stream is not open before its first byte.
    let why = intrude(node.address, tls(Some(&player), b"carom/1"), &[]);
    let ConnectionError::ApplicationClosed(close) = why else {
        panic!("{why:?}");
    };
    let why = String::from_utf8_lossy(&close.reason);
    assert!(why.contains("no control stream within 3 s"), "{why}");
}

#[test]
fn a_full_node_refuses_with_its_reason() {
    let farm = Authority::generate().unwrap();
    let node = Greeter::start(&farm);
    let player = farm.issue(Role::Player, "player", today()).unwrap();
    let (served, why) = block_on(async {
        let mut calls = Vec::new();
        loop {
            let config = tls(Some(&player), b"carom/1");
            let mut call = match call(node.address, config).await {
                Ok(call) => call,
                Err(why) => return (calls.len(), why),
            };
            let _ = call.send.write_all(&hello()).await;
            match call.receive.read_chunk(1, true).await {
                Ok(_) => calls.push(call),
                Err(_) => return (calls.len(), call.connection.closed().await),
            }
        }
    });
    assert_eq!(served, 4);
    let ConnectionError::ApplicationClosed(close) = why else {
        panic!("{why:?}");
    };
    assert_eq!(close.error_code, VarInt::from_u32(1));
}

#[test]
fn a_key_of_another_certificate_is_refused() {
    let farm = Authority::generate().unwrap();
    let one = farm.issue(Role::Node, "oak", today()).unwrap();
    let two = farm.issue(Role::Node, "elm", today()).unwrap();
    let authority = certificate(farm.certificate_pem());
    let oak = certificate(&one.certificate_pem);
    let credentials = Credentials::new(authority, oak, key(&two), Role::Node).unwrap();
    assert!(NodeServer::bind(any_port(), &credentials).is_err());
}
