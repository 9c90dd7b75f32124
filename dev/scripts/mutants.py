"""Draw random mutants of the pure core, run tests/central against each, and show the survivors.

    python dev/scripts/mutants.py --seed 7 --count 40

The exit code is 1 if fewer than nine of ten are killed. Some mutants behave like the original; they
count as survivors.
"""

import ast
import difflib
import importlib.util
import os
import queue
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import click

ROOT = Path(__file__).parents[2]
CORE = ROOT / "tca_central"
NOT_THE_CORE = ("shell", "__main__.py", "__init__.py")
NEEDED = ("tca_*", "tests", "dev", "setup.cfg", "pyproject.toml")
"""The files that tests/central needs to run."""

TESTS = ("tests/central/test_transcripts.py", "tests/central")
"""The fastest test comes first."""

WANTED = 0.9
"""The share of mutants that must be killed."""

AT_ONCE = 2
MEMORY = 4 << 20
"""The limit for the memory of a mutant, in kilobytes. A mutant might allocate memory without
end.
"""

FLIPPED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}


PLAIN = (ast.Name, ast.Attribute, ast.Call, ast.Subscript)
"""Conditions without an operator."""


@dataclass(frozen=True)
class Mutant:
    """A file of the core with one node changed."""

    path: Path
    """Relative to the root."""
    kind: str
    node: ast.expr | ast.stmt
    text: str
    """The new text."""

    @property
    def original(self) -> str:
        """The whole file as it is."""
        return (ROOT / self.path).read_text()

    @property
    def source(self) -> str:
        """The whole file with the change."""
        node, lines = self.node, self.original.encode().splitlines(keepends=True)
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        first, last = node.lineno - 1, node.end_lineno - 1
        before, after = lines[first][: node.col_offset], lines[last][node.end_col_offset :]
        changed = before + self.text.encode() + after
        return b"".join([*lines[:first], changed, *lines[last + 1 :]]).decode()

    def diff(self) -> str:
        """Return the mutant's change, with the lines around."""
        here, there = (text.splitlines(keepends=True) for text in (self.original, self.source))
        return "".join(
            difflib.unified_diff(here, there, str(self.path), f"mutant: {self.kind}", n=3)
        )


def all_mutants() -> list[Mutant]:
    """Return all mutants of the core."""
    found: list[Mutant] = []
    for file in sorted(CORE.rglob("*.py")):
        if not any(part in NOT_THE_CORE for part in file.relative_to(CORE).parts):
            for node in acting_nodes(ast.parse(file.read_text())):
                found += [Mutant(file.relative_to(ROOT), *change) for change in changes(node)]
    return found


def acting_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the statements and expressions that act: no annotations, assertions or decorators."""
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not isinstance(child, ast.Assert | ast.JoinedStr):
                    yield child
                    yield from acting_nodes(child)


def changes(node: ast.AST) -> Iterator[tuple[str, ast.expr | ast.stmt, str]]:
    """Yield each possible change of a node: its kind, the changed part, and the new text."""
    match node:
        case ast.Compare(left, [operator], [right]):
            yield (
                "comparison",
                node,
                f"({ast.unparse(ast.Compare(left, [FLIPPED[type(operator)]()], [right]))})",
            )
        case ast.BoolOp(operator, values):
            other = ast.Or() if isinstance(operator, ast.And) else ast.And()
            yield "and, or", node, f"({ast.unparse(ast.BoolOp(other, values))})"
        case ast.UnaryOp(ast.Not(), operand):
            yield "not", node, f"({ast.unparse(operand)})"
        case ast.If(test) | ast.While(test) | ast.IfExp(test) if isinstance(test, PLAIN):
            yield "not", test, f"(not {ast.unparse(test)})"
        case ast.Constant(bool() as value):
            yield "constant", node, str(not value)
        case ast.Constant(int() | float() as value):
            yield from (("constant", node, f"({value + more})") for more in (1, -1))
        case ast.Call(function, [one, two, *more], keywords) if not isinstance(two, ast.Starred):
            yield "arguments", node, ast.unparse(ast.Call(function, [two, one, *more], keywords))
        case (
            ast.Expr(ast.Call())
            | ast.Assign([ast.Attribute() | ast.Subscript()])
            | ast.AugAssign()
            | ast.Delete()
            | ast.Raise()
            | ast.Continue()
            | ast.Break()
        ):
            yield "deleted statement", node, "pass"


class Copy:
    """A copy of the sources, in which one file is changed at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for pattern in NEEDED:
            for path in ROOT.glob(pattern):
                if path.is_dir():
                    shutil.copytree(
                        path, folder / path.name, ignore=shutil.ignore_patterns("__pycache__")
                    )
                else:
                    shutil.copy(path, folder)

    def kills(self, mutant: Mutant, limit: float) -> bool:
        """Return whether the tests notice a mutant."""
        self._write(mutant.path, mutant.source)
        try:
            return not self.passes(limit)
        finally:
            self._write(mutant.path, mutant.original)

    def passes(self, limit: float) -> bool:
        """Return whether tests/central passes within a limit of processor seconds."""
        bounds = f"ulimit -t {int(limit)} -v {MEMORY}; exec "
        tests = (
            f"'{sys.executable}' -m pytest -x -q -p no:cacheprovider -p no:xdist {' '.join(TESTS)}"
        )
        environment = {**os.environ, "PYTHONPATH": str(self.folder)}
        try:
            done = subprocess.run(
                ["/bin/sh", "-c", bounds + tests],
                cwd=self.folder,
                env=environment,
                capture_output=True,
                check=False,
                timeout=10 * limit,
            )
        except subprocess.TimeoutExpired:
            return False
        return done.returncode == 0

    def _write(self, path: Path, text: str) -> None:
        """Write a file and delete its byte code. Python might reuse the old byte code, if the file
        has the same size and age as before.
        """
        file = self.folder / path
        file.write_text(text)
        Path(importlib.util.cache_from_source(str(file))).unlink(missing_ok=True)


@click.command()
@click.option("--seed", default=1, show_default=True, help="Seed of the draw.")
@click.option("--count", default=40, show_default=True, help="Number of mutants.")
def main(seed: int, count: int) -> None:
    """Draw mutants of the pure core and run tests/central against each."""
    drawn = random.Random(seed).sample(all_mutants(), count)  # noqa: S311
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE) as pool:
        copies: queue.Queue[Copy] = queue.Queue()
        for number in range(AT_ONCE):
            copies.put(Copy(Path(folder) / str(number)))
        limit = 3 * seconds_of(copies) + 2

        def run_tests(mutant: Mutant) -> bool:
            copy = copies.get()
            try:
                return copy.kills(mutant, limit)
            finally:
                copies.put(copy)

        killed = 0
        for mutant, is_killed in zip(drawn, pool.map(run_tests, drawn), strict=True):
            killed += is_killed
            state = "killed  " if is_killed else "SURVIVED"
            click.echo(f"{state} {mutant.path}:{mutant.node.lineno} {mutant.kind}")
            if not is_killed:
                click.echo(mutant.diff())
    click.echo(f"seed {seed}: {killed} of {count} mutants killed")
    sys.exit(killed < WANTED * count)


def seconds_of(copies: "queue.Queue[Copy]") -> float:
    """Return the processor seconds of the tests without a mutant. Ends the program if they fail."""
    copy, before = copies.get(), resource.getrusage(resource.RUSAGE_CHILDREN)
    if not copy.passes(300):
        raise click.ClickException("tests/central fails without a mutant: repair that first")
    copies.put(copy)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


if __name__ == "__main__":
    main()
