"""Runs the delivery."""

import argparse

from robots.youbot_sim.coordination import make_coordinator, make_module


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m robots.youbot_sim.modules.coordinator", description=__doc__)
    parser.add_argument("--plain", action="store_true", help="without a preview: nothing is done ahead")
    make_module(make_coordinator(has_preview=not parser.parse_args().plain)).run()


if __name__ == "__main__":
    main()
