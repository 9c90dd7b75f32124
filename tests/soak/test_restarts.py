"""One journal survives hundreds of power cuts, or dozens of full disks, with unattended restarts."""

import os
import re
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from pathlib import Path
from random import Random

import pytest
from processes import run
from simulation.life import Life
from simulation.options import FEATURES, Options
from supervise.robot_files import HASTY, kill, robot

from tca_central.shell.log_writer import Sync
from tca_module import Command, Module, Refused, connect
from tca_tools.journal.journals import open_log
from tca_wire.journal.facts import Received
from tca_wire.vocabulary import DISK_FULL

CUTS, DISKS = 500, 30
STEP, LONG = Command("step", str, result=int), 4000


def life(sync: Sync, seconds: float, cuts: int) -> None:
    """Run a life with users. Central is killed again and again, often by a power cut. The disk is
    full now and then.
    """
    features = frozenset(FEATURES) - ({"lock"} if sync is Sync.BATCH else set())
    options = Options(
        seconds=seconds,
        central_crashes=0.008,
        power_cuts=0.7,
        full_disks=0.0005,
        sync=sync,
        snapshots=0.01,
        users=2,
        actions=round(0.6 * seconds),
        features=features,
        away=0.5,
        slow=0.05,
        crashes=0.02,
        checks_each=64,
    )
    daemon = Life(7, options).run().daemon
    assert daemon.cuts >= cuts
    assert daemon.crashes > daemon.cuts
    print(
        f"\n{sync}: {daemon.crashes} ends of central, {daemon.cuts} power cuts, {daemon.full} failures on a full disk"
    )


@pytest.mark.parametrize("sync", [Sync.ALWAYS, Sync.BATCH])
def test_journal_survives_eight_power_cuts(sync: Sync) -> None:
    life(sync, 20.0, 8)


@pytest.mark.soak
@pytest.mark.parametrize("sync", [Sync.ALWAYS, Sync.BATCH])
def test_journal_survives_five_hundred_power_cuts(sync: Sync) -> None:
    life(sync, 750.0, CUTS)


@contextmanager
def small_disk(place: Path) -> Iterator[Path]:
    """Mount a separate disk of 32 megabytes for the block."""
    place.mkdir()
    if (
        os.getuid()
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", place], check=False
        ).returncode
    ):
        pytest.skip("only root can mount a small disk: run it as root")
    try:
        yield place
    finally:
        subprocess.run(["umount", "-l", place], check=True)


def fill(ballast: Path, spare: int) -> None:
    """Fill a disk up to *spare* bytes."""
    with suppress(OSError), ballast.open("wb", 0) as stream:
        while stream.write(bytes(4096)):
            pass
    os.truncate(ballast, max(0, ballast.stat().st_size - spare))


def use(address: str, ballast: Path, spare: int) -> set[int]:
    """Fill the disk, and send more tasks than it can hold. Return the accepted tasks, all of which
    are done.
    """
    found = set()
    with connect("user", address, patience=60) as user:
        user.status()
        fill(ballast, spare)
        tasks = [user.command(STEP, "x" * LONG) for _ in range(12)]
        for task in tasks:
            with suppress(Refused):  # while the disk is nearly full
                assert task.result(timeout=60) == LONG
                found.add(int(task.id))
    return found


@pytest.mark.soak
def test_journal_survives_thirty_full_disks(tmp_path: Path) -> None:
    """``tca run`` waits for room, and other starts of central fail. Sometimes central is killed
    after it has returned.
    """
    address, dice, known = f"ipc://{tmp_path}/c.sock", Random(7), set[int]()
    legs = Module("legs", address)

    @legs.handles(STEP)
    def step(_: object, text: str) -> int:
        return len(text)

    with small_disk(tmp_path / "disk") as disk, ThreadPoolExecutor(1) as pool:
        text = f"{HASTY}restarts = 1000\n[central]\naddress = '{address}'\njournal = '{disk}/journal'\n"
        with robot(tmp_path, text + "options = ['--sync', 'always']\n") as running:
            running.hear("listening on")
            with legs.running(patience=60):
                for _ in range(DISKS):
                    using = pool.submit(
                        use, address, disk / "ballast", dice.choice((0, 4096, 8192))
                    )
                    running.hear("waits for room")
                    assert (
                        run("-m", "tca_central", "--journal", f"{disk}/journal").returncode
                        == DISK_FULL
                    )
                    (disk / "ballast").unlink()
                    running.hear("listening on")
                    if dice.random() < 0.5:
                        kill(running.groups["central"])
                        running.hear("listening on")
                    known |= using.result()
            running.process.terminate()
            assert running.end()[0] == 0
        received = [
            fact
            for entry in open_log(disk / "journal")
            for fact in entry.facts
            if isinstance(fact, Received)
        ]
    assert known
    assert known <= {fact.id for fact in received}
    assert not re.search("differs|damaged|--fresh", running.said)
    print(
        f"\n{DISKS} full disks: {running.said.count('central started')} starts, {len(known)} tasks taken and done"
    )
