"""``tca top``: the load of a running central and its modules, refreshed every second."""

import os
import select
import signal
import sys
import termios
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

import click

from tca_module.client import Client, connect
from tca_module.errors import MisuseError, TcaError
from tca_tools.errors import extra
from tca_tools.live.shared import as_json, central_option, in_one_line, json_option, talking
from tca_tools.live.top_frame import Answer, Frame, frame
from tca_wire.endpoint import default_endpoint

_NAME = "tca top"
_PATIENCE = 1.0
"""Seconds until central counts as away; keys are not read during this wait."""
_QUICKEST = 0.1
_TERMINATED = 128 + signal.SIGTERM


@click.command()
@central_option
@json_option
@click.option(
    "--every",
    metavar="SECONDS",
    type=click.FloatRange(min=_QUICKEST),
    default=1.0,
    show_default=True,
    help="The time between two refreshes.",
)
@click.option(
    "--once", is_flag=True, help="Print it once, with the rates of the whole run, and end."
)
def top(central: str | None, every: float, *, in_json: bool, once: bool) -> None:
    """Watch the busy resources and the waits of a running central.

    It shows modules, resources, queues, rates, the longest waits, held and suspended tasks.

    Press q or Ctrl-C to end it. It reports when central is away, and continues when central is
    back.
    """
    if in_json and not once:
        raise click.UsageError("--json prints one answer: add --once")
    if once:
        with talking("top", central) as client:
            shown, address = frame(client.status("load"), hidden=client.name), client.address
        if in_json:
            click.echo(as_json(shown))
        else:
            _screen().console().print(_screen().screen(shown, address, ""))
        return
    _screen()
    with _typed_keys() as keys:
        signal.signal(signal.SIGTERM, _exit)  # SystemExit restores the terminal
        try:
            _watch(_Central(central), every, keys)
        except KeyboardInterrupt:
            return


def _screen() -> Any:
    """Import the screen, which needs the extra package rich."""
    with extra("top", "tca top", "ask for --once --json"):
        from tca_tools.live import top_screen  # noqa: PLC0415
    return top_screen


def _exit(_number: int, _frame: FrameType | None) -> None:
    sys.exit(_TERMINATED)


@contextmanager
def _typed_keys() -> Iterator[int | None]:
    """A context that yields the file to read single keys from, or None without a terminal.

    It restores the terminal's mode at its end.
    """
    if not sys.stdin.isatty():
        yield None
        return
    file = sys.stdin.fileno()
    before = termios.tcgetattr(file)
    try:
        tty.setcbreak(file)
        yield file
    finally:
        termios.tcsetattr(file, termios.TCSADRAIN, before)


def _watch(central: "_Central", every: float, keys: int | None) -> None:
    """Show a new frame every `every` seconds until the user presses q."""
    screen = _screen()
    terminal = screen.console()
    if not terminal.is_terminal:
        raise click.UsageError("tca top needs a terminal: use --once, or --once --json")
    shown: Frame | None = None
    with screen.live(terminal) as live:
        while True:
            shown = central.ask() or shown
            live.update(
                screen.screen(shown, central.address, central.trouble, terminal.height),
                refresh=True,
            )
            if select.select([] if keys is None else [keys], [], [], every)[0] and keys is not None:
                typed = os.read(keys, 64)
                if typed in (b"q", b"Q", b"\x1b"):
                    return
                keys = keys if typed else None  # end of file: no more keys can arrive


class _Central:
    """A central that may become unreachable and return."""

    def __init__(self, address: str | None) -> None:
        self.trouble = ""
        """The current problem."""
        self.address = address or default_endpoint()
        self._given_address = address
        self._client: Client | None = None
        self._before: Answer | None = None
        self._answered_at = time.monotonic()

    def ask(self) -> Frame | None:
        """Return the present frame, or None if central does not answer.

        Raises UsageError for an impossible address.
        """
        try:
            if self._client is None:
                self._client = connect(_NAME, self._given_address, patience=_PATIENCE)
            self.address = self._client.address
            now = self._client.status("load", timeout=_PATIENCE)
            name = self._client.name
        except MisuseError as error:
            raise click.UsageError(in_one_line(error)) from None
        except TcaError:
            if self._client is not None:
                self._client.close()
                self._client = None
            waited = time.monotonic() - self._answered_at
            self.trouble = f"no answer for {waited:.0f} s, trying again"
            return None
        self.trouble, self._answered_at = "", time.monotonic()
        shown = frame(now, self._before, hidden=name)
        self._before = now
        return shown


if __name__ == "__main__":
    top(prog_name="python -m tca_tools.live.top")
