"""What a scene may contain, from the input models: JSON Schema for editors, and the input reference in Markdown."""

import json
import re
import textwrap
from pathlib import Path
from typing import Any

from periporo.io.schema import obstacles
from periporo.io.schema.fields import field_schema
from periporo.io.schema.parameters import REQUIRED, Parameter, first_sentence, law_schema, parameters_of
from periporo.io.schema.scene import scene_json_schema
from periporo.materials import registry

_WIDTH = 120  # of a line
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
    "loads": ("initial stress and boundaries", ("initial_stress", "boundaries")),
    "water": ("pore water", ("pore_water",)),
    "contacts": ("contacts", ("contacts",)),
    "solids": ("solid obstacles", ()),
    "stages": ("stages", ("stages",)),
    "materials": ("materials", ("materials",)),
    "arena": ("the law `arena`", ()),
}
_APART = "arena"  # a law with more keys than all others, which has a page


_FIELD = "periporo:field"


def editor_schema() -> dict[str, Any]:
    """JSON Schema (2020-12) of a scene with the parameters of every installed law; units stand in the descriptions."""
    schema = scene_json_schema()
    laws = {f"law {name}": _entry_of_law(name) for name in sorted(registry.available())}
    definitions = schema["$defs"]
    definitions.pop("MaterialInput")
    definitions |= laws | {"field": field_schema() | {"$id": _FIELD}}
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
    for key, entry in law["properties"].items():
        choices = [entry, *entry.get("anyOf", ()), *entry.get("oneOf", ())]
        if any(one.get("type") == "number" for one in choices):
            shown = {word: entry.pop(word) for word in ("description", "unit", "title", "default") if word in entry}
            law["properties"][key] = {"anyOf": [entry, {"$ref": _FIELD}]} | shown
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
    text = "\n".join(_text(names) for names in _definitions().values())
    return f"# Input reference\n\n{_MADE}\n{_INTRODUCTION}\n{text}"


def input_pages() -> dict[str, str]:
    """The same on several pages, by their names; a link leads to the page that has its section."""
    pages = _definitions()
    home = {name: f"{page}.md" for page, names in pages.items() for name in names}
    texts = {}
    for page, names in pages.items():
        text = _text(names, {name: place for name, place in home.items() if name not in names})
        how = _INTRODUCTION if page == "scene" else "[The scene](scene.md) says how to read the tables.\n"
        texts[page] = f"# Input reference: {_PAGES[page][0]}\n\n{_MADE}\n{how}\n{text}".rstrip("\n") + "\n"
    return texts


def _definitions() -> dict[str, list[str]]:
    """The definitions that each page describes, in order; "Scene" is the scene itself."""
    schema = scene_json_schema()
    page_of = {key: page for page, (_, keys) in _PAGES.items() for key in keys}
    pages: dict[str, list[str]] = {page: [] for page in _PAGES}
    pages["scene"].append("Scene")
    found = {"MaterialInput"}
    for parameter in parameters_of(schema):
        fresh = [name for name in _order(parameter.refers, schema) if name not in found]
        pages[page_of.get(parameter.name, "scene")] += [name for name in fresh if not _is_solid(name)]
        pages["solids"] += [name for name in fresh if _is_solid(name)]
        found |= set(fresh)
    pages["materials"].append("MaterialInput")
    pages[_APART].append(_APART)
    return pages


def _is_solid(name: str) -> bool:
    """Whether a definition is that of a solid obstacle."""
    kind = getattr(obstacles, name, None)
    return isinstance(kind, type) and issubclass(kind, obstacles.Solid)


def _text(names: list[str], page_of: dict[str, str] | None = None) -> str:
    """The sections of definitions, with links to others, on another page where `page_of` names one."""
    schema, page_of = scene_json_schema(), page_of or {}
    parts = []
    for name in names:
        if name == "Scene":
            parts.append(f"## The scene\n\n{_table(parameters_of(schema), page_of)}")
        elif name == "MaterialInput":
            parts.append(_laws(page_of))
        elif name == _APART:
            parts.append(_law(name, law_schema(registry.load(name)), page_of))
        else:
            parts.append(_section(name, schema["$defs"][name], page_of))
    return "\n".join(parts)


def _section(name: str, node: dict[str, Any], page_of: dict[str, str]) -> str:
    """The section on a definition."""
    return f"## {_heading(name)}\n\n{_wrapped(node['description'])}\n\n{_table(parameters_of(node), page_of)}"


def _laws(page_of: dict[str, str]) -> str:
    """The section on the keys of the built-in laws, and those on what these refer to."""
    parts = ["## Materials\n", "An entry of `materials` has the key `model` and those of the law that it names.\n"]
    parts.append("Any number may be a mapping with the key `field`: [soil that varies](../../how-to/fields.md).\n")
    if _APART in page_of:
        parts.append(f"Those of `{_APART}` have [a page]({page_of[_APART]}) of their own.\n")
    definitions: dict[str, Any] = {}
    for name in sorted(registry.available()):
        law = registry.load(name)
        if name != _APART and law.__module__.startswith("periporo."):
            node = law_schema(law)
            definitions |= node.get("$defs", {})
            parts.append(_law(name, node, page_of))
    parts += [_section(name, node, page_of) for name, node in sorted(definitions.items())]
    return "\n".join(parts)


def _law(name: str, node: dict[str, Any], page_of: dict[str, str]) -> str:
    """The section on the keys of a law with the schema `node`."""
    level, description = "##" if name == _APART else "###", _wrapped(node.get("description", "").split("\n\n")[0])
    return f"{level} `model: {name}`\n\n{description}\n\n{_table(parameters_of(node), page_of)}"


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


def _linked(text: str, page_of: dict[str, str]) -> str:
    """`<PlaneContact>` as a link to its section."""

    def link(match):
        name = match[1]
        word = "material" if name == "MaterialInput" else _heading(name).lower()
        anchor = "materials" if name == "MaterialInput" else word.replace(" ", "-")
        return f"[{word}]({page_of.get(name, '')}#{anchor})"

    return re.sub(r"<([A-Z]\w+)>", link, text)


def _wrapped(text: str, indent: str = "") -> str:
    """Paragraphs of text in lines of a window's width."""
    options: Any = {"subsequent_indent": indent, "break_long_words": False, "break_on_hyphens": False}
    return "\n\n".join(textwrap.fill(" ".join(part.split()), _WIDTH, **options) for part in text.split("\n\n"))


def _table(parameters: list[Parameter], page_of: dict[str, str]) -> str:
    """A row for each parameter; what makes a row too wide for a window stands below the table."""
    lines, notes = ["| key | meaning | unit | allowed | default |", "|---|---|---|---|---|"], []
    for p in parameters:
        default = p.default if p.default in (REQUIRED, "") else f"`{p.default}`"
        cells = {"meaning": p.meaning, "allowed": _linked(p.allowed, page_of)}
        moved = {}
        for kind in sorted(cells, key=lambda kind: -len(cells[kind])):
            if len(_row(p.name, cells["meaning"], p.unit, cells["allowed"], default)) > _WIDTH:
                moved[kind], cells[kind] = cells[kind], "see below"
        lines.append(_row(p.name, cells["meaning"], p.unit, cells["allowed"], default))
        if moved:
            said = [moved[kind] if kind == "meaning" else f"allowed: {moved[kind]}" for kind in cells if kind in moved]
            notes.append(_wrapped(f"- `{p.name}`: {'; '.join(said)}.", "  "))
    return "\n".join([*lines, "", *notes] if notes else lines) + "\n"


def _row(name: str, *cells: str) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in (f"`{name}`", *cells)) + " |"


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
