"""Read an exported table: print how long tasks waited, and for what.

The tables are of a run of ``01_fetch.py``: ``tca export LOG --to csv -o tables``.
"""

import csv
from collections import defaultdict
from pathlib import Path

TABLES = Path(__file__).with_name("tables")
WAITS = {"held", "queued", "planned", "suspended"}


def main() -> None:
    """Print the sum of each kind of wait of each message."""
    waited = defaultdict[tuple[str, str], float](float)
    with (TABLES / "states.csv").open() as table:
        for row in csv.DictReader(table):
            if row["state"] in WAITS and row["end"]:
                waited[row["name"], row["state"]] += float(row["end"]) - float(row["start"])
    for (name, state), seconds in sorted(waited.items()):
        print(f"{name} {state}: {seconds * 1000:.1f} ms")


if __name__ == "__main__":
    main()
