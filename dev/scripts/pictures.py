"""Make the pictures of the documents from real runs: ``make pictures``, or with names of pictures.

python -m dev.scripts.pictures [NAME...]
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import PIL.Image
from playwright.sync_api import Page, sync_playwright

from dev.scripts.tutorial_picture import tutorial
from robots.cartesian_sim.messages import CLEAN, ENABLE, REFERENCE, SET_SPEED
from robots.cartesian_sim.robot import NAME, CleaningRobot
from tca_behaviours.activities.manager import ActivityMove, ApplicationMessages
from tca_module import connect
from tca_tools.drawing.chart_dot import chart_dot, likely_arrows, report_marks
from tca_tools.drawing.pictures import write_graph
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.fold import folded
from tca_tools.journal.journals import open_log
from tca_tools.supervise.programs import central_in
from tca_wire.charts import MachineChart, read_active, read_machine
from tca_wire.coordination import read_report
from tca_wire.points import Moment

ROOT = Path(__file__).parents[2]
IMAGES = ROOT / "docs/images"
WORK = ROOT / "build/pictures"
BIN = ROOT / ".venv/bin"
CHROMIUM = shutil.which("chromium") or shutil.which("google-chrome")
LARGEST = 300 * 1024
"""The most bytes of a picture."""


def run(*command: str) -> None:
    """Run a command of the virtual environment."""
    subprocess.run([str(BIN / command[0]), *command[1:]], cwd=ROOT, check=True)


@cache
def show(robot: str, folder: str, *options: str) -> Path:
    """Run the show of a robot once. Returns its folder."""
    out = WORK / folder
    shutil.rmtree(out, ignore_errors=True)
    run("python", "-m", f"robots.{robot}_sim", "--out", str(out), *options)
    return out


def walk() -> Path:
    """Return the journal of the demo."""
    return show("ambler", "walk", "--rocks", "2") / "journal"


def step() -> Path:
    """Return the journal of one step, with a rock that the leg must go around."""
    rock = ("--rock", "1.1", "0.9", "0.25", "1.9")
    return show("ambler", "step", "--distance", "0.5", "--arcs", "1", *rock) / "journal"


def _save_png(picture: PIL.Image.Image, file: Path) -> None:
    """Save a picture with 256 colours, the rare ones among them."""
    few = picture.convert("RGB").quantize(256, PIL.Image.Quantize.MAXCOVERAGE)
    few.save(file, optimize=True)


def bare_walk() -> Path:
    """Return the journal of a walk without layers, whose tree is small."""
    return show("ambler", "bare", "--bare", "--distance", "6") / "journal"


def drawn(command: str, journal: Callable[[], Path], *options: str) -> Callable[[Path], None]:
    """Return a function that has a `tca` command draw a run into a file."""

    def draw(file: Path) -> None:
        made = WORK / file.name
        run("tca", command, str(journal()), *options, "--force", "-o", str(made))
        if file.suffix == ".png":
            with PIL.Image.open(made) as picture:
                picture.thumbnail((1960, 1960))
                _save_png(picture, made)
        _copy(made, file)

    return draw


def mode(file: Path) -> None:
    """Draw two seconds of a walk over hills in the mode that the file is named after."""
    name = file.stem.removeprefix("ambler-")
    options = ("--mode", name, "--distance", "4", "--terrain", "hills", "--pace", "20")
    journal = show("ambler", f"mode-{name}", "--backend", "kinematic", *options) / "journal"
    began = next(
        task.reached[Moment.START_HANDLING]
        for task in folded(open_log(journal)).tasks.values()
        if task.name == "move leg"
    )
    span = ("--from", f"{began + 0.5:.2f}", "--to", f"{began + 2.5:.2f}")
    run("tca", "gantt", str(journal), *SHOWN, *span, "--force", "-o", str(file))


def film(file: Path) -> None:
    """Make a short film of the walk over hills: few, small frames."""
    hills = ("--distance", "18", "--terrain", "hills", "--pace", "0")
    made = ("--film", str(WORK / "film.webp"), "--film-from", "30")
    frames = []
    for path in sorted((show("ambler", "film", *hills, *made) / "frames").glob("*.png"))[::2]:
        with PIL.Image.open(path) as frame:
            frames.append(frame.resize((400, 250)))
    frames[0].save(
        file,
        save_all=True,
        append_images=frames[1:100],
        duration=80,
        loop=0,
        quality=30,
        method=6,
    )


def copied(robot: str, name: str) -> Callable[[Path], None]:
    """Return a function that copies a picture of a robot's show."""
    return lambda file: _copy(show(robot, robot) / name, file)


