"""What a scene may contain, from the input models: JSON Schema for editors, and the input reference in Markdown."""

import json
import re
from typing import Any

from periporo.io.schema.parameters import REQUIRED, Parameter, first_sentence, law_schema, parameters_of
from periporo.io.schema.scene import scene_json_schema
from periporo.materials import registry

_PAGE = """# Input reference

Made by `periporo schema --markdown` from the models that check the input; do not edit it by hand.

A scene is YAML in SI units; tension is positive. What stands under "allowed" is enforced: anything else is refused
with the line, before anything is allocated. `dimension` numbers are two or three, as the scene has dimensions.
Numbers may be written `25e6`; names have 1 to 64 letters, digits, spaces and `_ - . +`. In a Python dictionary the same
keys and values hold, and arrays are welcome. Laws of other packages have keys of their own:
`periporo materials` lists all that are installed.
"""


def editor_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a scene with the parameters of every installed law; units stand in the descriptions."""
    schema = scene_json_schema()
    laws = {f"law {name}": _entry_of_law(name) for name in sorted(registry.available())}
    definitions = schema["$defs"]
    definitions.pop("MaterialInput")
    definitions |= laws
    names = schema["properties"]["materials"]["patternProperties"]
    for pattern in names:
        names[pattern] = {"oneOf": [{"$ref": f"#/$defs/{law.replace(' ', '%20')}"} for law in laws]}
    _put_units_into_descriptions(schema)
    return schema | {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scene of periporo"}


def _entry_of_law(name: str) -> dict[str, Any]:
    """Schema of an entry of `materials` with `model: name`."""
    law = law_schema(registry.load(name))
    model = {"const": name, "description": first_sentence(law.get("description", ""))}
    law["properties"] = {"model": model} | law["properties"]
    law["required"] = ["model", *law.get("required", ())]
    if "$defs" in law:
        law["$id"] = f"periporo:law:{name}"  # makes its references its own
    return law


def _put_units_into_descriptions(node: Any) -> None:
    """Editors show descriptions and no units."""
    if isinstance(node, list):
        for entry in node:
            _put_units_into_descriptions(entry)
    elif isinstance(node, dict):
        if isinstance(node.get("unit"), str) and isinstance(node.get("description"), str):
            node["description"] += f" [{node['unit']}]"
        for entry in node.values():
            _put_units_into_descriptions(entry)


def input_reference() -> str:
    """The input reference in Markdown: the scene, what its keys refer to, and the built-in laws."""
    schema = scene_json_schema()
    parts = [_PAGE, "## The scene\n", _table(parameters_of(schema))]
    for name in _order(schema):
        node = schema["$defs"][name]
        if name != "MaterialInput":
            parts += [f"## {_heading(name)}\n", f"{node['description']}\n", _table(parameters_of(node))]
    parts.append("## Materials\n")
    parts.append("An entry of `materials` has the key `model` and those of the law that it names.\n")
    for name in sorted(registry.available()):
        law = registry.load(name)
        if law.__module__.startswith("periporo."):
            node = law_schema(law)
            description = " ".join(node.get("description", "").split("\n\n")[0].split())
            parts += [f"### `model: {name}`\n", f"{description}\n", _table(parameters_of(node))]
    return "\n".join(parts)


def _order(schema: dict[str, Any]) -> list[str]:
    """Definitions in the order in which a reader meets them: each before those that it refers to."""
    found: dict[str, None] = {}

    def visit(node):
        for parameter in parameters_of(node):
            for name in parameter.refers:
                if name not in found:
                    found[name] = None
                    visit(schema["$defs"][name])

    visit(schema)
    return list(found)


def _heading(name: str) -> str:
    """`PlaneContact` as `Plane contact`."""
    return re.sub(r"(?<=[a-z])([A-Z])", lambda m: f" {m[0].lower()}", name)


def _linked(text: str) -> str:
    """`<PlaneContact>` as a link to its section."""

    def link(match):
        if match[1] == "MaterialInput":
            return "[material](#materials)"
        heading = _heading(match[1])
        return f"[{heading.lower()}](#{heading.lower().replace(' ', '-')})"

    return re.sub(r"<(\w+)>", link, text)


def _table(parameters: list[Parameter]) -> str:
    lines = ["| key | meaning | unit | allowed | default |", "|---|---|---|---|---|"]
    for p in parameters:
        default = p.default if p.default in (REQUIRED, "") else f"`{p.default}`"
        cells = (f"`{p.name}`", p.meaning, p.unit, _linked(p.allowed), default)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def add_arguments(parser):
    """Arguments of `periporo schema`."""
    parser.add_argument("--markdown", action="store_true", help="the input reference in place of the JSON Schema")


def run(arguments):
    """Run `periporo schema`; the exit status."""
    print(input_reference() if arguments.markdown else json.dumps(editor_schema(), indent=2))
    return 0
