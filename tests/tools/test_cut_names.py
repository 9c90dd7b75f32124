"""A task's number is what tells it from others of its name: it stays where the name has no room."""

import pytest
from tools.story import Story

from tca_tools.run.at_time import RunAt
from tca_tools.tasktree_viz.outline import whole_outline
from tca_tools.tasktree_viz.outline_svg import outline_svg
from tca_tools.tasktree_viz.text import tree_lines
from tca_tools.terminal import columns_of, cut_name

LONG = "pour concrete with a really very long name that has no end in sight at all"


@pytest.mark.parametrize(
    ("width", "told"),
    [
        (40, "pour concrete {24} (exception handler)"),
        (30, "pour concrete {24}"),
        (18, "pour concrete {24}"),
        (17, "pour concre… {24}"),
        (10, "pour conc…"),
    ],
)
def test_the_number_stays_as_long_as_something_of_the_name_does(width: int, told: str) -> None:
    found = cut_name("pour concrete {24} (exception handler)", 24, width)
    assert (found, columns_of(found) <= width) == (told, True)


def test_numbers_of_long_names_are_seen_in_trees() -> None:
    story = Story().at(1.0)
    tasks = [story.command(LONG, "user") for _ in range(2)]
    at = RunAt(story.fold(), 9.0)
    rows = whole_outline(at)
    assert all(
        f"… {{{task}}}" in line for task, line in zip(tasks, list(tree_lines(at, rows, width=100))[1:], strict=True)
    )
    assert all(f"… {{{task}}}" in outline_svg(at, rows, "long") for task in tasks)
