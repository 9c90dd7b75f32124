"""The generated reference of ``robot.toml``, from the structs that read it."""

import json

import msgspec

from dev.site.markdown import code, sentence, table
from dev.site.sources import fields
from tca_tools.supervise.robot_file import CentralTable, Limits, ModuleTable


def robot_toml() -> str:
    """Return the keys of all tables."""
    common = {field.encode_name for field in msgspec.structs.fields(Limits)}
    return "\n".join(
        (
            "## [run]\n\nThese keys hold for all programs. Each table can give its own values.\n",
            _keys(Limits, set()),
            "## [central]\n\nThis table also has the keys of `[run]`.\n",
            _keys(CentralTable, common),
            "## [modules.NAME]\n\nEach program has such a table, with the keys of `[run]`, too.\n",
            _keys(ModuleTable, common),
        )
    )


def _keys(kind: type[msgspec.Struct], left_out: set[str]) -> str:
    texts = fields(kind)
    rows = [
        (
            code(one.encode_name),
            one.type.__metadata__[0].description,
            "needed" if one.required else code(json.dumps(_default(one))),
            sentence(texts[one.encode_name]),
        )
        for one in msgspec.structs.fields(kind)
        if one.encode_name not in left_out
    ]
    return table(("key", "value", "default", "meaning"), rows)


def _default(field: msgspec.structs.FieldInfo) -> object:
    factory = field.default_factory
    return field.default if factory is msgspec.NODEFAULT else factory()
