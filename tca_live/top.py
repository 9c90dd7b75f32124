"""``tca top``: what a running central and its modules do, again and again."""

import signal
import sys
import time
from types import FrameType
from typing import Any

import click

from tca_live.keys import Keys, typed_keys
from tca_live.shared import as_json, central_option, json_option, talking
from tca_live.top_frame import Answer, Frame, frame, plain_frame
from tca_module.client import Client, connect
from tca_module.errors import MisuseError, TcaError
from tca_wire.endpoint import default_endpoint
from tca_wire.text.printable import printable

_NAME = "tca top"
_PATIENCE = 1.0
"""Seconds until central counts as away: keys are not heard meanwhile."""
_QUICKEST = 0.1
_TERMINATED = 128 + signal.SIGTERM


@click.command()
@central_option
@json_option
@click.option(
    "--every", metavar="SECONDS", type=click.FloatRange(min=_QUICKEST), default=1.0, show_default=True,
    help="How often it is refreshed.",
)  # fmt: skip
@click.option("--once", is_flag=True, help="Print it once, with the rates of the whole run, and end.")
def top(central: str | None, every: float, *, in_json: bool, once: bool) -> None:
    """Watch what is busy and what waits, in a running central.

    Shown are modules, resources, queues, rates, the longest waits, held and suspended tasks.

    Press q or Ctrl-C to end it. It says when central is away, and goes on when central is back.
    """
    if in_json and not once:
        raise click.UsageError("--json prints one answer: ask for --once, too")
    if once:
        with talking("top", central) as client:
            _print_once(frame(client.status("load"), hidden=client.name), client.address, in_json)
        return
    _screen()
    with typed_keys() as keys:
        signal.signal(signal.SIGTERM, _end)  # so that the terminal is left as it was
        try:
            _watch(_Central(central), every, keys)
        except KeyboardInterrupt:
            return


def _print_once(shown: Frame, address: str, in_json: bool) -> None:
    if in_json:
        click.echo(as_json(plain_frame(shown)))
    else:
        looks = _screen()
        looks.console().print(looks.screen(shown, address, ""))


def _screen() -> Any:
    """How it looks; rich is an extra."""
    try:
        from tca_live import top_screen  # noqa: PLC0415
    except ImportError:
        raise click.ClickException(
            "tca top needs the Python package 'rich': pip install 'tca-central[top]', or ask for --once --json"
        ) from None
    return top_screen


def _end(_number: int, _frame: FrameType | None) -> None:
    sys.exit(_TERMINATED)


def _watch(central: "_Central", every: float, keys: Keys) -> None:
    """Show frame after frame until somebody presses q."""
    looks = _screen()
    terminal = looks.console()
    if not terminal.is_terminal:
        raise click.UsageError("tca top needs a terminal: ask for --once, or --once --json")
    shown: Frame | None = None
    with looks.live(terminal) as live:
        while True:
            shown = central.ask() or shown
            live.update(looks.screen(shown, central.address, central.trouble, terminal.height), refresh=True)
            if keys.wait(every) in ("q", "Q", "\x1b"):
                return


class _Central:
    """A central that may go away and come back."""

    def __init__(self, address: str | None) -> None:
        self.trouble = ""
        """What is wrong now."""
        self.address = address or default_endpoint()
        self._asked = address
        self._client: Client | None = None
        self._before: Answer | None = None
        self._heard = time.monotonic()

    def ask(self) -> Frame | None:
        """How it is now; None if central does not say. Raises UsageError if there can be no such central."""
        try:
            if self._client is None:
                self._client = connect(_NAME, self._asked, patience=_PATIENCE)
            self.address = self._client.address
            now = self._client.status("load", timeout=_PATIENCE)
            name = self._client.name
        except MisuseError as error:
            raise click.UsageError(printable(" ".join(str(error).split()))) from None
        except TcaError:
            self._lose()
            return None
        self.trouble, self._heard = "", time.monotonic()
        shown = frame(now, self._before, hidden=name)
        self._before = now
        return shown

    def _lose(self) -> None:
        """Central does not answer: say since when, and begin anew with the next question."""
        client, self._client = self._client, None
        if client is not None:
            client.close()
        self.trouble = f"no answer for {time.monotonic() - self._heard:.0f} s, trying again"


if __name__ == "__main__":
    top(prog_name="python -m tca_module.top")
