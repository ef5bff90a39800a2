"""Whether the parameters of materials fit their laws."""

from pathlib import Path as FilePath
from typing import Any

from pydantic import BaseModel, ValidationError

from periporo.errors import Path, Problem, choice
from periporo.io.geometry.fields import typical_place, typical_value
from periporo.io.schema.errors import model_problems, problems_of
from periporo.io.schema.fields import field_schema, is_field, read_field
from periporo.materials import registry


def material_problems(data: Any, folder: FilePath) -> list[Problem]:
    """What the laws that a scene's raw `data` name find wrong with their parameters; files lie relative to `folder`."""
    materials = data.get("materials") if isinstance(data, dict) else None
    problems: list[Problem] = []
    for name, entry in materials.items() if isinstance(materials, dict) else ():
        if isinstance(entry, dict) and isinstance(entry.get("model"), str):
            path = ("materials", name)
            parameters, places, wrong = _without_fields(path, entry, folder)
            problems += wrong or _law_problems(path, parameters, places)
    return problems


def _without_fields(
    path: Path, entry: dict[str, Any], folder: FilePath
) -> tuple[dict[str, Any], list[str], list[Problem]]:
    """Parameters with a number in place of each field, where the fields have these, and what is wrong with them."""
    parameters: dict[str, Any] = dict(entry)
    places: list[str] = []
    problems: list[Problem] = []
    for name, value in entry.items():
        if not is_field(value):
            continue
        try:
            field = read_field(value, folder)
            parameters[name] = typical_value(field)
            places.append(f"{name} = {parameters[name]:g}{typical_place(field)}")
        except ValidationError as error:
            found = problems_of(error, field_schema(), value)
            problems += [Problem((*path, name, *(part for part in p.path if part != value["field"])), p.message)
                         for p in found]  # fmt: skip
        except (ValueError, OSError) as error:
            problems.append(Problem((*path, name), str(error)))
    return parameters, places, problems


def _law_problems(path: Path, parameters: dict[str, Any], places: list[str]) -> list[Problem]:
    model = parameters.pop("model")
    try:
        law = registry.load(model)
    except KeyError:
        message = (
            f"no material model of this name is installed; {choice(model, sorted(registry.available()))}"
        )
        return [Problem((*path, "model"), message)]
    except ImportError as error:
        moved = (error.name or "").startswith("periporo.")
        hint = "; what a law needs of periporo is in periporo.materials" if moved else ""
        return [Problem((*path, "model"), f"the material model '{model}' cannot be imported: {error}{hint}")]
    if isinstance(law, type) and issubclass(law, BaseModel):
        where = f", with {', '.join(places)}" if places else ""
        return [Problem((*path, *p.path), p.message + where) for p in model_problems(law, parameters)]
    try:
        law(**parameters)
    except (TypeError, ValueError) as error:
        return [Problem(path, f"the material model '{model}' refuses its parameters: {error}")]
    return []
