"""The benchmarks for developers; those for users are in ``messages``."""

import argparse
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from dev.benchmarks.messages.processes import Children, address_in


def options_of(description: str | None) -> argparse.ArgumentParser:
    """Return a parser whose help shows the benchmark's docstring as it is."""
    return argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def measured_apart(
    module: str, way: str, path: Path, timeout: float | None = None
) -> tuple[float, float]:
    """Run a benchmark's ``--measure`` in a process of its own; return its seconds and megabytes."""
    command = [sys.executable, "-m", module, "--measure", way, str(path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, timeout=timeout)
    seconds, megabytes = done.stdout.split()[-2:]
    return float(seconds), float(megabytes)


@contextmanager
def central(folder: Path, *options: str) -> Iterator[str]:
    """Run central in a process of its own; its address is the value."""
    with closing(Children()) as children:
        children.central(folder, *options)
        yield address_in(folder)
