"""Pydantic's findings in the words of the input: what is wrong, what is allowed, the nearest valid key."""

from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic.errors import PydanticInvalidForJsonSchema
from pydantic_core import ErrorDetails

from periporo.errors import Path, Problem, choice, described, nearest
from periporo.io.schema.base import FILE_PATTERN, NAME_PATTERN, TEXT_PATTERN

_KINDS = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "an integer",
    "int_parsing": "an integer",
    "int_from_float": "an integer",
    "bool_type": "true or false",
    "string_type": "text",
    "model_type": "a mapping of keys to values",
    "model_attributes_type": "a mapping of keys to values",
    "dict_type": "a mapping of names to entries",
    "tuple_type": "a list",
    "list_type": "a list",
}
_BOUNDS = ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
_BOUND_WORDS = {
    "exclusiveMinimum": "greater than",
    "minimum": "at least",
    "exclusiveMaximum": "less than",
    "maximum": "at most",
}
_PATTERNS = {
    NAME_PATTERN: "{} is not a valid name: 1 to 64 letters, digits, spaces and _ - . +",
    FILE_PATTERN: "{} is not a valid file name: it contains control characters",
    TEXT_PATTERN: "{} contains control characters",
}
_PLAIN_MEMBERS = ("float", "int")  # as pydantic names them in a union
_SCALARS = ("number", "integer", "string", "boolean")
_NUMERIC = ("float_type", "int_type", "float_parsing", "int_parsing", "int_from_float")


def problems_of(error: ValidationError, schema: dict[str, Any], data: Any) -> list[Problem]:
    """Problems for the findings of `error` about `data`; `schema` is the JSON Schema of the model.

    A key that is missing because it was misspelt is reported once, as misspelt.
    """
    errors = [finding for finding in error.errors(include_url=False) if not _follows(finding)]
    findings = [(_data_path(f["loc"], data), f) for f in errors if not _is_of_another_kind(f)]
    missing = {path for path, f in findings if f["type"] == "missing"}
    problems, explained = [], set()
    for path, finding in findings:
        if finding["type"] == "extra_forbidden":
            allowed = _allowed_keys(schema, path[:-1], data)
            meant = nearest(path[-1], allowed)
            if meant and (*path[:-1], meant) in missing:
                explained.add((*path[:-1], meant))
            problems.append(Problem(path, f"unknown key; {choice(path[-1], allowed)}"))
    for path, finding in findings:
        if finding["type"] != "extra_forbidden" and path not in explained:
            problems.append(Problem(_place(path, finding), _message(finding, _node(schema, path, data))))
    return problems


def _is_of_another_kind(finding: ErrorDetails) -> bool:
    """Whether a number or a mapping of numbers was wanted, and this is what is wrong with it as the other."""
    member = str(finding["loc"][-1]) if finding["loc"] else ""
    if member.startswith("dict["):
        return finding["type"] == "dict_type"
    return member in _PLAIN_MEMBERS and isinstance(finding["input"], dict)


def _follows(finding: ErrorDetails) -> bool:
    """Whether a list was found too short only because entries of it are wrong, which is reported itself."""
    return finding["type"] == "too_short" and len(finding["input"]) >= finding["ctx"]["min_length"]


