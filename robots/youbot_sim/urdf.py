"""The robot as URDF text, after the youBot's published dimensions: for a physics engine, and for its pictures.

The wheels only turn in pictures: the base slides in x and y and turns, as four mecanum wheels let it.
"""

import itertools
from collections.abc import Sequence

from robots.youbot_sim.kinematics import FORE, HAND, LIMITS, MOUNT, SHOULDER_AHEAD, SHOULDER_HEIGHT, UPPER
from robots.youbot_sim.places import OBJECT

Triple = tuple[float, float, float]

EFFORT = {"base": 800.0, "arm": 60.0, "finger": 25.0}
"""The strongest force (N) or torque (Nm) of a motor."""

SHOULDER_RISE = 0.019
WRIST_TO_TURN = 0.1136
FINGER = (0.008, 0.016, 0.055)

GRIP = '<contact><lateral_friction value="2.0"/><spinning_friction value="0.05"/></contact>'
"""Of the fingers: rubber."""

COLOURS = {
    "orange": (0.93, 0.46, 0.10),
    "dark": (0.13, 0.14, 0.16),
    "grey": (0.55, 0.57, 0.60),
    "bright": (0.86, 0.87, 0.88),
}


def youbot_urdf() -> str:
    """The whole robot. Joints: x, y, heading, arm1 to arm5, finger1 and finger2."""
    parts = f"{_materials()}{_slides()}{_base()}{_arm()}{_gripper()}"
    return f'<?xml version="1.0"?>\n<robot name="youbot">{parts}</robot>\n'


def _slides() -> str:
    """Two sledges without a shape, so that the base moves freely in the plane."""
    sledges = "".join(_link(name, 1.0, (0.1, 0.1, 0.1)) for name in ("ground", "sledge_x", "sledge_y"))
    return (
        sledges
        + _joint("x", "prismatic", "ground", "sledge_x", (0, 0, 0), (1, 0, 0), (-20, 20), EFFORT["base"])
        + _joint("y", "prismatic", "sledge_x", "sledge_y", (0, 0, 0), (0, 1, 0), (-20, 20), EFFORT["base"])
        + _joint("heading", "continuous", "sledge_y", "base", (0, 0, 0), (0, 0, 1), None, EFFORT["base"])
    )


def _base() -> str:
    """580 by 376 by 140 mm, wheels of 100 mm, the plate for the arm on top."""
    looks = [
        _box((0, 0, 0.075), (0.56, 0.22, 0.07), "dark"),
        _box((0, 0, 0.105), (0.58, 0.376, 0.02), "orange"),
        _box((0.285, 0, 0.07), (0.012, 0.24, 0.06), "orange"),
        _box((-0.285, 0, 0.07), (0.012, 0.24, 0.06), "orange"),
        _box((-0.10, 0, 0.122), (0.30, 0.24, 0.014), "dark"),
        _box((-0.10, 0, 0.132), (0.26, 0.20, 0.006), "grey"),
        _cylinder((MOUNT, 0, 0.15), 0.062, 0.07, "dark"),
    ]
    for x in (0.235, -0.235):
        for y in (0.15, -0.15):
            looks.append(_wheel((x, y, 0.05), 0.05, 0.065, "dark"))
            looks.append(_wheel((x, y, 0.05), 0.030, 0.072, "grey"))
            looks.append(_wheel((x, y, 0.05), 0.012, 0.076, "orange"))
    shape = f'<collision>{_place((0, 0, 0.09))}<geometry><box size="0.58 0.376 0.08"/></geometry></collision>'
    return _link("base", 20.0, (0.58, 0.376, 0.14), looks, centre=(0, 0, 0.08), shape=shape)


def _arm() -> str:
    """Five joints: one about the upright, three that lean, one about the hand."""
    names = ["base", "arm1_link", "arm2_link", "arm3_link", "arm4_link", "hand"]
    places = [
        (MOUNT, 0.0, SHOULDER_HEIGHT - SHOULDER_RISE),
        (SHOULDER_AHEAD, 0.0, SHOULDER_RISE),
        (0.0, 0.0, UPPER),
        (0.0, 0.0, FORE),
        (0.0, 0.0, WRIST_TO_TURN),
    ]
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 0, 1)]
    joints = [
        _joint(f"arm{number}", "revolute", *ends, place, axis, limits, EFFORT["arm"])
        for number, (ends, place, axis, limits) in enumerate(
            zip(itertools.pairwise(names), places, axes, LIMITS, strict=True), start=1
        )
    ]
    return "".join([*_arm_links(), *joints])


