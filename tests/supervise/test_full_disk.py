"""A central with a full disk does not count as crashed."""

import os
from pathlib import Path

from tca_tools.supervise.output import Output
from tca_tools.supervise.programs import Programs
from tca_tools.supervise.robot_file import CENTRAL, Launch, Limits
from tca_tools.supervise.supervised import Supervised
from tca_wire.vocabulary import DISK_FULL

STARTS = 4


def test_central_is_restarted_until_the_disk_has_room(tmp_path: Path) -> None:
    """The disk has room at each check, but not when central starts. One crash would end the run."""
    script = f'echo >>starts; test "$(wc -l <starts)" -eq {STARTS} || exit {DISK_FULL}'
    program = Launch(
        name=CENTRAL,
        command=["sh", "-c", script],
        cwd=tmp_path,
        env=dict(os.environ),
        journal=tmp_path / "run",
        restart="never",
        limits=Limits(restarts=0, delay=0.0),
    )
    events: list[str] = []
    nothing = os.open(os.devnull, os.O_WRONLY)
    output = Output([CENTRAL], nothing, in_colour=False)
    output.start()
    with Programs() as programs:
        kept = Supervised(program, output, events.append, programs)
        kept.run()
    output.close(10)
    os.close(nothing)
    assert kept.code == 0
    assert [line.split(" (")[0] for line in events[:2]] == [
        "central started",
        f"central waits for room on the disk of {tmp_path / 'run'}",
    ]
    assert len((tmp_path / "starts").read_text()) == STARTS
