"""A number of bytes as a command line option."""

from typing import Any

import click

from tca_central.model.budget import LEAST_MEMORY


class Bytes(click.ParamType[int]):
    """A number of bytes: 64M, 2G."""

    name = "bytes"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> int:
        """Return the number. Raise UsageError if the text is not a number of bytes, or too few."""
        if isinstance(value, int):
            return value
        digits, unit = value.rstrip("KMGkmg"), value[-1:].upper()
        if not (digits.isascii() and digits.isdigit()) or len(value) - len(digits) > 1:
            self.fail(f"'{value}' is not a number of bytes: give for example 64M or 2G", param, ctx)
        number = int(digits) << {"K": 10, "M": 20, "G": 30}.get(unit, 0)
        if number < LEAST_MEMORY:
            self.fail(f"{value} is too little: give {LEAST_MEMORY >> 20}M or more", param, ctx)
        return number
