"""Failures on the page: marks on the slider, keys to the next failure, and the failed subtasks."""

import re
from pathlib import Path

import pytest
from playwright.sync_api import expect
from tools.story import Story, made

from tca_wire.journal import facts
from tca_wire.points import Moment, TaskId
from tca_wire.vocabulary import Outcome
from view.conftest import OpenPage, until

pytestmark = pytest.mark.slow


def test_handled_failures_are_marked_and_found(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("recovered").write(tmp_path / "walk"), "#t=0.5")
    expect(page.locator("#counts")).to_be_attached()
    for clock in ("2.000 s", "6.000 s"):
        page.keyboard.press("]")
        expect(page.locator("#clock")).to_have_text(clock)
        expect(page.locator("#task h2")).to_contain_text("step {")
    page.keyboard.press("[")
    expect(page.locator("#clock")).to_have_text("2.000 s")
    page.keyboard.press("End")
    expect(page.locator("#clock")).to_have_text("8.000 s")
    assert page.evaluate("tca.store.failures.map((one) => [one.time, one.handled])") == [
        [2, True],
        [6, False],
    ]
    assert page.evaluate(
        """[2, 6].map((time) => {
      const { canvas, store } = tca.slider, scale = canvas.width / canvas.clientWidth;
      const x = 7 + (time - store.start) / (store.end - store.start) * (canvas.clientWidth - 14);
      const [red, green] = canvas.getContext("2d").getImageData(x * scale, (canvas.clientHeight - 8.5) * scale, 1, 1).data;
      return green > 100 ? "amber" : red > 150 ? "red" : "none";
    })"""
    ) == ["amber", "red"]


def test_restart_of_central_is_marked_and_named(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "move").at(1.0)
    story.delivered(story.command("move", "user"), "legs")
    story.at(4.0).say(facts.CentralEnding("tca central", keep=True))
    story.at(4.5).say(facts.CentralRestarted(1.5, 2)).at(9.0).say(facts.Closed("done"))
    page = open_page(story.write(tmp_path / "run"))
    expect(page.locator("#counts")).to_be_attached()
    x, y, *colours = page.evaluate(
        """() => {
      const { chart, slider, store } = tca, box = chart.canvas.getBoundingClientRect(), [from, to] = chart.window;
      const x = chart.labelWidth + (4.5 - from) / (to - from) * (chart.width - chart.labelWidth);
      const { canvas } = slider, onSlider = 7 + (4.5 - store.start) / (store.end - store.start) * (canvas.clientWidth - 14);
      const isViolet = (canvas, x, y) => {
        const [red, green, blue] = canvas.getContext("2d").getImageData(Math.floor(x), y, 1, 1).data;
        return red > green + 20 && blue > green + 20;
      };
      return [box.left + x, box.top, isViolet(chart.canvas, x, 15), isViolet(chart.canvas, x, 60), isViolet(canvas, onSlider, 5)];
    }"""
    )
    assert colours == [True, True, True]
    page.mouse.move(x, y + 10)
    expect(page.locator("#hint")).to_have_text(
        "4.500 s: central was restarted, as asked, after 1.5 s"
    )


def baking() -> Story:
    """Return a story of thirty cakes. The heating of one cake fails, and this cake is killed."""
    story = Story().module("cook", "bake cake", "stir", "heat").at(1.0)
    for number in range(30):
        cake = story.goal("bake cake", "user")
        stir = story.command("stir", "cook", cake)
        heat = story.command("heat", "cook", cake)
        story.delivered(cake, "cook").returned(cake).acted(stir, "cook", 1.0).delivered(
            heat, "cook"
        )
        if number == 20:
            story.returned(heat, Outcome.FAILED).say(facts.Failed(heat, "burnt", "to coal"))
            story.say(
                facts.Killed(
                    TaskId(cake),
                    f"failure 'burnt' of heat {{{heat}}} was not handled",
                    failed=TaskId(heat),
                )
            )
        else:
            story.returned(heat).reached(heat, *Moment)
        story.reached(stir, *Moment).reached(cake, *Moment)
    return story.say(facts.Closed("done"))


