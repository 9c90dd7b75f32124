"""``python -m dev.fuzz TARGET --seconds 60``: atheris searches bytes that break a target.

Its search is guided by coverage. A fault ends it with exit code 77; the bytes are in a file, whose
name is printed. ``--again FILE`` runs these bytes once more.
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
    parser.add_argument("target", help="the attacked code: see dev/fuzz/targets.py")
    parser.add_argument("--seconds", type=int, default=60, help="duration of the attack")
    parser.add_argument(
        "--seed", type=int, default=0, help="seed of the fuzzer (0: a new seed each time)"
    )
    parser.add_argument(
        "--corpus",
        type=Path,
        help="folder for inputs that reached new code, reused by later runs",
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


# Untyped: dev.fuzz.targets is imported only after atheris instruments imports.
def _target(name: str):  # type: ignore[no-untyped-def]  # noqa: ANN202
    targets = importlib.import_module("dev.fuzz.targets").TARGETS
    if name not in targets:
        sys.exit(f"no target {name}: the targets are {', '.join(targets)}")
    return targets[name]


if __name__ == "__main__":
    main()
