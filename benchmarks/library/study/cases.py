"""The cases of a study: combinations of parameters, each a scene of its own that is run in a folder of its own."""

from copy import deepcopy
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from periporo.io.input.yaml_source import read_yaml

from .. import runs

HALF_WIDTH = 0.05  # m
FIELDS = [
    "displacement", "velocity", "stress", "equivalent_shear_strain", "volumetric_strain", "integrity",
    "contact_force", "friction_force",
]  # fmt: skip
SCENE, RESULT = "column.yaml", "column.vtkhdf"
_KEYS = ("set", "height", "spacing", "friction", "suction", "variant", "duration")


@dataclass(frozen=True)
class Case:
    """A column: `height` m, `spacing` m, `friction` of the floor, `suction` Pa or None for dry soil.

    It is followed for `duration` s, or until it rests; that is not part of its name.
    """

    set: str
    height: float
    spacing: float
    friction: float
    suction: float | None
    variant: str | None
    duration: float

    @property
    def name(self) -> str:
        """Name of the case's folder."""
        water = "dry" if self.suction is None else f"s{self.suction:g}Pa"
        parts = [self.set, f"H{1e3 * self.height:g}mm", f"mu{self.friction:g}", water, f"d{1e3 * self.spacing:g}mm"]
        return "-".join(parts + ([self.variant.replace(" ", "_")] if self.variant else []))


class Study:
    """The study that the YAML file `path` describes; with a `spacing` (m) all cases have that one."""

    def __init__(self, path: Path, spacing: float | None = None):
        text = read_yaml(path).data
        self._base = read_yaml(path.parent / text["scene"]).data
        self._change, self._sets, self._variants = text["change"], text["sets"], text["variants"]
        expanded = (c for entry in text["cases"] for c in self._expand(text["defaults"] | entry, spacing))
        self.cases = list(dict.fromkeys(expanded))

    def _expand(self, entry, spacing):
        """All combinations of the lists in one entry of `cases`. Raises ValueError for a key that is none."""
        if unknown := set(entry) - set(_KEYS):
            raise ValueError(f"cases: unknown key {', '.join(sorted(unknown))}; allowed are {', '.join(_KEYS)}")
        lists = {k: v if isinstance(v, list) else [v] for k, v in entry.items()}
        if spacing is not None:
            lists["spacing"] = [spacing]
        for values in product(*lists.values()):
            chosen = dict(zip(lists, values, strict=True))
            chosen.setdefault("friction", self._sets[chosen["set"]]["friction"])
            yield Case(**chosen)

    def scene(self, case: Case) -> dict:
        """The input of a case, as `periporo` reads it."""
        scene = deepcopy(self._base)
        scene["title"] = case.name
        scene["spacing"] = case.spacing
        scene["bodies"][0]["shape"] |= {"lower": [-HALF_WIDTH, 0.0], "upper": [HALF_WIDTH, case.height]}
        wall = HALF_WIDTH - case.spacing  # the outermost layer of points
        scene["boundaries"]["left"]["where"] = {"upper": [-wall, None]}
        scene["boundaries"]["right"]["where"] = {"lower": [wall, None]}
        scene["contacts"][0]["friction"] = case.friction
        scene["stages"][-1]["duration"] = case.duration
        if case.suction is not None:
            scene["pore_water"] = {"suction": case.suction, "retention": {"set": "fitted"}}
        scene["output"] = {"interval": 0.01, "fields": FIELDS, "history_interval": 100, "file": RESULT}
        scene["checkpoint"] = {"interval": 120.0}
        changes = self._change | self._sets[case.set]["change"]
        if case.variant is not None:
            changes |= self._variants[case.variant]
        for path, value in changes.items():
            _put(scene, path.split("."), value)
        return scene


def _put(scene, path, value):
    """Set the entry that a path of keys and of numbers in lists leads to."""
    *above, last = (int(part) if part.isdigit() else part for part in path)
    for part in above:
        scene = scene[part]
    scene[last] = value


def run(study: Study, case: Case, folder: Path) -> int:
    """Run a case in `folder`, or the rest of it; the exit status of `periporo`. A changed case starts anew."""
    return runs.run(study.scene(case), folder / SCENE, folder / RESULT)
