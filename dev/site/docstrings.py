"""The reader of docstrings for the site: an extension of griffe, which ``zensical.toml`` names.

- ``Example::`` and other blocks after ``::`` become blocks of Python.
- ``**options: Unpack[TaskOptions]`` becomes the options themselves, with kinds and defaults from
  the annotations of the TypedDict, and descriptions from the Args of its docstring.
- One signature stands for all overloads.
- Without Args, a constructor is not shown: the library itself makes the objects of that class.
"""

import re
import textwrap
from typing import Any

from griffe import (
    Class,
    Docstring,
    DocstringParameter,
    DocstringSectionKind,
    Expr,
    ExprSubscript,
    ExprTuple,
    Extension,
    Function,
    Object,
    Parameter,
    ParameterKind,
    Parameters,
)

BLOCK = re.compile(
    r"^(?P<start>(?:.*\S)?)::\n\n(?P<code>(?:    .*\n|\n)*(?:    .*)?)", re.MULTILINE
)
"""A line that ends with ``::``, and the indented block after it."""


class Docstrings(Extension):
    """Rewrites docstrings and signatures before they are shown."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Show the blocks of a docstring as Python."""
        if obj.docstring is not None:
            obj.docstring.value = with_code(obj.docstring.value)

    def on_class(self, *, cls: Class, **_: Any) -> None:
        """Show the options of a TypedDict as arguments, and hide undescribed constructors."""
        cls.overloads.clear()
        if is_typed_dict(cls):
            cls.set_member("__init__", Function("__init__", parameters=arguments_of(cls)))
            for name in [name for name, one in cls.members.items() if one.is_attribute]:
                cls.extra[__name__][name] = cls.members[name]
                cls.del_member(name)
        elif not (described(cls.docstring) or described(constructor_docstring(cls))):
            cls.members.pop("__init__", None)

    def on_function(self, *, func: Function, **_: Any) -> None:
        """Replace ``**options: Unpack[...]`` by the options themselves."""
        func.overloads = None
        for given in list(func.parameters):
            typed = unpacked(func, given)
            if typed is None:
                continue
            options = options_of(typed)
            if func.docstring is not None:  # read before the parameter is gone
                replace_description(func.docstring, given.name, options)
            del func.parameters[given.name]
            for one in options:
                func.parameters.add(one)


def with_code(text: str) -> str:
    """Return a docstring with Python blocks for the blocks after ``::``."""

    def block(found: re.Match[str]) -> str:
        start = found["start"]
        title = "**Example:**" if start == "Example" else f"{start}:" if start else ""
        code = textwrap.dedent(found["code"]).strip("\n")
        return f"{title}\n\n```python\n{code}\n```\n\n"

    return BLOCK.sub(block, text).rstrip()


def is_typed_dict(cls: Class) -> bool:
    """Whether a class is a TypedDict, or extends one."""
    names = [base.canonical_path for base in cls.bases if isinstance(base, Expr)]
    return "typing.TypedDict" in names or any(map(is_typed_dict, bases_of(cls)))


def bases_of(cls: Class) -> list[Class]:
    """Return the base classes."""
    return [base for base in cls.resolved_bases if isinstance(base, Class)]


def unpacked(func: Function, parameter: Parameter) -> Class | None:
    """Return the TypedDict of a parameter ``**options: Unpack[...]``."""
    kind = parameter.annotation
    if parameter.kind is not ParameterKind.var_keyword or not isinstance(kind, ExprSubscript):
        return None
    if kind.canonical_path != "typing.Unpack" or not isinstance(kind.slice, Expr):
        return None
    found = func.modules_collection[kind.slice.canonical_path]
    target = found.final_target if found.is_alias else found
    return target if isinstance(target, Class) else None


def options_of(typed: Class) -> list[Parameter]:
    """Return the options of a TypedDict as keyword parameters, those of its bases first.

    The Args of a TypedDict that extends it describe its options, too.
    """
    texts = described(typed.docstring)
    for extending in typed.module.classes.values():
        if typed in extending.resolved_bases:
            texts |= described(extending.docstring)
    inherited = [one for base in bases_of(typed) for one in options_of(base)]
    attributes = {**typed.extra.get(__name__, {}), **typed.attributes}
    own = [option(name, attribute.annotation) for name, attribute in attributes.items()]
    for parameter in (*inherited, *own):
        if parameter.name in texts:
            parameter.docstring = Docstring(texts[parameter.name])
    return [*inherited, *own]


def option(name: str, hint: Any) -> Parameter:
    """Return one option. Its annotation is such as ``Annotated[int, COUNT, 1]``."""
    default: Any = "..."
    is_annotated = isinstance(hint, ExprSubscript) and hint.canonical_path == "typing.Annotated"
    if is_annotated and isinstance(hint.slice, ExprTuple):
        hint, _, default = hint.slice.elements
    return Parameter(name, annotation=hint, kind=ParameterKind.keyword_only, default=default)


def arguments_of(typed: Class) -> Parameters:
    """Return the parameters of the constructor of a TypedDict."""
    this = Parameter("self", kind=ParameterKind.positional_or_keyword)
    return Parameters(this, *options_of(typed))


def constructor_docstring(cls: Class) -> Docstring | None:
    """Return the docstring of the constructor that a class declares itself."""
    return cls.members["__init__"].docstring if "__init__" in cls.members else None


def described(docstring: Docstring | None) -> dict[str, str]:
    """Return the descriptions of the Args of a docstring, by name."""
    sections = docstring.parse("google", warnings=False) if docstring is not None else []
    return {
        one.name.lstrip("*"): one.description
        for section in sections
        if section.kind is DocstringSectionKind.parameters
        for one in section.value
    }


def replace_description(docstring: Docstring, name: str, options: list[Parameter]) -> None:
    """Replace what a docstring says of ``options`` by the descriptions of the options."""
    for section in docstring.parsed:
        if section.kind is DocstringSectionKind.parameters:
            section.value[:] = [one for one in section.value if one.name.lstrip("*") != name]
            section.value += [
                DocstringParameter(
                    one.name,
                    description=one.docstring.value if one.docstring is not None else "",
                    annotation=one.annotation,
                    value=str(one.default),
                )
                for one in options
            ]