def test_failure_is_shown_under_the_task_killed_for_it(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(baking().write(tmp_path / "kitchen"))
    cake, heat = 61, 63
    expect(page.locator(f".row[data-task='{cake}'] .why")).to_contain_text("killed")
    failed = page.locator(f".row[data-task='{heat}']")
    expect(failed).to_contain_text("failed: burnt: to coal")
    page.locator(f".row[data-task='{cake}'] .twist").click()
    expect(failed).to_have_count(0)
    expect(page.locator(f".row[data-task='{cake}'] .hidden-failure")).to_have_count(1)
    page.locator(f".row[data-task='{cake}'] .name").click()
    expect(page.locator("#task h3").last).to_have_text("its failure, step by step")
    assert [step.inner_text().split("\t")[-1] for step in page.locator("#chain tr").all()] == [
        "heat {63} failed: burnt: to coal",
        "bake cake {61} was killed: failure 'burnt' of heat {63} was not handled",
        "heat {63}: its failure was not dealt with",
    ]
    page.locator("#task .lead.bad .link").filter(has_text="heat {63}").click()
    expect(page.locator("#task h2")).to_have_text("heat {63}")
    expect(failed).to_be_visible()


@pytest.mark.soak
def test_replaced_task_is_amber(open_page: OpenPage, tmp_path: Path) -> None:
    page = open_page(made("replaced").write(tmp_path / "walk"))
    expect(page.locator("#counts")).to_be_attached()
    page.locator(".row[data-task='2'] .name").click()
    expect(page.locator("#task h2")).to_have_text("step {2}")
    for line in page.locator("#task .lead").all():
        expect(line).to_have_class("lead handled")
    assert page.evaluate(
        "tca.store.failures.map((one) => [one.handled, one.span.failure === one])"
    ) == [[True, True]]
    row = page.locator(".row[data-task='2']")
    expect(row.locator(".why")).to_have_class("why handled")
    expect(row.locator(".why")).to_have_text("failed (handled): blind: fog")
    for amber in (
        row.locator(".dot"),
        page.locator("#task .state"),
        page.locator("[data-state^=failed] .dot"),
    ):
        expect(amber).to_have_css("background-color", "rgb(223, 174, 63)")
    expect(page.locator("#task .state")).to_have_text("failed (handled)")
    expect(page.locator("#counts")).to_contain_text("1 failed (handled)")
    page.locator("#search").fill("failed")
    expect(page.locator("#found")).to_have_text("1 found")
    page.locator("#search").fill("")
    page.locator("#tab-messages").click()
    expect(page.locator("#messages .line").filter(has_text="blind").last).to_have_class(
        re.compile(r"\bhandled\b")
    )

    page.locator("#tab-task").click()
    page.keyboard.press("[")  # red before the replacement, as in the tree of that time
    expect(row.locator(".why")).to_have_text("failed: blind: fog")
    expect(page.locator("#task .lead.bad").first).to_have_text("blind: fog")
    later = page.locator("#task .lead.faint")
    expect(later).to_contain_text("handled later: ")
    expect(page.locator("#counts")).not_to_contain_text("handled")
    page.locator("#search").fill("failed")
    expect(page.locator("#found")).to_have_text("1 found")
    later.locator("button").click()
    expect(row.locator(".why")).to_have_text("failed (handled): blind: fog")
    page.locator(".row[data-task='1'] .twist").click()
    expect(page.locator(".hidden-failure")).to_have_class("hidden-failure handled")


@pytest.mark.soak
def test_collapsed_mark_is_red_when_a_failure_was_not_handled(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(made("not_replaced").write(tmp_path / "walk"))
    page.locator(".row[data-task='1'] .twist").click()
    expect(page.locator(".hidden-failure")).to_have_class("hidden-failure")


@pytest.mark.soak
def test_recovering_task_names_its_handler_and_duration(
    open_page: OpenPage, tmp_path: Path
) -> None:
    page = open_page(made("in_recovery").write(tmp_path / "walk"))
    reason = page.locator(".row.recovering .why")
    expect(reason).to_have_text(
        "slip: on ice; until recover {3} has dealt with its failure, for 1.5 s"
    )
    expect(reason).to_have_attribute("title", re.compile("recover.*\n\nslip: on ice"))


@pytest.mark.soak
@pytest.mark.parametrize(("passed_on", "tint"), [(False, "handled"), (True, "bad")])
def test_failed_query_is_amber_when_its_asker_continued(
    open_page: OpenPage, tmp_path: Path, *, passed_on: bool, tint: str
) -> None:
    page = open_page(made("asking_in_vain" if passed_on else "asking").write(tmp_path / "ask"))
    expect(page.locator("#counts")).to_be_attached()
    page.evaluate("tca.slider.setTime(2.5)")
    expect(page.locator("#clock")).to_have_text("2.500 s")
    page.keyboard.press("[")
    expect(page.locator("#task h2")).to_have_text("look {3}")
    page.keyboard.press("End")  # before the end, the asker may still continue
    expect(page.locator("#task .lead").first).to_have_class(f"lead {tint}")
    went = "then failed" if passed_on else "continued"
    expect(page.locator("#task .lead").nth(1)).to_have_text(
        f"reported to maps, whose handler of where {{2}} {went}"
    )
    assert page.evaluate("tca.store.failures.map((one) => one.handled)") == [not passed_on] * (
        3 if passed_on else 1
    )
    marked = """() => {
      const { chart } = tca;
      chart.chosen = null; // without the frame of what is chosen
      chart.draw();
      const { top } = chart.layout.find(({ row }) => row.label === "eye"), scale = devicePixelRatio;
      const [from, to] = chart.window, x = chart.labelWidth + (1.6 - from) / (to - from) * (chart.width - chart.labelWidth);
      const [red, green] = chart.context.getImageData(x * scale, (top + 0.5) * scale, 1, 1).data;
      return green > 100 ? "handled" : red > 150 ? "bad" : "none";
    }"""
    page.keyboard.press("End")
    expect(page.locator("#clock")).to_have_text("5.000 s")
    assert page.evaluate(marked) == tint
    page.locator("#tab-messages").click()
    expect(page.locator("#messages .line").filter(has_text="blind").first).to_have_class(
        re.compile(rf"\b{tint}\b")
    )


@pytest.mark.soak
def test_failure_raised_outside_the_handler_is_marked_on_the_bar(
    open_page: OpenPage, tmp_path: Path
) -> None:
    story = Story().module("legs", "move", resource="left").at(1.0)
    move = story.command("move", "user")
    story.delivered(move, "legs", "left").at(3.0)
    story.say(
        facts.Failed(
            move,
            "slip",
            "why",
            is_beside=True,
            by="tca raise#7",
            body=b"\xcb@\t\x00\x00\x00\x00\x00\x00",
        )
    )
    waits = story.command("move", "user")
    story.queued(waits, "legs", "left").at(4.0).say(
        facts.Failed(waits, "timeout", "late", is_beside=True, by="central")
    )
    page = open_page(story.at(9.0).say(facts.Closed("done")).write(tmp_path / "slip"))
    expect(page.locator("#counts")).to_be_attached()
    for time, kind in ((3, "handled"), (4, "queued")):
        x, y, is_marked = page.evaluate(
            """([time, kind]) => {
          const { chart } = tca, place = chart.layout.find((one) => one.row.label === "legs / left");
          const [from, to] = chart.window, box = chart.canvas.getBoundingClientRect();
          const x = chart.labelWidth + (time - from) / (to - from) * (chart.width - chart.labelWidth);
          const y = place.top + (kind === "queued" ? 18 * place.handledLanes : 0) + 3;
          const [red, green, blue] = chart.canvas.getContext("2d").getImageData(Math.floor(x), y, 1, 1).data;
          return [box.left + x, box.top + y, red > 150 && blue < 60];  // red or amber
        }""",
            [time, kind],
        )
        assert is_marked
        page.mouse.move(x, y)
        expect(page.locator("#hint")).to_contain_text(f"beside its handler, at {time}.000 s")
    page.locator(f".row[data-task='{move}']").click()
    expect(page.locator("#task")).to_contain_text(
        "failed: slip: why (raised by the command 'tca raise')"
    )
    expect(page.locator("#task")).to_contain_text("the failure's data: 3.125")


@pytest.mark.soak
def test_running_bar_is_not_marked_failed(open_page: OpenPage, tmp_path: Path) -> None:
    story = Story().module("legs", "move").at(1.0)
    move = story.command("move", "user")
    story.delivered(move, "legs").at(9.0).returned(move, Outcome.FAILED).say(
        facts.Failed(move, "slip", "why")
    )
    page = open_page(story.at(10.0).say(facts.Closed("done")).write(tmp_path / "slip"), "#t=5")
    expect(page.locator("#clock")).to_have_text("5.000 s")
    framed = """([time]) => {
      const { chart } = tca, [{ top }] = chart.layout, [from, to] = chart.window, box = chart.canvas.getBoundingClientRect();
      const x = chart.labelWidth + (time - from) / (to - from) * (chart.width - chart.labelWidth);
      const [red, green, blue] = chart.canvas.getContext("2d").getImageData(Math.floor(x), top, 1, 1).data;
      return [box.left + x, box.top + top + 8, red > green + 50 && red > blue + 50];
    }"""
    title = "move {1} handled by legs"
    went = ": 1.000 s – 9.000 s (8 s)"
    for time, is_framed, hint in (
        (
            "5",
            [False, True],
            f"{title}: since 1.000 s (4 s so far); later: failed: until 9.000 s (8 s)",
        ),
        ("0.5", [True, True], f"later: {title}: failed{went}"),
        ("9", [True, True], f"{title}: failed{went}"),
    ):
        page.evaluate(f"location.hash = '#t={time}'")
        until(page, f"tca.chart.time === {time}")
        (x, y, early), (_, _, late) = (page.evaluate(framed, [time]) for time in (3, 7))
        assert [early, late] == is_framed
        page.mouse.move(x, y)
        expect(page.locator("#hint")).to_have_text(hint)
