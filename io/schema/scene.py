"""A complete scene: what may be said of it as a whole, and of the run."""

from copy import deepcopy
from functools import cache
from pathlib import PurePosixPath
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BeforeValidator, model_validator

from periporo.io.schema.base import (
    Acceleration,
    FileName,
    Flag,
    Integer,
    Name,
    OpenPosition,
    Position,
    Real,
    SceneModel,
    Text,
    key,
)
from periporo.io.schema.bodies import Body, InitialStress, MaterialInput
from periporo.io.schema.contacts import Boundary, Contact
from periporo.io.schema.stages import Stage
from periporo.io.schema.water import PoreWater

_RESULT_SUFFIXES = (".vtkhdf", ".h5", ".hdf5")


def _inside_the_working_folder(name: str) -> str:
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or "\\" in name or name.startswith("~"):
        raise ValueError(
            f"{name!r} is not relative to the working folder; give a name without '..', '~', '\\'"
        )
    if path.suffix not in _RESULT_SUFFIXES:
        raise ValueError(f"{name!r} must end in one of {', '.join(_RESULT_SUFFIXES)}")
    return name


SchemeName = Literal["bond_projected", "point_state", "standard", "sub_horizon", "sub_horizon_published"]

POINT_SCHEMES = ("point_state", "standard")
"""Schemes with one row of a law for each point."""

_SCHEMES_WITH = {  # option -> schemes that have it
    "self_point": ("sub_horizon_published",), "average_ends": ("sub_horizon_published",),
    "dilatation": ("bond_projected",), "sharpened": ("point_state",),
    "regular": ("point_state",), "balance": ("point_state", "bond_projected"),
}  # fmt: skip


class CorrespondenceInput(SceneModel):
    """A correspondence scheme with its options."""

    scheme: SchemeName = key("name of the scheme")
    self_point: Flag | None = key(
        "count a point in its own horizon (sub_horizon_published, default true)", default=None
    )
    average_ends: Flag | None = key(
        "give both ends of a bond the mean of their gradients (sub_horizon_published, default true)", default=None
    )

    dilatation: Literal["bond", "points"] | None = key(
        "whose volume change a bond feels: its own, or, so that soil can flow at constant volume, its points' "
        "(bond_projected, default bond)",
        default=None,
    )
    sharpened: Flag | None = key(
        "laws see a gradient that is of fourth order in waves; steps are shorter (point_state, default false)",
        default=None,
    )

    regular: Flag | None = key(
        "keep points regular and stress smooth where soil flows (point_state, default false)", default=None
    )

    balance: Flag | None = key(
        "tilt gradients so that forces balance in a uniform stress, for displaced points that stay neighbours "
        "(point_state, bond_projected, default false)",
        default=None,
    )

    @model_validator(mode="after")
    def _has_the_options(self):
        for option in self.options():
            schemes = _SCHEMES_WITH[option]
            if self.scheme not in schemes:
                choice = " or ".join(schemes)
                raise ValueError(f"'{self.scheme}' has no option {option}; leave it out, or choose {choice}")
        if self.balance and self.dilatation == "points":
            raise ValueError("balance needs bonds with a volume change of their own; leave out dilatation, or balance")
        return self

    def options(self) -> dict[str, Any]:
        """The options that were given, by name."""
        return {name: getattr(self, name) for name in _SCHEMES_WITH if getattr(self, name) is not None}


def _name_as_scheme(value: Any) -> Any:
    return {"scheme": value} if isinstance(value, str) else value


Correspondence = Annotated[
    CorrespondenceInput, BeforeValidator(_name_as_scheme, json_schema_input_type=SchemeName | CorrespondenceInput)
]


class TimeStep(SceneModel):
    """How the time step is chosen."""

    safety: Real = key("share of the stability bound", "1", default=0.8, gt=0, le=1)
    fixed: Real | None = key(
        "a constant step in place of the bound's share", "s", default=None, ge=1e-15, le=1e3
    )
    update: Integer = key("steps between updates of the bound", "steps", default=20, ge=1, le=10_000)
    added_inertia: Integer = key(
        "rounds that make relative accelerations of neighbours smaller, for longer steps", "1", default=0, ge=0, le=8
    )


class SleepInput(SceneModel):
    """Points at rest, which are passed over until something near them changes."""

    speed: Real = key("a point that is slower is at rest", "m/s", gt=0, le=1e6)
    steps: Integer = key(
        "for how long a point and all within two horizons must have been at rest", "steps", default=200, ge=10, le=10**6
    )


class Output(SceneModel):
    """What is written, and how often."""

    interval: Real | None = key(
        "time between outputs; default: a fiftieth of each stage", "s", default=None, gt=0, le=1e9
    )
    file: Annotated[FileName, AfterValidator(_inside_the_working_folder)] | None = key(
        "name of the result file in the working folder; default: the scene's name", default=None
    )
    fields: tuple[Name, ...] | None = key(
        "fields to write, see the page on results; default: the usual ones", default=None, max_length=100
    )
    parts: Integer | None = key(
        "part files that several ranks write, of checkpoints, too; default: one file", default=None, ge=1, le=4096
    )
    history_interval: Integer = key("steps between entries of histories", "steps", default=10, ge=1, le=10**6)


class Checkpoint(SceneModel):
    """Checkpoints, from which an interrupted run resumes."""

    interval: Real = key("wall time between checkpoints", "s", default=600.0, gt=0, le=1e7)
    keep: Integer = key("checkpoints that are kept", default=2, ge=1, le=1000)


