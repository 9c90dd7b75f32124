"""Frames, looks and ends of arrows that all pictures of machines have, in the language of Graphviz."""

from collections.abc import Iterator, Sequence
from html import escape
from typing import Protocol

from tca_tools.terminal import cut
from tca_wire.text.printable import printable

INK, FAINT = "#1f2933", "#52606d"
LONGEST_NAME = 36
LOOKS = f"""\
  graph [fontname="Helvetica,Arial,sans-serif", fontsize=12, fontcolor="{INK}", labelloc=t, labeljust=l,
    bgcolor=white, pad=0.3, nodesep=0.4, ranksep=0.4, compound=true];
  node [shape=box, style="rounded,filled", fillcolor=white, fontname="Helvetica,Arial,sans-serif", fontsize=12,
    fontcolor="{INK}", color="{INK}", penwidth=1, margin="0.12,0.06", height=0.3];
  edge [fontname="Helvetica,Arial,sans-serif", fontsize=10, penwidth=1, arrowsize=0.7];
"""
POINT = f'shape=circle, label="", width=0.11, height=0.11, fixedsize=true, color="{INK}"'
NOWHERE = 'shape=point, width=0.01, height=0.01, style=invis, label=""'


class FramedKind(Protocol):
    """The kind of a state."""

    @property
    def is_container(self) -> bool:
        """Whether it holds states."""


class Nested(Protocol):
    """A state that may stand in another."""

    @property
    def kind(self) -> FramedKind:
        """Its kind."""

    @property
    def parent(self) -> int:
        """The number of the state that holds it; -1: none does."""


def head(states: Sequence[Nested], number: int) -> str:
    """The node where an arrow to a state ends; of a container the one that stands for its frame."""
    return f"begin_{number}" if states[number].kind.is_container else f"s{number}"


def tail(states: Sequence[Nested], number: int) -> str:
    """The node where an arrow out of a state begins."""
    return f"end_{number}" if states[number].kind.is_container else f"s{number}"


def frames(states: Sequence[Nested], source: int, target: int) -> list[str]:
    """The frames at which an arrow is cut; none that holds both its ends. Its head has room before a frame."""
    return [
        look.format(number)
        for look, number, other in (
            ("ltail=cluster_{}", source, target),
            ("lhead=cluster_{}, minlen=2", target, source),
        )
        if number >= 0 and states[number].kind.is_container and number not in around(states, other)
    ]


def around(states: Sequence[Nested], number: int) -> Iterator[int]:
    """A state, and the containers that it stands in."""
    while number >= 0:
        yield number
        number = states[number].parent


def text(words: str, longest: int) -> str:
    """Words in a label of HTML."""
    return escape(cut(printable(words), longest)) or "?"
