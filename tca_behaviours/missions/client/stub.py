"""A Python file that describes the tasks of a server to editors and type checkers."""

import inspect
import re
from ast import literal_eval
from collections.abc import Iterable, Iterator

from tca_behaviours.missions.client.offered_task import OfferedTask, TaskParameter, is_identifier

MADE_BY = "Made by 'tca console --stub'"

_HEAD = '''"""The tasks of server '{title}', for editors and type checkers. {made_by}.

Generate it again when they change.
"""
# ruff: noqa
# fmt: off

from typing import TYPE_CHECKING, Any, Literal, Optional, Union, overload

from tca_behaviours.missions import TaskEnd, TaskHandle

if TYPE_CHECKING:
    from tca_behaviours.missions import BaseMission as Base  # an unknown task is an error
else:
    from tca_behaviours.missions import Mission as Base


class {name}(Base):
    """A mission with the tasks of server '{title}'."""

    SERVER = {server!r}

    if TYPE_CHECKING:
'''

_TASK = '''
        @overload
        def {name}({foreground}) -> TaskEnd: ...
        @overload
        def {name}({background}) -> TaskHandle: ...
        @overload
        def {name}({either}) -> TaskEnd | TaskHandle: ...
        def {name}(self, **parameters: Any) -> Any:
            """{help}"""
'''


def stub_text(server: str, tasks: Iterable[OfferedTask]) -> str:
    """Return the text of the stub file: a subclass of Mission with a typed method for each task."""
    parts = [
        _HEAD.format(
            title=_in_docstring(server.replace("\n", " ")),
            server=server,
            made_by=MADE_BY,
            name=class_name(server),
        )
    ]
    parts += [
        _method(task)
        for task in sorted(tasks, key=lambda task: task.name)
        if is_identifier(task.name)
    ]
    return "".join(parts if len(parts) > 1 else [*parts, "        pass\n"])


def _in_docstring(text: str) -> str:
    """Escape a text so that it can stand between triple quotes."""
    text = (
        text.replace("\\", "\\\\").replace('"""', "'''").replace("\r", "\\r").replace("\0", "\\0")
    )
    return f"{text} " if text.endswith('"') else text


def class_name(server: str) -> str:
    """Return the name of the class for a server: "turtle 1" gives Turtle1Mission."""
    return (
        "".join(word[:1].upper() + word[1:] for word in re.findall(r"\w+", server)).lstrip(
            "0123456789"
        )
        + "Mission"
    )


def _method(task: OfferedTask) -> str:
    def parameters(foreground: str) -> str:
        named = list(_parameters(task, foreground))
        return ", ".join(["self", *(["*"] if named else []), *named])

    foreground, background = "Literal[True] = True", "Literal[False]"
    if not task.runs_in_foreground:
        foreground, background = "Literal[True]", "Literal[False] = False"
    text = _in_docstring(task.help_text).replace("\n", "\n            ")
    return _TASK.format(
        name=task.name,
        help=re.sub(r"[ \t]+$", "", text, flags=re.MULTILINE),
        foreground=parameters(foreground),
        background=parameters(background),
        either=parameters("bool"),
    )


def _parameters(task: OfferedTask, foreground: str) -> Iterator[str]:
    for parameter in task.parameters:
        if parameter.name == "foreground":
            yield f"foreground: {foreground}"
        elif is_identifier(parameter.name):
            yield f"{parameter.name}: {_annotation(parameter)}"


def _annotation(parameter: TaskParameter) -> str:
    kind = inspect.formatannotation(parameter.type)
    if parameter.default is inspect.Parameter.empty:
        return kind
    default = repr(parameter.default)
    return f"{kind} = {default if _is_literal(default) else '...'}"


def _is_literal(text: str) -> bool:
    """Return whether *text* is a Python literal. A default of ``nan``, which a format may have, is
    not.
    """
    try:
        literal_eval(text)
    except (ValueError, SyntaxError):
        return False
    return True
