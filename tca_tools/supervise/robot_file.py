"""robot.toml: the programs of a robot and their restarts. It is checked before a program starts."""

import os
import re
import shlex
import shutil
import sys
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from tca_tools.errors import BadUserFile
from tca_tools.supervise.trial_log import second_address, trial_log
from tca_tools.user_toml import check_keys, check_table, read_table, read_toml
from tca_wire.endpoint import (
    IS_STARTED_VARIABLE,
    VARIABLE,
    BadAddresses,
    addresses_in,
    default_endpoint,
    new_journal,
)
from tca_wire.log_address import log_in
from tca_wire.text.missing import missing_package
from tca_wire.text.nearest import nearest_or_all

CENTRAL, STANDBY, SERVERS = "central", "standby", "nats"
_TRIAL = "trial"
_CENTRAL, _STANDBY = ["tca_central"], ["tca_tools.command_line", "standby"]
"""What starts a central: a module, and its first argument."""
RUN = "run"
"""The name of ``tca run`` among the programs."""

_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}")
_DAY = 86400.0

_NOT_AS_OPTIONS = {
    "--bind": "write address = ...",
    "--journal": "write journal = ...",
    "--fresh": "a central that has crashed would forget its run",
    "--log": "write replicated_log = ...",
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
    it is ``$TCA_CENTRAL`` or else the default socket. With a replicated log, several addresses with
    commas between them: of each central.
    """
    bind: Annotated[str, Meta(description="one of the addresses, in quotes")] = ""
    """Which of several addresses is this computer's central. The central at the first address
    begins the run, and the others are its standbys. Without it, it is the first address.
    """
    replicated_log: Annotated[
        str, Meta(description='"trial", or the address of a log: "nats://host,host,host/NAME"')
    ] = ""
    """The replicated log of the run. A standby continues the run when central is gone. "trial"
    starts three NATS servers, central and a standby on this computer.
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
        """Whether it is central or its standby, which end after the modules."""
        return self.name in (CENTRAL, STANDBY) and self.journal is not None

    @property
    def ends_last(self) -> int:
        """When it ends: 0 for modules, 1 for centrals, 2 for the servers of their log."""
        return 1 if self.is_central else 2 * self.is_server

    is_server: bool = False
    """Whether it is a server of the log."""


class RobotFile(msgspec.Struct, frozen=True):
    """The checked content of a robot's file."""

    address: str
    """The address of central, or several with commas between them."""
    programs: list[Launch]
    """First central, unless it runs already."""
    log: Path | None = None
    """The file of what ``tca run`` says itself."""
    has_others: bool = False
    """Whether centrals of other computers may continue the run."""
    scratch: Path | None = None
    """The folder of a trial's log that no later start of ``tca run`` reads."""

    @property
    def logs(self) -> dict[str, Path]:
        """The files of output, by program."""
        found = {RUN: self.log, **{program.name: program.log for program in self.programs}}
        return {name: path for name, path in found.items() if path is not None}

    @property
    def folders(self) -> list[Path]:
        """The folders that must exist before the start."""
        servers = [program.cwd for program in self.programs if program.is_server]
        return servers + [path.parent for path in self.logs.values()]

    def only(self, names: list[str]) -> "RobotFile":
        """Return a copy with only the named programs; a module's name stands for all its copies.

        Raises BadUserFile.
        """
        known = {program.name.partition(".")[0] for program in self.programs}
        for name in names:
            if name not in known:
                raise BadUserFile(f"--only {name}: {nearest_or_all(name, known)}")
        programs = [
            one
            for one in self.programs
            if one.name.partition(".")[0] in names or (one.is_server and CENTRAL in names)
        ]
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
    if ":*" in address:
        raise BadUserFile(f"central.address is {address}: name a port, so that modules find it")
    for option in central.options:
        if instead := _NOT_AS_OPTIONS.get(option.partition("=")[0]):
            raise BadUserFile(f"central.options: leave {option} out: {instead}")
    address, programs = _centrals(central, address, folder)
    environment = _environment(address, starts_central=central.start)
    for name, table in tables.get("modules", {}).items():
        programs += _copies(name, table, common, environment, folder)
    names = {one.name.partition(".")[0] for one in programs if one.is_central or one.is_server}
    if used := next((one for one in tables.get("modules", {}) if one in names), None):
        raise BadUserFile(
            f"modules.{used}: choose another name: the replicated log has such programs"
        )
    if not programs:
        raise BadUserFile("there are no programs to run: add a table [modules.NAME] with a command")
    servers = [one.cwd for one in programs if one.is_server]
    scratch = servers[0] if servers and not central.journal else None
    has_others = central.replicated_log not in ("", _TRIAL)
    log = _log(folder, common.get("log", ""), RUN)
    return RobotFile(address, programs, log, has_others, scratch)


def _centrals(table: CentralTable, address: str, folder: Path) -> tuple[str, list[Launch]]:
    """Return the addresses of all centrals, and the launches of those of this computer.

    Each run of the robot has its own journal, unless the file names a journal. If central is
    restarted during the run, it continues with the same journal. Raises BadUserFile.
    """
    try:
        addresses = addresses_in(address)
    except BadAddresses as error:
        raise BadUserFile(f"central.address: {error}") from None
    _check_log(table, addresses)
    if not table.start:
        return address, []
    journal = _path(folder, table.journal) if table.journal else new_journal()
    if table.replicated_log != _TRIAL:
        bind = table.bind or addresses[0]
        command = _CENTRAL if bind == addresses[0] else _STANDBY
        log = table.replicated_log
        return address, [_central(table, folder, CENTRAL, command, address, bind, journal, log)]
    log, commands = trial_log(journal / SERVERS)
    both = addresses if len(addresses) > 1 else [*addresses, second_address(addresses[0])]
    address = ",".join(both)
    leads = _central(table, folder, CENTRAL, _CENTRAL, address, both[0], journal, log)
    beside = journal / STANDBY
    follows = _central(table, folder, STANDBY, _STANDBY, address, both[1], beside, log)
    servers = [
        Launch(
            name=f"{SERVERS}.{number}",
            command=command,
            cwd=journal / SERVERS,
            env=leads.env,
            limits=table,
            is_left_down=True,
            is_server=True,
        )
        for number, command in enumerate(commands, 1)
    ]
    return address, [*servers, leads, follows]


def _check_log(table: CentralTable, addresses: list[str]) -> None:
    """Check the replicated log, and the addresses of its centrals. Raises BadUserFile."""
    log, bind = table.replicated_log, table.bind
    if log and not table.start:
        raise BadUserFile("central.replicated_log: leave it out, because start is false")
    if table.log.startswith("nats://"):
        raise BadUserFile("central.log is a folder for output: write replicated_log = ...")
    if bind and bind not in addresses:
        raise BadUserFile(
            f"central.bind is not in central.address: {nearest_or_all(bind, addresses)}"
        )
    if len(addresses) > 1 and table.start and not log:
        raise BadUserFile("central.address has several addresses: add replicated_log = ...")
    if log == _TRIAL and (bind or len(addresses) > 2):
        raise BadUserFile(
            'central.replicated_log is "trial": give at most two addresses, and leave bind out'
        )
    if log and find_spec("nats") is None:
        raise BadUserFile(missing_package("central.replicated_log", "nats-py", "log"))
    if log and log != _TRIAL:
        try:
            log_in(log)
        except ValueError as error:
            raise BadUserFile(f"central.replicated_log: {error}") from None


def _central(
    table: CentralTable,
    folder: Path,
    name: str,
    command: list[str],
    addresses: str,
    bind: str,
    journal: Path,
    log: str,
) -> Launch:
    """Return the launch of a central."""
    options = ["--bind", bind, "--journal", str(journal), *table.options]
    options += ["--log", log] if log else []
    return Launch(
        name=name,
        command=[sys.executable, "-m", *command, *options],
        cwd=folder,
        env=_environment(addresses, starts_central=True),
        limits=table,
        journal=journal,
        log=_log(folder, table.log, name),
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
