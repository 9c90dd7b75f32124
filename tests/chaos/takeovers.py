"""Lives of a robot whose central moves: ``python -m tests.chaos.takeovers [--seed N]
[--takeovers N] [--lives N] [--out FOLDER]``.
"""

import argparse
import os
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent.parent))


def live(folder: Path, seed: int, takeovers: int, **options: Any) -> tuple[Counter[str], list[str]]:
    """Live and judge. Return the counts, and the contradictions. *options*: of TakeoverLife."""
    from chaos.checker import Judge
    from chaos.journals import Merged
    from chaos.life import Broken
    from chaos.takeover_life import TakeoverLife

    wrong, life = list[str](), TakeoverLife(folder, seed, takeovers, **options)
    try:
        life.run()
    except Broken as error:
        wrong.append(str(error))
    merged = Merged(life.journals)
    merged.write(folder / "journal")
    judge = Judge(folder)
    counts = life.counts + judge.counts + Counter({"entries compared": merged.compared})
    return counts, wrong + merged.wrong + judge.wrong


def main() -> int:
    """Live, judge, and print the counts."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos.takeovers", description=__doc__)
    parser.add_argument("--seed", type=int, default=1, help="of the first life")
    parser.add_argument("--takeovers", type=int, default=20, help="in each life")
    parser.add_argument("--lives", type=int, default=1)
    parser.add_argument(
        "--out", type=Path, help="folder for what is left of them [default: a temporary one]"
    )
    options = parser.parse_args()
    out = options.out or Path(tempfile.mkdtemp(prefix="takeovers"))
    os.environ["XDG_STATE_HOME"] = os.environ["XDG_RUNTIME_DIR"] = str(out)
    os.environ.pop("TCA_CENTRAL", None)
    counts, broken, began = Counter[str](), 0, time.monotonic()
    for seed in range(options.seed, options.seed + options.lives):
        folder = out / f"life{seed}"
        found, wrong = live(folder, seed, options.takeovers)
        counts.update(found)
        said = ", ".join(f"{name} {number}" for name, number in sorted(found.items()))
        print(f"seed {seed}: {said}", flush=True)
        for one in wrong[:20]:
            print(f"  seed {seed}: {one[:2000]}", flush=True)
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
