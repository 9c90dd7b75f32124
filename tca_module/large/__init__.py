"""Large data in shared memory: the segments that a module writes, and those that it reads."""
