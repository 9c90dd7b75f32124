"""Every class of the vocabulary survives encoding and decoding by msgspec."""

from dataclasses import is_dataclass

import msgspec
import numpy as np
import pytest
from ambler.builders import ORIGIN, a_map, a_stance, a_step, an_arc

from robots.ambler_sim import vocabulary
from robots.ambler_sim.machine.making import make_robot
from robots.ambler_sim.planning.elevation import pack_scan
from robots.ambler_sim.planning.gait import plan_body_move
from robots.ambler_sim.planning.leg_recovery import plan_leg_move
from robots.ambler_sim.vocabulary import (
    Contact,
    Fault,
    Foot,
    Footfall,
    Footstep,
    Image,
    Obstacle,
    Rock,
    TerrainSpec,
    Window,
)

STEP = a_step()
ROBOT = make_robot("kinematic")
EXAMPLES = [
    ORIGIN,
    Foot(1, 0.1, 0.2, 0.3),
    a_stance(),
    an_arc(),
    STEP,
    plan_leg_move(a_map(), STEP, STEP.ideal),
    plan_body_move(STEP, STEP.ideal),
    Footfall(STEP.ideal, 3000.0, reached=True),
    a_map(size=2.0),
    pack_scan(a_stance(), ROBOT.scan()),
    Rock(1.0, 1.5, 0.25, 0.7),
    TerrainSpec(rocks=(Rock(1.0, 1.5, 0.25, 0.7),)),
    Contact(2, 1.0, 1.5, 0.5, 2300.0),
    Fault("amplifier trip", 2, needs_operator=True),
    Obstacle(1.0, 1.5, 0.5, 0.45, is_wall=True),
    Window(1.0, 2.0, 0.5),
    Image(3, pack_scan(a_stance(), np.zeros((2, 3)))),
    Footstep(7, 2, Foot(2, 1.0, 2.0, 0.1), Foot(2, 1.01, 2.0, 0.1), ORIGIN, ORIGIN, 0.2, 0.01, 0.6),
    ROBOT.readings(),
    ROBOT.state(),
    ROBOT.state().posture,
    ROBOT.state().posture.attitude,
]


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: type(example).__name__)
def test_vocabulary_value_survives_encoding(example: object) -> None:
    for codec in (msgspec.msgpack, msgspec.json):
        assert codec.decode(codec.encode(example), type=type(example)) == example


def test_vocabulary_has_an_example_of_every_class() -> None:
    nouns = {
        noun for noun in vars(vocabulary).values() if isinstance(noun, type) and is_dataclass(noun)
    }
    assert nouns == {type(example) for example in EXAMPLES}
