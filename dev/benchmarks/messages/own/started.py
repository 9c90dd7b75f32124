"""The module whose start is timed. It imports nothing but the library."""

from tca_module import Module, Query, Task

PING = Query("ping", bytes, reply=bytes)


def serve(address: str) -> None:
    """Run the module."""
    module = Module("started", address)

    @module.handles(PING)
    def ping(_: Task, body: bytes) -> bytes:
        return body

    module.run()
