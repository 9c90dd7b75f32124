"""Writes the code of a model into a folder. Files of the user are never changed."""

import ast
from collections.abc import Iterable, Iterator
from pathlib import Path

from tca_behaviours.activities.models.code import (
    MARK,
    application_module,
    component_module,
    distinct_methods,
    generated_module,
    stub_method,
)
from tca_behaviours.activities.models.model import ApplicationModel, ComponentModel
from tca_behaviours.activities.models.names import file_of
from tca_tools.errors import BadUserFile


def write_code(model: ApplicationModel, folder: Path) -> list[str]:
    """Write all modules. Returns the lines of a report: whether each was written, or what it lacks.

    Raises BadUserFile, before anything is written, if an existing file can't be used. Raises
    OSError.
    """
    package = _package(folder)
    overwritten = {"generated.py": generated_module(model)}
    if model.instances:
        overwritten["application.py"] = application_module(model, package)
    for name in overwritten:
        _check_ours(folder / name)
    by_hand = {folder / f"{file_of(name)}.py": name for name in model.components}
    names_by_file = {file: _names_in(file) for file in by_hand if file.exists()}
    folder.mkdir(parents=True, exist_ok=True)
    report = [_write(folder / name, lines) for name, lines in overwritten.items()]
    for file, name in by_hand.items():
        if file in names_by_file:
            report += _report_on(file, name, model.components[name], names_by_file[file])
        else:
            report.append(_write(file, component_module(model, name, package)))
    return report


def _package(folder: Path) -> str:
    """Return the package that a folder is, with a dot at the end; "" if it is not a package."""
    folder = folder.resolve()
    parts: list[str] = []
    while (folder / "__init__.py").exists():
        parts.insert(0, f"{folder.name}.")
        folder = folder.parent
    return "".join(parts)


def _check_ours(file: Path) -> None:
    """Raise BadUserFile if a file exists and was not generated."""
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


def _names_in(file: Path) -> set[str]:
    """Return all names that a module of the user defines or imports."""
    try:
        tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError) as error:
        line = f", line {error.lineno}" if isinstance(error, SyntaxError) else ""
        raise BadUserFile(f"{file}{line}: can't be read: {error.args[0]}") from None
    kinds = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.alias)
    return {node.name for node in ast.walk(tree) if isinstance(node, kinds)}


def _report_on(file: Path, name: str, component: ComponentModel, names: set[str]) -> Iterator[str]:
    """Report what the user's file of a component lacks. *names* are the names in the file."""
    if name not in names:
        yield f"{file}: yours, not changed; it lacks class {name}: add it"
        return
    lacking = [method for method in distinct_methods(component) if method.name not in names]
    if not lacking:
        yield f"{file}: yours, not changed"
        return
    names_lacking = ", ".join(method.name for method in lacking)
    yield f"{file}: yours, not changed; class {name} lacks {names_lacking}. Add:"
    for method in lacking:
        yield ""
        yield from stub_method(method)
