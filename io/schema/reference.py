"""What a scene may contain, from the input models: JSON Schema for editors, and the input reference in Markdown."""

import json
import re
from pathlib import Path
from typing import Any

from periporo.io.schema.parameters import REQUIRED, Parameter, first_sentence, law_schema, parameters_of
from periporo.io.schema.scene import scene_json_schema
from periporo.materials import registry

_MADE = "Made by `periporo schema --markdown FOLDER` from the models that check the input; do not edit it by hand.\n"
_INTRODUCTION = """A scene is YAML in SI units; tension is positive. What stands under "allowed" is enforced: all else
is refused with the line, before anything is allocated. `dimension` numbers are two or three, as the scene has
dimensions. Numbers may be written `25e6`; names have 1 to 64 letters, digits, spaces and `_ - . +`. In a Python
dictionary the same keys and values hold, and arrays are welcome. Laws of other packages have keys of their own:
`periporo materials` lists all that are installed.
"""
# Pages of the reference: title, and the keys of the scene whose values it describes; other keys are on "scene".
_PAGES = {
    "scene": ("the scene", ()),
    "bodies": ("bodies", ("bodies",)),
    "loads": ("initial stress, boundaries, pore water", ("initial_stress", "boundaries", "pore_water")),
    "contacts": ("contacts", ("contacts",)),
    "stages": ("stages", ("stages",)),
    "materials": ("materials", ("materials",)),
}


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
    """The input reference in Markdown, on one page: the scene, what its keys refer to, and the built-in laws."""
    text = "\n".join(part for sections in _sections().values() for part in sections.values())
    return f"# Input reference\n\n{_MADE}\n{_INTRODUCTION}\n{_linked(text)}"


def input_pages() -> dict[str, str]:
    """The same on several pages, by their names; a link leads to the page that has its section."""
    pages = _sections()
    home = {name: page for page, sections in pages.items() for name in sections}
    texts = {}
    for page, sections in pages.items():
        text = _linked("\n".join(sections.values()), {n: f"{home[n]}.md" for n in home if home[n] != page})
        how = _INTRODUCTION if page == "scene" else "[The scene](scene.md) says how to read the tables.\n"
        texts[page] = f"# Input reference: {_PAGES[page][0]}\n\n{_MADE}\n{how}\n{text}".rstrip("\n") + "\n"
    return texts


def _sections() -> dict[str, dict[str, str]]:
    """Sections of each page by the definition that they describe; links to a definition stand as `<Name>`."""
    schema = scene_json_schema()
    page_of = {key: page for page, (_, keys) in _PAGES.items() for key in keys}
    pages: dict[str, dict[str, str]] = {page: {} for page in _PAGES}
    pages["scene"][""] = f"## The scene\n\n{_table(parameters_of(schema))}"
    found = {"MaterialInput"}
    for parameter in parameters_of(schema):
        for name in _order(parameter.refers, schema):
            if name not in found:
                node = schema["$defs"][name]
                text = f"## {_heading(name)}\n\n{node['description']}\n\n{_table(parameters_of(node))}"
                pages[page_of.get(parameter.name, "scene")][name] = text
                found.add(name)
    pages["materials"]["MaterialInput"] = _laws()
    return pages


def _laws() -> str:
    """The section on the keys of the built-in laws."""
    parts = ["## Materials\n", "An entry of `materials` has the key `model` and those of the law that it names.\n"]
    for name in sorted(registry.available()):
        law = registry.load(name)
        if law.__module__.startswith("periporo."):
            node = law_schema(law)
            description = " ".join(node.get("description", "").split("\n\n")[0].split())
            parts += [f"### `model: {name}`\n", f"{description}\n", _table(parameters_of(node))]
    return "\n".join(parts)


def _order(names: tuple[str, ...], schema: dict[str, Any]) -> list[str]:
    """Definitions in the order in which a reader of `names` meets them: each before those that it refers to."""
    found: dict[str, None] = {}

    def visit(names):
        for name in names:
            if name not in found:
                found[name] = None
                for parameter in parameters_of(schema["$defs"][name]):
                    visit(parameter.refers)

    visit(names)
    return list(found)


def _heading(name: str) -> str:
    """`PlaneContact` as `Plane contact`."""
    return re.sub(r"(?<=[a-z])([A-Z])", lambda m: f" {m[0].lower()}", name)


def _linked(text: str, page_of: dict[str, str] | None = None) -> str:
    """`<PlaneContact>` as a link to its section, on another page where `page_of` names one."""

    def link(match):
        name = match[1]
        word = "material" if name == "MaterialInput" else _heading(name).lower()
        anchor = "materials" if name == "MaterialInput" else word.replace(" ", "-")
        return f"[{word}]({(page_of or {}).get(name, '')}#{anchor})"

    return re.sub(r"<([A-Z]\w+)>", link, text)


def _table(parameters: list[Parameter]) -> str:
    lines = ["| key | meaning | unit | allowed | default |", "|---|---|---|---|---|"]
    for p in parameters:
        default = p.default if p.default in (REQUIRED, "") else f"`{p.default}`"
        cells = (f"`{p.name}`", p.meaning, p.unit, p.allowed, default)
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def add_arguments(parser):
    """Arguments of `periporo schema`."""
    text = "the input reference in place of the JSON Schema; with a folder, its pages into the folder"
    parser.add_argument("--markdown", nargs="?", const="", metavar="FOLDER", help=text)


def run(arguments):
    """Run `periporo schema`; the exit status."""
    if arguments.markdown:
        Path(arguments.markdown).mkdir(parents=True, exist_ok=True)
        for name, text in input_pages().items():
            (Path(arguments.markdown) / f"{name}.md").write_text(text)
    else:
        print(json.dumps(editor_schema(), indent=2) if arguments.markdown is None else input_reference())
    return 0
