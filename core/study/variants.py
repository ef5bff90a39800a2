"""Which variants a study has: lists, grids and random draws of any keys of a scene."""

import copy
import dataclasses
import hashlib
import itertools
import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError, model_validator

from periporo.errors import InputError, Problem, choice
from periporo.io.input.load import located, parse_scene
from periporo.io.input.yaml_source import YamlSource, read_yaml
from periporo.io.schema.base import Integer, Name, Real, SceneModel, key
from periporo.io.schema.errors import problems_of
from periporo.io.schema.files import ExistingFile
from periporo.io.schema.scene import SceneInput

_MOST = 100_000  # variants
_LONGEST = 60  # characters of a folder's name before its hash

Values = list[Any] | dict[str, dict[str, Any]]


class Draw(SceneModel):
    """How a number is drawn."""

    uniform: tuple[Real, Real] | None = key("lowest and highest", default=None)
    normal: tuple[Real, Real] | None = key("mean and standard deviation", default=None)
    lognormal: tuple[Real, Real] | None = key("mean and standard deviation, of the values", default=None)
    integers: tuple[Integer, Integer] | None = key("lowest and highest", default=None)

    @model_validator(mode="after")
    def _is_one(self):
        given = {name: value for name in type(self).model_fields if (value := getattr(self, name)) is not None}
        if len(given) != 1:
            raise ValueError("give exactly one of: uniform, normal, lognormal, integers")
        ((name, (first, second)),) = given.items()
        if name in ("uniform", "integers") and not first < second:
            raise ValueError(f"{name}: the second number must exceed the first")
        if name in ("normal", "lognormal") and not (second > 0.0 and (name == "normal" or first > 0.0)):
            raise ValueError(f"{name}: give a mean{'' if name == 'normal' else ' > 0'} and a deviation > 0")
        return self

    def draw(self, rng: np.random.Generator) -> float | int:
        """A number."""
        if self.integers is not None:
            return int(rng.integers(self.integers[0], self.integers[1], endpoint=True))
        if self.uniform is not None:
            return float(rng.uniform(*self.uniform))
        if self.normal is not None:
            return float(rng.normal(*self.normal))
        mean, deviation = self.lognormal or (1.0, 1.0)
        variance = np.log1p((deviation / mean) ** 2)
        return float(mean * np.exp(rng.normal() * np.sqrt(variance) - 0.5 * variance))


class Draws(SceneModel):
    """Random draws: in each of them all keys have numbers of their own."""

    count: Integer = key("how many", ge=1, le=_MOST)
    seed: Integer = key("start of the random numbers", default=0, ge=0, lt=2**63)
    keys: dict[str, Draw] = key("how each key is drawn", min_length=1)


class Block(SceneModel):
    """A set of variants: all combinations of its grid, its rows of lists, and its draws.

    A key is a path into the scene, as materials.soil.cohesion or contacts.0.friction. In its place may stand any name,
    if its values are named themselves: {loose: {key: value, ...}, dense: {...}}.
    """

    grid: dict[str, Values] = key("values of which all combinations are run", default={})
    list: dict[str, Values] = key("values that go together, the first with the first", default={})
    random: Draws | None = key("random draws", default=None)

    @model_validator(mode="after")
    def _goes_together(self):
        if not self.grid and not self.list and self.random is None:
            raise ValueError("give at least one of: grid, list, random")
        lengths = {name: len(values) for name, values in self.list.items()}
        if len(set(lengths.values())) > 1:
            told = ", ".join(f"{name} {n}" for name, n in lengths.items())
            raise ValueError(f"the values in 'list' go together, so there must be as many of each: {told}")
        empty = [name for name, values in (self.grid | self.list).items() if not values]
        if empty:
            raise ValueError(f"{empty[0]} has no values")
        return self


class StudyInput(SceneModel):
    """A study: a scene, what is changed in all variants, and the variants."""

    title: str | None = key("what the study shows", default=None)
    scene: ExistingFile = key("file of the scene, relative to the study's folder")
    change: dict[str, Any] = key("changes of all variants: keys and values", default={})
    variants: tuple[Block, ...] = key("sets of variants, one after the other", min_length=1, max_length=1000)
    results: tuple[Name, ...] = key(
        "columns of the table: figures of a run, or max_NAME and last_NAME of its histories",
        default=("run_out_m", "height_m", "max_max_speed", "last_time"),
    )


@dataclass(frozen=True)
class Variant:
    """A scene of a study: `name` of its folder, what it has by name of each factor, and the scene itself."""

    name: str
    factors: dict[str, Any]
    scene: SceneInput


