"""Likelihoods that are learned from journals of earlier runs."""

from coordination.delivery_robot import BOX_B_FREE, base, delivery, play

from tca_behaviours.coordination import Coordination, Learned, Situation, count_transitions
from tca_wire.journal.facts import Entry


def delivered(free: float, name: str = "deliver") -> list[Entry]:
    with play(delivery(name), None) as run:
        run.box_b(free)
        run.begin()
        run.event("object given")
        run.central.advance(60)
        return run.central.entries


def test_transition_counts_cover_all_runs_of_one_machine() -> None:
    journals = [delivered(1.0), delivered(0.0), delivered(1.0), delivered(1.0, "another")]
    counts = count_transitions(journals, delivery().chart)
    assert counts["going to B", "done [box B is free]"] == 2
    assert counts["going to B", "done"] == 1
    assert counts["tucking", "done"] == 3
    with Coordination("deliver") as machine:
        there, end = machine.state("going to B", base("B")), machine.final("end")
        there.to(end, when=BOX_B_FREE, likelihood=Learned(counts))
        there.to(end, likelihood=Learned(counts))
    arrows = machine.automaton(Situation()).arcs(there.number)
    assert [round(arrow.likelihood, 3) for arrow in arrows] == [0.667, 0.333]
