"""A shift on a stepped clock: invariants of cups and goals, and the effect of each layer."""

import random
import re
from collections import Counter
from functools import cache

import pytest
from office.stepped import LAYERS, office, run_until_clean, the
from sampling import every

from robots.office_sim.layers import battery, grasps, vanished_cups
from robots.office_sim.layers.battery import RECHARGE, TRIES
from robots.office_sim.messages import COLLECT_CUP, KEEP_FLOOR_FREE, SCENE
from robots.office_sim.vocabulary import CupState, LabScene
from robots.office_sim.world import OfficeWorld
from tca_module import Client, TaskFailed

SHIFT = 150.0
SEEDS = every(3, [1, 3, 4])
NOTICED = 6.0
"""Seconds within which the goal of a vanished cup must end: the time of three pictures, a poll and
a grasp.
"""


class ShiftObserver:
    """An observer that checks the invariants every second."""

    def __init__(self) -> None:
        self.most_goals = 0
        self._gone_for: Counter[int] = Counter()

    def look(self, user: Client, scene: LabScene) -> None:
        """Raise AssertionError if an invariant is broken."""
        assert len(the(scene, CupState.HAND)) <= 1
        assert 0 < scene.battery <= 1
        goals = [goal.data(COLLECT_CUP).spot for goal in user.tasks(COLLECT_CUP)]
        self.most_goals = max(self.most_goals, len(goals))
        is_suspended = bool(user.tasks(RECHARGE))
        for cup in the(scene, CupState.TAKEN):
            if any(cup.spot.to(spot) < 0.1 for spot in goals) and not is_suspended:
                self._gone_for[cup.number] += 1
                assert self._gone_for[cup.number] < NOTICED, f"still a goal for cup {cup.number}"
        assert len(goals) == len({(round(spot.x, 1), round(spot.y, 1)) for spot in goals})


@cache
def shift(seed: int) -> tuple[str, LabScene, int]:
    """Run a whole shift. Return its transcript, its last scene and the greatest number of goals."""
    observer = ShiftObserver()
    central, scene = run_until_clean(OfficeWorld(seed, SHIFT), observer.look)
    return central.transcript(), scene, observer.most_goals


@pytest.mark.parametrize("seed", SEEDS)
def test_each_cup_ends_in_the_bin_or_is_taken(seed: int) -> None:
    transcript, scene, _ = shift(seed)
    assert len(the(scene, CupState.BIN)) + len(the(scene, CupState.TAKEN)) == len(scene.cups)
    lines = transcript.splitlines()
    dropped = {
        line.split("{")[1] for line in lines if re.search(r"returned: drop \{\d+\}: done", line)
    }
    assert len(dropped) == len(the(scene, CupState.BIN))


def test_goals_are_cancelled_when_their_cups_vanish() -> None:
    """A goal that waits for its turn, and has no running task, is cancelled, too."""
    transcript, scene, _ = shift(1)
    cancelled = re.findall(r"killed: collect cup \{(\d+)\}: cup \d+ is out of view", transcript)
    assert 2 <= len(cancelled) <= len(the(scene, CupState.TAKEN))
    before = [transcript.split(f"killed: collect cup {{{number}}}")[0] for number in cancelled]
    began = [
        f"reached: collect cup {{{number}}}: start achieving" in text
        for number, text in zip(cancelled, before, strict=True)
    ]
    assert True in began
    assert False in began


@pytest.mark.soak
def test_office_seed_is_reproducible() -> None:
    runs = [run_until_clean(OfficeWorld(2, 60.0), lambda *_: None) for _ in range(2)]
    assert runs[0][1] == runs[1][1]
    assert runs[0][0].transcript() == runs[1][0].transcript()


def test_office_goals_added_during_others_run_in_order() -> None:
    _, scene, most_goals = shift(1)
    assert most_goals >= 2
    hands = [line for line in scene.happened if "in the hand" in line or "in the bin" in line]
    assert all(
        "hand" in first and "bin" in then
        for first, then in zip(hands[::2], hands[1::2], strict=True)
    )