def _arm_links() -> list[str]:
    """Shoulder, upper arm, forearm, wrist and hand."""
    joint = _wheel((SHOULDER_AHEAD, 0, SHOULDER_RISE), 0.042, 0.105, "dark")
    upper = _box((0, 0, UPPER / 2), (0.062, 0.082, UPPER - 0.02), "orange")
    elbow = _wheel((0, 0, UPPER), 0.037, 0.098, "dark")
    fore = _box((0, 0, FORE / 2), (0.054, 0.07, FORE - 0.02), "orange")
    bend = _wheel((0, 0, FORE), 0.032, 0.086, "dark")
    wrist = [_box((0, 0, 0.05), (0.048, 0.056, 0.07), "orange"), _cylinder((0, 0, 0.095), 0.030, 0.035, "dark")]
    palm = _box((0, 0, 0.02), (0.05, 0.105, 0.034), "grey")
    return [
        _link("arm1_link", 1.39, (0.12, 0.12, 0.08), [_cylinder((0, 0, -0.02), 0.058, 0.06, "orange"), joint]),
        _link("arm2_link", 1.318, (0.07, 0.08, UPPER), [upper, elbow], centre=(0, 0, UPPER / 2)),
        _link("arm3_link", 0.821, (0.06, 0.07, FORE), [fore, bend], centre=(0, 0, FORE / 2)),
        _link("arm4_link", 0.769, (0.06, 0.06, 0.1), wrist, centre=(0, 0, 0.05)),
        _link("hand", 0.687, (0.06, 0.1, 0.04), [palm], centre=(0, 0, 0.02)),
    ]


def _gripper() -> str:
    """Two fingers; each joint is how far its inner side is from the middle."""
    thick, wide, long = FINGER
    tip = HAND - WRIST_TO_TURN
    parts = []
    for number, side in ((1, 1), (2, -1)):
        name, middle = f"finger{number}", (0.0, side * thick / 2, tip - long / 2 + OBJECT[2] / 3)
        size = (wide, thick, long)
        shape = f'<collision>{_place(middle)}<geometry><box size="{_text(size)}"/></geometry></collision>'
        looks = [_box(middle, size, "bright"), _box((0.0, side * thick, 0.045), (0.014, 0.01, 0.05), "dark")]
        link = _link(f"{name}_link", 0.05, FINGER, looks, shape=f"{GRIP}{shape}", centre=middle)
        ends, force = (0.0, 0.03), EFFORT["finger"]
        parts += [link, _joint(name, "prismatic", "hand", f"{name}_link", (0, 0, 0), (0, side, 0), ends, force)]
    return "".join(parts)


def _joint(
    name: str, kind: str, parent: str, child: str, origin: Triple, axis: Triple, limits: tuple[float, float] | None,
    effort: float,
) -> str:  # fmt: skip
    ends = f'lower="{limits[0]}" upper="{limits[1]}" ' if limits else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{_place(origin)}'
        f'<axis xyz="{_text(axis)}"/><limit {ends}effort="{effort}" velocity="10"/></joint>\n'
    )


def _link(
    name: str, mass: float, size: Triple, looks: Sequence[str] = (), *, centre: Triple = (0, 0, 0), shape: str = ""
) -> str:
    """Its inertia is that of a solid box."""
    x, y, z = (side * side * mass / 12 for side in size)
    moments = f'ixx="{y + z}" iyy="{x + z}" izz="{x + y}" ixy="0" ixz="0" iyz="0"'
    inertia = f'<inertial>{_place(centre)}<mass value="{mass}"/><inertia {moments}/></inertial>'
    return f'<link name="{name}">{inertia}{"".join(looks)}{shape}</link>\n'


def _box(centre: Triple, size: Triple, colour: str) -> str:
    return _visual(_place(centre), f'<box size="{_text(size)}"/>', colour)


def _cylinder(centre: Triple, radius: float, length: float, colour: str) -> str:
    return _visual(_place(centre), f'<cylinder radius="{radius}" length="{length}"/>', colour)


def _wheel(centre: Triple, radius: float, length: float, colour: str) -> str:
    """A cylinder that lies across."""
    place = f'<origin xyz="{_text(centre)}" rpy="1.5707963 0 0"/>'
    return _visual(place, f'<cylinder radius="{radius}" length="{length}"/>', colour)


def _visual(place: str, shape: str, colour: str) -> str:
    return f'<visual>{place}<geometry>{shape}</geometry><material name="{colour}"/></visual>'


def _place(origin: Triple) -> str:
    return f'<origin xyz="{_text(origin)}"/>'


def _materials() -> str:
    return "".join(
        f'<material name="{name}"><color rgba="{_text(rgb)} 1"/></material>' for name, rgb in COLOURS.items()
    )


def _text(triple: Triple) -> str:
    return " ".join(str(number) for number in triple)
