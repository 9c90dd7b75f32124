"""Commands of the pages beside the tutorial print what their blocks show."""

from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest
from docs.pages import BLOCKS, DOCS, ROOT, Block
from docs.steps import EXAMPLES, File, Step, steps_of
from docs.terminals import Player

FETCH = ("tca central --quiet --journal j1", "python examples/01_fetch.py", "tca central --stop")
OVEN = """\
from runpy import run_path

example = run_path("examples/40_task_server.py")
tasks = [example["Heat"], example["Measure"]]
example["TaskServer"]("oven", example["Oven"](), tasks=tasks, rate=50.0).run()
"""
FIRST = {
    "README.md: $ python deliver.py": ("tca central --quiet",),
    "docs/packages/missions.md: $ python examples/41_mission.py": ("tca central --quiet",),
    "docs/packages/task-servers.md: $ tca send": ("tca central --quiet", f"python -c '{OVEN}'"),
    "docs/tools/check.md: $ tca check j1": FETCH,
    "docs/tools/command-line.md: $ tca tree": ("tca central --stop", *FETCH),
    "docs/tools/exports.md: $ tca stats j1": FETCH,
    "docs/tools/reports.md: $ pip install": FETCH,
}
"""What the prose has the reader start before a block, each in a terminal of its own."""
NOT_PLAYED = {
    "docs/concepts/survival.md: central: continues the unfinished run": "the tutorial does it",
    "docs/how-to/give-permissions.md: $ tca central --bind": "two computers",
    "docs/how-to/give-permissions.md: $ tca send patrol": "two computers",
    "docs/how-to/start-at-boot.md: 17 4 * * *": "a line of a crontab",
    "docs/how-to/survive-a-machine.md: $ tca run": "a central is killed",
    "docs/how-to/survive-a-machine.md: $ export": "three computers",
    "docs/how-to/use-another-computer.md: $ tca keys new": "two computers",
    "docs/how-to/use-another-computer.md: $ scp": "two computers",
    "docs/packages/missions.md: $ pip install": "IPython, in a terminal",
    "docs/reference/protocol.md: 00 00": "bytes of a packet",
    "docs/robots/ambler.md: 12 footsteps": "a walk of minutes",
    "docs/robots/office.md: collect cup": "a shift of minutes",
    "docs/robots/turtle.md: mission show": "a robot with pictures",
}
"""Why a block is not played, by its page and the beginning of its first line."""
DEAR = {"docs/how-to/after-a-crash.md", "docs/how-to/test-without-a-daemon.md"}
VARYING = {"docs/tools/check.md", "docs/tools/exports.md", "docs/packages/task-servers.md"}
"""The pages whose commands print other numbers each time."""
WIDTH = {"docs/tools/exports.md": 88}
"""The columns of the terminal, if the page needs a certain number."""


def page_of(block: Block) -> str:
    return str(block.page.relative_to(ROOT))


def shows_output(block: Block) -> bool:
    lines = [line for line in block.text.splitlines() if line.strip()]
    if block.language == "console":
        return any(not line.lstrip().startswith("$ ") for line in lines)
    return block.language == "text" and not block.is_quote


def key_of(block: Block, table: Iterable[str]) -> str | None:
    """Return the key of a block: its page, and the beginning of its first line."""
    line = f"{page_of(block)}: {block.text.splitlines()[0]}"
    return next((key for key in table if line.startswith(key)), None)


SHOWN = [
    block for block in BLOCKS if block.page.parent != DOCS / "tutorial" and shows_output(block)
]
PLAYED = [block for block in SHOWN if key_of(block, NOT_PLAYED) is None]
PLAYED_PAGES = [
    pytest.param(page, marks=[pytest.mark.soak] if page in DEAR else [], id=page)
    for page in dict.fromkeys(map(page_of, PLAYED))
]


def steps_on(page: str) -> Iterator[File | Step]:
    """Yield the steps of the files, and of the blocks that show an output."""
    started = set[str]()
    for block in BLOCKS:
        if page_of(block) == page and (block in PLAYED or block.language in {"python", "toml"}):
            key = key_of(block, FIRST.keys() - started)
            if key is not None:
                started.add(key)
                for command in FIRST[key]:
                    yield Step(command.split("\n")[0], f"$ {command}", [], None)
            yield from steps_of([block])


@pytest.mark.slow
@pytest.mark.parametrize("page", PLAYED_PAGES)
def test_blocks_of_a_page_print_what_they_show(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TCA_CENTRAL", raising=False)
    width, varies = WIDTH.get(page, 120), page in VARYING
    player = Player(tmp_path, columns=width, all_numbers=varies, tells_jobs=False)
    (player.folder / "examples").symlink_to(EXAMPLES)
    player.play(steps_on(page))


def test_printed_texts_are_consoles_or_listed() -> None:
    assert [block.where for block in PLAYED if block.language == "text"] == []


@pytest.mark.parametrize("table", [FIRST, NOT_PLAYED], ids=["first", "not played"])
def test_listed_blocks_exist(table: dict[str, object]) -> None:
    assert table.keys() - {key_of(block, table) for block in SHOWN} == set()
