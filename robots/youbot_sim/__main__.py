"""The case study of preview coordination: an object is carried with and without a preview."""

import argparse
import sys

from robots.options import show_parser
from robots.show import run_show, save_picture
from robots.youbot_sim.robot import BACKENDS
from robots.youbot_sim.seeds import TABLE_HEAD, compare, random_lid, row, summary
from robots.youbot_sim.show import SCHEDULES, ShownDelivery, show
from tca_tools.gantt.chart import Chart
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.schedule.build import schedules
from tca_tools.schedule.svg import svg_text

SCHEDULE_HELP = (
    "best: box B is free; changed: it is covered on the way;"
    " plain: it is covered, and nothing is done ahead"
)


def main() -> int:
    """Run the command line. Returns the exit code."""
    parser = show_parser("youbot_sim", __doc__, out="runs/youbot")
    parser.add_argument(
        "--schedule", choices=(*SCHEDULES, "all"), default="all", help=SCHEDULE_HELP
    )
    parser.add_argument(
        "--backend", choices=BACKENDS, default="auto", help="backend of the simulator"
    )
    parser.add_argument(
        "--seed",
        type=int,
        help="instead of a schedule: with a preview, and box B as in this row of --seeds",
    )
    parser.add_argument(
        "--seeds",
        type=_count,
        metavar="N",
        help="instead of a schedule: a table of N deliveries with changing boxes",
    )
    return run_show(
        parser, lambda options: _show(options) if options.seeds is None else _table(options.seeds)
    )


def _count(text: str) -> int:
    count = int(text)
    if count < 1:
        raise argparse.ArgumentTypeError(f"the number of seeds is 1 or more, not {text}")
    return count


def _table(seeds: int) -> int:
    print(TABLE_HEAD)
    comparisons = []
    for comparison in compare(seeds):
        comparisons.append(comparison)
        print(row(comparison), flush=True)
    print(f"\n{summary(comparisons)}")
    return 0


def _show(options: argparse.Namespace) -> int:
    chosen = (
        SCHEDULES if options.schedule == "all" else {options.schedule: SCHEDULES[options.schedule]}
    )
    if options.seed is not None:
        lid = random_lid(options.seed)
        chosen = {f"seed-{options.seed}": ShownDelivery(f"with a preview, box B {lid}", lid)}
    charts: list[Chart] = []
    for name, delivery in chosen.items():
        folder = options.out / name
        folder.mkdir(parents=True, exist_ok=True)
        print(f"{name}: {delivery.title}")
        delivered, picture = show(delivery, folder, options.backend)
        for task in delivered.tasks:
            print(f"  {task}")
        print(f"  done after {delivered.seconds:.1f} s")
        journal = folder / "journal"
        for path in (journal, picture):
            print("  made", path)
        charts += schedules(folded(open_log(journal)), f"{name}: {delivery.title}")
    for path in save_picture(options.out / "schedules", svg_text(charts)):
        print("made", path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
