"""Input of the water in the pores, and outside."""

from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, Strict, model_validator

from periporo.io.schema.base import Flag, Integer, Motion, Name, Position, Real, SceneModel, key
from periporo.io.schema.files import ExistingFile
from periporo.io.schema.ground import Heights

BISHOP_NEEDS_RETENTION = (
    "bishop without a retention curve: pores are always full, and the factor is 1; give retention, or leave out bishop"
)
_Factor = Annotated[float, Strict(), Field(ge=1e-4, le=1e4)]


class VanGenuchten(SceneModel):
    """Effective saturation [1 + (alpha s)^n]^(1/n - 1)."""

    alpha: Real = key("parameter alpha", "1/kPa", gt=0, le=1e6)
    n: Real = key("parameter n", "1", gt=1, le=100)
    residual: Real = key("residual saturation", "1", default=0.0, ge=0, lt=1)


class Exponential(SceneModel):
    """Effective saturation exp(-alpha s)."""

    alpha: Real = key("parameter alpha", "1/kPa", gt=0, le=1e6)
    residual: Real = key("residual saturation", "1", default=0.0, ge=0, lt=1)


class Retention(SceneModel):
    """Water retention: a named set, or the three parameters of such a set, or a formula, or a table."""

    set: Literal["menon_song", "fitted"] | None = key("a named set of parameters", default=None)
    alpha1: Real | None = key("parameter alpha1", "1/kPa", default=None, gt=0, le=1e6)
    alpha2: Real | None = key("parameter alpha2", "1", default=None, ge=0, le=1e3)
    alpha3: Real | None = key("parameter alpha3", "1", default=None, gt=1, le=1e3)
    van_genuchten: VanGenuchten | None = key("van Genuchten's formula", default=None)
    exponential: Exponential | None = key("Gardner's formula", default=None)
    table: ExistingFile | None = key(
        "CSV file with suction, saturation, and, if not its cube, conductivity over that of full pores", default=None
    )

    @model_validator(mode="after")
    def _is_one_kind(self):
        alphas = [self.alpha1, self.alpha2, self.alpha3]
        some = any(a is not None for a in alphas)
        kinds = [self.set, self.van_genuchten, self.exponential, self.table]
        if some + sum(kind is not None for kind in kinds) != 1:
            raise ValueError(
                "give exactly one of: set; alpha1, alpha2 and alpha3; van_genuchten; exponential; table"
            )
        if some and any(a is None for a in alphas):
            raise ValueError("give all of alpha1, alpha2, alpha3")
        return self


class Bishop(SceneModel):
    """Bishop's factor chi of the pore pressure p in the effective stress sigma + chi p I; exactly one."""

    power: Real | None = key("chi = S^power", "1", default=None, gt=0, le=100)
    effective_power: Real | None = key(
        "chi = S_e^effective_power, S_e the saturation above the residual one, over what it is in full pores", "1",
        default=None, gt=0, le=100,
    )  # fmt: skip
    air_entry: Real | None = key(
        "chi = (s/air_entry)^-0.55 at a suction s beyond it, else 1", "Pa", default=None, gt=0, le=1e9
    )

    @model_validator(mode="after")
    def _is_one_kind(self):
        if [self.power, self.effective_power, self.air_entry].count(None) != 2:
            raise ValueError("give exactly one of: power, effective_power, air_entry; default is the saturation itself")
        return self


class PressureFile(SceneModel):
    """Pressures of a file at its points, and around each of them linear: as what points of the scene begin with.

    A CSV file headed x,y[,z] and names of columns, or a result file, of whose points the nearest count.
    """

    file: ExistingFile = key("file name, relative to the scene's folder: .csv or .vtkhdf")
    column: Name = key("name of the column, or field", default="pore_pressure")
    step: Integer | None = key("number of the output of a result file; default the last", default=None, ge=0)
    _origin: tuple[float, ...] = PrivateAttr(default=())

    @model_validator(mode="after")
    def _has_outputs(self):
        if self.step is not None and not self.is_result:
            raise ValueError("step is for a result file (.vtkhdf); leave it out")
        return self

    @property
    def is_result(self) -> bool:
        """Whether it is a file of results."""
        return self.file.endswith(".vtkhdf")


class FreeWater(SceneModel):
    """Water at rest around the bodies: it presses on them, and lifts what is below its level."""

    level: Motion = key("level against gravity: a number or {times, values}", "m", place="level")


class Soil(SceneModel):
    """What the water meets in one material, in place of what holds for all."""

    porosity: Real | None = key("porosity, if the law has none", "1", default=None, gt=0, lt=1)
    retention: Retention | None = key("the retention curve", default=None)
    bishop: Bishop | None = key("Bishop's factor", default=None)
    conductivity: Real | None = key("hydraulic conductivity of full pores", "m/s", default=None, gt=0, le=10)
    permeability: Real | None = key("permeability of full pores", "m^2", default=None, gt=0, le=1e-4)

    @model_validator(mode="after")
    def _has_one_unit(self):
        if self.conductivity is not None and self.permeability is not None:
            raise ValueError("give one of: conductivity in m/s, permeability in m^2")
        return self


