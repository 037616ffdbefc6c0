"""Attacks on a player by what it takes for a node of its farm."""

import os
import select
import socket
import struct
import time

from aioquic.buffer import Buffer
from aioquic.quic import events
from aioquic.quic.configuration import QuicConfiguration
from aioquic.quic.connection import QuicConnection
from aioquic.quic.packet import QuicPacketType, pull_quic_header
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID
from quic_client import DAY, NODE_ROLE, PLAYER, Attack, varlen

CONNECTION_ID_BYTES = 8
# Variants of messages.
TO_NODE_SCENE, TO_NODE_TRACE = 1, 2
TILES = 3


class Session:
    """A player's connection to the rogue."""

    def __init__(self, connection, behaviour):
        self.quic, self.behaviour = connection, behaviour
        self.control, self.stream_bytes, self.closed = b"", 0, False
        self.traces, self.welcomed = [], False

    def step(self, count):
        while (event := self.quic.next_event()) is not None:
            if isinstance(event, events.StreamDataReceived):
                self.stream_bytes += len(event.data)
                self.control += event.data
                self.read(event.stream_id, count)
            elif isinstance(event, events.ConnectionTerminated):
                self.closed = True

    def read(self, stream, count):
        """Splits the control stream into messages, and answers them."""
        while len(self.control) >= 4:
            (length,) = struct.unpack("<I", self.control[:4])
            if len(self.control) < 4 + length:
                return
            message, self.control = self.control[4 : 4 + length], self.control[4 + length :]
            self.behaviour(self, stream, message, count)

    def send(self, stream, message):
        self.quic.send_stream_data(stream, struct.pack("<I", len(message)) + message)


def numbers(data, count):
    """The first varints of a message."""
    found, at = [], 1
    for _ in range(count):
        value, shift = 0, 0
        while True:
            byte, at = data[at], at + 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                break
        found.append(value)
    return found


def tiles(request, first, count, busy=1, pixels=b""):
    """A tile message that says what it likes."""
    fields = [request, first, count, busy, 1, 1, 1, 0, len(pixels)]
    return bytes([TILES]) + b"".join(varlen(field) for field in fields) + pixels


class NodeAttacks(Attack):
    def serve(self, shown, behaviours):
        """Answers each connection at the rogue's address with the next certificate and behaviour."""
        listening = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        listening.bind(self.rogue)
        listening.setblocking(False)
        by_address, made = {}, 0
        while not self.ends():
            select.select([listening], [], [], 0.002)
            now = time.monotonic()
            while True:
                try:
                    data, address = listening.recvfrom(65536)
                except OSError:
                    break
                header = pull_quic_header(Buffer(data=data), host_cid_length=CONNECTION_ID_BYTES)
                if address not in by_address and header.packet_type == QuicPacketType.INITIAL:
                    certificate, key = shown[made % len(shown)]
                    configuration = QuicConfiguration(
                        is_client=False, alpn_protocols=["carom/1"], max_datagram_frame_size=65536
                    )
                    configuration.certificate, configuration.private_key = certificate, key
                    connection = QuicConnection(
                        configuration=configuration, original_destination_connection_id=header.destination_cid
                    )
                    by_address[address] = Session(connection, behaviours[made % len(behaviours)])
                    made += 1
                    self.count("calls")
                if address in by_address:
                    by_address[address].quic.receive_datagram(data, address, now=now)
            for address, session in list(by_address.items()):
                due = session.quic.get_timer()
                if due is not None and due <= now:
                    session.quic.handle_timer(now)
                session.step(self.count)
                for data, _ in session.quic.datagrams_to_send(now=now):
                    try:
                        listening.sendto(data, address)
                    except OSError:
                        pass
                if session.closed:
                    self.count("bytes told", session.stream_bytes)
                    del by_address[address]
        for session in by_address.values():
            self.count("bytes told", session.stream_bytes)

    # 2: nodes that are none

    def wrong_nodes(self):
        """A node of another authority, a player, one whose certificate is over."""
        stranger = ec.generate_private_key(ec.SECP256R1())
        issue = self.issuer()
        server = {"roles": [NODE_ROLE], "use": ExtendedKeyUsageOID.SERVER_AUTH}
        shown = [
            issue(by=stranger, **server),
            self.mallory(),
            issue(starts=-3 * DAY, **server),
            issue(roles=[PLAYER], use=ExtendedKeyUsageOID.SERVER_AUTH),
            issue(roles=[], use=ExtendedKeyUsageOID.SERVER_AUTH),
        ]
        self.serve(shown, [lambda *_: None])

    # 9: a node of the farm that lies

    def rogue_nodes(self):
        """Silence, silence after the scene, answers to nobody, false tiles, text for terminals, half messages."""
        welcome = self.message("welcome")[4:]

        def friendly(session, stream, message, count):
            """As a node answers, until there is something to trace."""
            if not session.welcomed:
                session.welcomed = True
                session.send(stream, welcome)
            if message[0] == TO_NODE_SCENE:
                session.send(stream, bytes([1]) + message[1:33])
            if message[0] == TO_NODE_TRACE:
                count("requests taken")
                return numbers(message, 2)[1]
            return None

        def silent(session, stream, message, count):
            count("silent")

        def idle(session, stream, message, count):
            if friendly(session, stream, message, count) is not None:
                count("never traced")

        def unasked(session, stream, message, count):
            request = friendly(session, stream, message, count)
            if request is not None:
                self.tell(session, tiles(request + 999, 0, 1))
                count("unasked tiles")

        def forged(session, stream, message, count):
            request = friendly(session, stream, message, count)
            if request is not None:
                self.tell(session, tiles(request, 0, 1, pixels=os.urandom(500)))
                count("forged tiles")

        def countless(session, stream, message, count):
            request = friendly(session, stream, message, count)
            if request is not None:
                self.tell(session, tiles(request, 0, 0xFFFF_FFFF, busy=0))
                count("countless tiles")

        def shouting(session, stream, message, count):
            name = b"\x1b[2J\x1b]0;mine\x07" * 3
            session.send(stream, welcome[:2] + varlen(len(name)) + name + welcome[2:][1 + welcome[2] :])
            count("text for terminals")

        def boundless(session, stream, message, count):
            session.quic.send_stream_data(stream, struct.pack("<I", 0xFFFF_FFFF) + os.urandom(4096))
            count("boundless messages")

        behaviours = [unasked, forged, silent, countless, shouting, boundless, idle]
        self.serve([self.identity("nodes/birch", "node")], behaviours)

    @staticmethod
    def tell(session, message):
        """Sends a tile message on a stream of its own."""
        stream = session.quic.get_next_available_stream_id(is_unidirectional=True)
        session.quic.send_stream_data(stream, message, True)
