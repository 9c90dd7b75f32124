"""The result of an exploration as text, with a counterexample as a numbered list of actions."""

from contextlib import suppress

from tca_tools.explore.errors import CentralFault
from tca_tools.explore.play.identifiers import numbers_shown
from tca_tools.explore.play.play import Play
from tca_tools.explore.play.words import describe
from tca_tools.explore.search.states import Result, Violation
from tca_wire.journal.facts import Fact, FormatDefined, kind_of
from tca_wire.text.facts_in_words import Wording


def report(result: Result) -> str:
    """Return *result* as text: one line, or the counterexample.

    A counterexample has one numbered line for each action; below it, indented, the facts that
    central recorded.

    Args:
        result: what ``explore`` has returned.
    """
    title, violation = result.scenario.title, result.violation
    size = f"{result.states:,} states"
    if violation is not None:
        with numbers_shown():
            return "\n".join(
                [f"{title}: NOT {violation.broken} (after {size})", *_story(result, violation)]
            )
    if not result.is_complete:
        line = (
            f"{title}: not known, nothing wrong in the first {size}: "
            "make the scenario smaller, or raise the limit"
        )
        most = ", ".join(result.branching)
        advice = f"\n  commonest alternatives: {most}; leave out those that you need least"
        return line + (advice if most else "")
    longest = "some runs may never end"
    if result.longest is not None:
        longest = f"at most {result.longest} actions a run"
    vacuous = (f"  holds vacuously: {text}" for text in result.vacuous)
    return "\n".join([f"{title}: good, {size}, {longest}", *vacuous])


def _story(result: Result, violation: Violation) -> list[str]:
    play, wording, lines = Play(result.scenario), Wording(), []
    stem = len(violation.actions)
    for number, action in enumerate((*violation.actions, *violation.cycle), start=1):
        if number == stem + 1:
            lines.append("then this cycle repeats forever:")
        lines.append(f"{number:3}. {describe(play, action)}")
        with suppress(CentralFault):  # then it is the violation itself, and shown below
            play.perform(action)
        lines += [f"       {line}" for fact in play.facts if (line := _line(wording, fact))]
    return [
        *lines,
        *(
            f"  => {line}" if i == 0 else f"     {line}"
            for i, line in enumerate(violation.why.splitlines())
        ),
    ]


def _line(wording: Wording, fact: Fact) -> str:
    words = wording.words(fact)
    return "" if isinstance(fact, FormatDefined) else f"{kind_of(fact)}: {words}"
