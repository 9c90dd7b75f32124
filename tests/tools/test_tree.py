import re
import shutil
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from click.testing import Result
from tools.story import THIS, Story, arcs, made, silent_for, stumbling, walking

from tca_tools.drawing.graphviz import render
from tca_tools.journal.at_time import RunAt
from tca_tools.journal.records import TaskState
from tca_tools.tasktree_viz import words
from tca_tools.tasktree_viz.arrows import KINDS, arrows
from tca_tools.tasktree_viz.dot import FILLS, dot_source
from tca_tools.tasktree_viz.outline import Row, excerpt, outline, whole_outline
from tca_tools.tasktree_viz.outline_svg import outline_svg
from tca_tools.tasktree_viz.text import tree_lines
from tca_tools.terminal import columns_of, cut_name
from tca_wire.constraints import Constraint, delay_planning, plan_first, sequential_achievement
from tca_wire.journal.facts import Failed, Killed
from tca_wire.points import Moment, Point, TaskId

Tca = Callable[..., Result]
needs_dot = pytest.mark.skipif(
    not (shutil.which("dot") or find_spec("pygraphviz")), reason="Graphviz is not installed"
)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    return walking().write(tmp_path / "run")


def test_text_trees_match_their_transcripts(
    tca: Tca, run: Path, tmp_path: Path, expect: Callable[[str, str], None]
) -> None:
    expect("tree_walking", tca("tree", run).stdout)
    expect("tree_stumbling", tca("tree", stumbling().write(tmp_path / "fall"), "--data").stdout)
    expect("tree_arcs", tca("tree", arcs().write(tmp_path / "arcs"), "--ascii").stdout)


def test_at_option_shows_the_tree_as_it_was(
    tca: Tca, run: Path, expect: Callable[[str, str], None]
) -> None:
    expect("tree_walking_at_1.0", tca("tree", run, "--at", 1.0).stdout)
    assert tca("tree", run, "--at", 0.2).stdout.splitlines() == [
        "run: 0.20 s, 0 tasks",
        "(no task was sent)",
    ]


def test_waits_and_bars_of_a_live_run_last_until_now(tca: Tca, run: Path) -> None:
    with silent_for(run, 40.0):
        live, before = (tca("tree", run, *options).stdout for options in ((), ("--at", 1.0)))
        bars = tca("gantt", run).stdout
    rested = tca("tree", run).stdout
    assert rested.startswith("run: 4.00 s, 8 tasks")
    assert (
        "take steps {3} is being achieved, for 3.4 s; in the end for move body {7}, which controller handles\n"
        in rested
    )
    title, *_, last = live.splitlines()
    assert float(title.split()[1]) >= 44
    assert float(last.partition(", for ")[2].split()[0]) >= 43
    assert before.startswith("run: 1.00 s, 4 tasks")
    assert float(bars.partition(" to ")[2].split()[0]) >= 44


def test_tree_lines_fit_the_terminal(tca: Tca, run: Path) -> None:
    lines = tca("tree", run, "--data", COLUMNS="70").stdout.splitlines()
    assert max(map(len, lines)) == 70


def test_latin_1_terminal_gets_ascii_guides_and_escapes(tmp_path: Path) -> None:
    from click.testing import CliRunner

    from tca_tools.command_line import main

    story = Story()
    story.goal("go", "x")
    story.goal("走る", "x", 1)
    result = CliRunner(charset="latin-1").invoke(main, ["tree", str(story.write(tmp_path / "run"))])
    assert result.exit_code == 0
    assert r"`- \u8d70\u308b {2}" in result.stdout


def test_damage_is_reported_after_the_output(tca: Tca, run: Path) -> None:
    segment = run / "00000001.tcaj"
    segment.write_bytes(segment.read_bytes() + b"\xce and then garbage")
    for command in ("tree", "gantt"):
        result = tca(command, run)
        assert result.exit_code == 1
        assert result.stdout.startswith("run: ")
        assert "no record starts here; the entries before it are shown" in result.stderr


def long_walk(achieved: int, held: int) -> Story:
    """Return a goal with commands in sequence: *achieved* of them are achieved, *held* are still
    held.
    """
    story = Story()
    walk = story.goal("walk", "x", to="planner", begins=True)
    for number in range(achieved + held):
        command = story.command("step", "planner", walk)
        if number < achieved:
            story.acted(command, "legs", 0.5)
    return story.returned(walk)


