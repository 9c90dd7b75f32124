"""The console in IPython. Only the command imports this module: IPython is an extra."""

from typing import Any

from IPython.core.interactiveshell import InteractiveShell
from IPython.terminal.embed import InteractiveShellEmbed  # noqa: T100 - no debugger
from traitlets.config import Config

from tca_behaviours.missions.console.names import ConsoleNames
from tca_module import TcaError


def run_shell(console: ConsoleNames) -> None:
    """Read and run the user's lines, until Ctrl-D."""
    settings = Config()
    settings.TerminalInteractiveShell.confirm_exit = settings.InteractiveShell.enable_tip = False
    names: dict[str, Any] = console.names
    make_shell: Any = InteractiveShellEmbed
    shell = make_shell(config=settings, user_ns=names, banner1="", exit_msg="")

    def show_in_one_line(
        _: InteractiveShell,
        __: type[BaseException],
        error: BaseException,
        *_trace: object,
        **___: object,
    ) -> None:
        """Print an error of a mission, a mistyped call, or Ctrl-C, without a traceback."""
        print(console.describe(error))

    shell.set_custom_exc((TcaError, KeyboardInterrupt, NameError, TypeError), show_in_one_line)

    def learn(*_: object) -> None:
        """Add the tasks that were offered since the last line."""
        shell.user_ns.update(
            {name: value for name, value in console.names.items() if name not in shell.user_ns}
        )

    shell.events.register("pre_run_cell", learn)
    console.index()
    console.help()
    shell(stack_depth=0)
