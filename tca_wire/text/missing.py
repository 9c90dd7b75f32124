"""The error for a missing optional package."""


def missing_package(feature: str, package: str, extra: str, otherwise: str = "") -> str:
    """Return ``a report needs the Python package 'jinja2': pip install 'tca-central[report]'``.

    *otherwise* is something else that the user can do.
    """
    advice = f"pip install 'tca-central[{extra}]'{f', or {otherwise}' if otherwise else ''}"
    return f"{feature} needs the Python package '{package}': {advice}"
