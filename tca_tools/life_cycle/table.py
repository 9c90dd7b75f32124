"""A life cycle as a text table: its first, active and final states, and a row per transition."""

from collections.abc import Iterator

from tca_tools.terminal import cut, table_lines
from tca_wire.life_cycles import Effect, LifeCycle
from tca_wire.vocabulary import Party

TAKEN_BY = {Party.CLIENT: "client", Party.SERVER: "server", Party.BOTH: "client or server"}
_EFFECTS = {
    Effect.NONE: "",
    Effect.NEW_GOAL: "requests a new goal",
    Effect.TAKE_GOAL: "accepts the new goal",
    Effect.REFUSE: "refuses the client's request",
    Effect.RESULT: "reports an intermediate result",
    Effect.STOP: "ends the task at the client's request",
}
_HEAD = ("state", "transition", "by", "to", "")


def life_cycle_lines(life_cycle: LifeCycle, width: int | None = None) -> list[str]:
    """Return the table in lines of at most *width* columns."""
    rows = [_HEAD, *_rows(life_cycle)]
    lines = [f"life cycle '{life_cycle.name}'", *_kinds(life_cycle), ""]
    return [cut(line, width) for line in [*lines, *table_lines(rows)]]


def _kinds(life_cycle: LifeCycle) -> Iterator[str]:
    yield f"  first: {life_cycle.initial}"
    yield f"  active: {', '.join(life_cycle.active)}"
    if not life_cycle.has_many_ends:
        yield f"  ends: {life_cycle.done}, {life_cycle.cancelled}"
    else:
        yield f"  ends as done: {', '.join(life_cycle.successes)}"
        yield f"  ends as cancelled: {', '.join(life_cycle.failures)}"


def _rows(life_cycle: LifeCycle) -> Iterator[tuple[str, ...]]:
    last = ""
    for state in life_cycle.states:
        for one in life_cycle.transitions:
            if one.source == state:
                yield (
                    "" if state == last else state,
                    one.name,
                    TAKEN_BY[one.by],
                    one.target,
                    _EFFECTS[one.effect],
                )
                last = state