def _copy(made: Path, file: Path) -> None:
    file.write_bytes(made.read_bytes())


# --- state machines -------------------------------------------------------------------------------


def patrol(file: Path) -> None:
    """Draw the machine of an example when its second drive is under way."""
    folder = WORK / "patrol"
    with central_in(folder) as (address, _):
        command = [str(BIN / "python"), str(ROOT / "examples/45_state_machine.py")]
        subprocess.run(command, check=True, env={**os.environ, "TCA_CENTRAL": address})
    for chart, progress in reports(folder / "journal", "patrol"):
        active = read_active(progress).active
        if any(chart.states[number].label == "Drive 2" for number in active):
            return write_graph(file, chart_dot(chart, dict.fromkeys(active, "active")))
    raise LookupError("the patrol never drove to its second place")


def foreseen(file: Path) -> None:
    """Draw the machine of a delivery while the robot goes to box B."""
    found = [
        (chart, report)
        for chart, progress in reports(show("youbot", "youbot") / "best/journal", "deliver")
        if (report := read_report(progress)) is not None
        and chart.states[report.current].label == "going to B"
    ]
    chart, report = max(found, key=lambda pair: len(pair[1].preview))
    write_graph(file, chart_dot(chart, report_marks(report), likely_arrows(chart, report)))


def reports(journal: Path, title: str) -> Iterator[tuple[MachineChart, bytes]]:
    """Yield the chart and the progress of a machine's task at each entry of a run."""
    run = folded(open_log(journal))
    charts = {
        number: chart
        for number, task in run.tasks.items()
        if task.name in run.formats
        and (chart := read_machine(run.formats[task.name].data, task.body)) is not None
        and chart.name == title
    }
    for time in run.times:
        at = RunAt(run, time)
        for number, chart in charts.items():
            if number in at.tasks:
                yield chart, at.tasks[number].life.progress


# --- pages in a browser ---------------------------------------------------------------------------


