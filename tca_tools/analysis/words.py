"""Lengths and times in the rows of the tree."""


def seconds(length: float) -> str:
    """A length of time with three digits or so: ``320 us``, ``12 ms``, ``3.42 s``, ``12:05 min``, ``33:09:06 h``."""
    if length < 0.0005:
        return "0 s" if length < 5e-7 else f"{length * 1e6:.0f} us"
    if length < 0.1:
        return f"{length * 1000:.{1 if length < 0.01 else 0}f} ms"
    if length < 120:
        return f"{length:.{2 if length < 10 else 1}f} s"
    minutes, rest = divmod(round(length), 60)
    return f"{minutes}:{rest:02} min" if minutes < 120 else f"{minutes // 60}:{minutes % 60:02}:{rest:02} h"


def moment(time: float) -> str:
    """A time of the run, in seconds since it began."""
    return f"{time:.3f} s" if time < 10_000 else f"{time:.1f} s"