def test_large_tree_is_folded_at_achieved_tasks() -> None:
    rows = outline(RunAt(long_walk(achieved=400, held=3).fold()))
    assert [row.folded or str(row.task) for row in rows] == [
        *("walk {1}", "step {2}", "step {3}", 396, "step {400}", "step {401}"),
        *("step {402}", "step {403}", "step {404}"),
    ]
    assert [row.is_last for row in rows] == [True, *[False] * 7, True]


def test_all_option_shows_every_task(tca: Tca, tmp_path: Path) -> None:
    folder = long_walk(achieved=400, held=3).write(tmp_path / "run")
    assert len(tca("tree", folder, "--all").stdout.splitlines()) == 2 + 404
    folded = tca("tree", folder).stdout.splitlines()
    assert "├─ + 396 tasks achieved" in folded


def test_siblings_of_one_state_are_folded_in_pictures_only(tca: Tca, tmp_path: Path) -> None:
    folder = long_walk(achieved=0, held=40).write(tmp_path / "run")
    assert len(tca("tree", folder).stdout.splitlines()) == 2 + 41
    tca("tree", folder, "-o", tmp_path / "walk.dot")
    dot = (tmp_path / "walk.dot").read_text()
    assert '"+ 36 tasks held"' in dot
    assert "t5 " not in dot


def test_failed_tasks_are_never_folded() -> None:
    story = long_walk(achieved=400, held=0)
    for task in range(200, 220):
        story.say(Failed(task, "slip", "on ice"))
    rows = outline(RunAt(story.fold()), shown_at_most=5)
    failed = [f"step {{{task}}}" for task in range(200, 220)]
    assert [row.folded or str(row.task) for row in rows] == ["walk {1}", 198, *failed, 182]


def test_deep_failure_is_shown_with_its_ancestors() -> None:
    story, parent = Story(), 0
    for _ in range(30):
        parent = story.goal("take steps", "planner", parent)
    for task in range(30, 0, -1):
        story.reached(task, *Moment)
    story.say(Failed(25, "slip", ""))
    rows = outline(RunAt(story.fold()), shown_at_most=10)
    assert [row.task.id for row in rows if row.task] == list(range(1, 26))


def test_deep_achieved_tasks_are_folded_first() -> None:
    story, parent = Story(), 0
    ids = []
    for _ in range(30):
        parent = story.goal("take steps", "planner", parent)
        ids.append(parent)
    for task in reversed(ids):
        story.reached(task, *Moment)
    rows = outline(RunAt(story.fold()), shown_at_most=10)
    assert [row.task.id for row in rows if row.task] == ids[:10]
    assert rows[-1].folded == 20


def test_constraints_between_two_tasks_become_one_arrow() -> None:
    """Delayed planning joins the arrow of the sequence. A constraint that two others imply has no
    arrow.
    """
    runs = walking().fold(), arcs().fold()
    walks, delays = (arrows(RunAt(run), set(run.tasks)) for run in runs)
    assert walks.between == {
        (2, 3): ["SEQ"],
        (3, 4): ["SEQ", "plan ahead"],
        (6, 7): ["SEQ"],
        (9, 10): ["SEQ"],
    }
    assert arrows(RunAt(runs[0]), {1, 2, 4}).between == {}
    assert (delays.between, delays.own) == ({(2, 3): ["SEQ", "DP"], (3, 4): ["SEQ", "DP"]}, {})
    story = Story()
    leg = TaskId(story.command("move leg", "x"))
    body = TaskId(story.command("move body", "x", 0, sequential_achievement(leg, THIS)))
    story.command(
        "check", "x", 0, sequential_achievement(body, THIS), sequential_achievement(leg, THIS)
    )
    assert arrows(RunAt(story.fold()), {1, 2, 3}).between == {(1, 2): ["SEQ"], (2, 3): ["SEQ"]}
    assert arrows(RunAt(story.fold()), {1, 3}).between == {(1, 3): ["SEQ"]}


def test_constraints_within_a_task_are_in_its_box() -> None:
    story = Story()
    story.goal("a", "x", 0, plan_first(THIS))
    story.goal("b", "x", 0, delay_planning(THIS))
    odd = Constraint(Point(TaskId(1), Moment.END_HANDLING), Point(THIS, Moment.START_HANDLING))
    story.goal("c", "x", 0, odd, sequential_achievement(TaskId(1), THIS))
    history = story.fold()
    found = arrows(RunAt(history), {1, 2, 3})
    assert found.own == {1: ["plan first"], 2: ["DP"]}
    assert found.between == {(1, 3): ["end handling before start handling", "SEQ"]}


