"""The shell completes names from a running central, and from a journal."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from processes import Central, central, program, run

pytestmark = pytest.mark.slow

MODULE = """
    import sys
    from tca_module import Command, Goal, Inform, Module, Query, Variable

    legs = Module("legs")
    legs.resource("left leg")
    for message in (Goal("walk", int), Inform("note", int), Variable("speed", int)):
        legs.handles(message, resource="left leg")(lambda task, data: None)
    for message in (Command("wait a bit"), Query("where", reply=int)):
        legs.handles(message, resource="left leg")(lambda task: None)
    with legs.running():
        print("runs", flush=True)
        sys.stdin.read()
"""


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Central]:
    folder: Path = tmp_path_factory.mktemp("robot")
    with central(folder) as running, program(MODULE, running.address) as legs:
        legs.hear("runs")
        yield running


@pytest.mark.parametrize(
    ("line", "names"),
    [
        ("tca send w", ["wait a bit", "walk", "where"]),
        ("tca send ", ["note", "wait a bit", "walk", "where"]),
        ("tca query ", ["where"]),
        ("tca set s", ["speed"]),
        ("tca kill w", ["wait a bit", "walk"]),
        ("tca unlock l", ["left leg"]),
        ("tca tree --task w", ["wait a bit", "walk"]),
        ("tca gantt --module l", ["legs"]),
    ],
)
def test_names_are_completed(robot: Central, line: str, names: list[str]) -> None:
    done = run(
        "tca",
        TCA_CENTRAL=robot.address,
        _TCA_COMPLETE="zsh_complete",
        COMP_WORDS=line,
        COMP_CWORD=str(line.count(" ")),
    )
    assert done.stdout.splitlines()[1::3] == names


def test_spaces_are_escaped_for_bash(robot: Central) -> None:
    words = {"COMP_WORDS": "tca send wai", "COMP_CWORD": "2", "_TCA_COMPLETE": "bash_complete"}
    done = run("tca", TCA_CENTRAL=robot.address, **words)
    assert done.stdout == "plain,wait\\ a\\ bit\n"


def test_nothing_is_completed_without_central(tmp_path: Path) -> None:
    words = {"COMP_WORDS": "tca send wai", "COMP_CWORD": "2", "_TCA_COMPLETE": "bash_complete"}
    assert run("tca", TCA_CENTRAL=f"ipc://{tmp_path}/none", **words).stdout.strip() == ""
