"""Writes the code of a model into a folder. Files of the user are never changed."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

from tca_behaviours.activities.models.code import (
    MARK,
    application,
    distinct,
    generated,
    skeleton,
    written,
)
from tca_behaviours.activities.models.model import ApplicationModel, ComponentModel
from tca_behaviours.activities.models.names import file_of
from tca_tools.errors import BadUserFile


def write_code(model: ApplicationModel, folder: Path) -> list[str]:
    """Write all modules. Returns a line for each, which says whether it was written.

    Raises BadUserFile, before anything is written, if an existing file can't be used; and OSError.
    """
    package = _package(folder)
    overwritten = {"generated.py": generated(model)}
    if model.instances:
        overwritten["application.py"] = application(model, package)
    for name in overwritten:
        _check_ours(folder / name)
    by_hand = {folder / f"{file_of(name)}.py": name for name in model.components}
    found = {file: _names(file) for file in by_hand if file.exists()}
    folder.mkdir(parents=True, exist_ok=True)
    report = [_write(folder / name, lines) for name, lines in overwritten.items()]
    for file, name in by_hand.items():
        if file in found:
            report += _lacking(file, name, model.components[name], found[file])
        else:
            report.append(_write(file, skeleton(model, name, package)))
    return report


def _package(folder: Path) -> str:
    """The package that a folder is, with a dot at the end; "" if it is not a package."""
    folder = folder.resolve()
    parts: list[str] = []
    while (folder / "__init__.py").exists():
        parts.insert(0, f"{folder.name}.")
        folder = folder.parent
    return "".join(parts)


def _check_ours(file: Path) -> None:
    if file.exists() and MARK not in file.read_text(errors="replace"):
        raise BadUserFile(
            f"{file} exists already, and was not {MARK}: "
            "rename it, or choose a folder with -o FOLDER"
        )


def _write(file: Path, lines: Iterable[str]) -> str:
    text = "\n".join(lines) + "\n"
    if file.exists() and file.read_text() == text:
        return f"{file}: unchanged"
    file.write_text(text)
    return f"{file}: written"


def _names(file: Path) -> set[str]:
    """All names that a module of the user defines or imports."""
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise BadUserFile(f"{file}{line}: can't be read: {error.args[0]}") from None
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.alias)
    return {node.name for node in ast.walk(tree) if isinstance(node, kinds)}


def _lacking(file: Path, name: str, component: ComponentModel, names: set[str]) -> Iterator[str]:
    if name not in names:
        yield f"{file}: yours, not changed; it lacks class {name}: add it"
        return
    lacking = [method for method in distinct(component) if method.name not in names]
    if not lacking:
        yield f"{file}: yours, not changed"
        return
    names_lacking = ", ".join(method.name for method in lacking)
    yield f"{file}: yours, not changed; class {name} lacks {names_lacking}. Add:"
    for method in lacking:
        yield ""
        yield from written(method)
