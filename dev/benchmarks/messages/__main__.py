"""``python -m dev.benchmarks.messages``: what messages and tasks cost here."""

from dev.benchmarks.messages.command import bench

if __name__ == "__main__":
    bench()
