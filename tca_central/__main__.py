"""The command line of the daemon: arguments, journal, signals."""

import contextlib
import gc
import logging
import os
import signal
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from secrets import token_hex
from typing import Any

import click

from tca_central.core import Central
from tca_central.errors import CentralError, DiskFull
from tca_central.loading import is_compiled
from tca_central.replication.follower import FollowedRunLost
from tca_central.replication.member import SILENT, Member
from tca_central.replication.shared_data import SharedData
from tca_central.replication.shared_log import Deposed, log_in
from tca_central.shell.bound_socket import check_can_bind
from tca_central.shell.bytes_option import Bytes
from tca_central.shell.door import raise_descriptor_limit
from tca_central.shell.gate import OpenGate, gate_for
from tca_central.shell.kept_data import KeptData
from tca_central.shell.log_limit import LineLimit
from tca_central.shell.log_lines import LineFormatter
from tca_central.shell.log_writer import Sync, is_in_use
from tca_central.shell.recovery import unfinished_segments
from tca_central.shell.run_folder import RunFolder
from tca_central.shell.server import LOST_AFTER, Daemon
from tca_central.shell.store import Store
from tca_wire.endpoint import (
    VARIABLE,
    NoHome,
    default_endpoint,
    is_loopback,
    journal_link,
    new_journal,
)
from tca_wire.errors import KeyRefused
from tca_wire.release import release
from tca_wire.standard_streams import replace_closed_streams
from tca_wire.text.missing import missing_package
from tca_wire.vocabulary import DISK_FULL

log = logging.getLogger("tca.central")

LONGEST_PATH = 100
"""Bytes in the path of a Unix socket. The limits of systems are between 103 and 107."""

INSECURE = (
    "every program of this computer can connect, and do everything (--insecure): "
    "make keys with 'tca keys new NAME'"
)

CORE = "compiled" if is_compiled() else "pure Python"


@dataclass(frozen=True)
class Options:
    """The options of the command line, by the names of their parameters."""

    bind: str | None
    journal: Path | None
    sync: str
    resume: tuple[str, ...]
    permissions: Path | None
    log_address: str | None
    if_fails: str
    lost_after: int
    memory: int
    tap_depth: int
    task_depth: int
    no_journal: bool
    no_inputs: bool
    fresh: bool
    insecure: bool
    quiet: bool
    is_standby: bool = False  #: whether another central leads
    has_followed: bool = False  #: whether this process has followed or led the run before
    after: float = SILENT  #: seconds of silence after which a standby leads
    folder: Path | None = None  #: the folder of the journal, with a replicated log


class _NoRoom(click.ClickException):
    exit_code = DISK_FULL


def _checked_lost_after(_context: click.Context, _option: click.Parameter, seconds: int) -> int:
    """Return the value of --lost-after. Raise BadParameter if it is too short."""
    if seconds == 1:
        msg = (
            "1 is too short to tell a stopped process from a busy computer: "
            "give 2 or more, or 0 for never"
        )
        raise click.BadParameter(msg)
    return seconds


def _unfinished_at(address: str, *, is_fresh: bool, accept: bool) -> Path | None:
    """Return the journal of an address's last central, if its run is unfinished and continues.

    Return None otherwise. Raises CentralError.
    """
    try:
        folder = journal_link(address).readlink()
        if is_fresh or not folder.is_dir() or is_in_use(folder):
            return None
        return folder if unfinished_segments(folder, accept=accept) else None
    except (OSError, NoHome):
        return None


def _run_folder(options: Options, address: str, store: Store) -> RunFolder:
    """Return the folder of the run at an address, with the run that continues, if any.

    Raises CentralError.
    """
    is_fresh, accept = options.fresh or options.no_inputs, "facts" in options.resume
    journal = options.journal
    unfinished = None if journal else _unfinished_at(address, is_fresh=is_fresh, accept=accept)
    folder = journal or unfinished or new_journal()
    return RunFolder(folder, is_fresh=is_fresh, accept=accept, adopt=store.adopt)


