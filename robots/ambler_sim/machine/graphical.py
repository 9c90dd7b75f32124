"""The graphical backend: the quick one, drawn while it moves."""

from robots.ambler_sim.machine.kinematic import KinematicPlant


class GraphicalPlant(KinematicPlant):
    """It goes exactly where the quick one goes; its controller shows each move, not only where that has led."""

    name = "graphical"
