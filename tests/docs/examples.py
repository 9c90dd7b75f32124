"""The examples, and what they print: the files in ``examples/printed``."""

import re
from pathlib import Path

EXAMPLES = Path(__file__).parents[2] / "examples"
ANY_ORDER = {"03_plan_ahead", "21_start_up_order", "25_mutex"}
"""Examples of programs whose lines may come in another order."""


def agrees(name: str, printed: str) -> bool:
    """Compare the output of an example with the expected one, where ``...`` stands for any text."""
    expected = (EXAMPLES / "printed" / f"{name}.txt").read_text()
    if name in ANY_ORDER:
        return sorted(printed.splitlines()) == sorted(expected.splitlines())
    pattern = ".*".join(re.escape(part) for part in expected.split("..."))
    return re.fullmatch(pattern, printed, re.DOTALL) is not None
