"""The guide: it leads the joints to points of the wall, and cleans a part of the wall in lanes."""

import math

from robots.cartesian_sim.generated import GuideBase, JointTarget
from robots.cartesian_sim.messages import WallPoint

LEFT, RIGHT = 0.4, 1.6
LANES = (0.3, 0.45, 0.6, 0.75, 0.9)
"""The part of the wall that is cleaned: the ends of its lanes in x, and the y of each lane (m)."""

PATTERN = [
    WallPoint(x, y)
    for lane, y in enumerate(LANES)
    for x in ((LEFT, RIGHT) if lane % 2 == 0 else (RIGHT, LEFT))
]
"""The corners of the tool's way along the lanes."""

TOOL_OUT = 0.19
"""The position (m) of the tool when it is pressed to the wall."""

TOOL_SPEED = 0.3
NEAR = 0.001
"""The distance (m) from a point at which it is reached."""


class Guide(GuideBase):
    """The activities of the guide."""

    # --- ports ------------------------------------------------------------------------------------

    def take_command(self, value: str) -> None:
        """Post a command (clean, stop) as an event."""
        self.post(value)

    def take_goal(self, value: WallPoint) -> None:
        """Go to a point."""
        if self.cleaning.is_in("idle"):
            self.data.goal_x, self.data.goal_y = value.x, value.y
        self.post("go")

    def take_speed(self, value: float) -> None:
        """Set the speed of later moves."""
        self.data.speed = value

    def take_x(self, value: float) -> None:
        """Store the position of the x axis."""
        self.data.x = value

    def take_y(self, value: float) -> None:
        """Store the position of the y axis."""
        self.data.y = value

    def take_tool(self, value: float) -> None:
        """Store the position of the tool."""
        self.data.tool = value

    # --- travel -----------------------------------------------------------------------------------

    def set_out(self) -> None:
        """Send both axes to the goal, at speeds with which they arrive together."""
        data = self.data
        ways = data.goal_x - data.x, data.goal_y - data.y
        length = math.hypot(*ways)
        if length <= NEAR:
            return
        speeds = [max(data.speed * abs(way) / length, NEAR) for way in ways]
        self.target_x.set(JointTarget(data.goal_x, speeds[0]))
        self.target_y.set(JointTarget(data.goal_y, speeds[1]))

    def is_there(self) -> bool:
        """Return whether both axes are at the goal."""
        return math.dist((self.data.x, self.data.y), (self.data.goal_x, self.data.goal_y)) <= NEAR

    # --- cleaning ---------------------------------------------------------------------------------

    def go_to_first(self) -> None:
        """Go to the start of the first lane."""
        self.data.passed = 0
        self._go_to_corner()

    def extend_tool(self) -> None:
        """Press the tool against the wall."""
        self.target_tool.set(JointTarget(TOOL_OUT, TOOL_SPEED))

    def retract_tool(self) -> None:
        """Take the tool off the wall."""
        self.target_tool.set(JointTarget(0.0, TOOL_SPEED))

    def follow(self) -> None:
        """Follow the pattern: at each corner set out for the next one."""
        if self.is_there():
            self.data.passed += 1
            if not self.is_pattern_done():
                self._go_to_corner()

    def is_tool_out(self) -> bool:
        """Return whether the tool touches the wall."""
        return abs(self.data.tool - TOOL_OUT) <= NEAR

    def is_tool_back(self) -> bool:
        """Return whether the tool is off the wall."""
        return self.data.tool <= NEAR

    def is_pattern_done(self) -> bool:
        """Return whether all lanes are clean."""
        return self.data.passed >= len(PATTERN)

    def _go_to_corner(self) -> None:
        point = PATTERN[self.data.passed]
        self.data.goal_x, self.data.goal_y = point.x, point.y
        self.set_out()
