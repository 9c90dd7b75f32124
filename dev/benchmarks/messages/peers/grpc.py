"""gRPC without a broker: a server with plain bytes. One-way messages are a stream; no broadcast."""

from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc

from dev.benchmarks.messages.contestant import (
    COUNT,
    SOON,
    Contestant,
    body_of,
    check_arrived,
    run_open,
    timed,
)

LARGE = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]


def serve(address: str) -> None:
    """Run the server, with one thread."""
    server = grpc.server(ThreadPoolExecutor(1), options=LARGE)
    handlers = {
        "ping": grpc.unary_unary_rpc_method_handler(lambda body, _: body),
        "pose": grpc.stream_unary_rpc_method_handler(
            lambda bodies, _: str(sum(1 for _ in bodies)).encode()
        ),
    }
    server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("bench", handlers),))
    server.add_insecure_port(address)
    server.start()
    server.wait_for_termination()


class Grpc(Contestant):
    """Client and server."""

    def start(self) -> None:
        address = f"unix:{self.folder}/grpc.sock"
        self.children.serve(serve, address)
        self.channel = grpc.insecure_channel(address, options=LARGE)
        self.ping: Any = self.channel.unary_unary("/bench/ping")
        self.pose: Any = self.channel.stream_unary("/bench/pose")

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

    def stop(self) -> None:
        if hasattr(self, "channel"):
            self.channel.close()
        super().stop()
