"""``tca activities``: the command line."""

import contextlib
import webbrowser
from secrets import token_urlsafe
from types import FrameType

import click

from tca_activities.page.live import LiveApplication, applications
from tca_live.shared import talking
from tca_tools.errors import ToolError
from tca_tools.view.door import LOCAL, in_address, listening
from tca_wire.endpoint import VARIABLE
from tca_wire.text.missing import missing_package


@click.command()
@click.argument("name", required=False)
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, help="Where to serve the page (0: where there is room)."
)
@click.option(
    "--host", default=LOCAL, show_default=True, help="The address to serve on: by default only for this machine."
)
@click.option("--central", metavar="ADDRESS", help=f"Where central listens [default: ${VARIABLE}].")
@click.option("--read-only", is_flag=True, help="Only look: nothing is allocated or sent.")
@click.option("--browser/--no-browser", default=True, help="Open the page in the browser.")
def activities(name: str | None, port: int, host: str, central: str | None, *, read_only: bool, browser: bool) -> None:
    """Show an application's regions, processors and activities in the browser, live.

    NAME is that of the application; it may be left out while central knows one only. Whoever opens the address that is
    printed can allocate activities, change periods and priorities, and use the application's buttons. With --host the
    page only looks, for those who have the address. It is served until interrupted.
    """
    try:
        import uvicorn  # noqa: PLC0415 - the page is an extra

        from tca_activities.page.app import application  # noqa: PLC0415
        from tca_tools.view.guards import TOKEN, PageKey  # noqa: PLC0415
    except ImportError as error:
        raise ToolError(missing_package("tca activities", str(error.name), "view")) from None
    live = LiveApplication(_chosen(name, central), central)
    with listening(host, port) as door, live.running():
        key = PageKey("tca activities") if host == LOCAL and not read_only else None
        token = "" if host == LOCAL else token_urlsafe(16)
        asked = f"?key={key.text}" if key else f"?{TOKEN}={token}" if token else ""
        address = f"http://{in_address(host)}:{door.getsockname()[1]}/{asked}"
        hosts = ["127.0.0.1", "localhost", "[::1]", host] if host == LOCAL else ["*"]

        class Server(uvicorn.Server):
            def handle_exit(self, sig: int, frame: FrameType | None) -> None:
                live.stop()  # or a page that waits for news would be waited for
                super().handle_exit(sig, frame)

        click.echo(f"{live.name}: {address}  (Ctrl-C ends)")
        if browser:
            webbrowser.open(address)
        config = uvicorn.Config(application(live, hosts, key, token), log_level="warning", timeout_graceful_shutdown=1)
        with contextlib.suppress(KeyboardInterrupt):
            Server(config).run(sockets=[door])


def _chosen(name: str | None, central: str | None) -> str:
    """The name of the application that is meant. Raises ClickException."""
    with talking("activities", central) as client:
        names = applications(client)
    if name in names or (name is None and len(names) == 1):
        return name or names[0]
    if not names:
        raise ToolError("central knows no application: start its program, with a Manager")
    there = ", ".join(f"'{one}'" for one in names)
    if name is None:
        raise ToolError(f"central knows several applications: give the name of one of {there}")
    raise ToolError(f"central knows no application '{name}': it knows {there}")
