"""Attacks on a node, by a QUIC stack that shares no code with Carom's.

attacker.py ATTACK NODE FOLDER    prints `attacking`, goes on until its standard input ends, and then prints
                                  one line of JSON: what it counted.

NODE is host:port; FOLDER holds what the test has put there: `.carom` with the farm, whose player mallory
the attacker is, and messages as files (hello, scene, trace, ...), each with its length before it.
"""

import datetime
import json
import os
import select
import socket
import struct
import sys
import time
from pathlib import Path

from aioquic.quic import connection as quic
from aioquic.quic import events
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.packet import QuicFrameType
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

PLAYER, NODE_ROLE = "carom://role/player", "carom://role/node"
DAY = datetime.timedelta(days=1)


class ShapedConnection(quic.QuicConnection):
    """A connection that sends bytes of the attacker's choice as frames, behind PINGs."""

    raw: list = []

    def _write_ping_frame(self, builder, uids=[], comment=""):
        raw = self.raw[0] if self.raw else b""
        frame = builder.start_frame(QuicFrameType.PING, capacity=1 + len(raw))
        frame.push_bytes(raw)
        del self.raw[:1]


quic.CRYPTO_BUFFER_SIZE = 1 << 20  # for certificates of any size


class Client:
    """One connection over a socket of its own."""

    def __init__(self, node, shown=None, alpn="carom/1", source="127.0.0.1", token=b"", parameters=None, **config):
        configuration = QuicConfiguration(
            is_client=True, alpn_protocols=[alpn], verify_mode=0, token=token, max_datagram_frame_size=65536, **config
        )
        if shown:
            configuration.certificate, configuration.private_key = shown[0], shown[1]
            configuration.certificate_chain = list(shown[2:])
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind((source, 0))
        self.socket.setblocking(False)
        self.node, self.quic = node, ShapedConnection(configuration=configuration)
        self.quic.raw = []
        if parameters is not None:
            self.quic._serialize_transport_parameters = lambda: parameters
        self.sent = self.received = self.stream_bytes = 0
        self.is_open, self.closed, self.first_flight = False, None, []
        self.quic.connect(node, now=time.monotonic())
        self.flush()

    def flush(self):
        for data, _ in self.quic.datagrams_to_send(now=time.monotonic()):
            if len(self.first_flight) < 4:
                self.first_flight.append(data)
            try:
                self.sent += self.socket.sendto(data, self.node)
            except OSError:
                pass

    def step(self):
        """Takes what has come, and sends what is due."""
        now = time.monotonic()
        while True:
            try:
                data = self.socket.recv(65536)
            except OSError:
                break
            self.received += len(data)
            self.quic.receive_datagram(data, self.node, now=now)
        due = self.quic.get_timer()
        if due is not None and due <= now:
            self.quic.handle_timer(now)
        while (event := self.quic.next_event()) is not None:
            if isinstance(event, events.HandshakeCompleted):
                self.is_open = True
            elif isinstance(event, events.ConnectionTerminated):
                self.closed = event
            elif isinstance(event, events.StreamDataReceived):
                self.stream_bytes += len(event.data)
        self.flush()

    def run(self, secs, until=lambda client: client.closed):
        """Goes on for so many seconds, or until something is so."""
        end = time.monotonic() + secs
        while time.monotonic() < end and not until(self):
            select.select([self.socket], [], [], 0.005)
            self.step()
        return self

    def open(self):
        self.run(3, lambda client: client.is_open or client.closed)
        return self

    def send(self, data, stream=0, end=False):
        self.quic.send_stream_data(stream, data, end)
        self.flush()

    def frames(self, *raw):
        """Sends frames as they are, a packet each."""
        self.quic.raw.extend(raw)
        end = time.monotonic() + 2
        while self.quic.raw and not self.closed and time.monotonic() < end:
            self.quic.send_ping(1)
            self.flush()
            if self.quic.raw:  # the window is full
                self.run(0.002, lambda client: False)

    def drop(self):
        self.socket.close()


def varint(value):
    if value < 64:
        return bytes([value])
    if value < 1 << 14:
        return struct.pack(">H", value | 0x4000)
    if value < 1 << 30:
        return struct.pack(">I", value | 0x8000_0000)
    return struct.pack(">Q", value | 0xC000_0000_0000_0000)


