"""Draws a flag above a row wherever something failed in it: the bars themselves may be too narrow to be seen."""

from collections.abc import Iterator
from dataclasses import dataclass

from tca_tools.drawing.svg import lines
from tca_tools.gantt.parts import Row
from tca_tools.gantt.scale import Scale
from tca_tools.gantt.shapes import COPED, FAILED

_WIDE, _TALL = 8.0, 7.0
_ABOVE = 10.0
"""Pixels: from a row's top to that of its flags."""
_TOGETHER = 6.0
"""Pixels: failures that are no further from each other share a flag."""


@dataclass(slots=True)
class _Failure:
    """One of them, in a bar or beside its handler."""

    time: float
    has_coped: bool
    title: str


def flags(row: Row, scale: Scale, top: float) -> Iterator[str]:
    """The flags of a row; red ones over amber ones."""
    for with_coped in (True, False):
        chosen = [one for one in _failures(row, scale) if one.has_coped is with_coped]
        for some in _side_by_side(chosen, _TOGETHER * scale.pixel):
            x, y = scale.x((some[0].time + some[-1].time) / 2), top - _ABOVE
            count = f"{len(some)} failures from {some[0].time:.3f} s to {some[-1].time:.3f} s, first: "
            title = (count if len(some) > 1 else "") + some[0].title
            yield (
                f'<path class="flag" fill="{COPED if with_coped else FAILED}" '
                f'd="M{x - _WIDE / 2:.2f} {y:.1f} h{_WIDE:.0f} l{-_WIDE / 2:.0f} {_TALL:.0f} z">'
                f"<title>{lines(title)}</title></path>"
            )


def _failures(row: Row, scale: Scale) -> list[_Failure]:
    """Those in sight, in the order of time."""
    found = [_Failure(bar.end, bar.has_coped, bar.title) for bar in row.handled if bar.has_failed]
    found += [_Failure(one.time, one.has_coped, one.title) for bar in row.bars for one in bar.raised]
    seen = (one for one in found if scale.start <= one.time <= scale.end)
    return sorted(seen, key=lambda one: one.time)


def _side_by_side(failures: list[_Failure], apart: float) -> Iterator[list[_Failure]]:
    """Those that are no further than that from the first of them."""
    some: list[_Failure] = []
    for one in failures:
        if some and one.time - some[0].time > apart:
            yield some
            some = []
        some.append(one)
    if some:
        yield some
