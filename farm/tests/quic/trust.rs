//! The life of trust: joining, renewal, revocation.

use std::fs;
use std::net::SocketAddr;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime};

use carom_farm::net::{
    Authority, AuthorityFolder, Client, Credentials, EnrolmentEvent, EnrolmentService,
    FIRST_PLAYER, IssuedCertificate, JoinUrl, LinkEvent, NodeServer, Role, ServerEvent, StopHandle,
    create_farm, join, revoke,
};
use carom_farm::node::Node;
use carom_protocol::PrecisionRange;
use carom_protocol::session::ClientEvent;
use carom_tracer::CpuTracer;
use quinn::{ConnectionError, VarInt};
use rustls::pki_types::CertificateDer;
use tempfile::TempDir;

use crate::greeter::{Greeter, any_port};
use crate::stranger::{block_on, call, certificate, hello, intrude, tls};

/// Far longer than anything here takes; a test that needs it has failed.
const TIMEOUT: Duration = Duration::from_secs(60);

/// An authority that admits nodes, on a thread of its own, with what happens at it.
struct RunningService {
    url: JoinUrl,
    events: Receiver<EnrolmentEvent>,
    thread: JoinHandle<()>,
}

impl RunningService {
    fn start(farm: &Path, uses: u32) -> Self {
        let folder = AuthorityFolder::open(farm, None).unwrap();
        let host = "127.0.0.1:1".parse().unwrap();
        let (service, url) = EnrolmentService::bind(any_port(), folder, host, uses).unwrap();
        let (sender, events) = mpsc::channel();
        let serve = move || service.serve(TIMEOUT, move |event| drop(sender.send(event)));
        let thread = std::thread::spawn(serve);
        Self {
            url,
            events,
            thread,
        }
    }

    fn address(&self) -> SocketAddr {
        self.url.address.to_string().parse().unwrap()
    }
}

/// Folders of a farm that has just been created, and of the node `oak` beside it.
fn farm() -> (TempDir, PathBuf, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let (farm, oak) = (dir.path().join("farm"), dir.path().join("oak"));
    create_farm(&farm).unwrap();
    (dir, farm, oak)
}

/// The same with `oak` joined.
fn farm_with_oak() -> (TempDir, PathBuf, PathBuf) {
    let (dir, farm, oak) = self::farm();
    let service = RunningService::start(&farm, 1);
    join(&service.url, "oak", &oak).unwrap();
    service.thread.join().unwrap();
    (dir, farm, oak)
}

/// Puts `oak`'s certificate in its place by one of another key, in the last of its thirty days.
fn last_day(farm: &Path, oak: &Path) -> IssuedCertificate {
    let authority = Authority::load(farm).unwrap();
    let issued = authority.issue(Role::Node, "oak", last_of_thirty_days());
    let issued = issued.unwrap();
    fs::write(oak.join("node.key"), &issued.key_pem).unwrap();
    fs::write(oak.join("node.pem"), &issued.certificate_pem).unwrap();
    issued
}

fn last_of_thirty_days() -> Range<SystemTime> {
    let (now, day) = (SystemTime::now(), Duration::from_secs(24 * 3600));
    now - 29 * day..now + day
}

fn shown(dir: &Path, role: &str) -> IssuedCertificate {
    let read = |file: String| fs::read_to_string(dir.join(file)).unwrap();
    IssuedCertificate {
        certificate_pem: read(format!("{role}.pem")),
        key_pem: read(format!("{role}.key")),
    }
}

#[test]
fn a_token_admits_as_many_nodes_as_it_says() {
    let (dir, farm, _) = farm();
    let RunningService { url, thread, .. } = RunningService::start(&farm, 2);
    let node = |name: &str| dir.path().join(name);
    let oak = join(&url, "oak", &node("oak")).unwrap();
    assert_eq!((oak.name(), oak.role()), ("oak", Role::Node));
    let refused = |url: &JoinUrl, name: &str| {
        let why = join(url, name, &node("refused")).unwrap_err().to_string();
        assert!(!node("refused").exists());
        why
    };
    let taken = refused(&url, "oak");
    assert!(taken.contains("oak has a certificate until"), "{taken}");
    let text = url.to_string();
    let guessed = format!("{}{}", &text[..text.len() - 32], "0".repeat(32));
    let guessed = refused(&guessed.parse().unwrap(), "elm");
    assert!(guessed.contains("token is not valid"), "{guessed}");
    let (address, token) = text.split_once('#').unwrap();
    let other_farm = format!("{address}#{}{}", "0".repeat(32), &token[32..]);
    let other_farm = refused(&other_farm.parse().unwrap(), "elm");
    assert!(other_farm.contains("another farm"), "{other_farm}");
    join(&url, "elm", &node("elm")).unwrap();
    thread.join().unwrap();
}

