"""Redis with redis-py: lists for single messages, in blocks where many wait; pub/sub for
broadcasts.
"""

import threading
from itertools import islice
from pathlib import Path
from typing import Any

import redis

from dev.benchmarks.messages.contestant import (
    COUNT,
    ECHO,
    LISTENERS,
    MARK,
    OPEN,
    NotThere,
    body_of,
    check_arrived,
    timed,
    until,
)
from dev.benchmarks.messages.images import Frame, Showing, Viewer
from dev.benchmarks.messages.processes import Children, program_path

FOREVER = 0


def start_redis(children: Children, folder: Path) -> tuple[int, str]:
    """Start a server that stores nothing on disk; return its process and its socket."""
    path = f"{folder}/redis.sock"
    where = ("--port", 0, "--unixsocket", path, "--dir", folder)
    no_disk = ("--save", "", "--appendonly", "no")
    no_limit = ("--client-output-buffer-limit", "pubsub 0 0 0")
    process = children.program(program_path("redis-server"), *where, *no_disk, *no_limit)
    line = connected(path)
    until(lambda: _check_there(line))
    return process, path


def connected(path: str) -> Any:
    """Return a client without a timeout."""
    return redis.Redis(unix_socket_path=path, socket_timeout=None)


def _check_there(line: Any) -> None:
    try:
        line.ping()
    except redis.ConnectionError as error:
        raise NotThere("redis-server does not answer") from error


def serve(path: str) -> None:
    """Pop all waiting messages at once, and push the answers together."""
    line = connected(path)
    count = 0
    while True:
        _, first = line.blpop("work", FOREVER)
        replies = []
        for body in (first, *(line.lpop("work", OPEN) or ())):
            kind = body[:1]
            if kind == COUNT:
                count += 1
                continue
            replies.append(body if kind == ECHO else str(count).encode())
            count = 0
        if replies:
            line.rpush("replies", *replies)


def listen(path: str) -> None:
    """Run the connections that receive a broadcast, each in a thread."""
    for _ in range(LISTENERS):
        threading.Thread(target=_count, args=(path,), daemon=True).start()
    threading.Event().wait()


def _count(path: str) -> None:
    counts, line = connected(path), connected(path).pubsub(ignore_subscribe_messages=True)
    line.subscribe("tick")
    count = 0
    for message in line.listen():
        if message["data"][:1] == MARK:
            counts.rpush("heard", count)
            count = 0
        else:
            count += 1


def watch(path: str, topic: str, notes: str) -> None:
    """Run a viewer."""
    viewer, line = Viewer(notes), connected(path).pubsub(ignore_subscribe_messages=True)
    line.subscribe(topic)
    for message in line.listen():
        viewer(message["data"])


class Redis(Showing):
    """Client, server of Redis, our server."""

    def start(self) -> None:
        self.broker, self.path = start_redis(self.children, self.folder)
        self.line = connected(self.path)
        self.receiver = self.children.serve(serve, self.path)
        self.children.serve(listen, self.path)

    def ready(self) -> None:
        super().ready()
        until(self._check_all_subscribed)

    def _check_all_subscribed(self) -> None:
        if dict(self.line.pubsub_numsub("tick"))[b"tick"] < LISTENERS:
            raise NotThere("not all listeners are connected yet")

    def round_trip(self, number: int, size: int) -> list[float]:
        body = body_of(size)

        def exchange() -> None:
            self.line.rpush("work", body)
            self.line.blpop("replies", FOREVER)

        return timed(number, exchange)

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        body, waiting, left = body_of(100), 0, number
        while left:
            if fresh := min(OPEN - waiting, left - waiting):
                self.line.rpush("work", *[body] * fresh)
                waiting += fresh
            self.line.blpop("replies", FOREVER)
            arrived = 1 + len(self.line.lpop("replies", OPEN) or ())
            waiting, left = waiting - arrived, left - arrived

    def oneway(self, number: int) -> None:
        bodies = iter([body_of(100, COUNT)] * number)
        while block := list(islice(bodies, OPEN)):
            self.line.rpush("work", *block)
        self.line.rpush("work", MARK)
        check_arrived(number, int(self.line.blpop("replies", FOREVER)[1]))

    def fanout(self, number: int) -> None:
        bodies = iter([*[body_of(100, COUNT)] * number, MARK])
        while block := list(islice(bodies, OPEN)):
            together = self.line.pipeline(transaction=False)
            for body in block:
                together.publish("tick", body)
            together.execute()
        check_arrived(
            number, *(int(self.line.blpop("heard", FOREVER)[1]) for _ in range(LISTENERS))
        )

    def start_viewer(self, topic: str, path: str) -> int:
        return self.children.serve(watch, self.path, topic, path)

    def show(self, topic: str, frame: Frame) -> None:
        self.line.publish(topic, frame.data)
