"""Measures how long central does not answer after a fault: ``python -m tests.chaos.gaps
[--faults N] [KIND ...]``.

A program sends one query after the other. A gap is the longest time between two answers.
"""

import argparse
import asyncio
import math
import os
import statistics
import sys
import tempfile
import threading
import time
from itertools import pairwise
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent))

import nats
from chaos.robot import PATIENCE, WHERE
from chaos.takeover_life import TakeoverLife

from tca_module import QueryFailed, connect

SECONDS = {
    "no": 3.0,
    "kill leader": 1.0,
    "stop leader": 5.0,
    "cut leader": 5.0,
    "hold leader": 5.0,
    "cut one line": 5.0,
    "kill standby": 1.0,
    "kill stream": 5.0,
    "stop stream": 9.0,
}
"""The kinds of faults, and how long each one lasts. A stream is the server that leads the log."""
REST = 4.0
"""Seconds between two faults."""


class QuietLife(TakeoverLife):
    """A life without other faults than those that are asked for, and with one module."""

    def _begin(self) -> None:
        self._start_central()
        self._start_module("eyes")
        self._doom = {"eyes": math.inf}

    def measure(self, kinds: list[str], number: int) -> dict[str, list[float]]:
        """Return the gaps after faults of each kind."""
        found: dict[str, list[float]] = {kind: [] for kind in kinds}
        self._answers, self._is_over = [0.0], False
        try:
            self._begin()
            prober = threading.Thread(target=self._probe)
            prober.start()
            self._pass(REST)
            for _ in range(number):
                for kind in kinds:
                    gap = self._gap_after(kind)
                    found[kind].append(gap)
                    print(f"{kind}: {gap:.2f} s", flush=True)
            self._is_over = True
            prober.join()
        finally:
            self._is_over = True
            for process in self._processes:
                process.close()
            self.servers.close()
            self.lines.close()
        return found

    def _probe(self) -> None:
        with connect("prober", self.address, patience=PATIENCE) as user:
            while not self._is_over:
                try:
                    user.query(WHERE, "here", timeout=60)
                except QueryFailed as error:
                    self._log(f"query failed: {error}")
                self._answers.append(time.monotonic())
                time.sleep(0.005)

    def _gap_after(self, kind: str) -> float:
        begin = len(self._answers) - 1
        how, _, what = kind.partition(" ")
        if what == "stream":
            self._server_fails(how, SECONDS[kind], self._stream_leader())
        elif what:
            self.fault(kind, SECONDS[kind])
        self._pass(SECONDS[kind] + REST)
        while self._repairs or not self.leader.listens:
            self._pass(0.1)
        answers = [*self._answers[begin:], time.monotonic()]
        return max(after - before for before, after in pairwise(answers))

    def _stream_leader(self) -> int:
        return int(asyncio.run(self._ask_stream_leader())[1:])

    async def _ask_stream_leader(self) -> str:
        client = await nats.connect([f"nats://127.0.0.1:{port}" for port in self.servers.ports])
        try:
            info = await client.jetstream().stream_info("TCA-robot")
            assert info.cluster is not None
            return str(info.cluster.leader)
        finally:
            await client.close()


def main() -> None:
    """Measure, and print a table."""
    parser = argparse.ArgumentParser(prog="python -m tests.chaos.gaps", description=__doc__)
    parser.add_argument("--faults", type=int, default=10, help="of each kind")
    parser.add_argument("kinds", nargs="*", help=f"kinds of faults: {', '.join(SECONDS)}")
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="gaps"))
    os.environ["XDG_STATE_HOME"] = os.environ["XDG_RUNTIME_DIR"] = str(folder)
    os.environ.pop("TCA_CENTRAL", None)
    life = QuietLife(folder / "life", 1, 0, events_between=10_000)
    found = life.measure(options.kinds or list(SECONDS), options.faults)
    for kind, gaps in found.items():
        print(
            f"{kind:13} {len(gaps)} faults: least {min(gaps):.2f} s,"
            f" median {statistics.median(gaps):.2f} s, most {max(gaps):.2f} s"
        )


if __name__ == "__main__":
    main()