@contextmanager
def page_of(*command: str, width: int, height: int) -> Iterator[Page]:
    """Start a command that prints the address of a page, and open the page."""
    words = [str(BIN / command[0]), *command[1:]]
    env = {**os.environ, "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(words, cwd=ROOT, env=env, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            found = (re.search(r"http://\S+", line) for line in server.stdout)
            with opened(next(one.group() for one in found if one), width, height) as page:
                yield page
        finally:
            server.terminate()
            server.communicate()


@contextmanager
def opened(address: str, width: int, height: int) -> Iterator[Page]:
    """Open an address in a browser."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": width, "height": height})
        page.goto(address)
        yield page
        browser.close()


def photograph(page: Page, file: Path) -> None:
    """Save what a page shows."""
    shot = WORK / f"{file.stem}-shot.png"
    page.screenshot(path=shot)
    with PIL.Image.open(shot) as picture:
        if file.suffix == ".webp":
            picture.convert("RGB").save(file, quality=80, method=6)
        else:
            _save_png(picture, file)


def viewer(file: Path) -> None:
    """Photograph the viewer at the first leg move that failed."""
    run = folded(open_log(walk()))
    failed = next(task for task in run.tasks.values() if task.name == "move leg" and task.failures)
    command = ("tca", "view", "--no-browser", str(walk()))
    with page_of(*command, width=1640, height=980) as page:
        page.wait_for_selector("#status:not(:has-text('reading'))")
        time = failed.failures[0][0] + 0.8
        page.evaluate(f"() => {{ location.hash = '#t={time:.2f}&task={failed.id}' }}")
        page.wait_for_timeout(1500)
        photograph(page, file)


def report(file: Path) -> None:
    """Photograph the first screen of a report."""
    made = WORK / "report.html"
    run("tca", "report", str(walk()), "--force", "-o", str(made))
    with opened(made.as_uri(), 1240, 680) as page:
        photograph(page, file)


def activities(file: Path) -> None:
    """Photograph the page of the cleaning robot while it works, on four processors."""
    with central_in(WORK / "cartesian") as (address, _):
        robot = CleaningRobot(address)
        with (
            robot.module.running(),
            robot.application.running(),
            connect("operator", address) as operator,
        ):
            for order in (ENABLE, REFERENCE):
                operator.command(order).result()
            operator.inform(SET_SPEED, 0.8)
            move = ApplicationMessages(NAME).move
            for processor in robot.application.allocation().processors:
                for activity in processor.activities:
                    place = PROCESSORS[activity.name.partition(".")[0]]
                    operator.command(move, ActivityMove(activity.name, place)).result()
            cleaning = operator.command(CLEAN)
            options = ("--central", address, "--no-browser")
            with page_of("tca", "activities", NAME, *options, width=1400, height=860) as page:
                page.wait_for_timeout(6_000)
                photograph(page, file)
            cleaning.kill()


PROCESSORS = {
    "device": "the device",
    "x": "joint x",
    "y": "joint y",
    "tool": "tool and guide",
    "guide": "tool and guide",
}
"""The processors of the activities' page, by component."""

SHOWN = [
    f"--module={name}"
    for name in (
        "footfall planner",
        "gait planner",
        "mapper",
        "footfall layer",
        "body planner",
        "scanner",
        "leg recovery planner",
        "error recovery",
        "stability layer",
        "controller",
    )
]
"""The modules of the Gantt chart."""

PICTURES: dict[str, Callable[[Path], None]] = {
    "activities.png": activities,
    "ambler-ahead.svg": mode,
    "ambler-concurrent.svg": mode,
    "ambler-sequential.svg": mode,
    "ambler.webp": film,
    "gantt.png": drawn("gantt", walk, *SHOWN, "--from", "2", "--to", "22"),
    "life-cycle.svg": lambda file: run("tca", "lifecycle", "general", "--force", "-o", str(file)),
    "office.svg": copied("office", "lab.svg"),
    "outline.svg": drawn("tree", walk, "--at", "8"),
    "preview-machine.svg": foreseen,
    "preview-schedules.svg": copied("youbot", "schedules.svg"),
    "recovery.png": drawn("tree", step, "--task", "take steps", "--layout", "figure"),
    "report.webp": report,
    "state-machine.svg": patrol,
    "tree.png": drawn("tree", bare_walk, "--at", "13", "--layout", "figure"),
    "tutorial-view.png": tutorial,
    "turtle.svg": copied("turtle", "sheet.svg"),
    "view.webp": viewer,
    "youbot.png": copied("youbot", "changed/robot.png"),
}
"""How each picture is made, by its name."""


def main() -> int:
    """Make the named pictures, or all. Returns the exit code."""
    IMAGES.mkdir(exist_ok=True)
    WORK.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name](IMAGES / name)
        print(name, f"{(IMAGES / name).stat().st_size / 1024:.0f} KiB", flush=True)
    large = [file.name for file in IMAGES.iterdir() if file.stat().st_size > LARGEST]
    print(*[f"{name} is too large" for name in large], sep="\n")
    return 1 if large else 0


if __name__ == "__main__":
    sys.exit(main())
