"""Parts of a robot as URDF text: what the descriptions of several robots are made of."""

from collections.abc import Mapping, Sequence

Triple = tuple[float, float, float]


def link(name: str, inertia: str, looks: Sequence[str], solid: str = "") -> str:
    """A body, with what it looks like and what is *solid* of it."""
    return f'<link name="{name}">{inertia}{"".join(looks)}{solid}</link>\n'


def joint(
    name: str, kind: str, parent: str, child: str, origin: Triple, axis: Triple, limits: tuple[float, float] | None,
    effort: float,
) -> str:  # fmt: skip
    """What moves *child* against *parent*. Without *limits* it has no end; with both at 0 it would be held at 0."""
    ends = f'lower="{limits[0]}" upper="{limits[1]}" ' if limits else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{_place(origin)}'
        f'<axis xyz="{_text(axis)}"/><limit {ends}effort="{effort}" velocity="10"/></joint>\n'
    )


def inertia_of(mass: float, centre: Triple, size: Triple) -> str:
    """Of a solid box."""
    x, y, z = (side * side * mass / 12 for side in size)
    moments = f'ixx="{y + z}" iyy="{x + z}" izz="{x + y}" ixy="0" ixz="0" iyz="0"'
    return f'<inertial>{_place(centre)}<mass value="{mass}"/><inertia {moments}/></inertial>'


def collision(centre: Triple, geometry: str) -> str:
    """A shape that others run into."""
    return f"<collision>{_place(centre)}<geometry>{geometry}</geometry></collision>"


def box(centre: Triple, size: Triple, colour: str) -> str:
    """The look of a box."""
    return _visual(_place(centre), f'<box size="{_text(size)}"/>', colour)


def cylinder(centre: Triple, radius: float, length: float, colour: str) -> str:
    """The look of an upright cylinder."""
    return _visual(_place(centre), f'<cylinder radius="{radius}" length="{length}"/>', colour)


def wheel(centre: Triple, radius: float, length: float, colour: str) -> str:
    """The look of a cylinder that lies across."""
    place = f'<origin xyz="{_text(centre)}" rpy="1.5707963 0 0"/>'
    return _visual(place, f'<cylinder radius="{radius}" length="{length}"/>', colour)


def materials(colours: Mapping[str, Triple]) -> str:
    """The colours, by name."""
    return "".join(
        f'<material name="{name}"><color rgba="{_text(rgb)} 1"/></material>' for name, rgb in colours.items()
    )


def _visual(place: str, shape: str, colour: str) -> str:
    return f'<visual>{place}<geometry>{shape}</geometry><material name="{colour}"/></visual>'


def _place(origin: Triple) -> str:
    return f'<origin xyz="{_text(origin)}"/>'


def _text(triple: Triple) -> str:
    return " ".join(str(number) for number in triple)
