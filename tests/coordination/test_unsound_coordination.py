"""An unsound machine is rejected when it is built. The error is one line that says how to repair
the machine.
"""

from collections.abc import Callable
from typing import Any

import pytest

import tca_behaviours.coordination
import tca_module
from tca_behaviours.coordination import (
    Activity,
    Agent,
    Coordination,
    Do,
    Fact,
    Prior,
    Situation,
    UnsoundMachine,
    Weighted,
)
from tca_module import BadData, Command, MisuseError, Variable

MOVE = Command("move", str, progress=float)
LOOK = Command("look", progress=list[float])
FREE = Variable("free", bool)
NAME = Variable("name", str)
ARM = Agent("arm")


def move(**options: Any) -> Activity:
    return Activity(Do(MOVE, "B", ARM), **options)


def needing(needs: dict[str, Fact], makes: dict[str, Fact]) -> Activity:
    return move(needs=needs, makes=makes)


def holds(_: Situation) -> bool:
    return True


def _unknown(m: Coordination) -> None:
    m.state("a").to("home", "go")
    m.state("b")


def _of_another(m: Coordination) -> None:
    with Coordination("other") as other:
        there = other.state("there")
        there.to(there, "go")
    m.state("a").to(there, "go")


def _never_reached(m: Coordination) -> None:
    m.state("a").to("a", "go")
    m.state("b").to("a", "go")
    with m.compound("c"):
        m.state("d").to("a", "go")


def _dead_end(m: Coordination) -> None:
    m.state("a").to("b", "go")
    m.state("b", move())


def _final_first(m: Coordination) -> None:
    m.state("a").to("b", "go")
    with m.compound("b") as b:
        m.final("c")
    b.to("a")


def _leaves_final(m: Coordination) -> None:
    m.state("a").to("b", "go")
    m.final("b").to("a")


def _waits_for_done(m: Coordination) -> None:
    m.state("a").to("b")
    m.final("b")


def _compound_never_done(m: Coordination) -> None:
    with m.compound("c") as c:
        m.state("a").to("a", "go")
    c.to("b")
    m.final("b")


def _compound_stuck(m: Coordination) -> None:
    with m.compound("c") as c:
        m.state("a", move()).to("e")
        m.final("e")
    c.to("b", when=FREE)
    m.final("b")


def _ends_for_ever(m: Coordination) -> None:
    with m.compound("c") as c:
        m.state("a", move()).to("e")
        m.final("e")
    with m.compound("d") as d:
        m.state("b", move()).to("f")
        m.final("f")
    c.to("f")
    d.to("e", when=FREE)
    d.to("a")


def _same_symbol(m: Coordination) -> None:
    a = m.state("a", move())
    a.to("b", when=lambda _: True)
    a.to("a", when=lambda _: False)
    m.final("b")


def _hidden(m: Coordination) -> None:
    a = m.state("a", move())
    a.to("a")
    a.to("b", when=FREE)
    m.final("b")


def _hidden_inside(m: Coordination) -> None:
    with m.compound("c") as c:
        m.state("a", move()).to("a", "stop")
    c.to("b", "stop", when=FREE)
    c.to("b", "failed")
    m.final("b")


def _too_likely(m: Coordination) -> None:
    with m.compound("c") as c:
        a = m.state("a", move())
        a.to("a", when=holds, likelihood=Prior(0.5))
        a.to("b", likelihood=Weighted([(1, Prior(0.3)), (1, Prior(0.5))]))
    c.to("b", "stop", likelihood=Prior(0.2))
    m.final("b")


def _no_probability(m: Coordination) -> None:
    m.state("a", move()).to("a", likelihood=Prior(1.2))


def _crowded(m: Coordination) -> None:
    m.state("a", Activity(Do(MOVE, "B", ARM), Do(MOVE, "C", ARM))).to("a")


def _two_arms(m: Coordination) -> None:
    m.state("a", move()).to("b")
    m.state("b", Activity(Do(MOVE, "B", Agent("arm", tasks=2)))).to("a")


def _nobody_makes(m: Coordination) -> None:
    m.state("a", needing({"arm": "B"}, {"arm": "C"})).to("a")


def _circle(m: Coordination) -> None:
    m.state("a", needing({}, {"w": 1})).to("b")
    m.state("b", needing({"w": 1, "x": 1}, {"y": True})).to("c")
    m.state("c", needing({"y": True}, {"z": 1})).to("d")
    m.state("d", needing({"z": 1}, {"x": 1})).to("a")


def test_unsound_machine_is_rejected_with_its_reason(approve: Callable[..., None]) -> None:
    def message_of(write: str) -> str:
        machine = Coordination("m")
        with pytest.raises(UnsoundMachine) as refused, machine:
            eval(write)(machine)
        return str(refused.value)

    approve("unsound_machines.txt", message_of)


def test_coordination_misuse_is_rejected_with_its_reason(approve: Callable[..., None]) -> None:
    def message_of(case: str) -> str:
        machine = Coordination("m")
        with pytest.raises((MisuseError, BadData)) as refused, machine:
            eval(
                case,
                {
                    **vars(tca_module),
                    **vars(tca_behaviours.coordination),
                    **globals(),
                    "m": machine,
                },
            )
        return str(refused.value)

    approve("misuses.txt", message_of)
