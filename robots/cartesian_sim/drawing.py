"""The wall, the robot and the clean area, as SVG."""

from robots.cartesian_sim.guide import PATTERN
from robots.cartesian_sim.mechanism import TOUCHES, Scene
from robots.drawing import View, attributes

WIDTH, HEIGHT = 2.0, 1.2
MARGIN = 0.12
BRUSH = 0.15
"""The width (m) that the tool wipes."""

STYLE = """
polyline{fill:none;stroke-linejoin:round;stroke-linecap:round}
.wall{fill:#dfe5ea}.clean{stroke:#8fd0a8}.way{stroke:#7b8794}.rail{fill:#52606d}
.carriage{fill:#1f2933}
.tool{fill:#f0a500;stroke:#1f2933}.out{fill:#d9480f}text{fill:#3e4c59;font:0.07px sans-serif}
@media(prefers-color-scheme:dark){
.wall{fill:#2b3540}.clean{stroke:#3f8f62}.rail{fill:#8a99a8}.carriage{fill:#d9dee4}
text{fill:#aeb9c4}}
"""
VIEW = View(0.0, HEIGHT, 1.0, digits=3)


def draw(scene: Scene) -> str:
    """Draw the scene. As on the wall, y points up."""
    x, y = scene.x, scene.y
    is_out = scene.tool >= TOUCHES * 0.2
    places = f"x {scene.x:.3f} m   y {scene.y:.3f} m   tool {scene.tool:.3f} m"
    pattern = [(point.x, point.y) for point in PATTERN]
    parts = [
        VIEW.box("wall", (0.0, 0.0), WIDTH, HEIGHT),
        *(VIEW.line("clean", stroke, stroke_width=BRUSH) for stroke in scene.strokes),
        VIEW.line("way", pattern, stroke_width=0.006, stroke_dasharray="0.02 0.02"),
        VIEW.box("rail", (x - 0.02, -0.06), 0.04, HEIGHT + 0.12),
        VIEW.box("carriage", (x - 0.06, y - 0.06), 0.12, 0.12, rx=0.015),
        VIEW.disc(f"tool{' out' * is_out}", (x, y), 0.035 + 0.15 * scene.tool, stroke_width=0.008),
        VIEW.words(places, (0.0, 0.0), down=0.14),
    ]
    width, height = WIDTH + 2 * MARGIN, HEIGHT + 2 * MARGIN + 0.06
    size = {"width": f"{300 * width:.0f}", "height": f"{300 * height:.0f}"}
    head = attributes({"viewBox": f"{-MARGIN} {-MARGIN} {width} {height}", **size})
    content = f"<style>{STYLE}</style>{''.join(parts)}"
    return f'<svg xmlns="http://www.w3.org/2000/svg"{head}>{content}</svg>'