#[test]
fn the_key_of_a_joining_node_stays_with_it() {
    let (dir, farm, oak) = farm_with_oak();
    let mut files: Vec<_> = fs::read_dir(&oak)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files, ["ca.pem", "farm.url", "node.key", "node.pem"]);
    // What the node keeps admits nobody.
    let kept = fs::read_to_string(oak.join("farm.url")).unwrap();
    let why = join(&kept.parse().unwrap(), "elm", &dir.path().join("elm")).unwrap_err();
    assert!(why.to_string().contains("token"), "{why}");
    assert!(!farm.join("nodes").exists());
}

#[test]
fn text_of_strangers_does_not_reach_the_operator() {
    let (_dir, farm, _) = farm();
    let service = RunningService::start(&farm, 1);
    let address = service.address();
    block_on(async {
        let mut call = call(address, tls(None, b"carom-join/1")).await.unwrap();
        let words = br#"{"\u001b]0;owned": 1}"#;
        call.send.write_all(words).await.unwrap();
        call.send.finish().unwrap();
        call.connection.closed().await;
    });
    let event = format!("{:?}", service.events.recv_timeout(TIMEOUT).unwrap());
    assert!(event.contains("not a request"), "{event}");
}

#[test]
fn reasons_of_strangers_do_not_control_the_operators_terminal() {
    let (_dir, farm, _) = farm();
    let service = RunningService::start(&farm, 1);
    let address = service.address();
    let hostile = "\u{1b}]0;owned\u{7}\u{1b}[2J\r\njoined: oak".as_bytes();
    for sent in [None, Some(&b"{"[..])] {
        block_on(async {
            let mut call = call(address, tls(None, b"carom-join/1")).await.unwrap();
            if let Some(sent) = sent {
                call.send.write_all(sent).await.unwrap();
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
            call.connection.close(VarInt::from_u32(9), hostile);
            call.endpoint.wait_idle().await;
        });
        let EnrolmentEvent::Refused { why, .. } = service.events.recv_timeout(TIMEOUT).unwrap()
        else {
            panic!("something else than a refusal");
        };
        assert_eq!(why.contains("owned"), sent.is_none(), "{why}");
        assert!(!why.contains(|letter: char| letter.is_control()), "{why:?}");
    }
}

#[test]
fn renewals_are_of_the_key_that_joined_and_only_when_they_are_due() {
    let (_dir, farm, oak) = farm_with_oak();
    let address = RunningService::start(&farm, 0).address();
    let request = |key: &rcgen::KeyPair| {
        let request = rcgen::CertificateParams::default().serialize_request(key);
        let request_pem = request.unwrap().pem().unwrap();
        serde_json::to_vec(&serde_json::json!({"Renew": {"request_pem": request_pem}})).unwrap()
    };
    let renewed = |shown: &IssuedCertificate, key: &rcgen::KeyPair| {
        block_on(async {
            let config = tls(Some(shown), b"carom-join/1");
            let mut call = call(address, config).await.unwrap();
            call.send.write_all(&request(key)).await.unwrap();
            call.send.finish().unwrap();
            let answer = call.receive.read_to_end(1 << 20).await.unwrap();
            String::from_utf8(answer).unwrap()
        })
    };
    let key = |folder: &Path| {
        let pem = fs::read_to_string(folder.join("node.key")).unwrap();
        rcgen::KeyPair::from_pem(&pem).unwrap()
    };
    let early = renewed(&shown(&oak, "node"), &key(&oak));
    assert!(early.contains("last third"), "{early}");

    last_day(&farm, &oak); // of a key of its own
    let other = renewed(&shown(&oak, "node"), &rcgen::KeyPair::generate().unwrap());
    assert!(other.contains("another key"), "{other}");
    let issued = || {
        let log = fs::read_to_string(farm.join("issued.jsonl")).unwrap();
        log.lines().count()
    };
    let before = issued();
    let good = renewed(&shown(&oak, "node"), &key(&oak));
    assert!(good.contains("BEGIN CERTIFICATE"), "{good}");
    // The old certificate is valid for another day, and buys no second one.
    let again = renewed(&shown(&oak, "node"), &key(&oak));
    assert!(again.contains("last third"), "{again}");
    assert_eq!(issued(), before + 1);
}

/// Its clock is ahead, so that it takes its certificate to be old, and the authority does not.
#[test]
fn a_node_that_is_refused_a_certificate_gets_the_deny_list() {
    let (_dir, farm, oak) = farm_with_oak();
    let issuer = AuthorityFolder::open(&farm, None).unwrap();
    issuer.add(Role::Node, "elm", None, false).unwrap();
    revoke(&farm, "elm").unwrap();
    let kept = RunningService::start(&farm, 0).url.to_string();
    fs::write(oak.join("farm.url"), &kept[..kept.len() - 32]).unwrap();
    // An earlier certificate of the key, in its last day: the authority has the later one on record.
    let key_pem = fs::read_to_string(oak.join("node.key")).unwrap();
    let key = rcgen::KeyPair::from_pem(&key_pem).unwrap();
    let request = rcgen::CertificateParams::default().serialize_request(&key);
    let request_pem = request.unwrap().pem().unwrap();
    let days = last_of_thirty_days();
    let authority = Authority::load(&farm).unwrap();
    let earlier = authority.sign_request(Role::Node, "oak", days, &request_pem);
    fs::write(oak.join("node.pem"), earlier.unwrap().pem()).unwrap();
    let credentials = Credentials::load(&oak, Role::Node).unwrap();
    assert!(credentials.is_due());
    let mut server = NodeServer::bind(any_port(), &credentials).unwrap();
    server.keep_renewed(credentials, oak.clone());
    let stop = StopHandle::default();
    let stopped = stop.clone();
    let node = Node::new("oak", Arc::new(CpuTracer::with_threads(1).unwrap()));
    let running = std::thread::spawn(move || {
        server.serve(&stopped, move |player, _| node.connect(player), |_| {});
    });
    let now = Instant::now();
    let list = || fs::read_to_string(oak.join("revoked.txt")).unwrap_or_default();
    while !list().contains(" node elm") {
        assert!(now.elapsed() < TIMEOUT, "no list has come");
        std::thread::sleep(Duration::from_millis(10));
    }
    stop.stop();
    running.join().unwrap();
}

#[test]
fn a_running_node_renews_its_certificate() {
    let (_dir, farm, oak) = farm_with_oak();
    let last_day = last_day(&farm, &oak);
    let kept = RunningService::start(&farm, 0).url.to_string();
    fs::write(oak.join("farm.url"), &kept[..kept.len() - 32]).unwrap();
    let credentials = Credentials::load(&oak, Role::Node).unwrap();
    assert!(credentials.is_due());
    let mut server = NodeServer::bind(any_port(), &credentials).unwrap();
    let address = server.local_addr().unwrap();
    server.keep_renewed(credentials, oak.clone());
    let (stop, (sender, events)) = (StopHandle::default(), mpsc::channel());
    let stopped = stop.clone();
    let node = Node::new("oak", Arc::new(CpuTracer::with_threads(1).unwrap()));
    let running = std::thread::spawn(move || {
        let connect = move |player, _| node.connect(player);
        server.serve(&stopped, connect, move |event| drop(sender.send(event)));
    });
    let renewed = events.recv_timeout(TIMEOUT).unwrap();
    assert!(
        matches!(renewed, ServerEvent::Renewed { .. }),
        "{renewed:?}"
    );
    assert!(!Credentials::load(&oak, Role::Node).unwrap().is_due());
    let player = shown(&farm, "player");
    let seen = block_on(async {
        let call = call(address, tls(Some(&player), b"carom/1")).await.unwrap();
        let identity = call.connection.peer_identity().unwrap();
        identity.downcast::<Vec<CertificateDer<'static>>>().unwrap()
    });
    let written = fs::read_to_string(oak.join("node.pem")).unwrap();
    assert_eq!(seen[0], certificate(&written));
    assert_ne!(written, last_day.certificate_pem);
    assert_eq!(
        fs::read_to_string(oak.join("node.key")).unwrap(),
        last_day.key_pem
    );
    stop.stop();
    running.join().unwrap();
}

#[test]
fn certificates_of_nodes_live_thirty_days() {
    let (_dir, farm, _) = farm();
    let folder = AuthorityFolder::open(&farm, None).unwrap();
    let days = |role, name| {
        let out = folder.add(role, name, None, false).unwrap();
        let validity = Credentials::load(&out, role).unwrap().validity().unwrap();
        let life = validity.end.duration_since(validity.start).unwrap();
        life.as_secs() / (24 * 3600)
    };
    // And a day before they are issued.
    assert_eq!(days(Role::Node, "oak"), 31);
    assert_eq!(days(Role::Player, "bob"), 91);
}

#[test]
fn a_running_player_cuts_off_a_revoked_node() {
    let (_dir, farm, _) = farm();
    let folder = AuthorityFolder::open(&farm, None).unwrap();
    let oak = folder.add(Role::Node, "oak", None, false).unwrap();
    let node = Greeter::with_credentials(&Credentials::load(&oak, Role::Node).unwrap());
    let client = Client::new(&Credentials::load(&farm, Role::Player).unwrap()).unwrap();
    let (sender, events) = mpsc::channel();
    let address = node.address.to_string().parse().unwrap();
    let _link = client.link(address, PrecisionRange::EXACT, move |several| {
        let _ = several.into_iter().try_for_each(|event| sender.send(event));
    });
    let next = |wanted: fn(&LinkEvent) -> bool| {
        let mut events = std::iter::from_fn(|| events.recv_timeout(TIMEOUT).ok());
        events.find(wanted).expect("the event comes")
    };
    next(|event| matches!(event, LinkEvent::Session(ClientEvent::Welcome(_))));
    revoke(&farm, "oak").unwrap();
    // It is cut off, and refused when it is called again.
    for _ in 0..2 {
        let lost = next(|event| matches!(event, LinkEvent::Lost { .. }));
        let LinkEvent::Lost { why, .. } = lost else {
            unreachable!()
        };
        assert!(why.contains("its certificate has been revoked"), "{why}");
    }
}

#[test]
fn revoked_players_are_cut_off_and_refused() {
    let (_dir, farm, _) = farm();
    let folder = AuthorityFolder::open(&farm, None).unwrap();
    let oak = folder.add(Role::Node, "oak", None, false).unwrap();
    let node = Greeter::with_credentials(&Credentials::load(&oak, Role::Node).unwrap());
    let player = shown(&farm, "player");
    let why = block_on(async {
        let mut call = call(node.address, tls(Some(&player), b"carom/1"))
            .await
            .unwrap();
        call.send.write_all(&hello()).await.unwrap();
        call.receive.read_chunk(1, true).await.unwrap();
        revoke(&farm, FIRST_PLAYER).unwrap();
        fs::copy(farm.join("revoked.txt"), oak.join("revoked.txt")).unwrap();
        tokio::time::timeout(TIMEOUT, call.connection.closed())
            .await
            .unwrap()
    });
    let ConnectionError::ApplicationClosed(close) = &why else {
        panic!("{why:?}");
    };
    assert_eq!(close.error_code, VarInt::from_u32(5));
    let why = intrude(node.address, tls(Some(&player), b"carom/1"), &hello());
    let ConnectionError::ConnectionClosed(close) = &why else {
        panic!("{why:?}");
    };
    // certificate_revoked (RFC 8446, 6.2).
    assert_eq!(u64::from(close.error_code), 0x100 + 44);
    // Another person is not concerned.
    let bob = folder.add(Role::Player, "bob", None, false).unwrap();
    let config = tls(Some(&shown(&bob, "player")), b"carom/1");
    assert!(block_on(async { call(node.address, config).await.is_ok() }));
}
