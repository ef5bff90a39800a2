"""Files of the laboratory: laws, measured curves, and tables that are written."""

import csv
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ValidationError

from periporo.core.points.material import Material
from periporo.errors import InputError, Problem, choice
from periporo.io.input.yaml_source import read_yaml
from periporo.io.schema.errors import problems_of
from periporo.materials import registry
from periporo.materials.laboratory.columns import Columns


def as_material(material: Material | str | Path | dict[str, Any]) -> Material:
    """A law that is ready, whatever stands for it. Raises InputError."""
    if isinstance(material, str | Path):
        return load_material(material)
    return _created(material, "material", [], None) if isinstance(material, dict) else material


def load_material(file: str | Path) -> Material:
    """The material of a YAML file: `model` and its parameters. Raises InputError with line and key."""
    source = read_yaml(file)
    return _created(source.data, str(file), list(source.problems), source)


def _created(data: Any, name: str, problems: list[Problem], source) -> Material:
    """The law of a mapping `data`; `source` knows the lines."""

    def line(path):
        return source.line(path) if source else None

    parameters = dict(data) if isinstance(data, dict) else {}
    model = parameters.pop("model", None)
    if not isinstance(model, str):
        message = f"give the name of the material model, one of {', '.join(sorted(registry.available()))}"
        raise InputError(name, [*problems, Problem(("model",), message, line(("model",)))])
    try:
        law = registry.load(model)
    except KeyError as error:
        raise InputError(name, [*problems, Problem(("model",), error.args[0])]) from None
    try:
        material = law(**parameters)
    except ValidationError as error:
        schema = law.model_json_schema() if issubclass(law, BaseModel) else {}
        problems += problems_of(error, schema, parameters)
    except (TypeError, ValueError) as error:
        problems.append(Problem((), str(error)))
    if problems:
        raise InputError(name, [dataclasses.replace(p, line=p.line or line(p.path)) for p in problems])
    return material


def read_measured(file: str | Path) -> Columns:
    """The columns of a CSV file with a header; `#` starts a comment line, an empty cell is nan. Raises InputError."""
    name = str(file)
    try:
        lines = Path(file).read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
        raise InputError(name, [Problem((), f"the file cannot be read: {reason}")]) from None
    numbered = [(k, line) for k, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    rows = [(k, [cell.strip() for cell in next(csv.reader([line]))]) for k, line in numbered]
    if len(rows) < 2:
        raise InputError(name, [Problem((), "a measured curve needs a header and at least one row")])
    header, values = rows[0][1], []
    for k, cells in rows[1:]:
        try:
            numbers = [float(cell) if cell else np.nan for cell in cells]
        except ValueError:
            numbers = []
        if len(numbers) != len(header):
            message = f"must be {len(header)} numbers separated by commas, one under each column"
            raise InputError(name, [Problem((), message, k)])
        values.append(numbers)
    return dict(zip(header, np.array(values).T, strict=True))


_UNITS = {"pa": 1.0, "kpa": 1e3, "kn/m2": 1e3, "mpa": 1e6, "mn/m2": 1e6, "%": 0.01, "mm": 1e-3, "deg": 1.0, "": 1.0}
"""What numbers of AGS4 files are multiplied by, by their unit."""


def read_ags(file: str | Path, group: str, columns: dict[str, str], where: dict[str, str]) -> Columns:
    """Columns of a group of an AGS4 file in SI units: {column: heading}, of the rows with the values of `where`.

    What is no number is nan. Raises InputError, and ImportError without python-ags4.
    """
    try:
        from python_ags4 import AGS4
    except ImportError as error:
        raise ImportError("AGS4 files need python-ags4 (pip install 'periporo[laboratory]')") from error
    name = str(file)
    try:
        tables, _ = AGS4.AGS4_to_dict(name)
    except (OSError, UnicodeDecodeError, AGS4.AGS4Error) as error:
        raise InputError(name, [Problem((), f"the file cannot be read: {error}")]) from None
    if group not in tables:
        raise InputError(name, [Problem(("group",), f"there is no group '{group}'; {choice(group, list(tables))}")])
    table = tables[group]
    for heading in (*columns.values(), *where):
        if heading not in table:
            message = f"group {group} has no heading '{heading}'; {choice(heading, list(table))}"
            raise InputError(name, [Problem(("columns",), message)])
    kinds = table["HEADING"]
    rows = [
        k for k, kind in enumerate(kinds)
        if kind == "DATA" and all(table[h][k].strip() == value for h, value in where.items())
    ]  # fmt: skip
    if not rows:
        raise InputError(name, [Problem(("where",), f"group {group} has no such row")])
    found = {}
    for column, heading in columns.items():
        unit = table[heading][kinds.index("UNIT")].strip().lower() if "UNIT" in kinds else ""
        if unit not in _UNITS:
            message = f"{heading} has the unit '{unit}'; allowed: {', '.join(filter(None, _UNITS))}"
            raise InputError(name, [Problem(("columns", column), message)])
        found[column] = _UNITS[unit] * np.array([_as_number(table[heading][k]) for k in rows])
    return found


def _as_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return np.nan


def write_table(file: Path, columns: Columns) -> None:
    """Write columns (m,) as CSV with 17 significant digits, which is exact."""
    table = np.stack(list(columns.values()), axis=1)
    np.savetxt(file, table, fmt="%.17g", delimiter=",", header=",".join(columns), comments="")
