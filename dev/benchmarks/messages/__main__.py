"""``python -m dev.benchmarks.messages``: the costs of messages and tasks."""

from dev.benchmarks.messages.command import bench

if __name__ == "__main__":
    bench()