def test_text_tree_names_roles_of_tasks_sent_by_central(tca: Tca, tmp_path: Path) -> None:
    shown = tca("tree", made("with_roles").write(tmp_path / "run")).stdout
    assert re.findall(r"(\w[^{\n]*\{\d\}(?: \(.*\))?)  ", shown) == [
        "move leg {1}",
        "raise leg {2} (exception handler)",
        "stability check {3} (listener)",
        "achieved position? {4} (monitor)",
        "at rest? {5} (condition)",
        "report {6} (action)",
        "watch {7} (monitor, listener)",
    ]


def test_reason_of_a_killed_tree_is_at_its_top_only(tca: Tca, tmp_path: Path) -> None:
    """The top task's sender was notified of a failure, so the state "killed" needs a reason."""
    run, why = (
        stumbling().write(tmp_path / "fall"),
        "failure 'terrain collision' of move body {7} was not handled",
    )
    assert re.findall(rf"(\w+ \w+ {{\d}}) .*{re.escape(why)}", tca("tree", run).stdout) == [
        "traverse arc {1}"
    ]
    assert tca("tree", run, "-o", tmp_path / "fall.dot").exit_code == 0
    labels = re.findall(r"label=<(.*?)>, style", (tmp_path / "fall.dot").read_text())
    label_texts = [re.sub(r"<[^>]*>", " ", label) for label in labels]
    assert [text.split(" ")[0] for text in label_texts if "was not" in " ".join(text.split())] == [
        "traverse"
    ]
    assert tca("tree", run, "--layout", "outline", "-o", tmp_path / "fall.svg").exit_code == 0
    notes = re.findall(r'class="note"[^>]*>(killed[^<]*)', (tmp_path / "fall.svg").read_text())
    assert [note for note in notes if "failure" in note] == [
        "killed: failure &#x27;terrain collision&#x27; of move body {7}"
    ]


def test_picture_marks_tasks_sent_by_central() -> None:
    history = made("with_roles").fold()
    dot = dot_source(RunAt(history), whole_outline(RunAt(history)), "roles")
    nodes = dict(re.findall(r"^  (t\d+) \[(.*)\];$", dot, re.MULTILINE))
    assert ["penwidth" in nodes[f"t{number}"] for number in (1, 2, 3, 4)] == [
        False,
        True,
        True,
        True,
    ]
    for meaning in ("exception handler", "sent by a wiretap", "monitor"):
        assert f">{meaning}</font>" in dot


def test_picture_shows_classes_states_and_order() -> None:
    history = walking().fold()
    dot = dot_source(RunAt(history), whole_outline(RunAt(history)), "<walk> & talk")
    nodes = dict(re.findall(r"^  (t\d+) \[(.*)\];$", dot, re.MULTILINE))
    assert 'style="filled,rounded"' in nodes["t2"]
    assert 'style="filled"' in nodes["t7"]
    assert f'fillcolor="{FILLS[TaskState.ACHIEVED]}"' in nodes["t6"]
    assert "handling since 3.40" in nodes["t7"]
    assert "achieved 1.40–3.40" in nodes["t6"]
    assert "{ rank=same; t2; t3; t4;  }" in dot
    assert "t1 -> t2 [weight=2];" in dot
    assert "&lt;walk&gt; &amp; talk" in dot


def test_siblings_without_constraints_keep_their_order() -> None:
    story = Story()
    for name in "abc":
        story.goal(name, "x")
    history = story.fold()
    dot = dot_source(RunAt(history), whole_outline(RunAt(history)), "abc")
    assert "{ rank=same; t1; t2; t3; t1 -> t2 [style=invis]; t2 -> t3 [style=invis]; }" in dot


def hostile() -> Story:
    """Return a story whose names and data have the special characters of dot."""
    story = Story()
    goal = story.goal(
        'a "quoted" \\n <b>&amp;</b> \x1b[0m ' + "x" * 200, "x", data={'"': "\\", "<": ">\n"}
    )
    story.goal("", "x", goal, data="]" * 500)
    story.goal("走る ロボット", "x", goal)
    return story


@needs_dot
@pytest.mark.parametrize(
    "story", [walking(), stumbling(), arcs(), hostile(), Story(), long_walk(3, 40)]
)
def test_tree_picture_is_valid_svg(tca: Tca, tmp_path: Path, story: Story) -> None:
    picture = tmp_path / "tree.svg"
    result = tca("tree", story.write(tmp_path / "run"), "--data", "-o", picture)
    assert (result.exit_code, result.stderr) == (0, "")
    assert ET.fromstring(picture.read_text()).tag.endswith("svg")


