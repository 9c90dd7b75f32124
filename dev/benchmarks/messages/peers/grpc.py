"""gRPC without a broker: a server with plain bytes. One-way messages are a stream; no broadcast.

A viewer of images is a server of its own, with a stream from the sender.
"""

from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from queue import SimpleQueue
from typing import Any

import grpc

from dev.benchmarks.messages.contestant import (
    COUNT,
    SOON,
    body_of,
    check_arrived,
    run_open,
    timed,
)
from dev.benchmarks.messages.images import Frame, Showing, Viewer

LARGE = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]
PATIENT = [*LARGE, ("grpc.max_reconnect_backoff_ms", 200)]


def serve(address: str) -> None:
    """Run the server."""
    _run(
        address,
        ping=grpc.unary_unary_rpc_method_handler(lambda body, _: body),
        pose=grpc.stream_unary_rpc_method_handler(
            lambda bodies, _: str(sum(1 for _ in bodies)).encode()
        ),
    )


def watch(path: str) -> None:
    """Run a viewer."""
    viewer = Viewer(path)

    def view(bodies: Any, _: Any) -> bytes:
        for body in bodies:
            viewer(body)
        return b""

    _run(f"unix:{path}.sock", image=grpc.stream_unary_rpc_method_handler(view))


def _run(address: str, **handlers: Any) -> None:
    """Run a server with one thread."""
    server = grpc.server(ThreadPoolExecutor(1), options=LARGE)
    server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("bench", handlers),))
    server.add_insecure_port(address)
    server.start()
    server.wait_for_termination()


class Grpc(Showing):
    """Client and server."""

    def __init__(self) -> None:
        super().__init__()
        self.channels: list[grpc.Channel] = []
        self.streams: list[Any] = []  # a stream that is forgotten is cancelled
        self.images = defaultdict[str, list[SimpleQueue[bytes | None]]](list)

    def start(self) -> None:
        address = f"unix:{self.folder}/grpc.sock"
        self.receiver = self.children.serve(serve, address)
        channel = grpc.insecure_channel(address, options=LARGE)
        self.channels.append(channel)
        self.ping: Any = channel.unary_unary("/bench/ping")
        self.pose: Any = channel.stream_unary("/bench/pose")

    def ready(self) -> None:
        self.ping(body_of(100), wait_for_ready=True, timeout=SOON)

    def round_trip(self, number: int, size: int) -> list[float]:
        body = body_of(size)
        return timed(number, lambda: self.ping(body))

    def pipelined(self, number: int, slots: int) -> None:
        del slots
        body = body_of(100)
        run_open(number, lambda: self.ping.future(body).result)

    def oneway(self, number: int) -> None:
        body = body_of(100, COUNT)
        check_arrived(number, int(self.pose(iter([body] * number))))

    def fanout(self, number: int) -> None:
        raise NotImplementedError("no broadcast")

    def start_viewer(self, topic: str, path: str) -> int:
        viewer, images = self.children.serve(watch, path), SimpleQueue[bytes | None]()
        channel = grpc.insecure_channel(f"unix:{path}.sock", options=PATIENT)
        call: Any = channel.stream_unary("/bench/image")
        self.streams.append(call.future(iter(images.get, None), wait_for_ready=True))
        self.channels.append(channel)
        self.images[topic].append(images)
        return viewer

    def show(self, topic: str, frame: Frame) -> None:
        body = frame.tobytes()
        for images in self.images[topic]:
            images.put(body)

    def stop(self) -> None:
        for images in (one for topic in self.images.values() for one in topic):
            images.put(None)
        for channel in self.channels:
            channel.close()
        super().stop()
