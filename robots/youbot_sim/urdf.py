"""The robot as URDF text, after the youBot's published dimensions, for a physics engine and its
pictures.

The wheels do not turn: the base slides in x and y and turns, as with four mecanum wheels.
"""

from robots.urdf import box, cylinder, joint, link, robot, solid_box, wheel
from robots.youbot_sim.kinematics import (
    FORE,
    HAND,
    LIMITS,
    MOUNT,
    SHOULDER_AHEAD,
    SHOULDER_HEIGHT,
    UPPER,
)
from robots.youbot_sim.places import OBJECT

EFFORT = {"base": 800.0, "arm": 60.0, "gripper": 25.0}
"""The greatest force (N) or torque (Nm) of a motor."""

SHOULDER_RISE = 0.019
WRIST_TO_TURN = 0.1136
FINGER = (0.008, 0.016, 0.055)

GRIP = '<contact><lateral_friction value="2.0"/><spinning_friction value="0.05"/></contact>'
"""The contact of the rubber fingers."""

COLOURS = {
    "orange": (0.93, 0.46, 0.10),
    "dark": (0.13, 0.14, 0.16),
    "grey": (0.55, 0.57, 0.60),
    "bright": (0.86, 0.87, 0.88),
}


def youbot_urdf() -> str:
    """Describe the whole robot. Joints: x, y, heading, arm1 to arm5, finger1 and finger2."""
    return robot("youbot", COLOURS, [_slides(), _base(), _arm(), _gripper()])


def _slides() -> str:
    """Two sledges without a shape, on which the base moves freely in the plane."""
    sledges = [link(name, 1.0, (0.1, 0.1, 0.1)) for name in ("ground", "sledge_x", "sledge_y")]
    ways = [
        ("x", "prismatic", ("ground", "sledge_x"), (1, 0, 0), (-20, 20)),
        ("y", "prismatic", ("sledge_x", "sledge_y"), (0, 1, 0), (-20, 20)),
        ("heading", "continuous", ("sledge_y", "base"), (0, 0, 1), None),
    ]
    joints = [
        joint(name, kind, *ends, (0, 0, 0), axis, limits, EFFORT["base"])
        for name, kind, ends, axis, limits in ways
    ]
    return "".join([*sledges, *joints])


def _base() -> str:
    """Return the base: 580 by 376 by 140 mm, wheels of 100 mm, and the plate for the arm on top."""
    looks = [
        box((0, 0, 0.075), (0.56, 0.22, 0.07), "dark"),
        box((0, 0, 0.105), (0.58, 0.376, 0.02), "orange"),
        box((0.285, 0, 0.07), (0.012, 0.24, 0.06), "orange"),
        box((-0.285, 0, 0.07), (0.012, 0.24, 0.06), "orange"),
        box((-0.10, 0, 0.122), (0.30, 0.24, 0.014), "dark"),
        box((-0.10, 0, 0.132), (0.26, 0.20, 0.006), "grey"),
        cylinder((MOUNT, 0, 0.15), 0.062, 0.07, "dark"),
    ]
    for x in (0.235, -0.235):
        for y in (0.15, -0.15):
            looks.append(wheel((x, y, 0.05), 0.05, 0.065, "dark"))
            looks.append(wheel((x, y, 0.05), 0.030, 0.072, "grey"))
            looks.append(wheel((x, y, 0.05), 0.012, 0.076, "orange"))
    shape = solid_box((0, 0, 0.09), (0.58, 0.376, 0.08))
    return link("base", 20.0, (0.58, 0.376, 0.14), looks, shape, centre=(0, 0, 0.08))


def _arm() -> str:
    """Return the arm's links and joints: one joint turns the arm, three lean it, one turns the
    hand.
    """
    rows = [
        ("base", "arm1_link", (MOUNT, 0.0, SHOULDER_HEIGHT - SHOULDER_RISE), (0, 0, 1)),
        ("arm1_link", "arm2_link", (SHOULDER_AHEAD, 0.0, SHOULDER_RISE), (0, 1, 0)),
        ("arm2_link", "arm3_link", (0.0, 0.0, UPPER), (0, 1, 0)),
        ("arm3_link", "arm4_link", (0.0, 0.0, FORE), (0, 1, 0)),
        ("arm4_link", "hand", (0.0, 0.0, WRIST_TO_TURN), (0, 0, 1)),
    ]
    joints = [
        joint(f"arm{number}", "revolute", *row, limits, EFFORT["arm"])
        for number, (row, limits) in enumerate(zip(rows, LIMITS, strict=True), start=1)
    ]
    return "".join([*_arm_links(), *joints])


def _arm_links() -> list[str]:
    """Shoulder, upper arm, forearm, wrist and hand."""
    shoulder = wheel((SHOULDER_AHEAD, 0, SHOULDER_RISE), 0.042, 0.105, "dark")
    upper = box((0, 0, UPPER / 2), (0.062, 0.082, UPPER - 0.02), "orange")
    elbow = wheel((0, 0, UPPER), 0.037, 0.098, "dark")
    fore = box((0, 0, FORE / 2), (0.054, 0.07, FORE - 0.02), "orange")
    bend = wheel((0, 0, FORE), 0.032, 0.086, "dark")
    wrist = [
        box((0, 0, 0.05), (0.048, 0.056, 0.07), "orange"),
        cylinder((0, 0, 0.095), 0.030, 0.035, "dark"),
    ]
    palm = box((0, 0, 0.02), (0.05, 0.105, 0.034), "grey")
    return [
        link(
            "arm1_link",
            1.39,
            (0.12, 0.12, 0.08),
            [cylinder((0, 0, -0.02), 0.058, 0.06, "orange"), shoulder],
        ),
        link("arm2_link", 1.318, (0.07, 0.08, UPPER), [upper, elbow], centre=(0, 0, UPPER / 2)),
        link("arm3_link", 0.821, (0.06, 0.07, FORE), [fore, bend], centre=(0, 0, FORE / 2)),
        link("arm4_link", 0.769, (0.06, 0.06, 0.1), wrist, centre=(0, 0, 0.05)),
        link("hand", 0.687, (0.06, 0.1, 0.04), [palm], centre=(0, 0, 0.02)),
    ]


def _gripper() -> str:
    """Two fingers. Each joint value is the distance of the finger's inner side from the middle."""
    thick, wide, long = FINGER
    tip = HAND - WRIST_TO_TURN
    parts = []
    for number, side in ((1, 1), (2, -1)):
        name, middle = f"finger{number}", (0.0, side * thick / 2, tip - long / 2 + OBJECT[2] / 3)
        size = (wide, thick, long)
        looks = [
            box(middle, size, "bright"),
            box((0.0, side * thick, 0.045), (0.014, 0.01, 0.05), "dark"),
        ]
        finger = link(
            f"{name}_link", 0.05, FINGER, looks, GRIP + solid_box(middle, size), centre=middle
        )
        ends, force = (0.0, 0.03), EFFORT["gripper"]
        parts += [
            finger,
            joint(name, "prismatic", "hand", f"{name}_link", (0, 0, 0), (0, side, 0), ends, force),
        ]
    return "".join(parts)
