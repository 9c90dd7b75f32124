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

from tca_tools.view.guards import TOKEN
from tca_tools.view.page_socket import LOCAL


def serve_page(
    listener: socket,
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
        listener: where the server listens.
        host: the host that the user named.
        key: the key that allows the page to change anything; "" for a read-only page.
        application: creates the application from two arguments: the host names to which the server
            answers, and the token that requests must have.
        name: the title of what the page shows.
        notes: lines to print below the address.
        browser: whether the page is opened.
        stop: ends all open requests of pages, so that the server can end at once.
    """

    class Server(uvicorn.Server):
        def handle_exit(self, sig: int, frame: FrameType | None) -> None:
            stop()
            super().handle_exit(sig, frame)

    token = "" if host == LOCAL else token_urlsafe(16)
    query = f"?{TOKEN}={token}" if token else ""
    if key:
        query = f"?key={key}"
    named = f"[{host}]" if ":" in host else host
    address = f"http://{named}:{listener.getsockname()[1]}/{query}"
    hosts = ["127.0.0.1", "localhost", "[::1]", host] if host == LOCAL else ["*"]
    config = uvicorn.Config(
        application(hosts, token), log_level="warning", timeout_graceful_shutdown=1
    )
    click.echo("\n".join([f"{name}: {address}  (Ctrl-C ends)", *notes]))
    if browser:
        webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt):
        Server(config).run(sockets=[listener])
