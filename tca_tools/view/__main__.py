"""``tca view``: a run in the browser, live or afterwards."""

from pathlib import Path

import click

from tca_tools.errors import extra
from tca_tools.journal.journals import open_log
from tca_tools.options import log_argument
from tca_tools.view.page_socket import LOCAL, listening, page_options
from tca_wire.endpoint import VARIABLE


@click.command()
@log_argument
@page_options
@click.option(
    "--central",
    metavar="ADDRESS",
    help=f"The address of the central to steer [default: ${VARIABLE}].",
)
@click.option(
    "--read-only", is_flag=True, help="Do not let the page kill, suspend, resume or retry tasks."
)
def view(
    log_path: Path | None,
    port: int,
    host: str,
    central: str | None,
    *,
    read_only: bool,
    browser: bool,
) -> None:
    """Show a run in the browser: its task tree and Gantt chart at any time.

    Without LOG, each run that central starts later is shown, too. The page follows a live run. With
    the printed address it can kill, suspend, resume and retry tasks. With --host the page is
    read-only, and needs the printed address. It is served until interrupted.
    """
    with extra("view", "tca view"):
        from tca_tools.view.app import Steering, application  # noqa: PLC0415 - an extra
        from tca_tools.view.runs import Runs  # noqa: PLC0415
        from tca_tools.view.served_page import serve_page  # noqa: PLC0415
    log = open_log(log_path)
    log.check_beginning()
    log.print_remarks()
    runs = Runs(log, follows=log_path is None)
    with listening(host, port) as listener:
        steering = Steering(central) if host == LOCAL and not read_only else None
        runs.show(None)
        notes = ["it is empty: the page will show what central writes to it"] * log.is_empty
        try:
            serve_page(
                listener,
                host,
                steering.key.text if steering else "",
                lambda hosts, token: application(runs, hosts, steering, token),
                name=runs.first.name,
                notes=notes,
                browser=browser,
                stop=runs.stop,
            )
        finally:
            runs.stop()


if __name__ == "__main__":
    view(prog_name="python -m tca_tools.view")
