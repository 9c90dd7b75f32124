"""robot.toml: the programs of a robot and their restarts. It is checked before a program starts."""

import os
import re
import shlex
import shutil
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from tca_tools.errors import BadUserFile
from tca_tools.user_toml import check_keys, check_table, read_table, read_toml
from tca_wire.endpoint import (
    IS_STARTED_VARIABLE,
    VARIABLE,
    BadAddresses,
    addresses_in,
    default_endpoint,
    new_journal,
)
from tca_wire.text.nearest import nearest_or_all

CENTRAL = "central"
RUN = "run"
"""The name of ``tca run`` among the programs."""

_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")
_DAY = 86400.0

_NOT_AS_OPTIONS = {
    "--bind": "write address = ...",
    "--journal": "write journal = ...",
    "--fresh": "a central that has crashed would forget its run",
}


Seconds = Annotated[float, Meta(ge=0, le=_DAY, description="a number of seconds")]
PathName = Annotated[str, Meta(description="a folder in quotes")]


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """The limits of a program's restarts, and of its time to end."""

    restarts: Annotated[int, Meta(ge=0, le=1000, description="a whole number from 0 to 1000")] = 5
    """All programs are ended if one crashes more often than this in ``within`` seconds."""
    within: Annotated[float, Meta(gt=0, le=_DAY, description="a number of seconds above 0")] = 60.0
    """The seconds in which restarts are counted."""
    delay: Seconds = 0.5
    """Seconds before the first restart. Each further delay is doubled, up to ``longest_delay``."""
    longest_delay: Seconds = 10.0
    """The longest seconds before a restart."""
    grace: Seconds = 5.0
    """Seconds to end after SIGINT. SIGTERM follows."""
    log: PathName = ""
    """The folder of files with the programs' output, ``NAME.log``. A file has at most 10 MiB; four
    older ones stay beside it. Without a folder there are no files.
    """


class CentralTable(Limits, frozen=True, kw_only=True):
    """The table of central."""

    start: Annotated[bool, Meta(description="true, or false if central runs already")] = True
    """Whether to start central. With false it runs elsewhere, such as on another computer."""
    address: Annotated[
        str, Meta(description='an address in quotes, such as "ipc:///run/robot/central.sock"')
    ] = ""
    """The address where central listens; programs get it as ``$TCA_CENTRAL``. Without an address,
    it is ``$TCA_CENTRAL`` or else the default socket. Without *start* there may be several with
    commas, of which one central leads.
    """
    journal: PathName = ""
    """The folder of the journal. Without a folder, each start of ``tca run`` has a new one. A
    restart of central always continues the same journal.
    """
    options: Annotated[
        list[str],
        Meta(description='a list of options of \'tca central\', such as ["--sync", "always"]'),
    ] = []
    """More options of ``tca central``."""


class ModuleTable(Limits, frozen=True, kw_only=True):
    """The table of a program."""

    command: Annotated[
        str | list[str],
        Meta(
            description='what starts the program, such as "python legs.py", or a list of its words'
        ),
    ]
    """The program. A text is split into words as a shell does, but no shell runs it. ``python`` is
    the Python that runs ``tca``.
    """
    cwd: PathName = ""
    """The folder to run in. Without a folder, it is that of the file. Relative paths count from the
    file.
    """
    env: Annotated[
        dict[str, str], Meta(description='a table of texts, such as { SIDE = "left" }')
    ] = {}
    """More environment variables."""
    restart: Annotated[
        Literal["on-failure", "always", "never"],
        Meta(description='"on-failure", "always" or "never"'),
    ] = "on-failure"
    """When to start the program again. A signal and an exit code other than 0 are failures."""
    hung: Annotated[Literal["leave", "restart"], Meta(description='"leave" or "restart"')] = "leave"
    """Whether to restart a process that lives but that central has lost."""
    when_crashing: Annotated[
        Literal["end", "leave"], Meta(description='"end" (the robot) or "leave" (it down)')
    ] = "end"
    """What a program that crashes too often does: it ends all programs, or it alone stays down."""
    copies: Annotated[int, Meta(ge=1, le=99, description="a whole number from 1 to 99")] = 1
    """The number of processes. They are named NAME.1, NAME.2 and so on."""


class Launch(msgspec.Struct, frozen=True, kw_only=True):
    """A program to run."""

    name: str
    command: list[str]
    cwd: Path
    env: dict[str, str]
    limits: Limits
    restart: str = "always"
    journal: Path | None = None
    """The folder of central's journal; None for a module."""
    restarts_hung: bool = False
    """Whether to restart it when central has lost its module but its process lives."""
    is_left_down: bool = False
    """Whether it is left down when it crashes too often; else all programs are ended."""
    log: Path | None = None
    """The file of its output."""

    @property
    def is_central(self) -> bool:
        """Whether it is central, which starts first and ends last."""
        return self.name == CENTRAL


class RobotFile(msgspec.Struct, frozen=True):
    """The checked content of a robot's file."""

    address: str
    """The address of central."""
    programs: list[Launch]
    """First central, unless it runs already."""
    log: Path | None = None
    """The file of what ``tca run`` says itself."""

    @property
    def logs(self) -> dict[str, Path]:
        """The files of output, by program."""
        found = {RUN: self.log, **{program.name: program.log for program in self.programs}}
        return {name: path for name, path in found.items() if path is not None}

    def only(self, names: list[str]) -> "RobotFile":
        """Return a copy with only the named programs; a module's name stands for all its copies.

        Raises BadUserFile.
        """
        known = {program.name.partition(".")[0] for program in self.programs}
        for name in names:
            if name not in known:
                raise BadUserFile(f"--only {name}: {nearest_or_all(name, known)}")
        programs = [one for one in self.programs if one.name.partition(".")[0] in names]
        return msgspec.structs.replace(self, programs=programs)


