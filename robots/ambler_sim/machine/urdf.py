"""The Ambler as URDF text: its mechanism for a physics engine, and its look."""

from itertools import pairwise

from robots.ambler_sim.geometry import AMBLER, SHAFT_Y, SHOULDER_Z
from robots.ambler_sim.vocabulary import LEGS
from robots.urdf import box, collision, cylinder, joint, link, robot, solid_box

PARTS = ("shoulder", "extension", "vertical", "foot")
EFFORT = {"shoulder": 3e4, "extension": 2e4, "vertical": 4e4}
"""The greatest torque (Nm) or force (N) of each joint's motor."""

COLOURS = {
    "aluminium": (0.80, 0.82, 0.85),
    "bright": (0.93, 0.94, 0.95),
    "box": (0.93, 0.90, 0.82),
    "dark": (0.20, 0.21, 0.24),
    "orange": (0.93, 0.45, 0.10),
    "blue": (0.16, 0.36, 0.66),
}


def ambler_urdf() -> str:
    """Describe the whole robot. Its joints are shoulder0, extension0, vertical0, foot0, shoulder1
    ...
    """
    return robot("ambler", COLOURS, [_body(), *map(_leg, LEGS)])


def _body() -> str:
    """Two shafts with equipment boxes, a bridge between them, and the scanner on its mast."""
    looks = []
    for y in (AMBLER.shaft_offset, -AMBLER.shaft_offset):
        looks += [
            cylinder((0, y, 0.45), 0.17, 1.7, "bright"),
            box((0, y, 1.40), (0.95, 0.80, 0.24), "dark"),
            box((-0.12, y, 1.86), (0.70, 0.72, 0.68), "box"),
            box((-0.12, y, 2.22), (0.74, 0.76, 0.05), "blue"),
            cylinder((0, y, -0.44), 0.22, 0.10, "dark"),
        ]
    looks += [
        box((0.22, 0, 1.50), (0.26, 2.0, 0.16), "aluminium"),
        box((-0.22, 0, 1.50), (0.26, 2.0, 0.16), "aluminium"),
        cylinder((0.75, 0, 1.95), 0.06, 1.0, "aluminium"),
        box((0.45, 0, 1.50), (0.70, 0.18, 0.12), "aluminium"),
        box((0.80, 0, 2.52), (0.34, 0.56, 0.30), "orange"),
        box((0.98, 0, 2.52), (0.03, 0.40, 0.18), "dark"),
    ]
    width, height = 2 * AMBLER.shaft_offset + AMBLER.body_length / 2, 2.7
    solid = solid_box((0, 0, height / 2 - AMBLER.belly), (AMBLER.body_length, width, height))
    return link(
        "body",
        AMBLER.body_mass,
        (0.9, 2.7, 1.6),
        looks,
        solid,
        centre=(0, 0, AMBLER.body_mass_height),
    )


def _leg(leg: int) -> str:
    """Shoulder beam, sliding extension, vertical link, foot: each the child of the one before."""
    parts, reach, length, width = AMBLER, AMBLER.min_reach, AMBLER.link_length, AMBLER.beam_width
    shoulder = link(
        f"shoulder{leg}_link",
        parts.shoulder_mass,
        (reach, 0.3, 0.25),
        [
            cylinder((0, 0, 0), 0.27, 0.30, "dark"),
            box((reach / 2, 0, 0), (reach, 0.26, 0.24), "aluminium"),
        ],
        solid_box((reach / 2, 0, 0), (reach, width, width)),
        centre=(reach / 2, 0, 0),
    )
    extension = link(
        f"extension{leg}_link",
        parts.extension_mass,
        (parts.beam_length, 0.2, 0.15),
        [
            box((-reach / 2, 0, 0), (reach + 0.2, 0.17, 0.15), "bright"),
            box((0, 0, 0), (0.28, 0.28, 0.42), "blue"),
        ],
        solid_box((-reach / 2, 0, 0), (reach, width, width)),
        centre=(-parts.beam_length / 2, 0, 0),
    )
    middle = (0, 0, length / 2 + 0.1)
    vertical = link(
        f"vertical{leg}_link",
        parts.vertical_mass,
        (0.15, 0.15, length),
        [cylinder(middle, 0.075, length - 0.2, "bright")],
        collision(middle, f'<cylinder radius="0.075" length="{length - 0.2}"/>'),
        centre=(0, 0, length / 2),
    )
    foot = link(
        f"foot{leg}_link",
        parts.foot_mass,
        (0.3, 0.3, 0.1),
        [cylinder((0, 0, -0.02), 0.26, 0.10, "dark"), cylinder((0, 0, 0.08), 0.12, 0.14, "orange")],
        _springs() + collision((0, 0, 0), f'<sphere radius="{parts.foot_radius}"/>'),
    )
    return shoulder + extension + vertical + foot + _joints(leg)


def _joints(leg: int) -> str:
    """Return the joints of a leg, from the body down to the foot."""
    parts, no_offset, upright = AMBLER, (0, 0, 0), (0, 0, 1)
    shaft = (0.0, float(SHAFT_Y[leg]), float(SHOULDER_Z[leg]))
    extent, drop = (0.9, parts.max_reach + 0.1), (0.0, parts.max_drop)
    links = ["body", *(f"{part}{leg}_link" for part in PARTS)]
    motions = (
        ("continuous", shaft, upright, None),
        ("prismatic", no_offset, (1, 0, 0), extent),
        ("prismatic", no_offset, (0, 0, -1), drop),
        ("fixed", (0, 0, parts.foot_radius), upright, None),
    )
    return "".join(
        joint(f"{part}{leg}", kind, upper, lower, origin, axis, limits, EFFORT.get(part, 0.0))
        for part, (upper, lower), (kind, origin, axis, limits) in zip(
            PARTS, pairwise(links), motions, strict=True
        )
    )


def _springs() -> str:
    """Compliant feet. On rigid ones the robot would rock on two or three legs, like a table."""
    return (
        '<contact><lateral_friction value="1.0"/><spinning_friction value="0.01"/>'
        f'<stiffness value="{AMBLER.foot_stiffness}"/>'
        f'<damping value="{AMBLER.foot_damping}"/></contact>'
    )