def model_problems(model: type[BaseModel], data: dict[str, Any]) -> list[Problem]:
    """Problems that the pydantic class `model` finds in `data`; none if it accepts them."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        return problems_of(error, schema_of(model), data)
    return []


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """JSON Schema of a pydantic class; its keys alone if it has types that JSON does not know."""
    try:
        return model.model_json_schema()
    except PydanticInvalidForJsonSchema:  # a plugin's own types; its keys are known all the same
        return {"properties": {name: {} for name in model.model_fields}}


def _data_path(location: Path, data: Any) -> Path:
    """The path in the data of a finding: without the names of union members that pydantic puts in."""
    path: list[str | int] = []
    here, may_be_tag = data, True
    for part in location:
        member = str(part).startswith(("[", "dict[")) or (part in _PLAIN_MEMBERS and not _has(here, part))
        if member or (may_be_tag and isinstance(here, dict) and here.get("type") == part):
            may_be_tag = False
            continue
        path.append(part)
        may_be_tag = True
        try:
            here = here[part]
        except (KeyError, IndexError, TypeError):
            here = None
    return tuple(path)


def _has(data: Any, part: Any) -> bool:
    return isinstance(data, dict) and part in data


def _node(schema: dict[str, Any], path: Path, data: Any) -> dict[str, Any]:
    """The part of the JSON Schema that describes the value at `path`; empty if there is none."""
    node, here = _resolved(schema, schema, data), data
    for part in path:
        try:
            here = here[part]
        except (KeyError, IndexError, TypeError):
            here = None
        if isinstance(part, int):
            items = node.get("prefixItems", [])
            inner = items[part] if part < len(items) else node.get("items", {})
        else:
            by_name: Any = node.get("additionalProperties") or next(
                iter(node.get("patternProperties", {}).values()), {}
            )
            inner = node.get("properties", {}).get(part, by_name)
        node = _resolved(schema, inner, here)
    return node


def _resolved(schema: dict[str, Any], node: Any, value: Any) -> dict[str, Any]:
    """`node` with references followed and the member of a union chosen that `value` is meant for."""
    if not isinstance(node, dict):
        return {}
    outer = {k: node[k] for k in ("description", "unit") if k in node}
    if "$ref" in node:
        inner = schema["$defs"][node["$ref"].rsplit("/", 1)[-1]]
        return _resolved(schema, inner, value) | outer
    if "oneOf" in node and "discriminator" in node:
        tag = value.get(node["discriminator"]["propertyName"]) if isinstance(value, dict) else None
        mapping = node.get("discriminator", {}).get("mapping", {})
        if tag not in list(mapping):
            return outer | {"tags": list(mapping)}
        return _resolved(schema, {"$ref": mapping[tag]}, value) | outer
    for member in node.get("anyOf") or node.get("oneOf") or []:
        inner = _resolved(schema, member, value)
        fits = ("object",) if isinstance(value, dict) else ("array",) if isinstance(value, list) else _SCALARS
        if inner.get("type") in fits or "tags" in inner:
            return inner | outer
    return node


def _place(path: Path, finding: ErrorDetails) -> Path:
    """Path to show for a finding; what is wrong with the key that tells the kind, one level above it."""
    if finding["type"] == "union_tag_invalid":
        return (*path, finding["ctx"]["discriminator"].strip("'"))
    written = _misspelt(finding)
    if finding["type"] == "missing" and written:
        return (*path[:-1], written)
    return (*path, written) if written else path


def _misspelt(finding: ErrorDetails) -> str | None:
    """The key that stands in place of a missing 'type' or 'model', if any.

    Only these two can be misspelt without being reported as unknown.
    """
    if finding["type"] == "union_tag_not_found":
        return nearest("type", map(str, finding["input"]))
    if finding["type"] == "missing" and finding["loc"][-1] == "model":
        return nearest("model", map(str, finding["input"]), cutoff=0.8)
    return None


def _allowed_keys(schema: dict[str, Any], path: Path, data: Any) -> list[str]:
    return list(_node(schema, path, data).get("properties", {}))


def _range(node: dict[str, Any]) -> str:
    """`greater than 0 and at most 1`, from the bounds in the schema."""
    return " and ".join(f"{words} {node[name]:g}" for name, words in _BOUND_WORDS.items() if name in node)


def _meaning(node: dict[str, Any]) -> str:
    """Description and unit in brackets, or nothing."""
    unit = f", {node['unit']}" if node.get("unit") and node["unit"] != "1" else ""
    return f" ({node['description']}{unit})" if "description" in node else ""


def _message(finding: ErrorDetails, node: dict[str, Any]) -> str:
    kind, value, context = finding["type"], finding["input"], finding.get("ctx", {})
    if kind == "missing" and _misspelt(finding):
        return "unknown key; did you mean 'model'?"
    if kind == "missing":
        return f"this key is missing{_meaning(node)}"
    if kind == "union_tag_not_found":
        what = "unknown key; did you mean 'type'?" if _misspelt(finding) else "the key 'type' is missing;"
        return f"{what} Allowed values of 'type': {', '.join(node['tags'])}"
    if kind == "union_tag_invalid":
        return _option(value[context["discriminator"].strip("'")], node["tags"]) + _meaning(node)
    if kind == "literal_error":
        return _option(value, [str(o) for o in node.get("enum", [node.get("const")])]) + _meaning(node)
    if kind in _KINDS:
        hint = "; write it without quotes" if kind in _NUMERIC and isinstance(value, str) and is_number(value) else ""
        return f"must be {_KINDS[kind]}, not {described(value)}{hint}{_meaning(node)}"
    if kind in _BOUNDS and _range(node):
        return f"must be {_range(node)}, not {described(value)}{_meaning(node)}"
    if kind == "finite_number":
        return f"must be a finite number, not {described(value)}{_meaning(node)}"
    if kind in ("too_short", "too_long"):
        bound = (
            f"at least {context['min_length']}" if kind == "too_short" else f"at most {context['max_length']}"
        )
        return f"must have {bound} entries, not {described(value)}{_meaning(node)}"
    if kind == "string_pattern_mismatch":
        return _PATTERNS[context["pattern"]].format(described(value))
    if kind == "value_error":
        return str(context["error"])
    return f"{finding['msg'][:1].lower()}{finding['msg'][1:]}, not {described(value)}{_meaning(node)}"


def _option(value: Any, allowed: list[str]) -> str:
    return f"{described(value)} is not an option; {choice(value, allowed)}"


def is_number(text: str) -> bool:
    """Whether a text is that of a number."""
    try:
        float(text)
    except ValueError:
        return False
    return True
