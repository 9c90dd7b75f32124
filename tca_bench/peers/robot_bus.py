"""robot-bus with its Python nodes: services, topics and actions, all with plain bytes."""

import queue
import sys
import threading
from collections import deque
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import robot_bus

from tca_bench.contestant import (
    COUNT,
    LISTENERS,
    MARK,
    OPEN,
    SOON,
    Contestant,
    NotThere,
    body_of,
    check_arrived,
    timed,
    until,
)
from tca_bench.processes import free_port

WITHIN = 20.0


def node(name: str, port: int) -> Any:
    """A node. Raises NotThere as long as there is no broker."""
    try:
        return robot_bus.Node.discover(name, transport="tcp", api_url=f"http://127.0.0.1:{port}")
    except Exception as error:  # it has no class of its own
        raise NotThere(f"no broker: {error}") from error


def serve(port: int) -> None:
    """A service, an action, and a topic that is counted."""
    server = node("server", port)
    server.create_service("/ping", lambda body: body)
    server.create_action_server("/move", lambda _: [("RESULT", b"")])
    _count(server, "/pose")
    server.start()
    threading.Event().wait()


def listen(port: int) -> None:
    """The nodes that hear a broadcast."""
    nodes = [node(f"listener {number}", port) for number in range(LISTENERS)]
    for one in nodes:
        _count(one, "/tick")
        one.start()
    threading.Event().wait()


def _count(one: Any, topic: str) -> None:
    count = 0
    told = one.create_publisher("/told")

    def hear(body: bytes) -> None:
        nonlocal count
        if body[:1] == COUNT:
            count += 1
        else:
            told.publish(str(count).encode())
            count = 0

    one.create_subscription(topic, hear, qos_depth=100_000)


class RobotBus(Contestant):
    """Client, broker, server; over TCP."""

    def start(self) -> None:
        port = free_port()
        place = ("--api-listen", f"127.0.0.1:{port}", "--advertise-host", "127.0.0.1")
        self.children.program(sys.executable, "-m", "robot_bus.broker", *place, "--snd-hwm", 0, "--rcv-hwm", 0)
        until(lambda: self._join(port))
        self.children.serve(serve, port)
        self.children.serve(listen, port)

    def _join(self, port: int) -> None:
        self.node = node("client", port)
        self.told = queue.SimpleQueue[bytes]()
        self.node.create_subscription("/told", self.told.put, qos_depth=100_000)
        self.topics = {key: self.node.create_publisher(key, qos_depth=100_000) for key in ("/pose", "/tick")}
        self.services = [self.node.create_client("/ping") for _ in range(OPEN)]
        self.action = self.node.create_action_client("/move")
        self.threads = ThreadPoolExecutor(OPEN)
        self.node.start()

    def ready(self) -> None:
        if not self.services[0].wait_for_service(SOON) or not self.action.wait_for_action_server(SOON):
            raise NotThere("our server is not connected yet")
        until(lambda: self._check_heard("/pose", 1))
        until(lambda: self._check_heard("/tick", LISTENERS))

    def _check_heard(self, topic: str, ears: int) -> None:
        self.topics[topic].publish(MARK)
        try:
            for _ in range(ears):
                self.told.get(timeout=0.3)
        except queue.Empty as error:
            raise NotThere("not all are connected yet") from error

    def round_trip(self, number: int, size: int) -> list[float]:
        body, service = body_of(size), self.services[0]
        return timed(number, lambda: service.call(body, WITHIN))

    def pipelined(self, number: int, slots: int) -> None:
        """It has no call that does not wait: so each has a thread and a client of its own."""
        del slots
        body = body_of(100)
        parts = [number // OPEN + (one < number % OPEN) for one in range(OPEN)]

        def calls(service: Any, part: int) -> None:
            for _ in range(part):
                service.call(body, WITHIN)

        list(self.threads.map(calls, self.services, parts))

    def oneway(self, number: int) -> None:
        self._flood("/pose", number, 1)

    def fanout(self, number: int) -> None:
        self._flood("/tick", number, LISTENERS)

    def _flood(self, topic: str, number: int, ears: int) -> None:
        body, publisher = body_of(100, COUNT), self.topics[topic]
        for _ in range(number):
            publisher.publish(body)
        publisher.publish(MARK)
        check_arrived(number, *(int(self.told.get(timeout=WITHIN)) for _ in range(ears)))

    def commands(self, number: int) -> list[float]:
        body = body_of(100)
        return timed(number, lambda: self.action.send_goal(body).result(WITHIN))

    def commands_open(self, number: int) -> None:
        body = body_of(100)
        pending: deque[Any] = deque()
        for _ in range(number):
            if len(pending) == OPEN:
                pending.popleft().result(WITHIN)
            pending.append(self.action.send_goal(body))
        for goal in pending:
            goal.result(WITHIN)

    def stop(self) -> None:
        if hasattr(self, "node"):
            self.threads.shutdown(wait=False)
            self.node.shutdown()
        super().stop()