def test_cup_in_hand_comes_to_the_charger_and_then_the_bin() -> None:
    _, scene = run_until_clean(OfficeWorld(9, 30.0, battery=0.35), ShiftObserver().look)
    told = [line.split("  ")[-1] for line in scene.happened]
    grasped = told.index("cup 1 is in the hand")
    charged = next(number for number, line in enumerate(told) if "is being charged" in line)
    assert grasped < charged < told.index("the battery is full") < told.index("cup 1 is in the bin")


@pytest.mark.parametrize("is_removed", [True, False])
def test_robot_waits_for_a_blocked_charger_with_a_limit(*, is_removed: bool) -> None:
    """A box blocks the charger while the robot arrives with a cup in its hand."""
    world = OfficeWorld(9, 30.0, battery=0.35)
    box = world.floor.charger.around(0.2)
    world.floor.tables.append(box)
    with office(world) as (central, user):
        keeping = user.goal(KEEP_FLOOR_FREE)
        for _ in range(100):
            central.advance(1.0)
        assert user.tasks(RECHARGE)
        (held,) = the(user.query(SCENE), CupState.HAND)
        if is_removed:
            world.floor.tables.remove(box)
        for _ in range(150):
            central.advance(1.0)
        scene = user.query(SCENE)
        if is_removed:
            assert (
                next(cup.state for cup in scene.cups if cup.number == held.number) is CupState.BIN
            )
            assert scene.charges == 1
        else:
            fell, was_put_down = (
                line for line in scene.happened if f"cup {held.number} is on the floor" in line
            )
            assert fell < was_put_down
            with pytest.raises(
                TaskFailed, match=f"could not be charged in {TRIES} tries: nothing leads to"
            ):
                keeping.result(timeout=0)


@pytest.mark.soak
def test_office_rules_hold_in_any_lab() -> None:
    rng = random.Random(1)
    for seed in range(100, 160):
        world = OfficeWorld(
            seed, rng.choice([60.0, 150.0, 300.0]), battery=rng.choice([1.0, rng.uniform(0.3, 0.6)])
        )
        _, scene = run_until_clean(world, ShiftObserver().look)
        assert len(the(scene, CupState.BIN)) + len(the(scene, CupState.TAKEN)) == len(scene.cups)


def test_cup_that_slips_too_often_is_postponed() -> None:
    transcript, scene, _ = shift(1)
    slips = Counter(line.split()[3] for line in scene.happened if line.endswith("slips"))
    often = next(number for number, count in slips.items() if count == 4)
    assert "given up for a while" in transcript
    assert any(f"cup {often} is in the bin" in line for line in scene.happened)


def test_cup_of_a_killed_goal_is_put_down_and_collected_later() -> None:
    with office(OfficeWorld(2, 1.0)) as (central, user):
        user.goal(KEEP_FLOOR_FREE)
        for _ in range(60):
            central.advance(1.0)
            if held := the(user.query(SCENE), CupState.HAND):
                break
        central.advance(3.0)
        for goal in user.tasks(COLLECT_CUP):
            goal.kill("the operator says so")
        central.advance(0.1)
        (lying,) = the(user.query(SCENE), CupState.FLOOR)
        assert lying.number == held[0].number
        assert lying.spot.to(held[0].spot) > 1.0
        central.advance(60.0)
        assert [cup.number for cup in the(user.query(SCENE), CupState.BIN)] == [lying.number]


@pytest.mark.parametrize("without", [vanished_cups, battery, grasps])
def test_office_robot_does_not_import_its_layers(without: object) -> None:
    """Without a layer the robot continues, but worse. It drives to vanished cups, stops, or fails
    at a slip.
    """
    layers = tuple(make for make in LAYERS if make.__module__ != getattr(without, "__name__", ""))
    assert len(layers) == len(LAYERS) - 1
    with office(OfficeWorld(1, SHIFT, battery=0.4), layers) as (central, user):
        keeping = user.goal(KEEP_FLOOR_FREE)
        central.advance(300.0)
        scene, transcript = user.query(SCENE), central.transcript()
        if without is vanished_cups:
            assert "the fingers feel no cup" in transcript
            assert not [cup for cup in scene.cups if cup.state is CupState.FLOOR]
        elif without is battery:
            assert scene.battery == 0
            assert scene.charges == 0
        else:
            with pytest.raises(TaskFailed, match="slipped"):
                keeping.result(timeout=0)
