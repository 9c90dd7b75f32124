"""``python -m dev.fuzz TARGET --seconds 60``: atheris looks for bytes that break a target, guided
by what they reach.

A fault ends it with exit code 77 and leaves the bytes in a file, whose name is said; ``--again
FILE`` runs that once more.
"""

import argparse
import importlib
import sys
import tempfile
from pathlib import Path

OURS = ["tca_wire", "tca_central", "tca_module", "tca_tools.supervise"]


def main() -> None:
    """Attack one target."""
    parser = argparse.ArgumentParser(prog="python -m dev.fuzz", description=__doc__)
    parser.add_argument("target", help="what is attacked: see dev/fuzz/targets.py")
    parser.add_argument("--seconds", type=int, default=60, help="how long")
    parser.add_argument(
        "--seed", type=int, default=0, help="of the fuzzer's own choices (0: another one each time)"
    )
    parser.add_argument(
        "--corpus",
        type=Path,
        help="folder of inputs that reached something new, kept from run to run",
    )
    parser.add_argument(
        "--faults", type=Path, default=Path(), help="folder for the bytes of a fault"
    )
    parser.add_argument("--again", type=Path, help="run this file's bytes once, without atheris")
    asked = parser.parse_args()
    if asked.again is not None:
        _target(asked.target).attack(asked.again.read_bytes())
        return
    try:
        import atheris  # noqa: PLC0415 - it has wheels for some systems only
    except ImportError:
        sys.exit("atheris is not installed: pip install 'tca-central[fuzz]' (Linux on x86-64 only)")
    with atheris.instrument_imports(include=OURS):
        target = _target(asked.target)
    with tempfile.TemporaryDirectory() as seeds:
        for number, seed in enumerate(target.seeds()):
            Path(seeds, str(number)).write_bytes(seed)
        corpus = [str(asked.corpus)] if asked.corpus else []
        options = [
            f"-max_total_time={asked.seconds}",
            f"-max_len={target.most}",
            f"-seed={asked.seed}",
            f"-artifact_prefix={asked.faults}/",
            "-timeout=20",
            "-rss_limit_mb=4096",
            "-len_control=0",
            *corpus,
            seeds,
        ]
        atheris.Setup(["fuzz", *options], target.attack)
        atheris.Fuzz()


def _target(name: str):  # type: ignore[no-untyped-def]  # noqa: ANN202 - imported only when atheris looks
    targets = importlib.import_module("dev.fuzz.targets").TARGETS
    if name not in targets:
        sys.exit(f"there is no target {name}; there are {', '.join(targets)}")
    return targets[name]


if __name__ == "__main__":
    main()