def test_legend_fits_every_kind_of_arrow(capfd: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pygraphviz")
    story = Story()
    first = story.goal("walk", "user")
    for kind, (before, after) in enumerate(KINDS):
        story.goal(
            f"kind {kind}", "user", 0, Constraint(Point(TaskId(first), before), Point(THIS, after))
        )
    at = RunAt(story.fold())
    source = dot_source(at, whole_outline(at), "all kinds")
    assert all(f"<b>{kind}</b>" in source for kind in KINDS.values())
    render(source, "svg")
    assert "too small" not in capfd.readouterr().err


@needs_dot
def test_siblings_are_side_by_side_in_the_picture(tca: Tca, run: Path, tmp_path: Path) -> None:
    tca("tree", run, "-o", tmp_path / "tree.svg")
    places = {}
    for group in ET.parse(tmp_path / "tree.svg").iter("{http://www.w3.org/2000/svg}g"):
        if group.get("class") == "node":
            text = next(group.iter("{http://www.w3.org/2000/svg}text"))
            places[group[0].text] = (float(text.get("x", 0)), float(text.get("y", 0)))
    assert places["t2"][0] < places["t3"][0] < places["t4"][0]
    assert places["t2"][1] == places["t3"][1] == places["t4"][1]
    assert places["t1"][1] < places["t2"][1] < places["t6"][1] == places["t10"][1]


@pytest.mark.parametrize("suffix", [".txt", ".dot"])
def test_text_and_dot_files_need_no_graphviz(
    tca: Tca, run: Path, tmp_path: Path, suffix: str
) -> None:
    path = tmp_path / f"tree{suffix}"
    assert tca("tree", run, "-o", path).exit_code == 0
    text = path.read_text()
    assert (
        text == tca("tree", run).stdout + "made by tca\n"
        if suffix == ".txt"
        else text.startswith("digraph")
    )


def test_tree_explains_unusable_output_names(tca: Tca, run: Path, tmp_path: Path) -> None:
    assert (
        "must end in .svg, .png, .pdf, .html, .dot or .txt"
        in tca("tree", run, "-o", tmp_path / "tree.gif").stderr
    )
    result = tca("tree", run, "-o", tmp_path / "no" / "such" / "folder.txt")
    assert result.exit_code == 1
    assert result.stderr.endswith("folder.txt: can't be written: No such file or directory\n")


def test_wide_characters_keep_columns_aligned() -> None:
    story = Story()
    story.goal("走る", "x")
    story.goal("walk", "x")
    lines = list(tree_lines(RunAt(story.fold()), whole_outline(RunAt(story.fold()))))
    assert lines[1].index("held") + 2 == lines[2].index("held")


def test_constraint_words_are_on_arrows_between_neighbours_only() -> None:
    story = Story()
    walk = story.goal("walk", "user")
    first = TaskId(story.goal("approach", "planner", walk))
    story.goal("grasp", "planner", walk, sequential_achievement(first, THIS))
    story.goal("lift", "planner", walk, sequential_achievement(first, THIS))
    at = RunAt(story.fold())
    source = dot_source(at, whole_outline(at), "a lift")
    near, far = (
        next(line for line in source.splitlines() if line.startswith(f"  t2 -> t{one}"))
        for one in (3, 4)
    )
    assert 'label="SEQ"' in near
    assert 'label=""' in far
    assert "after approach {2}" in next(
        line for line in source.splitlines() if line.startswith("  t4 [")
    )


# --- large trees and long names -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("width", "shown"),
    [
        (40, "pour concrete {24} (exception handler)"),
        (30, "pour concrete {24}"),
        (18, "pour concrete {24}"),
        (17, "pour concre… {24}"),
        (10, "pour conc…"),
    ],
)
def test_cut_name_keeps_the_number_while_part_of_the_name_fits(width: int, shown: str) -> None:
    found = cut_name("pour concrete {24} (exception handler)", 24, width)
    assert (found, columns_of(found) <= width) == (shown, True)


def test_trees_keep_the_numbers_of_long_names() -> None:
    story = Story().at(1.0)
    tasks = [
        story.command(
            "pour concrete with a really very long name that has no end in sight at all", "user"
        )
        for _ in range(2)
    ]
    at = RunAt(story.fold(), 9.0)
    rows = whole_outline(at)
    assert all(
        f"… {{{task}}}" in line
        for task, line in zip(tasks, list(tree_lines(at, rows, width=100))[1:], strict=True)
    )
    assert all(f"… {{{task}}}" in outline_svg(at, rows, "long") for task in tasks)


