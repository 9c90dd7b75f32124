"""``tca activities``: the command line."""

import click

from tca_behaviours.activities.page.live import LiveApplication, applications
from tca_tools.errors import ToolError, extra
from tca_tools.live.shared import central_option, talking
from tca_tools.view.page_socket import LOCAL, listening, page_options


@click.command()
@click.argument("name", required=False)
@page_options
@central_option
@click.option("--read-only", is_flag=True, help="Only show: the page can change nothing.")
def activities(
    name: str | None, port: int, host: str, central: str | None, *, read_only: bool, browser: bool
) -> None:
    """Show an application's regions, processors and activities in the browser, live.

    NAME is the name of the application; it may be left out if central knows only one. The printed
    address carries a key. With it you can allocate activities, change periods and priorities, and
    use the application's buttons. With --host the page is read-only, for all users who have the
    address. The page is served until you press Ctrl-C.
    """
    with extra("view", "tca activities"):
        # The page is an extra, so these imports come late.
        from tca_behaviours.activities.page.app import page_app  # noqa: PLC0415
        from tca_tools.view.guards import PageKey  # noqa: PLC0415
        from tca_tools.view.served_page import serve_page  # noqa: PLC0415
    live = LiveApplication(_choose(name, central), central)
    with listening(host, port) as listener, live.running():
        key = PageKey("tca activities") if host == LOCAL and not read_only else None
        serve_page(
            listener,
            host,
            key.text if key else "",
            lambda hosts, token: page_app(live, hosts, key, token),
            name=live.name,
            notes=[],
            browser=browser,
            stop=live.stop,
        )


def _choose(name: str | None, central: str | None) -> str:
    """Choose an application: the named one, or the only one. Raises ToolError."""
    with talking("activities", central) as client:
        names = applications(client)
    if name in names or (name is None and len(names) == 1):
        return name or names[0]
    if not names:
        raise ToolError("central knows no application: start a program that has a Manager")
    known = ", ".join(f"'{known_name}'" for known_name in names)
    if name is None:
        raise ToolError(f"central knows several applications: name one of {known}")
    raise ToolError(f"central knows no application '{name}': it knows {known}")
