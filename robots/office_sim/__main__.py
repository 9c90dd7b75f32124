"""Shows the robot that keeps a lab floor free of cups: cups fall, people take some of them away, the robot collects the
others, and charges its battery in between.
"""

import argparse
import logging
import signal
import sys
from pathlib import Path

from robots.office_sim.drawing import in_words
from robots.office_sim.show import LAYERS, OfficeShift, pictures, work
from tca_module import TcaError


def main() -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m robots.office_sim", description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("runs/office"), help="folder of its files (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="which lab, which cups and people (%(default)s)")
    parser.add_argument("--pace", type=_pace, default=16.0, help="how fast the lab's time passes (%(default)s)")
    parser.add_argument("--shift", type=_shift, default=240.0, help="seconds in which cups fall (%(default)s)")
    parser.add_argument("--without", action="append", default=[], choices=LAYERS, metavar="LAYER",
                        help=f"leave out a layer: {', '.join(LAYERS)}")  # fmt: skip
    options = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: the programs are stopped in order
    shift = OfficeShift(options.seed, options.shift, options.pace, tuple(options.without))
    try:
        options.out.mkdir(parents=True, exist_ok=True)
        scene = work(shift, options.out)
        title = f"seed {options.seed}"
        print(f"{title}: {in_words(scene)}")
        for path in pictures(scene, title, options.out):
            print("made", path)
    except OSError as error:
        parser.error(f"--out: {error}")
    except TcaError as error:
        print(f"office: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"office: ended by Ctrl-C; what happened so far is in {options.out}", file=sys.stderr)
        return 130
    return 0


def _pace(text: str) -> float:
    pace = float(text)
    if not 0.1 <= pace <= 100.0:
        raise argparse.ArgumentTypeError(f"the pace is a number from 0.1 to 100, not {text}")
    return pace


def _shift(text: str) -> float:
    seconds = float(text)
    if not 1.0 <= seconds <= 36000.0:
        raise argparse.ArgumentTypeError(f"a shift has 1 to 36,000 seconds, not {text}")
    return seconds


if __name__ == "__main__":
    sys.exit(main())
