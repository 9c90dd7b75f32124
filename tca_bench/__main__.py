"""``python -m tca_bench``: the same as ``tca bench``."""

from tca_bench.command import bench

if __name__ == "__main__":
    bench()
