"""The chart of the page: its rows, how to reach them, and their colours."""

from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import Story, made, stuck
from wire.test_waits_in_words import test_duration_is_written_with_a_fitting_unit as of_durations

from tca_tools.gantt.build import chart
from tca_wire.journal import facts
from tca_wire.points import TaskId
from tca_wire.vocabulary import Outcome
from view.conftest import OpenPage, until, written

pytestmark = pytest.mark.slow


def crowded() -> Story:
    """Return a story with forty modules, a message without a handler, and a suspended task."""
    story = Story()
    for number in range(40):
        story.module(f"module {number}", f"work {number}")
    story.at(1.0).queued(story.command("deliver", "user"))
    story.say(facts.SuspendedOrResumed(TaskId(story.command("mop", "user")), True))
    return story.at(2.0).acted(story.command("work 39", "user"), "module 39", 3.0)


@pytest.mark.soak
def test_rows_below_the_edge_are_announced_and_reachable(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(crowded().write(tmp_path / "crowd"))
    labels = "tca.chart.layout.filter(({ top, bottom }) => top >= 20 && bottom <= tca.chart.height).map(({ row }) => row.label)"
    seen = page.evaluate(labels)
    assert seen[:2] == ["module 0", "module 1"]
    assert "module 39" not in seen
    below = page.locator("#chart-below")
    expect(below).to_have_text(f"▾ {42 - len(seen)} more rows below")
    below.click()
    expect(below).not_to_have_text(f"▾ {42 - len(seen)} more rows below")
    page.locator("#chart-bar").evaluate("(bar) => { bar.scrollTop = 100000; }")
    expect(below).to_be_hidden()
    assert page.evaluate(labels)[-3:] == ["module 39", "(suspended)", "(no handler)"]
    page.evaluate("tca.chart.scroll = 0; tca.chart.draw()")
    page.locator(".row[data-task='3']").click()  # the chart moves to the bar of a chosen task
    assert "module 39" in page.evaluate(labels)
    page.set_viewport_size({"width": 1400, "height": 3000})
    expect(page.locator("#chart-bar")).to_be_hidden()
    assert page.evaluate(labels)[0] == "module 0"


def test_rows_of_one_module_stand_together(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("bakery").write(tmp_path / "bakery"))
    labels = "tca.chart.layout.map(({ row }) => row.label)"
    order = ["oven / chamber", "oven / meter", "store / phone"]
    shown = page.evaluate(labels)
    assert [label for label in shown if " / " in label] == order
    assert shown[-2:] == ["(suspended)", "(no handler)"]
    assert [row.label for row in chart(made("bakery").fold()).rows] == shown
    place = "tca.chart.layout.find((one) => one.row.label === '(suspended)')"
    assert page.evaluate(f"{place}.row.queued.length") == 10
    assert page.evaluate(f"{place}.bottom - {place}.top") < 50  # pixels: two rows and their number
    page.set_viewport_size({"width": 700, "height": 500})
    until(page, "() => tca.chart.width < 700")
    assert (
        page.evaluate(
            "tca.chart.layout.filter(({ bottom }) => bottom <= tca.chart.height)[0].row.module"
        )
        == "oven"
    )


LOOKS = """([time, before]) => {
  const { chart } = tca, [{ top }] = chart.layout, [from, to] = chart.window;
  const x = chart.labelWidth + (time - from) / (to - from) * (chart.width - chart.labelWidth) - before;
  chart.draw();
  const at = [x, top + 4].map((place) => place * devicePixelRatio);
  return [...chart.canvas.getContext("2d").getImageData(...at, 1, 1).data.slice(0, 3)];
}"""
"""JavaScript: the colour of the first row, some pixels before a time."""


@pytest.mark.soak
def test_killed_bar_has_a_dark_end_and_future_bar_is_paler(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().module("legs", "walk").at(1.0)
    for outcome in (Outcome.DONE, Outcome.KILLED):
        task = story.command("walk", "user")
        story.delivered(task, "legs").at(len(story.entries) + 2.0).returned(task, outcome)
    page = open_page(story.at(9.0).say(facts.Closed("done")).write(tmp_path / "walk"))
    ends = page.evaluate("tca.chart.layout[0].row.handled.lists.flat().map(({ end }) => end)")
    bar, dark = page.evaluate(LOOKS, [ends[0], 20]), [31, 41, 51]
    assert [page.evaluate(LOOKS, [ends[0], 2]), page.evaluate(LOOKS, [ends[1], 20])] == [bar, bar]
    assert page.evaluate(LOOKS, [ends[1], 2]) == dark
    page.evaluate("tca.slider.setTime(2)")
    until(page, "tca.chart.time === 2")
    now, to_come = (page.evaluate(LOOKS, [time, 0]) for time in (1.9, 2.9))
    assert now != to_come
    page.evaluate(
        "Object.assign(tca.chart, { from: 2.5, to: 3.5 })"
    )  # also without other rows in sight
    assert page.evaluate(LOOKS, [2.9, 0]) == to_come


@pytest.mark.soak
def test_hover_names_the_user_who_suspended_a_task(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "mop", "dust").at(1.0)
    for name, by in (("mop", "tca suspend"), ("dust", "")):  # an older journal has no name
        task = TaskId(story.command(name, "user"))
        story.say(facts.SuspendedOrResumed(task, True, by)).at(2.0 if by else 4.0)
    page = open_page(story.say(facts.Closed("done")).write(tmp_path / "still"))
    expect(page.locator("#counts")).to_be_attached()
    for lane, (time, label) in enumerate(
        {
            1.5: "mop {1} suspended by the command 'tca suspend': ",
            3.0: "dust {2} suspended: ",
        }.items()
    ):
        x, y = page.evaluate(
            """([time, lane]) => {
          const { chart } = tca, place = chart.layout.find((one) => one.row.label === "(suspended)");
          const [from, to] = chart.window, box = chart.canvas.getBoundingClientRect();
          for (let y = place.top; y < place.bottom; y++) {
            const x = chart.labelWidth + (time - from) / (to - from) * (chart.width - chart.labelWidth);
            if (chart.hitAt(x, y)?.span?.message === lane + 1) return [box.left + x, box.top + y];
          }
        }""",
            [time, lane],
        )
        page.mouse.move(x, y)
        expect(page.locator("#hint")).to_contain_text(label)


@pytest.mark.soak
def test_chart_times_have_the_form_of_other_tools(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "move").at(6700.0)
    page = open_page(
        story.acted(story.command("move", "user"), "legs", 8.5).write(tmp_path / "late")
    )
    expect(page.locator("#clock")).to_have_text("1:51:48.5")
    for window, labels in {
        "6700, 6710": ["1:51:40", "1:51:45", "1:51:50"],
        "659.7, 660.2": ["10:59.8", "11:00.0", "11:00.2"],
        "0, 4": ["0 s", "2 s", "4 s"],
        "6600, 7200": ["1:50:00", "1:55:00", "2:00:00"],
        "0, 720": ["0:00", "5:00", "10:00"],
    }.items():
        made = f"import('/page/axis.js').then(({{ ticks }}) => ticks({window}, 3).map(({{ label }}) => label))"
        assert page.evaluate(made) == labels
    lengths, texts = zip(*of_durations.pytestmark[0].args[1], strict=True)  # type: ignore[attr-defined]
    durations = "(all) => import('/page/words.js').then(({ duration }) => all.map(duration))"
    assert page.evaluate(durations, lengths) == [*texts]


def test_bar_names_are_legible_and_marked_when_cut(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "hold the arm", "ask the eyes").at(1.0)
    for name, wait in (("hold the arm", 0.0), ("ask the eyes", 9.0)):
        task = story.command(name, "user")
        story.delivered(task, "legs").say(
            facts.Claimed(task + 90, "eyes", "eyes", False, "legs", task)
        )
        story.at(story.entries[-1].time + wait).say(facts.Granted(task + 90)).at(
            story.entries[-1].time + 10 - wait
        )
        story.returned(task)
    page = open_page(story.write(tmp_path / "names"))
    expect(page.locator("#counts")).to_be_attached()
    colours = dict(written(page))
    assert (colours["hold the arm"], colours["ask the eyes"]) == ("#ffffff", "#111111")
    page.evaluate("Object.assign(tca.chart, { from: 0, to: 200 })")
    assert any(text.startswith("hold") and text.endswith("…") for text, _ in written(page))


@pytest.mark.soak
def test_chart_shows_one_second_when_the_run_has_no_messages(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(
        Story().at(5.399).module("legs", "move").module("eyes", "look").write(tmp_path / "new")
    )
    expect(page.locator("#counts")).to_be_attached()
    until(page, "tca.chart.layout.length === 2")
    start, end = page.evaluate("[tca.store.start, tca.store.end]")
    from_, to = page.evaluate("tca.chart.window")
    assert from_ <= start <= end < to
    assert to - from_ >= 1.0
    x, y = page.evaluate(
        "(({ canvas }) => { const box = canvas.getBoundingClientRect(); return [box.left + 400, box.top + 60]; })(tca.chart)"
    )
    page.mouse.move(x, y)
    page.mouse.wheel(0, -300)
    until(page, "(wide) => tca.chart.window[1] - tca.chart.window[0] < wide", to - from_)


@pytest.mark.soak
def test_unhandled_bars_have_names_and_show_in_dark_mode(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(stuck().write(tmp_path / "stuck"))
    page.emulate_media(color_scheme="dark")
    assert page.evaluate(f"({_UNHANDLED_ROW}).queuedStep") > 10
    assert page.evaluate(_BRIGHTEST) > 70


_UNHANDLED_ROW = "tca.chart.layout.find((one) => one.row.label === '(no handler)')"
_BRIGHTEST = """(() => {
  const { canvas, layout } = tca.chart, { top } = layout.find((one) => one.row.label === '(no handler)');
  tca.chart.draw();
  const seen = canvas.getContext("2d").getImageData(canvas.width * 0.6, (top + 3) * devicePixelRatio, 1, 1).data;
  return Math.max(...seen.slice(0, 3)) * seen[3] / 255;
})()"""
"""JavaScript: the strongest colour of the first bar."""
