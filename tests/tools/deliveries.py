"""The three runs of figure 7 as journals: deliveries by a real coordinator, on a stepped clock."""

from pathlib import Path

from coordination.delivery_robot import delivery, play
from tools.runs import OPENED

from tca_coordination import Discrete, Policy
from tca_wire.journal.facts import Entry
from tca_wire.journal.records import record

LIKELY = Discrete(0.5, utility=lambda candidate: candidate.probability)


def deliver(free: float, policy: Policy | None = LIKELY, changed: float | None = None) -> list[Entry]:
    """An object is delivered to box B if it is free; after 2 s that may change."""
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


def written(entries: list[Entry], folder: Path) -> Path:
    """A journal of them."""
    folder.mkdir()
    (folder / "00000001.tcaj").write_bytes(b"".join(map(record, entries)))
    return folder


def figure_7(folder: Path) -> list[Path]:
    """Journals of the best case, of a box that is occupied on the way, and of plain execution in the worst case."""
    return [
        written(deliver(1.0), folder / "free"),
        written(deliver(1.0, changed=0.0), folder / "occupied on the way"),
        written(deliver(0.0, policy=None), folder / "without preview"),
    ]