class _Ends(SceneModel):
    lower: OpenPosition | None = key("lower corner, null = open", "m", default=None, vector=True, place="point")
    upper: OpenPosition | None = key("upper corner, null = open", "m", default=None, vector=True, place="point")

    def along(self, axis: int) -> tuple[float | None, float | None]:
        """The lower and the upper end along an axis, m."""
        lower, upper = ((end or ())[axis : axis + 1] for end in (self.lower, self.upper))
        return (lower[0] if lower else None), (upper[0] if upper else None)


class Domain(_Ends):
    """A box that points may leave, but not come back to: outside they are taken away."""

    @model_validator(mode="after")
    def _bounds(self):
        if self.lower is None and self.upper is None:
            raise ValueError("give at least one of lower, upper")
        return self


class Symmetry(_Ends):
    """Planes across the axes behind which everything is a mirror image; the bodies lie between them."""


class Periodic(_Ends):
    """A cell that repeats for ever along the axes along which both of its ends are given."""


class Monitor(SceneModel):
    """What is watched during the run."""

    points: tuple[Position, ...] = key(
        "places; displacement and velocity of the point nearest to each at the start, and pore pressure where there is "
        "pore_water, are recorded as histories",
        "m",
        default=(),
        place="point",
        max_length=1000,
    )
    energy_tolerance: Real = key(
        "energy error over work done that stops the run", "1", default=0.01, gt=0, le=1
    )


class SceneInput(SceneModel):
    """A complete scene in SI units, made and checked as a whole by `load_scene` or `parse_scene`."""

    title: Text | None = key("what the scene shows", default=None)
    dimension: Literal[2, 3] = key("dimensions of space, 2 is plane strain")
    axisymmetric: Flag = key(
        "points are rings about the axis x = 0: x is the radius, y the height, zz the direction around (2D)",
        default=False,
    )
    spacing: Real = key("distance of the points", "m", ge=1e-6, le=1e4)
    horizon: Real = key("radius within which points interact", "spacings", default=2.2, ge=1.5, le=6)
    influence: Literal["cubic", "conical", "gaussian", "constant"] = key("weight of a bond", default="cubic")
    correspondence: Correspondence = key(
        "scheme that turns bonds into deformation and stress into force: its name, or {scheme, options}",
        default=CorrespondenceInput(scheme="point_state", sharpened=True, regular=True),
    )
    materials: dict[Name, MaterialInput] = key("materials by name", min_length=1, max_length=1000)
    bodies: tuple[Body, ...] = key("what the scene consists of", min_length=1, max_length=1000)
    seed: Integer = key("start of all random numbers", default=0, ge=0, lt=2**63)
    gravity: Acceleration | None = key("acceleration, default zero", "m/s^2", default=None, vector=True)
    initial_stress: InitialStress | None = key("stress at the start, default none", default=None)
    boundaries: dict[Name, Boundary] = key("boundary conditions by name, for use in stages", default={})
    contacts: tuple[Contact, ...] = key("what bodies may touch", default=(), max_length=1000)
    domain: Domain | None = key("where points stay; default everywhere", default=None)
    symmetry: Symmetry | None = key("planes of symmetry; default none", default=None)
    periodic: Periodic | None = key("axes along which the scene repeats; default none", default=None)
    failed_points: Literal["keep", "remove"] = key(
        "points whose law fails in a step: they keep their stress, or are taken away", default="keep"
    )
    pore_water: PoreWater | None = key("water in the pores, default dry", default=None)
    stages: tuple[Stage, ...] = key("what happens, one after the other", min_length=1, max_length=1000)
    time_step: TimeStep = key("choice of the time step", default=TimeStep())
    sleep: SleepInput | None = key("let points at rest sleep; default none", default=None)
    output: Output = key("results", default=Output())
    cpu_target: Literal["own", "common"] = key(
        "what kernels are compiled for: each rank's own processor, which must be alike, or what all have in common",
        default="own",
    )
    checkpoint: Checkpoint | None = key("checkpoints, default none", default=None)
    monitor: Monitor = key("what is watched", default=Monitor())

    def vector(self, entry: tuple[float, ...] | None) -> np.ndarray:
        """A vector entry of the scene as an array (dimension,), zero if it was not given."""
        return np.zeros(self.dimension) if entry is None else np.array(entry, dtype=float)

    def touching_bodies(self) -> set[frozenset[str]]:
        """Pairs of names of the bodies between which there is a contact in any stage."""
        pairs = (c.pairs([b.name for b in self.bodies]) for c in self.contacts if c.type == "bodies")
        return {frozenset(pair) for of_entry in pairs for pair in of_entry}

    def placed_bodies(self) -> set[str]:
        """Names of the bodies that a stage places: they are not there at the start."""
        return {name for stage in self.stages for name in stage.place}

    def bodies_in_contact(self) -> set[str]:
        """Names of the bodies that a bodies contact names: they bond with no other."""
        return {name for pair in self.touching_bodies() for name in pair}


@cache
def scene_schema() -> dict[str, Any]:
    """JSON Schema of a scene, made once; whoever changes it takes a copy, as `scene_json_schema` does."""
    return SceneInput.model_json_schema()


def scene_json_schema() -> dict[str, Any]:
    """JSON Schema of a scene, with descriptions and units, for editors and for the reference."""
    return deepcopy(scene_schema())