class PoreWater(SceneModel):
    """Water in the pores: its pressure at the start, and whether it can leave."""

    suction: Motion | None = key(
        "the same suction everywhere: a number, or for drained water {times, values}", "Pa", default=None
    )
    water_table: Motion | None = key(
        "level against gravity below which pressure is that of water at rest: a number, or for drained water "
        "{times, values}",
        "m",
        default=None,
        place="level",
    )
    phreatic_line: tuple[Position, ...] | None = key(
        "points of a water table that is not level, in two dimensions, from the left; level beyond the ends",
        "m",
        default=None,
        place="point",
        min_length=2,
        max_length=1000,
    )
    phreatic_surface: Heights | None = key(
        "heights of a water table that is not level, in three dimensions: a raster; level beyond its edges",
        "m",
        default=None,
    )
    pressure: PressureFile | None = key("pressures that are known at points", "Pa", default=None)
    largest_suction: Real = key(
        "above the water table suction grows with height up to this", "Pa", default=0.0, ge=0, le=1e9
    )
    drainage: Literal["drained", "undrained", "flowing"] = key(
        "water keeps the pressure of its place; or cannot leave its point, with a pressure that follows the volume; or "
        "flows by Darcy's law",
        default="drained",
    )
    conductivity: Real | None = key(
        "hydraulic conductivity of full pores, under 9.81 m/s^2", "m/s", default=None, gt=0, le=10
    )
    permeability: Real | None = key("permeability of full pores, in place of it", "m^2", default=None, gt=0, le=1e-4)
    anisotropy: Annotated[tuple[_Factor, ...], Field(min_length=2, max_length=3)] | None = key(
        "permeability along the axes, which do not turn with the soil, over the one that is given; default 1 along all",
        "1",
        default=None,
        vector=True,
    )
    viscosity: Real = key("viscosity of the water", "Pa s", default=1e-3, gt=0, le=1e3)
    kozeny_carman: Flag = key("permeability follows the porosity, as phi^3/(1 - phi)^2", default=False)
    soils: dict[Name, Soil] = key("what differs in single materials, by their names", default={})
    retention: Retention | None = key("the retention curve; default: pores are always full", default=None)
    bishop: Bishop | None = key("Bishop's factor; default: the saturation", default=None)
    porosity: Real | None = key("porosity of materials whose law has none", "1", default=None, gt=0, lt=1)
    free_water: FreeWater | None = key("water outside; default none", default=None)
    bulk_modulus: Real = key("bulk modulus of the water", "Pa", default=2.2e9, ge=1e3, le=1e12)
    water_density: Real = key("density of the water", "kg/m^3", default=1000.0, ge=1, le=1e5)
    report_work: Flag = key("tell the ledger what the soil's change of volume does on the water", default=False)
    frozen: Flag = key("keep saturation and mass of drained water as they are at the start", default=False)

    @model_validator(mode="after")
    def _has_a_start(self):
        starts = [self.suction, self.water_table, self.phreatic_line, self.phreatic_surface, self.pressure]
        if starts.count(None) != len(starts) - 1:
            raise ValueError(
                "give exactly one of: suction (0 for full pores without pressure), water_table, phreatic_line, "
                "phreatic_surface, pressure"
            )
        if self.largest_suction > 0.0 and (self.suction is not None or self.pressure is not None):
            raise ValueError("largest_suction belongs to a water table; leave it out, or give one")
        for name in ("suction", "water_table"):
            history = getattr(self, name)
            if history is not None and len(set(history.values)) > 1 and (self.drainage != "drained" or self.frozen):
                raise ValueError(
                    f"a history of {name} is for drained water that is not frozen; give a number, and where water "
                    "flows let the head of a boundary change"
                )
        suctions = (0.0,) if self.suction is None else self.suction.values
        if min(suctions) < 0.0:
            raise ValueError(f"suction must not be below 0, not {min(suctions):g}; give a water_table for pressures")
        if self.conductivity is not None and self.permeability is not None:
            raise ValueError("give one of: conductivity in m/s, permeability in m^2")
        largest = max(*suctions, self.largest_suction)
        if self.drainage != "drained" and largest >= 0.5 * self.bulk_modulus:
            raise ValueError(
                f"a suction of {largest:g} Pa would pull water of a bulk_modulus of {self.bulk_modulus:g} Pa apart; "
                "give a bulk_modulus that is at least twice as large"
            )
        if self.retention is None:
            unheld = self.bishop is not None and all(soil.retention is None for soil in self.soils.values())
            if unheld or any(soil.bishop is not None and soil.retention is None for soil in self.soils.values()):
                raise ValueError(BISHOP_NEEDS_RETENTION)
        if self.frozen and self.drainage != "drained":
            raise ValueError("frozen is for drained water; undrained water stays anyway: leave frozen out")
        return self
