"""The error for a missing optional package."""


def missing_package(feature: str, package: str, extra: str, otherwise: str = "") -> str:
    """Return ``a report needs the Python package 'jinja2': pip install 'tca-central[report]'``.

    *otherwise* is an alternative.
    """
    other = f", or {otherwise}" if otherwise else ""
    return (
        f"{feature} needs the Python package '{package}': pip install 'tca-central[{extra}]'{other}"
    )
