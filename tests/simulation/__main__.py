"""Lives of a simulated town: python -m tests.simulation [--log] [--seed N | --lives N] [--trace]."""

import argparse
import logging
import sys
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))


def counts_of(life: Any) -> dict[str, int]:
    """Return what happened in a life."""
    return {
        **life.outside.counts,
        "lives": 1,
        "crashes of central": life.daemon.crashes,
        "images": life.daemon.images,
        "power cuts": life.daemon.cuts,
        "full disks": life.daemon.full,
        "crashes of modules": life.crashes,
        "breaks": life.network.breaks,
        "writes": life.daemon.disk.writes,
        "happened": life.clockwork.happened,
    }


def main() -> int:
    from simulation.life import Life
    from simulation.log_life import LogLife

    parser = argparse.ArgumentParser(prog="python -m tests.simulation", description=__doc__)
    parser.add_argument("--seed", type=int, help="live this one")
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--lives", type=int, default=1000)
    parser.add_argument("--stop-after", type=int, default=5)
    parser.add_argument(
        "--digests", action="store_true", help="of each life: two are the same if these are"
    )
    parser.add_argument("--trace", action="store_true")
    parser.add_argument(
        "--log", action="store_true", help="let central be several members with a replicated log"
    )
    arguments = parser.parse_args()
    kind = LogLife if arguments.log else Life
    logging.getLogger("tca.central").disabled = not arguments.trace
    if arguments.seed is not None:
        life = kind(arguments.seed, write_trace=print if arguments.trace else None)
        print(life.options)
        life.run()
        print(life.clockwork.digest, dict(life.outside.counts))
        return 0
    began, counts, broken = time.process_time(), Counter[str](), 0
    for seed in range(arguments.first, arguments.first + arguments.lives):
        life = kind(seed)
        try:
            life.run()
        except Exception as error:  # noqa: BLE001
            broken += 1
            text = f"{type(error).__name__}: {error}"
            place = traceback.extract_tb(error.__traceback__)[-1]
            print(f"seed {seed}: {text[:300]} [{Path(place.filename).name}:{place.lineno}]")
            if broken >= arguments.stop_after:
                break
        if arguments.digests:
            print(life.clockwork.digest)
        counts.update(counts_of(life))
    seconds = time.process_time() - began
    print(
        f"{counts['lives']} lives in {seconds:.1f} s: {counts['lives'] / seconds:.0f} a second; {broken} broken"
    )
    print(", ".join(f"{name} {number}" for name, number in sorted(counts.items())))
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
