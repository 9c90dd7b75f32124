"""The console in IPython. Nothing else imports it."""

from typing import Any

from IPython.core.interactiveshell import InteractiveShell
from IPython.terminal.embed import InteractiveShellEmbed  # noqa: T100 - no debugger
from traitlets.config import Config

from tca_behaviours.missions.console.names import ConsoleNames
from tca_module import TcaError


def run_shell(console: ConsoleNames) -> None:
    """Read and run what is typed, until Ctrl-D."""
    settings = Config()
    settings.TerminalInteractiveShell.confirm_exit = settings.InteractiveShell.enable_tip = False
    names: dict[str, Any] = console.names
    made: Any = InteractiveShellEmbed
    shell = made(config=settings, user_ns=names, banner1="", exit_msg="")
    shell.set_custom_exc((TcaError, KeyboardInterrupt), _show_in_one_line)

    def learn(*_: object) -> None:
        """Tasks that have come since the last line are names, too."""
        shell.user_ns.update(
            {name: value for name, value in console.names.items() if name not in shell.user_ns}
        )

    shell.events.register("pre_run_cell", learn)
    console.index()
    console.help()
    shell(stack_depth=0)


def _show_in_one_line(
    _: InteractiveShell,
    kind: type[BaseException],
    error: BaseException,
    *_trace: object,
    **__: object,
) -> None:
    """An error of a mission says what, which and what to do, and Ctrl-C is none: nobody needs the
    traceback.
    """
    print(
        f"{kind.__name__}: {error}"
        if str(error)
        else f"{kind.__name__}: status() shows what still runs"
    )
