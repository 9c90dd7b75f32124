"""A robot publishes a picture of itself. ``tca view`` shows it beside the task tree."""

from tca_module import Variable, connect

PICTURE = Variable("picture of the arm", str)


def drawing(angle: int) -> str:
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 100 60">'
        f'<path d="M50 55V30" stroke="black" transform="rotate({angle} 50 55)"/></svg>'
    )


if __name__ == "__main__":
    with connect("arm") as arm:
        for angle in (0, 30, 60):
            arm.set_variable(PICTURE, drawing(angle))
        print("published", len(drawing(60)), "characters of SVG, turned by 60 degrees")
