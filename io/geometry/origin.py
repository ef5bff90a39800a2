"""Coordinates are counted from an origin near the bodies.

A number of 4 000 000 m has steps of 5e-10 m: soil that creeps would not move at all. Scenes far from zero are therefore
computed as if they stood near zero, and results say what their places are counted from.
"""

import math
from typing import Any

import numpy as np

from periporo.io.geometry.points import counted_from
from periporo.io.geometry.shapes import bounds
from periporo.io.schema.base import History, SceneModel
from periporo.io.schema.scene import SceneInput

_NEAR = 100.0  # sizes of the scene


def scene_origin(scene: SceneInput) -> np.ndarray:
    """What the coordinates of a scene are counted from, (d,) m in whole metres; zero where the bodies are near.

    Raises PointFileError.
    """
    corners = [bounds(body.shape, scene.dimension) for body in scene.bodies]
    lower, upper = np.min([low for low, _ in corners], axis=0), np.max([up for _, up in corners], axis=0)
    size = max(float((upper - lower).max()), scene.spacing)
    if max(np.abs(lower).max(), np.abs(upper).max()) <= _NEAR * size:
        return np.zeros(scene.dimension)
    unit = max(1.0, 10.0 ** math.ceil(math.log10(size)))
    return np.floor(lower / unit) * unit


def relative(scene: SceneInput, origin: np.ndarray) -> SceneInput:
    """The same scene with all places counted from `origin` (d,) m."""
    if not origin.any():
        return scene
    gravity = scene.vector(scene.gravity)
    strength = math.sqrt(float((gravity**2).sum()))
    level = float(-(gravity * origin).sum() / strength) if strength else 0.0
    return _moved(scene, origin.tolist(), level)


def _moved(value: Any, origin: list[float], level: float) -> Any:
    """A part of a scene with its places counted from `origin`, and its levels from `level`."""
    if isinstance(value, tuple):
        return tuple(_moved(entry, origin, level) for entry in value)
    if isinstance(value, dict):
        return {name: _moved(entry, origin, level) for name, entry in value.items()}
    if not isinstance(value, SceneModel):
        return value
    changed: dict[str, Any] = {}
    for name, info in type(value).model_fields.items():
        before = getattr(value, name)
        extra = info.json_schema_extra
        match extra.get("place") if isinstance(extra, dict) and before is not None else None:
            case "point":
                changed[name] = _point(before, origin)
            case "level" if isinstance(before, tuple):
                changed[name] = tuple(counted_from(v, level) for v in before)
            case "level":
                changed[name] = _level(before, level)
            case "z":
                changed[name] = tuple(counted_from(z, origin[2]) for z in before)
            case _:
                changed[name] = _moved(before, origin, level)
    for name, extra in (value.model_extra or {}).items():  # fields of parameters
        changed[name] = _moved(extra, origin, level)
    copy = value.model_copy(update=changed)
    if hasattr(copy, "_origin"):
        copy._origin = tuple(origin)
    return copy


def _level(value: float | History, level: float) -> float | History:
    """A level, or a history of it."""
    if isinstance(value, History):
        return value.model_copy(update={"values": tuple(counted_from(v, level) for v in value.values)})
    return counted_from(value, level)


def _point(value: tuple, origin: list[float]) -> tuple:
    """A point, open where a component is None, or several."""
    if value and isinstance(value[0], tuple):
        return tuple(_point(point, origin) for point in value)
    return tuple(None if x is None else counted_from(x, o) for x, o in zip(value, origin, strict=False))
