"""Mosquitto with paho: the fastest quality of service, 0; each client has a thread of paho."""

import getpass
import threading
from functools import partial
from typing import Any

from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

from dev.benchmarks.messages.contestant import (
    COUNT,
    ECHO,
    LISTENERS,
    OPEN,
    NotThere,
    body_of,
    timed,
    until,
)
from dev.benchmarks.messages.images import Frame, Viewer
from dev.benchmarks.messages.processes import program_path
from dev.benchmarks.messages.publishing import Publishing

CONFIGURATION = """
listener 0 {path}
allow_anonymous true
persistence false
max_queued_messages 0
max_queued_bytes 0
user {user}
"""


def joined(path: str, topic: str, handle: Any, *, own_thread: bool = True) -> Client:
    """Return a client that subscribes to a topic."""
    client = Client(CallbackAPIVersion.VERSION2, transport="unix")
    client.on_message = handle
    client.on_connect = lambda *_: client.subscribe(topic)
    try:
        client.connect(path)
    except OSError as error:
        raise NotThere("mosquitto does not answer") from error
    if own_thread:
        client.loop_start()
    return client


def _handler(answers: str) -> Any:
    count = 0

    def handle(client: Client, _: Any, message: Any) -> None:
        nonlocal count
        kind = message.payload[:1]
        if kind == COUNT:
            count += 1
            return
        client.publish(answers, message.payload if kind == ECHO else str(count))
        count = 0

    return handle


def serve(path: str) -> None:
    """Run the server."""
    joined(path, "pose", _handler("replies"), own_thread=False).loop_forever()


def listen(path: str) -> None:
    """Run the clients that receive a broadcast."""
    ears = [joined(path, "tick", _handler("replies")) for _ in range(LISTENERS)]
    threading.Event().wait()
    del ears


def watch(path: str, topic: str, notes: str) -> None:
    """Run a viewer."""
    viewer = Viewer(notes)
    line = joined(path, topic, lambda _, __, one: viewer(one.payload), own_thread=False)
    line.loop_forever()


class Mosquitto(Publishing):
    """Client, broker, and a server that sends back messages under *pose*, or counts them."""

    def start(self) -> None:
        self.path = path = f"{self.folder}/mosquitto.sock"
        configuration = self.folder / "mosquitto.conf"
        configuration.write_text(CONFIGURATION.format(path=path, user=getpass.getuser()))
        self.broker = self.children.program(program_path("mosquitto"), "-c", configuration)
        until(lambda: self._connect(path))
        self.receiver = self.children.serve(serve, path)
        self.children.serve(listen, path)

    def _connect(self, path: str) -> None:
        self.line = joined(path, "replies", lambda _, __, message: self.counts.put(message.payload))

    def publisher(self, name: str) -> Any:
        return partial(self.line.publish, name)

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, self.path, topic, path)

    def show(self, topic: str, frame: Frame) -> None:
        self.line.publish(topic, frame.tobytes())

    def round_trip(self, number: int, size: int) -> list[float]:
        body = body_of(size)

        def exchange() -> None:
            self.line.publish("pose", body)
            self.counts.get()

        return timed(number, exchange)

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        body = body_of(100)
        for one in range(number):
            if one >= OPEN:
                self.counts.get()
            self.line.publish("pose", body)
        for _ in range(min(number, OPEN)):
            self.counts.get()
