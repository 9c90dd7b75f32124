"""Lives of a robot in chaos: ``python -m tests.chaos [--seed N] [--kills N] [--lives N] [--out
FOLDER]``.
"""

import argparse
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))


def main() -> int:
    """Live, judge, and print the counts."""
    from chaos.checker import Judge
    from chaos.life import Broken, Life

    parser = argparse.ArgumentParser(prog="python -m tests.chaos", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the first life")
    parser.add_argument("--kills", type=int, default=50, help="of central, in each life")
    parser.add_argument("--lives", type=int, default=1)
    parser.add_argument("--events-between", type=int, default=500, help="two images of the state")
    parser.add_argument(
        "--out", type=Path, help="folder for what is left of them [default: a temporary one]"
    )
    options = parser.parse_args()
    out = options.out or Path(tempfile.mkdtemp(prefix="chaos"))
    counts, broken, began = Counter[str](), 0, time.monotonic()
    for seed in range(options.seed, options.seed + options.lives):
        folder, wrong = out / f"life{seed}", list[str]()
        life = Life(folder, seed, options.kills, events_between=options.events_between)
        try:
            life.run()
        except Broken as error:
            wrong.append(str(error))
        judge = Judge(folder)
        wrong += judge.wrong
        counts.update(life.counts + judge.counts)
        said = ", ".join(
            f"{name} {number}" for name, number in sorted((life.counts + judge.counts).items())
        )
        print(f"seed {seed}: {said}", flush=True)
        for one in wrong:
            print(f"  seed {seed}: {one}", flush=True)
        broken += bool(wrong)
        if not wrong and options.out is None:
            shutil.rmtree(folder)
    print(
        f"{options.lives} lives in {time.monotonic() - began:.0f} s, {broken} broken; all together:"
    )
    print(", ".join(f"{name} {number}" for name, number in sorted(counts.items())))
    return bool(broken)


if __name__ == "__main__":
    sys.exit(main())
