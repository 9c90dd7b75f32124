"""Parts of URDF robot descriptions, as text. Several robots use them."""

from collections.abc import Iterable, Mapping

Triple = tuple[float, float, float]


def robot(name: str, colours: Mapping[str, Triple], parts: Iterable[str]) -> str:
    """Return the whole description: the colours that visuals name, and the links and joints."""
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
    """Return a link with the inertia of a box of this size, its visuals *looks* and its collision
    shape *solid*.
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
    """Return a joint that moves *child* against *parent*.

    Without *limits* the joint turns or slides without end. Limits of 0 and 0 would hold it at 0.
    """
    ends = f'lower="{limits[0]}" upper="{limits[1]}" ' if limits else ""
    return (
        f'<joint name="{name}" type="{kind}">'
        f'<parent link="{parent}"/><child link="{child}"/>{_place(origin)}'
        f'<axis xyz="{_text(axis)}"/><limit {ends}effort="{effort}" velocity="10"/></joint>\n'
    )


def solid_box(centre: Triple, size: Triple) -> str:
    """Return the collision shape of a box."""
    return collision(centre, f'<box size="{_text(size)}"/>')


def collision(centre: Triple, geometry: str) -> str:
    """Return a collision shape."""
    return f"<collision>{_place(centre)}<geometry>{geometry}</geometry></collision>"


def box(centre: Triple, size: Triple, colour: str) -> str:
    """Return the visual of a box."""
    return _visual(_place(centre), f'<box size="{_text(size)}"/>', colour)


def cylinder(centre: Triple, radius: float, length: float, colour: str) -> str:
    """Return the visual of an upright cylinder."""
    return _visual(_place(centre), f'<cylinder radius="{radius}" length="{length}"/>', colour)


def wheel(centre: Triple, radius: float, length: float, colour: str) -> str:
    """Return the visual of a cylinder that lies across."""
    place = f'<origin xyz="{_text(centre)}" rpy="1.5707963 0 0"/>'
    return _visual(place, f'<cylinder radius="{radius}" length="{length}"/>', colour)


def _visual(place: str, shape: str, colour: str) -> str:
    return f'<visual>{place}<geometry>{shape}</geometry><material name="{colour}"/></visual>'


def _place(origin: Triple) -> str:
    return f'<origin xyz="{_text(origin)}"/>'


def _text(triple: Triple) -> str:
    return " ".join(str(number) for number in triple)
