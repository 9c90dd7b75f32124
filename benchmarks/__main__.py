"""All benchmarks, one after the other: ``make bench``."""

import subprocess
import sys

for name in ("core_events", "core_control", "waits", "messaging", "handlers", "direct", "journals"):
    print(f"== {name}", flush=True)
    subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], check=True)
