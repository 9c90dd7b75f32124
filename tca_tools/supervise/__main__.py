"""``python -m tca_tools.supervise``."""

from tca_tools.supervise.command import run

if __name__ == "__main__":
    run(prog_name="tca run")
