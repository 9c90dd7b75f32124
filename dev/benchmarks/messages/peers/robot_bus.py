"""robot-bus with its Python nodes: services, topics and actions, all with plain bytes."""

import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import robot_bus

from dev.benchmarks.messages.contestant import (
    COUNT,
    LISTENERS,
    OPEN,
    SOON,
    NotThere,
    body_of,
    run_open,
    shares,
    timed,
    until,
)
from dev.benchmarks.messages.images import ONE, THREE, Frame, Viewer
from dev.benchmarks.messages.processes import free_port
from dev.benchmarks.messages.publishing import Publishing


def node(name: str, port: int) -> Any:
    """Return a node. Raises NotThere while there is no broker."""
    try:
        return robot_bus.Node.discover(name, transport="tcp", api_url=f"http://127.0.0.1:{port}")
    except Exception as error:  # the library raises a plain Exception
        raise NotThere(f"no broker: {error}") from error


def serve(port: int) -> None:
    """Run a service, an action, and a topic that is counted."""
    server = node("server", port)
    server.create_service("/ping", lambda body: body)
    server.create_action_server("/move", lambda _: [("RESULT", b"")])
    _count(server, "/pose")
    server.start()
    threading.Event().wait()


def listen(port: int) -> None:
    """Run the nodes that receive a broadcast."""
    nodes = [node(f"listener {number}", port) for number in range(LISTENERS)]
    for one in nodes:
        _count(one, "/tick")
        one.start()
    threading.Event().wait()


def watch(port: int, topic: str, path: str) -> None:
    """Run a viewer."""
    one = node(f"viewer {path}", port)
    one.create_subscription(f"/{topic}", Viewer(path), qos_depth=100_000)
    one.start()
    threading.Event().wait()


def _count(one: Any, topic: str) -> None:
    count = 0
    counts = one.create_publisher("/counts")

    def receive(body: bytes) -> None:
        nonlocal count
        if body[:1] == COUNT:
            count += 1
        else:
            counts.publish(str(count).encode())
            count = 0

    one.create_subscription(topic, receive, qos_depth=100_000)


class RobotBus(Publishing):
    """Client, broker and server, over TCP."""

    pose, tick = "/pose", "/tick"

    def start(self) -> None:
        self.port = port = free_port()
        place = ("--api-listen", f"127.0.0.1:{port}", "--advertise-host", "127.0.0.1")
        self.broker = self.children.program(
            sys.executable, "-m", "robot_bus.broker", *place, "--snd-hwm", 0, "--rcv-hwm", 0
        )
        until(lambda: self._join(port))
        self.receiver = self.children.serve(serve, port)
        self.children.serve(listen, port)

    def _join(self, port: int) -> None:
        self.node = node("client", port)
        self.node.create_subscription("/counts", self.counts.put, qos_depth=100_000)
        names = self.pose, self.tick, f"/{ONE}", f"/{THREE}"
        self.publishers = {
            name: self.node.create_publisher(name, qos_depth=100_000) for name in names
        }
        self.services = [self.node.create_client("/ping") for _ in range(OPEN)]
        self.action = self.node.create_action_client("/move")
        self.threads = ThreadPoolExecutor(OPEN)
        self.node.start()

    def ready(self) -> None:
        if not self.services[0].wait_for_service(SOON) or not self.action.wait_for_action_server(
            SOON
        ):
            raise NotThere("our server is not connected yet")
        super().ready()

    def publisher(self, name: str) -> Any:
        return self.publishers[name].publish

    def round_trip(self, number: int, size: int) -> list[float]:
        body, service = body_of(size), self.services[0]
        return timed(number, lambda: service.call(body, SOON))

    def pipelined(self, number: int, slots: int) -> None:
        """Give each open call a thread and a client of its own: every call blocks."""
        del slots
        body = body_of(100)

        def calls(service: Any, share: int) -> None:
            for _ in range(share):
                service.call(body, SOON)

        list(self.threads.map(calls, self.services, shares(number)))

    def commands(self, number: int) -> list[float]:
        body = body_of(100)
        return timed(number, lambda: self.action.send_goal(body).result(SOON))

    def commands_open(self, number: int) -> None:
        body = body_of(100)
        run_open(number, lambda: partial(self.action.send_goal(body).result, SOON))

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, self.port, topic, path)

    def show(self, topic: str, frame: Frame) -> None:
        self.publishers[f"/{topic}"].publish(frame.tobytes())

    def stop(self) -> None:
        if hasattr(self, "node"):
            self.threads.shutdown(wait=False)
            self.node.shutdown()
        super().stop()
