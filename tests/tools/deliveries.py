"""The three runs of figure 7 as journals: deliveries by a real coordinator, on a stepped clock."""

from pathlib import Path

from coordination.delivery_robot import AS_SOON_AS_LIKELY, HOME, arm, delivery, opened, play
from coordination.test_previews import fork
from tools.runs import OPENED

from tca_behaviours.coordination import Coordination, Policy
from tca_wire.journal.facts import Entry
from tca_wire.journal.records import record


def deliver(
    free: float, policy: Policy | None = AS_SOON_AS_LIKELY, changed: float | None = None
) -> list[Entry]:
    """Return the entries of a delivery to box B if it is free. After 2 s, *free* may become
    *changed*.
    """
    with play(delivery(), policy) as run:
        ran = run.begin()
        run.box_b(free)
        run.event("object given")
        run.central.advance(2.0)
        if changed is not None:
            run.box_b(changed)
        run.central.advance(60.0)
        ran.result(timeout=5)
        return [OPENED, *run.central.entries]


def undone() -> list[Entry]:
    """Return the entries of a run in which box B turns out to be taken while the arm is ahead
    there. The arm must go home first.
    """
    return _taken_after(4, fork(arm("box B", undo=HOME), opened(arm="home")))


def too_late() -> list[Entry]:
    """Return the entries of a run in which box B turns out to be taken while the arm is ahead
    there. The arm reaches box C after the base.
    """
    return _taken_after(6, fork(arm("box B"), arm("box C")))


def _taken_after(seconds: float, machine: Coordination) -> list[Entry]:
    with play(machine, AS_SOON_AS_LIKELY) as run:
        run.box_b(1.0)
        ran = run.begin()
        run.central.advance(seconds)
        run.box_b(0.0)
        run.central.advance(20)
        ran.result(timeout=5)
        return [OPENED, *run.central.entries]


def held_up() -> list[Entry]:
    """Return the entries of two runs. A branch needs the arm at home, so the arm waits for its turn
    in both.
    """
    with play(fork(arm("box B"), opened(arm="home")), AS_SOON_AS_LIKELY) as run:
        run.box_b(1.0)
        for _ in range(2):
            ran = run.begin()
            run.central.advance(20)
            ran.result(timeout=5)
        return [OPENED, *run.central.entries]


def killed() -> list[Entry]:
    """Return the entries of a delivery that is killed while the arm moves ahead."""
    with play(delivery(), AS_SOON_AS_LIKELY) as run:
        ran = run.begin()
        run.box_b(1.0)
        run.event("object given")
        run.central.advance(2)
        ran.kill("not now")
        run.central.advance(5)
        return [OPENED, *run.central.entries]


def written(entries: list[Entry], folder: Path) -> Path:
    """Write entries as a journal."""
    folder.mkdir()
    (folder / "00000001.tcaj").write_bytes(b"".join(map(record, entries)))
    return folder


def figure_7(folder: Path) -> list[Path]:
    """Write three journals: the best case, a box that is occupied on the way, and the worst case
    without preview.
    """
    return [
        written(deliver(1.0), folder / "free"),
        written(deliver(1.0, changed=0.0), folder / "occupied on the way"),
        written(deliver(0.0, policy=None), folder / "without preview"),
    ]
