"""How the answers say lengths of time, how often, and lists."""


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


def percent(share: float) -> str:
    """A share in per cent."""
    return f"{share:.0%}" if share >= 0.0995 else f"{share:.1%}"


def times(number: int) -> str:
    """``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(number, f"{number:,} times")


def counted(number: int, what: str) -> str:
    """``1 task``, ``2 tasks``, ``12,000 tasks``."""
    return f"{number:,} {what}{'s' * (number != 1)}"


def listed(names: list[str]) -> str:
    """``a``, ``a and b``, ``a, b and c``."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
