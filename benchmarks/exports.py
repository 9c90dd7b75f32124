"""Seconds and memory to export and to measure a journal, in each format.

    python -m benchmarks.exports LOG

Each runs in a process of its own; the first line is what reading the journal costs that all but jsonl have in common.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tca_tools.export.__main__ import FORMATS

FOLD = "import sys, pathlib; from tca_tools.history import History; from tca_tools.logs import open_log"
FOLD += "; History.until(open_log(pathlib.Path(sys.argv[1])))"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", metavar="LOG")
    log = parser.parse_args().log
    print(f"{'':>10} {'seconds':>8} {'peak MB':>8} {'written MB':>11}")
    with tempfile.TemporaryDirectory() as folder:
        report("fold", [sys.executable, "-c", FOLD, log], None)
        report("stats", [sys.executable, "-m", "tca_tools.stats", log], None)
        for name in FORMATS:
            output = Path(folder) / name
            report(name, [sys.executable, "-m", "tca_tools.export", log, "--to", name, "-o", str(output)], output)


def report(name: str, command: list[str], output: Path | None) -> None:
    """Seconds are those of the processor, so that other programs on the machine don't count."""
    begin = time.perf_counter()
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    if status:
        sys.exit(f"{name} failed after {time.perf_counter() - begin:.1f} s")
    files = [] if output is None else list(output.iterdir()) if output.is_dir() else [output]
    written = f"{sum(path.stat().st_size for path in files) / 1e6:>11.1f}" if files else f"{'-':>11}"
    seconds = usage.ru_utime + usage.ru_stime
    print(f"{name:>10} {seconds:>8.1f} {usage.ru_maxrss / 1e3:>8.0f} {written}", flush=True)


if __name__ == "__main__":
    main()
