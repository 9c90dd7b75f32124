"""A mission that writes TCA, each letter with another pen."""

from tca_behaviours.missions import Mission

# The strokes of each letter.
T = [[(0.8, 8.0), (3.4, 8.0)], [(2.1, 8.0), (2.1, 3.0)]]
C = [
    [(6.4, 7.2), (5.6, 8.0), (4.6, 8.0), (3.9, 7.0), (3.9, 4.0), (4.6, 3.0), (5.6, 3.0), (6.4, 3.8)]
]
A = [[(7.2, 3.0), (8.6, 8.0), (10.0, 3.0)], [(9.5, 4.8), (7.7, 4.8)]]

PENS = ({"r": 200, "g": 60, "b": 40}, {"r": 40, "g": 90, "b": 170}, {"r": 60, "g": 130, "b": 70})
EXACTLY = {"k_v": 2.0, "k_alpha": 4.0, "max_velocity": 2.0, "dist_threshold": 0.05}


def letters(mission: Mission) -> None:
    """Draw each stroke, with the pen up on the way to the next."""
    mission.Clear(header={"frame_id": "letters"})
    for colour, strokes in zip(PENS, (T, C, A), strict=True):
        for start, *others in strokes:
            mission.SetPen(on=False)
            mission.GoTo(goal_x=start[0], goal_y=start[1], **EXACTLY)
            mission.SetPen(width=10, **colour)
            for x, y in others:
                mission.GoTo(goal_x=x, goal_y=y, **EXACTLY)
    mission.SetPen(on=False)
    mission.GoTo(goal_x=5.5, goal_y=1.5)


if __name__ == "__main__":
    with Mission("turtle") as turtle:
        letters(turtle)