@dataclass(frozen=True)
class Study:
    """A study that was read: its input and its variants, each of them once."""

    model: StudyInput
    variants: list[Variant]

    @property
    def factors(self) -> list[str]:
        """Names of what varies."""
        return list(dict.fromkeys(name for variant in self.variants for name in variant.factors))


def read_study(file: str | Path) -> Study:
    """The study in a YAML file, every scene of which is checked. Raises InputError."""
    source = read_yaml(file)
    folder = Path(file).resolve().parent
    problems = list(source.problems)
    try:
        model = StudyInput.model_validate(source.data, context={"folder": folder})
    except ValidationError as error:
        problems += problems_of(error, StudyInput.model_json_schema(), source.data)
    if problems:
        raise InputError(str(file), [dataclasses.replace(p, line=p.line or source.line(p.path)) for p in problems])
    base = read_yaml(model.scene)
    found: dict[str, Variant] = {}
    for number, block in enumerate(model.variants):
        for factors, changes in _expanded(block):
            data = _changed(source, base.data, model.change | changes, ("variants", number))
            variant = _variant(source, factors, data, Path(model.scene))
            found.setdefault(variant.scene.model_dump_json(), variant)  # what is the same is run once
            if len(found) > _MOST:
                raise InputError(str(file), [Problem(("variants",), f"more than {_MOST} variants")])
    return Study(model, list(found.values()))


def _expanded(block: Block) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Factors and changes of each variant of a block."""
    axes = [[_chosen(name, values, k) for k in range(len(values))] for name, values in block.grid.items()]
    if block.list:
        count = len(next(iter(block.list.values())))
        rows = [[_chosen(name, values, k) for name, values in block.list.items()] for k in range(count)]
        axes.append([_merged(row) for row in rows])
    if block.random is not None:
        rng = np.random.default_rng(block.random.seed)
        drawn = [{n: d.draw(rng) for n, d in block.random.keys.items()} for _ in range(block.random.count)]
        axes.append([(values, values) for values in drawn])
    for combination in itertools.product(*axes):
        yield _merged(combination)


def _chosen(name: str, values: Values, k: int) -> tuple[dict[str, Any], dict[str, Any]]:
    """Factor and changes of value k of a key, or of a name whose values are named."""
    if isinstance(values, dict):
        label = list(values)[k]
        return {name: label}, values[label] or {}
    return {name: values[k]}, {name: values[k]}


def _merged(parts) -> tuple[dict[str, Any], dict[str, Any]]:
    factors: dict[str, Any] = {}
    changes: dict[str, Any] = {}
    for of_part, by_part in parts:
        factors |= of_part
        changes |= by_part
    return factors, changes


def _changed(source: YamlSource, base: Any, changes: dict[str, Any], place: tuple) -> Any:
    """The raw scene with changes. Raises InputError for a key that leads nowhere."""
    data = copy.deepcopy(base)
    for path, value in changes.items():
        *above, last = (int(part) if part.isdigit() else part for part in path.split("."))
        here = data
        for part in above:
            try:
                here = here[part]
            except (KeyError, IndexError, TypeError):
                known = list(map(str, here)) if isinstance(here, dict) else [f"0 to {len(here) - 1}"] if here else []
                message = f"the key {path} leads nowhere: there is no '{part}'; {choice(part, known)}"
                raise InputError(source.name, [Problem(place, message, source.line(place))]) from None
        try:
            here[last] = value
        except (IndexError, TypeError):
            message = f"the key {path} leads nowhere: there is no '{last}'"
            raise InputError(source.name, [Problem(place, message, source.line(place))]) from None
    return data


def _variant(source: YamlSource, factors: dict[str, Any], data: Any, scene: Path) -> Variant:
    try:
        checked = parse_scene(data, scene.resolve().parent)
    except InputError as error:
        wrong = located(InputError(str(scene), error.problems), scene)
        told = ", ".join(f"{name} = {value}" for name, value in factors.items())
        raise InputError(f"{Path(source.name).name}, variant {told}: {scene.name}", wrong.problems) from None
    return Variant(_folder_name(factors), factors, checked)


def _folder_name(factors: dict[str, Any]) -> str:
    """Short names of the factors with their values, and a hash that tells what the short names do not."""
    short = {name.split(".")[-1]: value for name, value in factors.items()}
    texts = [f"{n}={f'{v:.6g}' if isinstance(v, float) else v}" for n, v in short.items()]
    text = re.sub(r"[^\w.=+-]+", "-", "_".join(texts))[:_LONGEST].rstrip("._-")
    exact = json.dumps(factors, sort_keys=True, default=str)
    return f"{text}_{hashlib.sha256(exact.encode()).hexdigest()[:8]}"
