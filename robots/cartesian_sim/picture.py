"""The wall, the robot and what is clean, as SVG."""

from robots.cartesian_sim.guide import PATTERN
from robots.cartesian_sim.mechanism import TOUCHES, Scene, Stroke

WIDTH, HEIGHT = 2.0, 1.2
MARGIN = 0.12
BRUSH = 0.15
"""Metres that the tool wipes."""

STYLE = """
polyline{fill:none;stroke-linejoin:round;stroke-linecap:round}
.wall{fill:#dfe5ea}.clean{stroke:#8fd0a8}.way{stroke:#7b8794}.rail{fill:#52606d}.carriage{fill:#1f2933}
.tool{fill:#f0a500;stroke:#1f2933}.out{fill:#d9480f}text{fill:#3e4c59;font:0.07px sans-serif}
@media(prefers-color-scheme:dark){.wall{fill:#2b3540}.clean{stroke:#3f8f62}.rail{fill:#8a99a8}.carriage{fill:#d9dee4}text{fill:#aeb9c4}}
"""


def draw(scene: Scene) -> str:
    """The picture: y points up, as on the wall."""
    x, y = scene.x, HEIGHT - scene.y
    is_out = scene.tool >= TOUCHES * 0.2
    reach = 0.035 + 0.03 * scene.tool / 0.2
    parts = [
        f'<rect class="wall" width="{WIDTH}" height="{HEIGHT}"/>',
        *(_line(stroke, "clean", BRUSH) for stroke in scene.strokes),
        _line(tuple((point.x, point.y) for point in PATTERN), "way", 0.006, ' stroke-dasharray="0.02 0.02"'),
        f'<rect class="rail" x="{x - 0.02:.3f}" y="-0.06" width="0.04" height="{HEIGHT + 0.12}"/>',
        f'<rect class="carriage" x="{x - 0.06:.3f}" y="{y - 0.06:.3f}" width="0.12" height="0.12" rx="0.015"/>',
        f'<circle class="tool{" out" * is_out}" cx="{x:.3f}" cy="{y:.3f}" r="{reach:.3f}" stroke-width="0.008"/>',
        f'<text x="0" y="{HEIGHT + 0.14}">x {scene.x:.3f} m   y {scene.y:.3f} m   tool {scene.tool:.3f} m</text>',
    ]
    width, height = WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN + 0.06
    size = f'viewBox="{-MARGIN} {-MARGIN} {width} {height}" width="{300 * width:.0f}" height="{300 * height:.0f}"'
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}><style>{STYLE}</style>{"".join(parts)}</svg>'


def _line(points: Stroke, name: str, width: float, more: str = "") -> str:
    way = " ".join(f"{x:.3f},{HEIGHT - y:.3f}" for x, y in points)
    return f'<polyline class="{name}" points="{way}" stroke-width="{width}"{more}/>'
