"""A client with pyzmq and msgpack only: it sends a command, then answers a query."""

import os
import secrets
from typing import Any

import msgpack
import zmq

from tca_module import Command, Module, Query  # only for the other side, at the end

HELLO, REGISTER, UNREGISTER, SEND, REPLY, AWAIT_POINT, BYE = 1, 2, 3, 4, 5, 8, 12
WELCOME, ACCEPTED, ANSWER, DELIVER, BEAT, UNKNOWN = 33, 34, 36, 37, 39, 40
NUMBER, NOTHING = '{"type":"number"}', '{"type":"null"}'
MOVE, LIMIT = ["move", "command", NUMBER, NUMBER], ["limit", "query", NOTHING, NUMBER]
END_ACHIEVING, RUN = 32, secrets.token_hex(16)
RUNTIME = os.environ.get("XDG_RUNTIME_DIR")
FOLDER = f"{RUNTIME}/tca" if RUNTIME else f"/tmp/tca-{os.getuid()}"


class Connection:
    def __init__(self, number: int, resource: str = "") -> None:
        self.socket: zmq.Socket[bytes] = zmq.Context.instance().socket(zmq.DEALER)
        self.socket.setsockopt(zmq.IMMEDIATE, 1)
        self.socket.setsockopt(zmq.PROBE_ROUTER, 1)
        self.socket.connect(os.environ.get("TCA_CENTRAL", f"ipc://{FOLDER}/central.sock"))
        self.requests, self.packet = 0, b""
        self.request(WELCOME, HELLO, 8, "raw", RUN, number, resource)

    def send(self, *header: Any, body: bytes = b"") -> None:
        packed = msgpack.packb(header)
        self.socket.send(len(packed).to_bytes(4) + len(body).to_bytes(4) + packed + body)

    def request(self, answer: int, kind: int, *fields: Any, body: bytes = b"") -> Any:
        self.requests += 1
        self.send(kind, self.requests, *fields, body=body)
        return self.receive(answer) if answer else None

    def receive(self, expected: int) -> tuple[list[Any], bytes]:
        while True:
            packet = self.packet or self.socket.recv()  # a packet may have several items
            start = 8 + int.from_bytes(packet[:4])
            end = start + int.from_bytes(packet[4:8])
            header, body, self.packet = packet[8:start], packet[start:end], packet[end:]
            fields = msgpack.unpackb(header)
            if fields[0] == expected:
                return fields, body
            assert fields[0] in (BEAT, UNKNOWN), fields


def talk() -> None:
    client, slot = Connection(0), Connection(1, "eyes")
    client.request(ACCEPTED, REGISTER, [MOVE, LIMIT], [["limit", "eyes"]])
    (_, _, task), _ = client.request(ACCEPTED, SEND, "move", body=msgpack.packb(1.5))
    client.request(0, AWAIT_POINT, [task, END_ACHIEVING], 0, True)
    (_, delivery, message, *_), _ = slot.receive(DELIVER)
    print("asked for the", message)
    slot.send(REPLY, delivery, body=msgpack.packb(0.8))
    (_, _, outcome, *_), body = client.receive(ANSWER)
    print(f"move {{{task}}}: {outcome}, {msgpack.unpackb(body)} m")
    client.request(ACCEPTED, UNREGISTER, [])
    slot.send(BYE)
    client.send(BYE)


if __name__ == "__main__":  # the other side, with the library
    legs, move = Module("legs"), Command("move", float, result=float)
    legs.handles(move)(lambda task, m: min(m, task.query(Query("limit", reply=float))))
    with legs.running():
        talk()
