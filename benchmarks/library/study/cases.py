"""The cases of a study: combinations of parameters, each a scene of its own that is run in a folder of its own."""

from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path

from periporo.core.study.variants import read_study

from .. import runs

HALF_WIDTH = 0.05  # m
SCENE, RESULT = "column.yaml", "column.vtkhdf"


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
        self._scenes = {}
        for variant in read_study(path).variants:
            scene = variant.scene.model_dump(mode="json", exclude_none=True)
            if spacing is not None:
                wall = HALF_WIDTH - spacing  # the outermost layer of points
                scene["spacing"] = spacing
                scene["boundaries"]["left"]["where"]["upper"][0] = -wall
                scene["boundaries"]["right"]["where"]["lower"][0] = wall
            self._scenes.setdefault(_case(variant.factors, scene), scene)
        self.cases = list(self._scenes)

    def scene(self, case: Case) -> dict:
        """The input of a case, as `periporo` reads it."""
        scene = deepcopy(self._scenes[case])
        scene["title"] = case.name
        scene["output"]["file"] = RESULT
        return scene


def _case(factors: dict, scene: dict) -> Case:
    variant, water = factors.get("variant"), scene.get("pore_water")
    return Case(
        factors["soil"], scene["bodies"][0]["shape"]["upper"][1], scene["spacing"], scene["contacts"][0]["friction"],
        water and water["suction"]["values"][0], None if variant == "as it is" else variant,
        scene["stages"][-1]["duration"],
    )  # fmt: skip


def run(study: Study, case: Case, folder: Path) -> int:
    """Run a case in `folder`, or the rest of it; the exit status of `periporo`. A changed case starts anew."""
    return runs.run(study.scene(case), folder / SCENE, folder / RESULT)
