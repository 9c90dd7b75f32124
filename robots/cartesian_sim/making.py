"""Makes `generated` and `application` of `cleaning.toml`, as `tca generate` does, when the package is imported.

So they are always those of the model, and none of them is kept.
"""

import fcntl
from pathlib import Path

from tca_behaviours.activities.models.reading import read_model
from tca_behaviours.activities.models.writing import write_code

_MODEL = Path(__file__).with_name("cleaning.toml")

with _MODEL.open() as _alone:
    fcntl.flock(_alone, fcntl.LOCK_EX)  # programs that start together would read what is half written
    write_code(read_model(_MODEL), _MODEL.parent)
