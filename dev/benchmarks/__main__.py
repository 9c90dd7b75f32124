"""Run all benchmarks for developers in turn: ``python -m dev.benchmarks``."""

import subprocess
import sys

for name in (
    "core_lives",
    "core_events",
    "core_control",
    "waits",
    "handlers",
    "periods",
    "journals",
    "long_runs",
    "preview",
):
    print(f"== {name}", flush=True)
    subprocess.run([sys.executable, "-m", f"dev.benchmarks.{name}"], check=True)
