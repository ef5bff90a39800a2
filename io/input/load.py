"""Reading a scene from a YAML file or a dictionary, with all that is wrong with it."""

import re
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from periporo.errors import InputError, Problem
from periporo.io.input.checks import scene_problems
from periporo.io.input.laws import material_problems
from periporo.io.input.yaml_source import YamlSource, read_yaml
from periporo.io.schema.errors import problems_of
from periporo.io.schema.scene import SceneInput, scene_schema

_MAX_NESTING = 40
_EXPONENT = re.compile(r"[-+]?[0-9]+(\.[0-9]*)?[eE][-+]?[0-9]+")


def load_scene(path: str | Path) -> SceneInput:
    """Read and check the scene in the YAML file `path`. Raises InputError with all problems found."""
    source = read_yaml(path)
    return _checked(source.data, Path(path).resolve().parent, source)


def parse_scene(data: dict[str, Any], folder: str | Path = ".") -> SceneInput:
    """Check a scene given as a dictionary; arrays are welcome, file names are relative to `folder`.

    Raises InputError with all problems found.
    """
    return _checked(_plain(data), Path(folder), None)


def _checked(data: Any, folder: Path, source: YamlSource | None) -> SceneInput:
    scene = None
    problems = list(source.problems) if source else []
    problems += material_problems(data, folder)
    try:
        scene = SceneInput.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        problems += problems_of(error, scene_schema(), data)
    if scene is not None and not problems:
        problems += scene_problems(scene)
    if scene is None or problems:
        name = source.name if source else "scene"
        raise InputError(name, [_with_line(problem, source) for problem in problems])
    return scene


def located(error: InputError, path: str | Path) -> InputError:
    """The problems that were found in the scene of the YAML file `path`, with that name and its lines."""
    source = read_yaml(path)
    return InputError(source.name, [_with_line(problem, source) for problem in error.problems])


def _with_line(problem: Problem, source: YamlSource | None) -> Problem:
    if source is None or problem.line is not None:
        return problem
    return Problem(problem.path, problem.message, source.line(problem.path))


def _plain(value: Any, depth: int = 0) -> Any:
    """Arrays, NumPy numbers and numbers as text as lists and numbers, throughout a nest of dictionaries and lists.

    The text is what PyYAML makes of 25e6, which YAML 1.1 reads as a number only with a point and a sign: 25.0e+6.
    """
    if depth > _MAX_NESTING:
        raise InputError("scene", [Problem((), f"nested more than {_MAX_NESTING} levels deep")])
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, str) and _EXPONENT.fullmatch(value):
        return float(value)
    if isinstance(value, dict):
        return {k: _plain(v, depth + 1) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v, depth + 1) for v in value]
    return value
