"""Keys of the input and parameters of laws as rows of a table: name, unit, what is allowed, default, meaning."""

import inspect
import re
from dataclasses import dataclass
from typing import Any

from pydantic import BaseModel

from periporo.io.schema.errors import schema_of

REQUIRED = "required"
_PLAIN = {"number": "number", "integer": "integer", "boolean": "true, false", "string": "text"}
_SIGNS = {"exclusiveMinimum": ">", "minimum": ">=", "exclusiveMaximum": "<", "maximum": "<="}


@dataclass(frozen=True)
class Parameter:
    """A key: `allowed` and `default` are text, `refers` names the definitions that its value may follow."""

    name: str
    unit: str
    allowed: str
    default: str
    meaning: str
    refers: tuple[str, ...] = ()


def parameters_of(node: dict[str, Any]) -> list[Parameter]:
    """The keys that the JSON Schema `node` of a mapping describes, in order."""
    required = node.get("required", ())
    rows = []
    for name, entry in node.get("properties", {}).items():
        default = REQUIRED if name in required else shown(entry["default"]) if "default" in entry else ""
        words = {w["$ref"].rsplit("/", 1)[-1]: None for w in _walk(entry) if "$ref" in w}
        unit = entry.get("unit", "")
        rows.append(Parameter(name, unit, _allowed(entry), default, entry.get("description", ""), tuple(words)))
    return rows


def law_schema(law: type) -> dict[str, Any]:
    """JSON Schema of the parameters of a material class; names and defaults alone if it is not a pydantic model."""
    if isinstance(law, type) and issubclass(law, BaseModel):
        return schema_of(law)
    properties, required = {}, []
    for name, parameter in inspect.signature(law).parameters.items():
        if parameter.kind in (parameter.VAR_POSITIONAL, parameter.VAR_KEYWORD):
            continue
        plain = isinstance(parameter.default, str | int | float | bool | None)
        properties[name] = {"default": parameter.default} if plain else {}
        if parameter.default is parameter.empty:
            required.append(name)
    return {"type": "object", "properties": properties, "required": required, "description": inspect.getdoc(law) or ""}


def first_sentence(text: str) -> str:
    """The first line, or more if the sentence goes on; without line breaks."""
    paragraph = " ".join(text.strip().split("\n\n")[0].split())
    return re.split(r"(?<=[.;]) ", paragraph)[0].rstrip(".;")


def shown(value: Any) -> str:
    """A default as it would stand in a scene."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.10g}"
    if isinstance(value, dict):
        given = {k: v for k, v in value.items() if v is not None}
        return "{" + ", ".join(f"{k}: {shown(v)}" for k, v in given.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(shown, value)) + "]"
    return str(value)


def _walk(node: Any):
    """Every mapping within a schema node, but not what its default holds."""
    if isinstance(node, dict):
        yield node
        for name, entry in node.items():
            if name not in ("default", "discriminator"):
                yield from _walk(entry)
    elif isinstance(node, list):
        for entry in node:
            yield from _walk(entry)


def _allowed(node: dict[str, Any]) -> str:
    """What a value may be, in words; definitions that are referred to appear as `<Name>`."""
    if "$ref" in node:
        return f"<{node['$ref'].rsplit('/', 1)[-1]}>"
    for members in ("anyOf", "oneOf"):
        if members in node:
            choices = [_allowed(m) for m in node[members] if m.get("type") != "null"]
            return ", ".join(choices) if members == "oneOf" else " or ".join(choices)
    if "const" in node or "enum" in node:
        return ", ".join(map(str, node.get("enum", [node.get("const")])))
    kind = node.get("type", "")
    if kind == "object":
        by_name = next(iter(node.get("patternProperties", {}).values()), None) or node.get("additionalProperties")
        return f"name: {_allowed(by_name)} for each" if isinstance(by_name, dict) else "mapping"
    if kind == "array":
        return _list(node)
    if kind in ("number", "integer"):
        bounds = [f"{sign} {node[name]:g}" for name, sign in _SIGNS.items() if name in node]
        return f"{kind} {', '.join(bounds)}".rstrip()
    return _PLAIN.get(kind, "")


def _list(node: dict[str, Any]) -> str:
    low, high = node.get("minItems"), node.get("maxItems")
    if "prefixItems" in node:
        return "[" + ", ".join(_PLAIN.get(item.get("type"), "value") for item in node["prefixItems"]) + "]"
    items = node.get("items", {})
    inner = _allowed(items) if isinstance(items, dict) else ""
    if node.get("vector") or (low, high) == (2, 3):
        return "list of dimension numbers" + (" or null" if "null" in str(items) else "")
    return f"list of {inner}" if inner else "list"