WHY = "failure 'bad part' was not handled"


def jobs(good: int, bad: int, parts: int = 30) -> Story:
    """Return a story of jobs with *parts* parts of two steps each: first the *good* jobs, then the
    *bad* ones.

    In a bad job a step of part 10 failed. All later tasks were killed, except the last step.
    """
    story = Story()
    for number in range(good + bad):
        job = story.goal("job", "x")
        above = [story.goal("part", "boss", job) for _ in range(parts)]
        steps = [story.command("step", "boss", part) for part in above for _ in range(2)]
        if number < good:
            story.reached(job, *Moment)
            for task in (*above, *steps):
                story.reached(task, *Moment)
            continue
        for task in (*above[:10], *steps[:20], steps[-1]):
            story.reached(task, *Moment)
        story.say(Failed(TaskId(steps[20]), "bad part", "burr"))
        for task in (*steps[21:-1], *above[10:], job):
            story.say(Killed(TaskId(task), WHY)).reached(task, *Moment)
    return story


def row_texts(rows: list[Row]) -> list[str]:
    return [f"{row.task.name} {row.task.state}" if row.task else words.folded(row) for row in rows]


def test_tasks_killed_with_their_parent_are_folded() -> None:
    rows = outline(RunAt(jobs(0, 10).fold()), budget=20)
    assert len(rows) == 10 * 6
    assert row_texts(rows[:6]) == [
        "job killed",
        "+ 30 tasks achieved",
        "part killed",
        "step failed",
        "+ 1 task killed",
        "+ 57 tasks: 1 achieved, 56 killed",
    ]


def test_first_and_last_of_many_achieved_jobs_are_shown() -> None:
    few, many = (row_texts(outline(RunAt(jobs(good, 0).fold()), budget=20)) for good in (10, 40))
    assert few == ["job achieved", "+ 90 tasks achieved"] * 10
    assert many[:5] == ["job achieved", "+ 90 tasks achieved"] * 2 + [
        f"+ {36 * 91:,} tasks achieved"
    ]
    assert many[5:] == ["job achieved", "+ 90 tasks achieved"] * 2


def test_task_killed_for_its_own_reason_is_not_folded() -> None:
    story = jobs(0, 4)
    story.say(Killed(TaskId(20), "not needed any more"))
    rows = outline(RunAt(story.fold()), budget=1)
    assert 20 in [row.task.id for row in rows if row.task]


def test_excerpt_keeps_the_first_and_last_rows() -> None:
    at = RunAt(jobs(0, 10).fold())
    rows = outline(at, budget=20)
    assert excerpt(at, rows, 60) == rows
    texts = row_texts(excerpt(at, rows, 54))
    assert len(texts) == 4 * 6 + 1 + 4 * 6
    assert texts[4 * 6] == "+ 182 tasks: 62 achieved, 2 failed, 118 killed"
    last = excerpt(at, outline(at, budget=20), 2)
    assert row_texts(last) == ["job killed", "+ 30 tasks achieved", "+ 879 tasks further down"]


def test_excerpt_prefers_failed_tasks() -> None:
    story = long_walk(achieved=100, held=0)
    for task in (40, 60):
        story.say(Failed(task, "slip", "on ice"))
    at = RunAt(story.fold())
    assert row_texts(excerpt(at, whole_outline(at), 8)) == [
        "walk achieving",
        "step achieved",
        "+ 37 tasks achieved",
        "step failed",
        "+ 19 tasks achieved",
        "step failed",
        "+ 40 tasks achieved",
        "step achieved",
    ]


def test_picture_of_many_rows_counts_what_it_omits(tca: Tca, tmp_path: Path) -> None:
    run = jobs(0, 100, parts=11).write(tmp_path / "run")
    for name in ("tree.svg", "tree.dot"):
        assert tca("tree", run, "-o", tmp_path / name).exit_code == 0
        picture = (tmp_path / name).read_text()
        assert max(picture.count('class="name"'), picture.count(" [label=<")) < 250
        assert re.search(r"\+ [23],\d+ tasks: [\d,]+ achieved, \d+ failed, [\d,]+ killed", picture)
        assert "folded tasks; a part of the tree (--task, --module, --from, --to)" in picture
