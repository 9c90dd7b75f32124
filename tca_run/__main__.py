"""``python -m tca_run``."""

from tca_run.command import run

if __name__ == "__main__":
    run(prog_name="tca run")
