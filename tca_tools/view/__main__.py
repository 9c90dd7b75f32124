"""``tca view``: a run in the browser, live or afterwards."""

import contextlib
import webbrowser
from pathlib import Path
from secrets import token_urlsafe
from types import FrameType

import click

from tca_tools.errors import ToolError
from tca_tools.options import log_argument
from tca_tools.run.journals import open_log
from tca_tools.view.door import LOCAL, in_address, listening
from tca_wire.endpoint import VARIABLE
from tca_wire.text.missing import missing_package


@click.command()
@log_argument
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Where to serve the page (0: where there is room)."
)
@click.option(
    "--host", default=LOCAL, show_default=True, help="The address to serve on: by default only for this machine."
)
@click.option("--central", metavar="ADDRESS", help=f"Where central listens that is steered [default: ${VARIABLE}].")
@click.option("--read-only", is_flag=True, help="Only look: nothing is killed, suspended, resumed or retried.")
@click.option("--browser/--no-browser", default=True, help="Open the page in the browser.")
def view(log_path: Path | None, port: int, host: str, central: str | None, *, read_only: bool, browser: bool) -> None:
    """Show a run in the browser: its task tree and Gantt chart at any moment.

    LOG is a journal directory or one of its segments; without it, the newest run is shown, and when central is started
    anew, that run. A run that goes on is followed, and whoever opens the address that is printed can kill, suspend,
    resume and retry its tasks. With --host the page only looks, for those who have the address. It is served until
    interrupted.
    """
    try:
        import uvicorn  # noqa: PLC0415 - the viewer is an extra

        from tca_tools.view.app import application  # noqa: PLC0415
        from tca_tools.view.guards import TOKEN  # noqa: PLC0415
        from tca_tools.view.runs import Runs  # noqa: PLC0415
        from tca_tools.view.steering import Steering  # noqa: PLC0415
    except ImportError as error:
        raise ToolError(missing_package("tca view", str(error.name), "view")) from None
    log = open_log(log_path)
    log.check_beginning()
    log.tell()
    runs = Runs(log, follows=log_path is None)
    with listening(host, port) as door:
        steering = Steering(central) if host == LOCAL and not read_only else None
        token = "" if host == LOCAL else token_urlsafe(16)
        asked = f"?key={steering.key.text}" if steering else f"?{TOKEN}={token}" if token else ""
        address = f"http://{in_address(host)}:{door.getsockname()[1]}/{asked}"
        hosts = ["127.0.0.1", "localhost", "[::1]", host] if host == LOCAL else ["*"]

        class Server(uvicorn.Server):
            def handle_exit(self, sig: int, frame: FrameType | None) -> None:
                runs.stop()  # or a page that waits for news would be waited for
                super().handle_exit(sig, frame)

        config = uvicorn.Config(
            application(runs, hosts, steering, token), log_level="warning", timeout_graceful_shutdown=1
        )
        runs.show(None)
        click.echo(f"{runs.first.name}: {address}  (Ctrl-C ends)")
        if log.is_empty:
            click.echo("it is empty: what central writes to it will be shown")
        if browser:
            webbrowser.open(address)
        try:
            with contextlib.suppress(KeyboardInterrupt):
                Server(config).run(sockets=[door])
        finally:
            runs.stop()


if __name__ == "__main__":
    view(prog_name="python -m tca_tools.view")
