"""The server of a page in the browser."""

import contextlib
import webbrowser
from collections.abc import Callable
from secrets import token_urlsafe
from socket import socket
from types import FrameType
from typing import Any

import click
import uvicorn

from tca_tools.view.door import LOCAL
from tca_tools.view.guards import TOKEN


def serve_page(
    door: socket,
    host: str,
    key: str,
    application: Callable[[list[str], str], Any],
    *,
    name: str,
    notes: list[str],
    browser: bool,
    stop: Callable[[], None],
) -> None:
    """Serve a page until interrupted.

    Args:
        door: where the server listens.
        host: the host that the user named.
        key: the key with which the page may change anything; "" if it only looks.
        application: makes the application, of the names to which it answers and the token that it
            asks for.
        name: the title of what the page shows.
        notes: lines to print below the address.
        browser: whether the page is opened.
        stop: ends what pages wait for, or they would be waited for.
    """

    class Server(uvicorn.Server):
        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            stop()
            super().handle_exit(sig, frame)

    token = "" if host == LOCAL else token_urlsafe(16)
    asked = f"?key={key}" if key else f"?{TOKEN}={token}" if token else ""
    named = f"[{host}]" if ":" in host else host
    address = f"http://{named}:{door.getsockname()[1]}/{asked}"
    hosts = ["127.0.0.1", "localhost", "[::1]", host] if host == LOCAL else ["*"]
    config = uvicorn.Config(
        application(hosts, token), log_level="warning", timeout_graceful_shutdown=1
    )
    click.echo("\n".join([f"{name}: {address}  (Ctrl-C ends)", *notes]))
    if browser:
        webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt):
        Server(config).run(sockets=[door])