def load(path: Path) -> RobotFile:
    """Read a robot's file. Raises BadUserFile."""
    tables = read_toml(path)
    try:
        return _robot(tables, path.resolve().parent)
    except BadUserFile as error:
        raise BadUserFile(f"{path}: {error}") from None


def _robot(tables: dict[str, Any], folder: Path) -> RobotFile:
    for name, table in tables.items():
        if name not in (CENTRAL, RUN, "modules"):
            is_program = isinstance(table, dict) and "command" in table
            others = nearest_or_all(name, [CENTRAL, "modules", RUN])
            what_to_do = f"a program stands under [modules.{name}]" if is_program else others
            raise BadUserFile(f"'{name}' is unknown: {what_to_do}")
        check_table(name, table)
    common = tables.get(RUN, {})
    check_keys(Limits, RUN, common)
    central = read_table(CentralTable, CENTRAL, tables.get(CENTRAL, {}), common)
    address = central.address or default_endpoint()
    if address.endswith(":*"):
        raise BadUserFile(f"central.address is {address}: name a port, so that modules find it")
    _check_addresses(address, starts_central=central.start)
    for option in central.options:
        if instead := _NOT_AS_OPTIONS.get(option.partition("=")[0]):
            raise BadUserFile(f"central.options: leave {option} out: {instead}")
    programs = [_central(central, address, folder)] if central.start else []
    environment = _environment(address, starts_central=central.start)
    for name, table in tables.get("modules", {}).items():
        programs += _copies(name, table, common, environment, folder)
    if not programs:
        raise BadUserFile("there are no programs to run: add a table [modules.NAME] with a command")
    return RobotFile(address, programs, _log(folder, common.get("log", ""), RUN))


def _check_addresses(text: str, *, starts_central: bool) -> None:
    """Raise BadUserFile if central's address is an invalid list, or central would listen there."""
    try:
        is_list = len(addresses_in(text)) > 1
    except BadAddresses as error:
        raise BadUserFile(f"central.address: {error}") from None
    if is_list and starts_central:
        raise BadUserFile(
            f"central.address has several addresses, {text}: name the one of the central that"
            " 'tca run' starts, or set central.start = false and start it elsewhere"
        )


def _central(table: CentralTable, address: str, folder: Path) -> Launch:
    """Return the launch of central.

    Each run of the robot has its own journal, unless the file names a journal. If central is
    restarted during the run, it continues with the same journal.
    """
    journal = _path(folder, table.journal) if table.journal else new_journal()
    options = ["--bind", address, "--journal", str(journal), *table.options]
    command = [sys.executable, "-m", "tca_central", *options]
    environment = _environment(address, starts_central=True)
    return Launch(
        name=CENTRAL,
        command=command,
        cwd=folder,
        env=environment,
        limits=table,
        journal=journal,
        log=_log(folder, table.log, CENTRAL),
    )


def _copies(
    name: str, given: Any, common: dict[str, Any], environment: dict[str, str], folder: Path
) -> list[Launch]:
    """Return the launches of a module's table, one for each copy."""
    place = f"modules.{name}"
    if not _NAME.fullmatch(name) or name in (CENTRAL, RUN):
        raise BadUserFile(
            f"{place}: choose another name, of letters, digits, '-' and '_',"
            f" but not '{CENTRAL}' or '{RUN}'"
        )
    table = read_table(ModuleTable, place, given, common)
    if table.hung == "restart" and table.restart == "never":
        raise BadUserFile(
            f'{place}.hung is "restart", but restart is "never": leave one of them out'
        )
    cwd = _path(folder, table.cwd)
    if not cwd.is_dir():
        raise BadUserFile(f"{place}.cwd: there is no folder {cwd}")
    command, env = _words(place, table.command), environment | table.env
    program = cwd / command[0] if "/" in command[0] else command[0]
    if shutil.which(program, path=env["PATH"]) is None:
        raise BadUserFile(
            f"{place}.command: there is no executable program {command[0]}, seen from {cwd}"
        )
    names = [f"{name}.{number}" for number in range(1, table.copies + 1)]
    return [
        Launch(
            name=one,
            command=command,
            cwd=cwd,
            env=env,
            limits=table,
            restart=table.restart,
            restarts_hung=table.hung == "restart",
            is_left_down=table.when_crashing == "leave",
            log=_log(folder, table.log, one),
        )
        for one in (names if table.copies > 1 else [name])
    ]


def _words(place: str, command: str | list[str]) -> list[str]:
    try:
        words = shlex.split(command) if isinstance(command, str) else command
    except ValueError as error:
        raise BadUserFile(f"{place}.command: {error}".lower()) from None
    if not words or not words[0]:
        raise BadUserFile(f"{place}.command is empty: say what starts the program")
    return words


def _path(folder: Path, name: str) -> Path:
    """Return a path of the file, relative to the file's folder."""
    try:
        return folder / Path(name).expanduser()
    except RuntimeError:
        raise BadUserFile(f"{name}: there is no such home folder: write the whole path") from None


def _log(folder: Path, name: str, program: str) -> Path | None:
    """Return the file of a program's output, in the folder *name* ("": no file)."""
    return _path(folder, name) / f"{program}.log" if name else None


def _environment(address: str, *, starts_central: bool) -> dict[str, str]:
    """Return the environment of a program: ours, with our Python first and unbuffered output."""
    started = {IS_STARTED_VARIABLE: "1"} if starts_central else {}
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", os.defpath)])
    return {**os.environ, "PATH": path, "PYTHONUNBUFFERED": "1", VARIABLE: address, **started}
