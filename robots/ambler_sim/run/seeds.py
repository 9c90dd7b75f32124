"""Walks over the hills of several seeds, one after the other, and a table of them."""

import argparse
import subprocess
import sys
from pathlib import Path

import msgspec

from robots.ambler_sim.run.figures import Figures

HEAD = (
    "| seed | way | footsteps | steepest | faults recovered | kinds | operator | greatest tilt | least margin | error"
    " | rules | time | processor | memory of central and all |"
)


def walk(seed: int, folder: Path, options: list[str]) -> tuple[bool, Figures | None]:
    """Whether the walk came to its end, and its figures; none if it was killed."""
    command = [sys.executable, "-m", "robots.ambler_sim", "--pace", "0", "--seed", str(seed), "--out", str(folder)]
    code = subprocess.run([*command, *options], stdout=subprocess.DEVNULL, check=False).returncode
    written = folder / "figures.json"
    return code == 0, msgspec.json.decode(written.read_bytes(), type=Figures) if written.exists() else None


def row(seed: int, has_arrived: bool, figures: Figures) -> str:
    """A line of the table."""
    injected = sum(each.injected for each in figures.faults.values())
    recovered = sum(each.recovered for each in figures.faults.values())
    cells = (
        f"{seed}",
        f"{figures.way:.0f} m" + ("" if has_arrived else ", given up"),
        f"{figures.footsteps:,}",
        f"{figures.steepest:.1%}",
        f"{recovered} of {injected}",
        f"{len(figures.faults)}",
        f"{figures.operator_calls}",
        f"{figures.most_tilt:.2f}\N{DEGREE SIGN}",
        f"{figures.least_margin:.2f} m",
        f"{figures.error:.2f} m",
        f"{figures.rules}",
        f"{figures.wall:.0f} s",
        f"{figures.cpu:.0f} s",
        f"{figures.memory}",
    )
    return f"| {' | '.join(cells)} |"


def main() -> int:
    """The command line; options that it does not know are the walks'. Exit code 1 if a walk was given up."""
    parser = argparse.ArgumentParser(prog="python -m robots.ambler_sim.run.seeds", description=__doc__)
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 11)))
    parser.add_argument("--out", type=Path, default=Path("walks"), help="folder for the walks")
    known, options = parser.parse_known_args()
    known.out.mkdir(parents=True, exist_ok=True)
    print(HEAD, "|---" * (HEAD.count("|") - 1) + "|", sep="\n", flush=True)
    arrived = []
    for seed in known.seeds:
        folder = known.out / f"seed-{seed}"
        has_arrived, figures = walk(seed, folder, options)
        arrived.append(has_arrived)
        print(row(seed, has_arrived, figures) if figures else f"| {seed} | no figures: see {folder} |", flush=True)
    return 0 if all(arrived) else 1


if __name__ == "__main__":
    sys.exit(main())
