"""A daemon for one test, with the programs of a robot as processes."""

import os
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

from tca_module import connect
from tca_module.rig import Rig
from tca_tools.supervise.programs import START_TIME, Programs, central_in
from tca_tools.supervise.robot_file import load
from tca_wire.endpoint import VARIABLE


class DaemonOfTest(Rig):
    """A central that runs as a process of its own, for one test.

    Attributes:
        address: its address. ``$TCA_CENTRAL`` has it, too, during the test.
        journal: the folder of its journal.
        programs: the processes, to start, stop and kill them; central is "central".

    Example::

        tca_daemon.start_robot("robot.toml")
        with connect("test") as user:
            assert user.goal(PATROL).wait(timeout=30) is Outcome.DONE
    """

    def __init__(self, address: str, journal: Path, programs: Programs) -> None:
        super().__init__(address)
        self.address = address
        self.journal = journal
        self.programs = programs

    def start_robot(self, file: str | Path, *, leave_out: Collection[str] = ()) -> None:
        """Start the programs of a robot's file as processes, all but central.

        A program that ends is not started again. Its output is in the log of its name.

        Args:
            file: the path of a file for ``tca run``.
            leave_out: the names of programs that are not started, such as those whose messages
                the test fakes. Default: none.

        Raises:
            BadUserFile: the file is wrong, or has no such program.
            OSError: a program can't be started.

        Example::

            tca_daemon.fake(DRIVE)
            tca_daemon.start_robot("robot.toml", leave_out=["wheels"])
        """
        robot = load(Path(file))
        kept = {one.name.partition(".")[0] for one in robot.programs} - set(leave_out)
        robot.only(list(leave_out))
        for program in robot.only(sorted(kept)).programs:
            if not program.ends_last:
                environment = {**program.env, VARIABLE: self.address}
                self.programs.start(
                    program.name, *program.command, cwd=program.cwd, env=environment
                )


@contextmanager
def daemon_in(folder: Path) -> Iterator[DaemonOfTest]:
    """A context with a central of its own, whose journal and logs are in *folder*."""
    with central_in(folder, is_fresh=False) as (address, programs):
        connect("pytest", address, patience=START_TIME).close()  # it has started
        daemon = DaemonOfTest(address, folder / "journal", programs)
        before = os.environ.get(VARIABLE)
        os.environ[VARIABLE] = address
        try:
            yield daemon
        finally:
            daemon.close()
            os.environ.pop(VARIABLE)
            if before is not None:
                os.environ[VARIABLE] = before
