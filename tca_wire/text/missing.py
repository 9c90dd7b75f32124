"""Words for what needs a package that is not installed."""


def missing_package(what: str, package: str, extra: str, otherwise: str = "") -> str:
    """``a report needs the Python package 'jinja2': pip install 'tca-central[report]'``, or what
    else would do.
    """
    other = f", or {otherwise}" if otherwise else ""
    return f"{what} needs the Python package '{package}': pip install 'tca-central[{extra}]'{other}"
