"""The options and the socket of a page's server."""

import socket
from collections.abc import Callable
from typing import Any

import click

from tca_tools.errors import ToolError

LOCAL = "127.0.0.1"

_OPTIONS = (
    click.option(
        "--port",
        type=click.IntRange(0, 65535),
        default=0,
        help="The port to serve the page on (0: any free port).",
    ),
    click.option(
        "--host",
        default=LOCAL,
        show_default=True,
        help="The address to serve on; the default serves only this machine.",
    ),
    click.option("--browser/--no-browser", default=True, help="Open the page in the browser."),
)


def page_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Add the options of a page in the browser to a command: port, host and browser."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def listening(host: str, port: int) -> socket.socket:
    """Return a listening socket; port 0 stands for any free port. Raises ToolError."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise ToolError(
            f"can't serve on {host}:{port} ({error.strerror or error}): give another --port"
        ) from None
