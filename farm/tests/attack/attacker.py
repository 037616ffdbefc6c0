"""Attacks on a node and on its player, by a QUIC stack that shares no code with Carom's.

attacker.py ATTACK NODE ROGUE FOLDER    prints `attacking`, goes on until its standard input ends, and then prints
                                        one line of JSON: what it counted.

NODE is host:port; at ROGUE, host:port too, the player believes another node to be. FOLDER holds what the test has put
there: `.carom` with the farm, whose player mallory the attacker is, and messages as files (hello, scene, trace, ...),
each with its length before it.
"""

import json
import os
import random
import socket
import struct
import sys
import time

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec, rsa
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from quic_client import DAY, NODE_ROLE, PLAYER, Attack, Client, address, varint, varlen
from rogue_node import NodeAttacks


# Half of what a link of a gigabit a second carries.
FLOOD_PACKETS_PER_SEC = 50_000


class PlayerAttacks(Attack):
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
        identifiers = os.urandom(1 << 16)
        while not self.ends():
            # Not as fast as it can: on a machine of two cores its own work would be what disturbs the player.
            early = begun + packets / FLOOD_PACKETS_PER_SEC - time.monotonic()
            if early > 0.0:
                time.sleep(early)
            for at, data in enumerate(flights):
                # Other connection identifiers each time: nothing of an earlier one is met again.
                place = packets * 8 % len(identifiers)
                fresh = data[:6] + identifiers[place : place + 8] + data[14:]
                try:
                    sent += sockets[at].sendto(fresh if packets % 2 else data, self.node)
                except OSError:
                    pass
                packets += 1
                try:
                    received += len(sockets[at].recv(65536))
                except OSError:
                    pass
            identifiers = os.urandom(1 << 16)
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
            for _ in range(50):
                number += 1
                client.send(renumbered(request, number))
            self.count("requests", 50)
            client.step()
            time.sleep(0.01)

    def scenes(self):
        """A scene of 20 MB in chunks, and then the few bytes that it takes when its chunks are there, again and again."""
        whole, again = self.message("long-scene"), self.message("long-scene-again")
        client, block = None, 1 << 16
        while not self.ends():
            if client is None or client.closed:
                client = self.insider()
                if client is None:
                    time.sleep(0.2)
                    continue
            for start in range(0, len(whole), block):
                client.send(whole[start : start + block])
                client.run(0.004)
                if client.closed:  # it has come before
                    break
            if not whole:
                client.send(again)
            whole = b""
            self.count("scenes")
            client.run(0.05)

    # 7: few bytes that become many

    def textures(self):
        """Scenes whose small pictures are large when they are decoded, each another."""
        scenes = sorted(self.folder.glob("bomb-*"))
        client, turn = None, 0
        while not self.ends():
            if client is None or client.closed:
                client = self.insider()
                if client is None:
                    time.sleep(0.2)
                    continue
            scene, trace = scenes[turn % len(scenes)], self.message(f"trace-{scenes[turn % len(scenes)].name}")
            client.send(scene.read_bytes() + renumbered(trace, turn))
            turn += 1
            self.count("scenes")
            client.run(0.25)

    # 10: tokens

    def guesses(self):
        """Guesses of a token's secret, each on a connection of its own."""
        service = address(self.message("enrolment").decode())
        key = ec.generate_private_key(ec.SECP256R1())
        names = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "guesser")])
        request = x509.CertificateSigningRequestBuilder().subject_name(names).sign(key, hashes.SHA256())
        request_pem = request.public_bytes(serialization.Encoding.PEM).decode()
        host = 0
        while not self.ends():
            host = host % 250 + 1
            client = Client(service, alpn="carom-join/1", source=f"127.0.6.{host}").open()
            if client.is_open:
                guess = {"secret": os.urandom(16).hex(), "name": f"guess-{host}", "request_pem": request_pem}
                client.send(json.dumps({"Join": guess}).encode(), end=True)
                client.run(1, lambda client: client.closed or client.answer)
                self.count("admitted" if b"Certified" in client.answer else "guesses")
            client.drop()

    # 13: arbitrary bytes

    def noise(self):
        """What a player says with some of its bytes changed, and bytes that nobody says."""
        hello, scene, trace = (self.message(name) for name in ("hello", "scene", "trace"))
        turn = 0
        while not self.ends():
            client = self.insider(greets=False)
            if not client:
                continue
            words = bytearray(random.choice([hello, hello + scene, hello + scene + trace, hello + os.urandom(300)]))
            # The first one is sure to break a rule, however few there is time for.
            for _ in range(random.choice([0, 1, 3, 30]) if turn else 300):
                words[random.randrange(len(words))] = random.randrange(256)
            client.send(bytes(words))
            for _ in range(20):
                client.quic.send_datagram_frame(os.urandom(random.randrange(1, 1000)))
            client.run(0.5 if turn else 2, lambda client: client.closed)
            self.count("closed" if client.closed else "borne")
            client.drop()
            turn += 1

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


def renumbered(request, number):
    """A request with another number, which must rise: it is the byte behind length, kind and frame."""
    message = request[4:6] + varlen(number) + request[7:]
    return struct.pack("<I", len(message)) + message


class Attacks(PlayerAttacks, NodeAttacks):
    """All attacks by their names."""


# Length, variant and hash.
SCENE_READY_BYTES = 4 + 1 + 32

if __name__ == "__main__":
    os.nice(19)  # it is the node that is attacked, not the machine's other processes
    attack = Attacks(sys.argv[2], sys.argv[3], sys.argv[4])
    getattr(attack, sys.argv[1])()
    attack.counts.pop("announced", None)
    print(json.dumps(attack.counts), flush=True)