def _kept_data(run: RunFolder | Member | None, sync: Sync, *, keeps_tasks: bool) -> KeptData | None:
    """Return the copies of large data, on the disk or in the log; None without a journal."""
    if run is None:
        return None
    if isinstance(run, Member):
        return SharedData(run.shared, run.path, run.central.epoch, sync)
    return KeptData(run.path, run.central.epoch, sync, keeps_tasks=keeps_tasks)


def _member(options: Options, address: str, store: Store, key: str) -> Member:
    """Return this central as one of those with the same log. Raises CentralError."""
    try:
        from tca_central.replication.jetstream import JetStreamLog  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise CentralError(missing_package("--log", str(error.name), "log")) from None
    shared = JetStreamLog(*log_in(str(options.log_address)))
    try:
        return Member(shared, address, options.folder or new_journal(), store, key)
    except BaseException:
        shared.close()
        raise


def _lead(member: Member, options: Options) -> bool:
    """Lead, at once or as a standby. Return False if a signal or the run's end came first."""
    check_can_bind(str(options.bind))
    if not options.is_standby:
        member.begin(is_fresh=options.fresh)
        return True
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
        signal.signal(number, lambda number, _: signals.append(number))
    signal.signal(signal.SIGUSR2, lambda *_: member.lead_now())
    return member.stand_by(
        lambda: bool(signals), after=options.after, has_followed=options.has_followed
    )


def _check_address(bind: str, *, insecure: bool) -> None:
    """Raise UsageError if an address is invalid, or lets other machines connect without a key."""
    if "," in bind:
        msg = f"central listens at one address, and '{bind}' has several: give one with --bind"
        raise click.UsageError(msg)
    port = bind.rpartition(":")[2]
    is_number = port.isascii() and port.isdigit()
    is_tcp = bind.startswith("tcp://") and (port == "*" or (is_number and 0 < int(port) < 65536))
    if bind.startswith("ipc:///") and len(bind) > LONGEST_PATH + len("ipc://"):
        msg = f"{bind} is too long: the path of a socket has at most {LONGEST_PATH} bytes"
        raise click.UsageError(msg)
    if not is_tcp and not bind.startswith("ipc:///"):
        msg = (
            f"'{bind}' is not an address: use ipc:///path/of/socket or tcp://127.0.0.1:port "
            "(port * for a free one)"
        )
        raise click.UsageError(msg)
    if is_tcp and insecure and not is_loopback(bind):
        msg = (
            f"{bind} can be reached from other machines, so every program needs a key: "
            "leave --insecure out, and make keys with 'tca keys new NAME'"
        )
        raise click.UsageError(msg)


def _check_log_options(options: Options) -> None:
    """Raise UsageError for options that contradict --log."""
    if options.log_address is None:
        return
    wrong = {
        "--no-journal": options.no_journal,
        "--no-inputs": options.no_inputs,
        "--if-journal-fails go-on": options.if_fails != "stop",
        "--resume facts": "facts" in options.resume,
    }
    for option, is_given in wrong.items():
        if is_given:
            raise click.UsageError(f"leave {option} out: with --log the inputs are in the log")


def _link_journal(address: str, journal: Path | None, *, is_named: bool) -> None:
    """Link a journal to its address, so that tools find it. Without a journal remove the link.

    A journal that *is_named* by an option is also linked as the newest one, which tools show by
    default.
    """
    with contextlib.suppress(OSError, NoHome):
        link = journal_link(address)
        if journal is not None and is_named:
            _link(new_journal(), journal.resolve())
        link.unlink(missing_ok=True)
        if journal is not None:
            _link(link, journal.resolve())


def _link(link: Path, folder: Path) -> None:
    """Link a folder, and remove links beside it that are broken or lead to the same folder."""
    link.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    for other in link.parent.iterdir():
        if other.is_symlink() and (not other.exists() or other.resolve() == folder):
            other.unlink(missing_ok=True)
    link.symlink_to(folder, target_is_directory=True)


