"""The case study of preview coordination: an object is carried to a box, with and without a look ahead."""

import argparse
import logging
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import cast

from robots.youbot_sim.robot import Physics
from robots.youbot_sim.seeds import HEAD, box_of, compare, row, summary
from robots.youbot_sim.show import SCHEDULES, DeliveryShow, ShownDelivery
from tca_module import TcaError
from tca_tools.drawing.pictures import converted
from tca_tools.errors import NoPicture
from tca_tools.run.fold import folded
from tca_tools.run.journals import open_log
from tca_tools.schedule.build import AgentSchedule, schedules
from tca_tools.schedule.svg import svg_text

WHICH = "best: box B is free; changed: it is covered on the way; plain: it is covered, and nothing is done ahead"


def main() -> int:
    """The command line; the exit code."""
    parser = argparse.ArgumentParser(prog="python -m robots.youbot_sim", description=__doc__)
    parser.add_argument("--schedule", choices=(*SCHEDULES, "all"), default="all", help=WHICH)
    parser.add_argument("--backend", choices=("auto", "pybullet", "kinematic"), default="auto", help="of the simulator")
    parser.add_argument("--out", type=Path, default=Path("runs/youbot"), help="folder of its files (%(default)s)")
    parser.add_argument(
        "--seed", type=int, help="instead of a schedule: a preview, with the box B of that row of the table"
    )
    parser.add_argument(
        "--seeds", type=_count, metavar="N", help="instead: a table of N deliveries with changing boxes"
    )
    options = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s")
    try:
        if options.seeds is not None:
            return _table(options.seeds)
        options.out.mkdir(parents=True, exist_ok=True)
        return _show(options)
    except OSError as error:
        parser.error(f"--out: {error}")
    except TcaError as error:
        print(f"youbot: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"youbot: ended by Ctrl-C; what happened so far is in {options.out}", file=sys.stderr)
        return 130


def _count(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"the number of seeds is 1 or more, not {text}")
    return count


def _table(seeds: int) -> int:
    print(HEAD)
    rows = []
    for one in compare(seeds):
        rows.append(one)
        print(row(one), flush=True)
    print(f"\n{summary(rows)}")
    return 0


def _show(options: argparse.Namespace) -> int:
    chosen = SCHEDULES if options.schedule == "all" else {options.schedule: SCHEDULES[options.schedule]}
    if options.seed is not None:
        box = box_of(options.seed)
        title = f"with a preview, box B {box}"
        chosen = {f"seed-{options.seed}": ShownDelivery(title, changes=box.changes, starts_covered=box.starts_covered)}
    drawn: list[AgentSchedule] = []
    for name, delivery in chosen.items():
        folder = options.out / name
        folder.mkdir(parents=True, exist_ok=True)
        show = DeliveryShow(delivery, folder, cast("Physics", options.backend))
        print(f"{name}: {delivery.title}")
        delivered = show.run()
        for task in delivered.tasks:
            print(f"  {task}")
        print(f"  done after {delivered.seconds:.1f} s")
        for path in (show.journal, show.picture()):
            print("  made", path)
        drawn += schedules(folded(open_log(show.journal)), f"{name}: {delivery.title}")
    for path, data in _pictures(options.out / "schedules", svg_text(drawn)):
        path.write_bytes(data)
        print("made", path)
    return 0


def _pictures(path: Path, svg: str) -> Iterator[tuple[Path, bytes]]:
    yield path.with_suffix(".svg"), svg.encode()
    try:
        yield path.with_suffix(".png"), converted(svg, "png")
    except NoPicture as error:
        print(error, file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
