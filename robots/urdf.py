"""Parts of a robot as URDF text: what the descriptions of several robots are made of."""

from collections.abc import Iterable, Mapping

Triple = tuple[float, float, float]


def robot(name: str, colours: Mapping[str, Triple], parts: Iterable[str]) -> str:
    """The whole description: what looks name as a colour, links and joints."""
    materials = "".join(
        f'<material name="{colour}"><color rgba="{_text(rgb)} 1"/></material>'
        for colour, rgb in colours.items()
    )
    return f'<?xml version="1.0"?>\n<robot name="{name}">{materials}{"".join(parts)}</robot>\n'


def link(
    name: str,
    mass: float,
    size: Triple,
    looks: Iterable[str] = (),
    solid: str = "",
    *,
    centre: Triple = (0, 0, 0),
) -> str:
    """A body that is as heavy as a box of this size, with what it looks like and what is *solid* of
    it.
    """
    x, y, z = (side * side * mass / 12 for side in size)
    moments = f'ixx="{y + z}" iyy="{x + z}" izz="{x + y}" ixy="0" ixz="0" iyz="0"'
    inertia = f'<inertial>{_place(centre)}<mass value="{mass}"/><inertia {moments}/></inertial>'
    return f'<link name="{name}">{inertia}{"".join(looks)}{solid}</link>\n'


def joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    origin: Triple,
    axis: Triple,
    limits: tuple[float, float] | None,
    effort: float,
) -> str:
    """What moves *child* against *parent*. Without *limits* it has no end; with both at 0 it would
    be held at 0.
    """
    ends = f'lower="{limits[0]}" upper="{limits[1]}" ' if limits else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{_place(origin)}'
        f'<axis xyz="{_text(axis)}"/><limit {ends}effort="{effort}" velocity="10"/></joint>\n'
    )


def solid_box(centre: Triple, size: Triple) -> str:
    """A box that others run into."""
    return collision(centre, f'<box size="{_text(size)}"/>')


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


def _visual(place: str, shape: str, colour: str) -> str:
    return f'<visual>{place}<geometry>{shape}</geometry><material name="{colour}"/></visual>'


def _place(origin: Triple) -> str:
    return f'<origin xyz="{_text(origin)}"/>'


def _text(triple: Triple) -> str:
    return " ".join(str(number) for number in triple)
