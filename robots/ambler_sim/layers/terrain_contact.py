"""The terrain contact layer: the ladder of figure 3, for a leg that meets an obstacle unseen by the
scanner.

Each rung is attached at its own level of the task tree. First the leg move is retried higher. Then
the step is planned again. Then the feet are shuffled into the standard configuration and the arc is
begun again.
"""

from robots.ambler_sim.messages import MOVE_LEG, TAKE_STEPS, TERRAIN_COLLISION
from robots.ambler_sim.recovery import RAISE_LEG, REPLAN_MOVE, make_layer
from tca_module import Module

layer = make_layer("terrain contact")


@layer.at_start
def attach(module: Module) -> None:
    """Attach a rung to every leg move and step."""
    module.on_failure(TERRAIN_COLLISION, RAISE_LEG, of=MOVE_LEG, maximum=2)
    module.on_failure(TERRAIN_COLLISION, REPLAN_MOVE, of=TAKE_STEPS)


if __name__ == "__main__":
    layer.run()
