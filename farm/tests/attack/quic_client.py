"""A QUIC client of the attacker's own making, and what all attacks share: the farm's certificates, messages that the
test has written, and counts."""

import datetime
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
from cryptography.hazmat.primitives.asymmetric import ec
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
        self.is_open, self.closed, self.first_flight, self.answer = False, None, [], b""
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
                self.answer = (self.answer + event.data)[-10_000:]
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


def varlen(value):
    """A number as postcard has it."""
    out = bytearray()
    while True:
        byte, value = value & 0x7F, value >> 7
        out.append(byte | (0x80 if value else 0))
        if not value:
            return bytes(out)


def address(text):
    host, port = text.rsplit(":", 1)
    return host, int(port)


class Attack:
    """What an attacker has: the farm's folder, and counts."""

    def __init__(self, node, rogue, folder):
        self.node, self.rogue = address(node), address(rogue)
        self.folder, self.counts = Path(folder), {}

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

    def identity(self, folder, role):
        """A certificate of the farm's, and its key."""
        path = self.folder / ".carom" / folder / role
        certificate = x509.load_pem_x509_certificate(path.with_suffix(".pem").read_bytes())
        key = serialization.load_pem_private_key(path.with_suffix(".key").read_bytes(), None)
        return certificate, key

    def mallory(self):
        return self.identity("players/mallory", "player")

    def insider(self, greets=True, **config):
        """A connection of mallory's that the node has taken, or None."""
        client = Client(self.node, self.mallory(), **config).open()
        if greets and client.is_open:
            client.send(self.message("hello"))
        # A node that has no place says so after the handshake, and one that has a place answers the greeting.
        client.run(3 if greets else 0.2, lambda client: client.closed or client.stream_bytes > 0)
        if client.closed or not client.is_open:
            outcome = "turned away"
        elif greets and not client.stream_bytes:
            outcome = "unanswered"
        else:
            outcome = "taken"
        self.count(outcome)
        if outcome == "taken":
            return client
        client.drop()
        return None

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