def _set_up_logging(*, quiet: bool) -> None:
    """Log to standard error, in limited lines."""
    replace_closed_streams()
    lines = logging.StreamHandler()
    lines.setFormatter(LineFormatter("central: %(message)s"))
    lines.addFilter(LineLimit())
    logging.basicConfig(level=logging.WARNING if quiet else logging.INFO, handlers=[lines])


def _install_signal_handlers(server: Daemon, *, is_shared: bool) -> None:
    """Stop at SIGINT and SIGTERM, and at SIGUSR1 so that the run continues at the next start.

    With a shared log the run also continues after SIGTERM, which a computer sends to all programs
    when it is turned off. At SIGHUP check files again or, if the terminal was closed, stop as after
    SIGTERM.
    """
    signal.signal(signal.SIGINT, lambda *_: server.stop(signal.SIGINT.name))
    signal.signal(signal.SIGTERM, lambda *_: server.stop(signal.SIGTERM.name, keep=is_shared))
    signal.signal(signal.SIGUSR1, lambda *_: server.stop(signal.SIGUSR1.name, keep=True))
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)  # it leads already
    has_terminal = os.isatty(sys.stderr.fileno())

    def on_hangup(*_: object) -> None:
        """Check keys and permissions again; or end, if the terminal was closed."""
        if has_terminal and not os.isatty(sys.stderr.fileno()):
            server.stop(signal.SIGHUP.name, keep=is_shared)
        else:
            server.check_soon()

    signal.signal(signal.SIGHUP, on_hangup)


