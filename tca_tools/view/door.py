"""Where a page's server listens."""

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
        help="Where to serve the page (0: where there is room).",
    ),
    click.option(
        "--host",
        default=LOCAL,
        show_default=True,
        help="The address to serve on: by default only for this machine.",
    ),
    click.option("--browser/--no-browser", default=True, help="Open the page in the browser."),
)


def page_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the options of a page in the browser: port, host and browser."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def listening(host: str, port: int) -> socket.socket:
    """A socket that listens there; with port 0 where there is room. Raises ToolError."""
    try:
        family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        return socket.create_server((host, port), family=family)
    except OSError as error:
        raise ToolError(
            f"{host}:{port}: can't serve there ({error.strerror or error}): give another --port"
        ) from None
