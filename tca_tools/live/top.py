"""``tca top``: what a running central and its modules do, again and again."""

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
"""Seconds until central counts as away: keys are not heard meanwhile."""
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
    help="How often it is refreshed.",
)
@click.option(
    "--once", is_flag=True, help="Print it once, with the rates of the whole run, and end."
)
def top(central: str | None, every: float, *, in_json: bool, once: bool) -> None:
    """Watch what is busy and what waits, in a running central.

    Shown are modules, resources, queues, rates, the longest waits, held and suspended tasks.

    Press q or Ctrl-C to end it. It says when central is away, and goes on when central is back.
    """
    if in_json and not once:
        raise click.UsageError("--json prints one answer: ask for --once, too")
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
        signal.signal(signal.SIGTERM, _end)  # so that the terminal is left as it was
        try:
            _watch(_Central(central), every, keys)
        except KeyboardInterrupt:
            return


def _screen() -> Any:
    """How it looks; rich is an extra."""
    with extra("top", "tca top", "ask for --once --json"):
        from tca_tools.live import top_screen  # noqa: PLC0415
    return top_screen


def _end(_number: int, _frame: FrameType | None) -> None:
    sys.exit(_TERMINATED)


@contextmanager
def _typed_keys() -> Iterator[int | None]:
    """The file from which keys can be read as they are typed; None without a terminal, which is
    restored afterwards.
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
    """Show frame after frame until somebody presses q."""
    looks = _screen()
    terminal = looks.console()
    if not terminal.is_terminal:
        raise click.UsageError("tca top needs a terminal: ask for --once, or --once --json")
    shown: Frame | None = None
    with looks.live(terminal) as live:
        while True:
            shown = central.ask() or shown
            live.update(
                looks.screen(shown, central.address, central.trouble, terminal.height), refresh=True
            )
            if select.select([] if keys is None else [keys], [], [], every)[0] and keys is not None:
                typed = os.read(keys, 64)
                if typed in (b"q", b"Q", b"\x1b"):
                    return
                keys = keys if typed else None  # nobody can type any more


class _Central:
    """A central that may go away and come back."""

    def __init__(self, address: str | None) -> None:
        self.trouble = ""
        """The current problem."""
        self.address = address or default_endpoint()
        self._asked = address
        self._client: Client | None = None
        self._before: Answer | None = None
        self._heard = time.monotonic()

    def ask(self) -> Frame | None:
        """How it is now; None if central does not say. Raises UsageError if there can be no such
        central.
        """
        try:
            if self._client is None:
                self._client = connect(_NAME, self._asked, patience=_PATIENCE)
            self.address = self._client.address
            now = self._client.status("load", timeout=_PATIENCE)
            name = self._client.name
        except MisuseError as error:
            raise click.UsageError(in_one_line(error)) from None
        except TcaError:
            if self._client is not None:
                self._client.close()
                self._client = None
            self.trouble = f"no answer for {time.monotonic() - self._heard:.0f} s, trying again"
            return None
        self.trouble, self._heard = "", time.monotonic()
        shown = frame(now, self._before, hidden=name)
        self._before = now
        return shown


if __name__ == "__main__":
    top(prog_name="python -m tca_tools.live.top")