@click.command()
@click.option(
    "--bind",
    metavar="ADDRESS",
    help=f"Where to listen [default: ${VARIABLE}, else a socket of your own].",
)
@click.option(
    "--journal",
    type=click.Path(path_type=Path),
    help="Folder for the journal, where tools find it; it may hold earlier runs [default: the "
    "folder of this address's unfinished run, else a new one; with --log a new one].",
)
@click.option("--no-journal", is_flag=True, help="Keep no journal.")
@click.option(
    "--sync",
    type=click.Choice([str(sync) for sync in Sync]),
    default="batch",
    show_default=True,
    help="When the journal is safe: 'always' on the disk before messages leave, 'batch' with the "
    "kernel by then and on the disk within a second, 'none' whenever convenient.",
)
@click.option(
    "--no-inputs", is_flag=True, help="Store no inputs: after a crash central starts a new run."
)
@click.option(
    "--if-journal-fails",
    "if_fails",
    type=click.Choice(["stop", "go-on"]),
    default="stop",
    show_default=True,
    help="When the journal can't be written: 'go-on' continues without a journal.",
)
@click.option(
    "--fresh",
    is_flag=True,
    help="Start a new run, even if the last one is unfinished.",
)
@click.option(
    "--resume",
    type=click.Choice(["hold", "facts"]),
    multiple=True,
    help="How an unfinished run continues: 'hold' starts no task until 'tca resume', "
    "'facts' accepts a journal that does not match the inputs.",
)
@click.option(
    "--lost-after",
    type=click.IntRange(min=0),
    callback=_checked_lost_after,
    default=LOST_AFTER,
    show_default=True,
    metavar="SECONDS",
    help="Silence after which a program whose process stands still (stopped, paused) counts as "
    "lost; 0: never.",
)
@click.option(
    "--memory",
    type=Bytes(),
    default="512M",
    show_default=True,
    metavar="BYTES",
    help="How much central may hold of what modules send, for example 64M or 2G; beyond that it "
    "refuses and drops messages.",
)
@click.option(
    "--tap-depth",
    type=click.IntRange(min=1),
    default=8,
    show_default=True,
    metavar="NUMBER",
    help="How many listeners of wiretaps one chain of messages may call; beyond that it refuses "
    "tapped messages.",
)
@click.option(
    "--task-depth",
    type=click.IntRange(min=1),
    default=20_000,
    show_default=True,
    metavar="NUMBER",
    help="How many tasks may stand under one another; beyond that it refuses tasks.",
)
@click.option(
    "--insecure",
    is_flag=True,
    help="Over TCP, let every program of this computer connect without a key.",
)
@click.option(
    "--permissions",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A TOML file of what each key may do, read again when it changes [default: every program "
    "that connects may do everything].",
)
@click.option(
    "--log",
    "log_address",
    metavar="SERVERS",
    envvar="TCA_LOG",
    help="Keep inputs and images in a replicated log, nats://host:port,host:port/NAME, so that "
    "a standby can take over [default: $TCA_LOG, which hides a password from other users].",
)
@click.option("-q", "--quiet", is_flag=True, help="Log only what went wrong.")
@click.version_option(
    release(), prog_name="tca central", message=f"%(prog)s, version %(version)s, core: {CORE}"
)
def central(**options: Any) -> None:
    """Run the daemon that routes messages and keeps the task tree."""
    run_central(Options(**options))


def run_central(options: Options) -> None:
    """Run central until it ends, as one of several with the same log perhaps."""
    _set_up_logging(quiet=options.quiet)
    options = replace(options, bind=options.bind or default_endpoint())
    _check_address(str(options.bind), insecure=options.insecure)
    _check_log_options(options)
    if options.log_address is not None:  # the same if this central becomes a standby later
        options = replace(options, folder=options.journal or new_journal())
    raise_descriptor_limit()
    while True:
        try:
            _run_once(options)
        except (Deposed, FollowedRunLost) as error:
            log.warning("%s: this central follows the log from its start", error)
            gc.unfreeze()  # the state before is garbage now
            options = replace(options, is_standby=True, has_followed=True, fresh=False, resume=())
        except (CentralError, KeyRefused, NoHome) as error:
            raise (_NoRoom if isinstance(error, DiskFull) else click.ClickException)(
                str(error)
            ) from None
        else:
            return


def _run_once(options: Options) -> None:
    """Run central until it ends, or another one leads. Raises CentralError, KeyRefused, NoHome."""
    run: RunFolder | Member | None = None
    server: Daemon | None = None
    store, endpoint = Store(), str(options.bind)
    try:
        gate = gate_for(endpoint, options.permissions, insecure=options.insecure)
        if options.log_address is not None:
            run = member = _member(options, endpoint, store, gate.public_key)
            if not _lead(member, options):
                return
        elif not options.no_journal:
            run = _run_folder(options, endpoint, store)
        server = Daemon(
            Central(token_hex(8)) if run is None else run.central,
            endpoint,
            lost_after=options.lost_after,
            gate=gate,
            memory=options.memory,
            tap_depth=options.tap_depth,
            task_depth=options.task_depth,
            store=store,
        )
        _begin_run(options, run, server, store)
        if isinstance(gate, OpenGate):
            log.warning("%s", INSECURE)
        log.info("no journal" if run is None else f"journal in {run.path}{run.history}")
        # Objects that last as long as central need no scan in each garbage collection.
        gc.freeze()
        server.serve()
    except Deposed:
        if server is None or not server.stopping:
            raise
    finally:
        if server is not None:
            server.close()
        if run is not None:
            run.close()


def _begin_run(
    options: Options, run: RunFolder | Member | None, server: Daemon, store: Store
) -> None:
    """Open the files and the memory of a run, and let the server use them. Raises CentralError."""
    sync, keeps_inputs = Sync(options.sync), not options.no_inputs
    kept = _kept_data(run, sync, keeps_tasks=keeps_inputs)
    store.open(server.central.epoch, kept, succeeds_living=options.is_standby)
    server.continues_unrecorded = options.if_fails == "go-on"
    if run is not None:
        run.open(server, sync, keeps_inputs=keeps_inputs, hold="hold" in options.resume)
    journal = None if run is None else run.path
    _link_journal(server.endpoint, journal, is_named=options.journal is not None)
    _install_signal_handlers(server, is_shared=options.log_address is not None)
    log.info("listening on %s", server.endpoint)


if __name__ == "__main__":
    central(prog_name="tca central")
