"""The version of this program."""

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache
def release() -> str:
    """Return the version; "unknown" in a checkout that is not installed."""
    try:
        return version("tca-central")
    except PackageNotFoundError:
        return "unknown"
