"""The version of this program."""

from functools import cache
from importlib.metadata import PackageNotFoundError, version


@cache
def release() -> str:
    """Its version; "unknown" where it runs from a checkout that is not installed."""
    try:
        return version("tca-central")
    except PackageNotFoundError:
        return "unknown"