class Attack:
    def __init__(self, node, folder):
        host, port = node.rsplit(":", 1)
        self.node, self.folder, self.counts = (host, int(port)), Path(folder), {}

    def count(self, what, by=1):
        self.counts[what] = self.counts.get(what, 0) + by

    def ends(self):
        """Whether the test has had enough. The first time it says that the attack is on, which goes through
        all that it has at least once."""
        if not self.counts.get("announced"):
            self.counts["announced"] = 1
            print("attacking", flush=True)
            return False
        return bool(select.select([sys.stdin], [], [], 0)[0])

    def message(self, name):
        return (self.folder / name).read_bytes()

    def mallory(self):
        folder = self.folder / ".carom/players/mallory"
        certificate = x509.load_pem_x509_certificate((folder / "player.pem").read_bytes())
        key = serialization.load_pem_private_key((folder / "player.key").read_bytes(), None)
        return certificate, key

    def insider(self, greets=True, **config):
        """A connection of mallory's that the node has taken, or None."""
        client = Client(self.node, self.mallory(), **config).open()
        if greets and client.is_open:
            client.send(self.message("hello"))
        # A node that has no place says so after the handshake.
        client.run(0.2, lambda client: client.closed or client.stream_bytes > 0)
        if client.closed or not client.is_open:
            self.count("turned away")
            client.drop()
            return None
        self.count("taken")
        return client

    def issuer(self):
        """Issues certificates as the farm's authority would, or would not."""
        authority = x509.load_pem_x509_certificate((self.folder / ".carom/ca.pem").read_bytes())
        issuer = serialization.load_pem_private_key((self.folder / ".carom/ca.key").read_bytes(), None)
        now = datetime.datetime.now(datetime.timezone.utc)

        def issue(by=issuer, key=None, roles=(PLAYER,), starts=-DAY, days=2 * DAY, use=ExtendedKeyUsageOID.CLIENT_AUTH, name="mallory"):
            key = key or ec.generate_private_key(ec.SECP256R1())
            names = [x509.UniformResourceIdentifier(role) for role in roles] or [x509.DNSName("mallory")]
            builder = (
                x509.CertificateBuilder()
                .subject_name(x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)]))
                .issuer_name(authority.subject)
                .public_key(key.public_key())
                .serial_number(x509.random_serial_number())
                .not_valid_before(now + starts)
                .not_valid_after(now + starts + days)
                .add_extension(x509.SubjectAlternativeName(names), critical=False)
                .add_extension(x509.ExtendedKeyUsage([use]), critical=False)
            )
            hashed = hashes.SHA256() if isinstance(by, ec.EllipticCurvePrivateKey) else None
            return builder.sign(by, hashed), key

        return issue

    # 1: certificates

    def certificates(self):
        stranger = ec.generate_private_key(ec.SECP256R1())
        issue = self.issuer()
        shown = issue()
        cases = {
            "good": shown,
            "none": None,
            "of another authority of the same name": issue(by=stranger),
            "signed by a player": issue(by=shown[1]),
            "expired": issue(starts=-3 * DAY),
            "not yet valid": issue(starts=DAY),
            "a node's": issue(roles=[NODE_ROLE], use=ExtendedKeyUsageOID.SERVER_AUTH),
            "of both roles": issue(roles=[PLAYER, NODE_ROLE]),
            "of no role": issue(roles=[]),
            "for servers": issue(use=ExtendedKeyUsageOID.SERVER_AUTH),
            "RSA of 1024 bits": issue(key=rsa.generate_private_key(65537, 1024)),
            "behind a chain of 200": issue(by=stranger) + tuple(issue(by=stranger)[0] for _ in range(200)),
            "with a name of 20 kB": issue(by=stranger, name="m" * 64, roles=[PLAYER + "x" * 20_000]),
        }
        seen = {}
        while not self.ends():
            for case, certificate in cases.items():
                client = Client(self.node, certificate).open()
                if client.is_open and not client.closed:
                    client.send(self.message("hello"))
                    client.run(1.0, lambda client: client.closed or client.stream_bytes > 0)
                is_heard = client.stream_bytes > 0
                seen[case] = seen.get(case, False) or is_heard
                if is_heard:
                    client.quic.close()
                    client.run(0.1)
                client.drop()
        self.counts["heard"] = sorted(case for case, is_heard in seen.items() if is_heard)

    # 3: replays and tokens

    def replays(self):
        victim = Client(self.node, self.mallory()).open()
        flight = victim.first_flight
        assert victim.is_open
        victim.send(self.message("hello"))
        victim.run(0.2)
        # So many handshakes are left half that the node asks for proofs of addresses, one of which is stolen.
        half = [Client(self.node, source=f"127.0.1.{host}") for host in range(1, 33)]
        end = time.monotonic() + 2
        token = b""
        while not token and time.monotonic() < end:
            for client in half:
                client.step()
                token = token or client.quic._peer_token
            half.append(Client(self.node, source=f"127.0.2.{len(half) % 250 + 1}"))
        self.counts["token stolen"] = int(bool(token))
        replayer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        replayer.bind(("127.0.3.1", 0))
        replayer.setblocking(False)
        sent = received = 0
        while not self.ends():
            for data in flight:
                sent += replayer.sendto(data, self.node)
            try:
                while True:
                    received += len(replayer.recv(65536))
            except OSError:
                pass
            for stolen in (token, os.urandom(len(token) or 64)):
                client = Client(self.node, source="127.0.4.9", token=stolen)
                client.run(0.01)
                self.count("bytes sent", client.sent)
                self.count("bytes received", client.received)
                client.drop()
            time.sleep(0.01)
        self.count("bytes sent", sent)
        self.count("bytes received", received)
        for client in half + [victim]:
            client.drop()

    # 4: a flood from addresses that answer nothing

    def flood(self):
        sockets, flights = [], []
        for host in range(1, 201):
            client = Client(self.node, source=f"127.1.{host}.{host}")
            flights.append(client.first_flight[0])
            client.socket.setblocking(False)
            sockets.append(client.socket)
        begun, sent, received, packets = time.monotonic(), 0, 0, 0
        while not self.ends():
            for at, data in enumerate(flights):
                # Other connection identifiers each time: nothing of an earlier one is met again.
                fresh = data[:6] + os.urandom(8) + data[14:]
                try:
                    sent += sockets[at].sendto(fresh if packets % 2 else data, self.node)
                except OSError:
                    pass
                packets += 1
                try:
                    received += len(sockets[at].recv(65536))
                except OSError:
                    pass
            time.sleep(max(0.0, packets / FLOOD_PACKETS_PER_SEC - (time.monotonic() - begun)))
        self.counts["packets a second"] = int(packets / (time.monotonic() - begun))
        self.counts["bytes sent"], self.counts["bytes received"] = sent, received

    # 5: slow and silent peers

    def slow(self):
        """Handshakes left half, streams of a byte a second, players that only ping, and tiles that nobody
        takes."""
        half, insiders, last = [], [], 0.0
        greeting = self.message("hello")
        while not self.ends():
            now = time.monotonic()
            if now - last > 0.05:
                last = now
                half.append(Client(self.node))
                if len(half) > 200:
                    half.pop(0).drop()
                for client in half[-3:]:
                    client.step()
                insiders = [client for client in insiders if not client.closed]
                if len(insiders) < 3:
                    kind = len(insiders)
                    client = self.insider(greets=kind == 2, max_data=1 << 14 if kind == 2 else 1 << 20)
                    if client:
                        if kind == 2:
                            client.send(self.message("scene") + self.message("trace"))
                        client.at = 0
                        insiders.append(client)
                for client in insiders:
                    client.frames(b"")
            for client in insiders:
                if client.at < len(greeting) and time.monotonic() - last > 0.04:
                    client.send(greeting[client.at : client.at + 1])
                    client.at += 1
                client.step()
                if client.closed:
                    self.count("cut off")
            time.sleep(0.005)

    # 6: frames that are legal one by one

    def frames(self):
        """Gaps of a byte, churn of connection identifiers, floods of challenges and limits, and transport
        parameters that are not allowed."""
        floods = {
            "gaps": lambda at: b"\x0e" + varint(0) + varint(20_000 + 2 * at) + varint(1) + b"x",
            "identifiers": lambda at: b"\x18" + varint(at + 8) + varint(at + 4) + b"\x08" + os.urandom(8) + os.urandom(16),
            "retired": lambda at: b"\x19" + varint(at % 3),
            "challenges": lambda at: b"\x1a" + os.urandom(8),
            "limits": lambda at: b"\x12" + varint(at) + b"\x13" + varint(at) + b"\x10" + varint(1 << 40),
            "tokens": lambda at: b"\x07" + varint(500) + os.urandom(500),
            "resets": lambda at: b"\x04" + varint(4 * at) + varint(0) + varint(0),
            "unknown": lambda at: varint(0x1F00 + at),
        }
        parameters = [varint(0x0A) + varint(1) + varint(60), varint(0x03) + varint(1) + varint(1), b"\xff" * 50, b""]
        while not self.ends():
            for name, frame in floods.items():
                client = self.insider()
                if not client:
                    continue
                at = 0
                while at < 4_000 and not client.closed:
                    packet = b""
                    while len(packet) < 500:
                        packet += frame(at)
                        at += 1
                    client.frames(packet)
                    client.step()
                client.run(0.3)
                self.count(f"{name}: " + ("closed" if client.closed else "borne"))
                client.quic.close()
                client.run(0.02)
                client.drop()
            for data in parameters:
                client = Client(self.node, self.mallory(), parameters=data).open()
                self.count("parameters: " + ("taken" if client.is_open and not client.closed else "refused"))
                client.drop()

    # 8: lengths and messages

    def messages(self):
        """Lengths that are not there, kinds that do not exist, greetings twice: each must close its own
        connection."""
        hello = self.message("hello")
        words = {
            "length 0": struct.pack("<I", 0),
            "length of 4 GB": struct.pack("<I", 0xFFFF_FFFF),
            "length below 0": struct.pack("<i", -1),
            "unknown kind": struct.pack("<I", 3) + b"\x7f\x00\x00",
            "cut short": struct.pack("<I", 1) + b"\x00",
            "bytes behind": struct.pack("<I", 9) + hello[4:] + b"\x00" * (9 - len(hello[4:])),
            "greeting twice": hello + hello,
            "trace of nothing": hello + struct.pack("<I", 60) + b"\x02" + b"\x00" * 59,
        }
        while not self.ends():
            for name, data in words.items():
                client = self.insider(greets=False)
                if not client:
                    continue
                client.send(data)
                client.run(2)
                self.count("closed" if client.closed else f"borne: {name}")
                client.drop()

    # 8: what is legal and costs much

    def requests(self):
        """Requests of an unknown scene, as fast as they go."""
        request, number = self.message("unknown-trace"), 0
        client = None
        while not self.ends():
            if client is None or client.closed:
                client = self.insider()
                if client is None:
                    time.sleep(0.2)
                    continue
            # The request's number is the byte behind length, kind and frame: it must rise.
            for _ in range(50):
                number += 1
                fresh = request[:6] + varlen(number) + request[7:]
                fresh = struct.pack("<I", len(fresh) - 4) + fresh[4:]
                client.send(fresh)
            self.count("requests", 50)
            client.step()
            time.sleep(0.01)

    def scenes(self):
        """Scenes of 24 MB that are none."""
        junk = struct.pack("<I", 24 << 20) + b"\x01" + os.urandom(32)
        block = os.urandom(1 << 16)
        while not self.ends():
            client = self.insider()
            if not client:
                time.sleep(0.2)
                continue
            client.send(junk)
            for _ in range((24 << 20) // len(block)):
                client.send(block)
                client.run(0.004)
                self.count("bytes", len(block))
                if client.closed:
                    break
            client.run(3)
            self.count("closed" if client.closed else "borne")
            client.drop()

    # 12: more connections than there is room for

    def connections(self):
        """Connections of one player without end, each left as it is."""
        open_ones = []
        while not self.ends():
            client = self.insider()
            if client:
                open_ones.append(client)
            for client in open_ones:
                client.step()
            open_ones = [client for client in open_ones if not client.closed]
            self.counts["most at once"] = max(self.counts.get("most at once", 0), len(open_ones))

    def crowd(self):
        """A hundred players with a scene each time, who watch."""
        issue, players = self.issuer(), []
        for _ in range(100):
            client = Client(self.node, issue()).open()
            if client.is_open:
                client.send(self.message("hello"))
                client.run(0.5, lambda client: client.closed or client.stream_bytes > 0)
            # The greeting is as long as the device's name; its answer to the scene is the hash.
            all_bytes = client.stream_bytes + SCENE_READY_BYTES
            if client.stream_bytes > 0:
                client.send(self.message("scene"))
                client.run(0.5, lambda client: client.closed or client.stream_bytes >= all_bytes)
            self.count("served" if client.stream_bytes >= all_bytes and not client.closed else "turned away")
            players.append(client)
        while not self.ends():
            for client in players:
                client.frames(b"")
                client.step()
            time.sleep(0.2)

    def nobody(self):
        """No attack: what the machine's own noise does."""
        while not self.ends():
            time.sleep(0.01)


def varlen(value):
    """A number as postcard has it."""
    out = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        out.append(byte | (0x80 if value else 0))
        if not value:
            return bytes(out)


FLOOD_PACKETS_PER_SEC = 3_000
# Length, variant and hash.
SCENE_READY_BYTES = 4 + 1 + 32

if __name__ == "__main__":
    os.nice(19)  # it is the node that is attacked, not the machine's other processes
    attack = Attack(sys.argv[2], sys.argv[3])
    getattr(attack, sys.argv[1])()
    attack.counts.pop("announced", None)
    print(json.dumps(attack.counts), flush=True)
