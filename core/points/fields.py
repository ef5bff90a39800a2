"""Quantities at the points that can be written to the result file."""

from dataclasses import dataclass

import numpy as np

from periporo.core.numerics.jit import kernel
from periporo.core.points.material import derived_fields, state_column
from periporo.core.points.particles import Field

DEFAULT = ("displacement", "velocity", "stress", "equivalent_shear_strain", "volumetric_strain", "material", "body")
"""What is written without being asked for, with what laws name in `default_output`."""

_PLAIN = {  # name -> unit and how to get it from the particles, owned rows
    "displacement": ("m", lambda p, n: p.position[:n] - p.initial_position[:n]),
    "velocity": ("m/s", lambda p, n: p.velocity[:n]),
    "volume": ("m^3", lambda p, n: p.present_volume()),
    "mass": ("kg", lambda p, n: p.mass[:n]),
    "density": ("kg/m^3", lambda p, n: p.mass[:n] / p.present_volume()),
    "material": ("", lambda p, n: p.material[:n]),
    "body": ("", lambda p, n: p.body[:n]),
    "integrity": ("1", lambda p, n: p.share[:n, 1]),
}


@dataclass(frozen=True)
class OutputField:
    """A quantity that is written: its columns and unit."""

    name: str
    columns: int
    unit: str


class StrainMeasures:
    """Accumulated strain of the points: equivalent shear sqrt(2/3)|dev D| dt, and volumetric tr D dt."""

    output = ("equivalent_shear_strain", "volumetric_strain")

    def attach(self, p) -> None:
        """Declare the two fields."""
        for name in self.output:
            p.add_field(Field(name, None, "1", sent=False))

    def update(self, p, bonds, dt: float) -> None:
        """Add this step's strain."""
        _accumulate_strain(p.awake, dt, p.gradient, p.equivalent_shear_strain, p.volumetric_strain, p.dim)


@kernel
def _accumulate_strain(owned, dt, gradient, shear, volumetric, dim):
    d = len(dim)
    for i in range(owned):
        trace = 0.0
        square = 0.0
        for a in range(d):
            trace += gradient[i, d * a + a]
            for b in range(d):
                rate = 0.5 * (gradient[i, d * a + b] + gradient[i, d * b + a])
                square += rate * rate
        volumetric[i] += dt * trace
        shear[i] += dt * np.sqrt(2.0 / 3.0 * max(square - trace * trace / 3.0, 0.0))


def available(sim) -> dict[str, OutputField]:
    """Every field that this simulation can write, by name."""
    p = sim.particles
    fields = {}
    for name, (unit, _) in _PLAIN.items():
        width = p.fields[name].columns if name in p.fields else (p.dimension if name == "displacement" else None)
        fields[name] = OutputField(name, width or 1, unit)
    for name in _of_processes(sim):
        fields[name] = OutputField(name, p.fields[name].columns or 1, p.fields[name].unit)
    for name, (columns, unit, _) in _derived(sim).items():
        fields[name] = OutputField(name, columns, unit)
    fields["stress"] = OutputField("stress", p.components, "Pa")
    for name in sim.forces.names:
        fields[f"{name}_force"] = OutputField(f"{name}_force", p.dimension, "N")
    for block in sim.bonds.blocks:
        for state in (*block.material.state_fields, *derived_fields(block.material)):
            fields[state.name] = OutputField(state.name, state.columns(p.components), state.unit)
    return fields


def default(sim) -> list[str]:
    """Names of the fields that are written without being asked for."""
    of_laws = (getattr(m, "default_output", ()) for m in sim.materials)
    return list(dict.fromkeys([*DEFAULT, *(name for names in of_laws for name in names)]))


def _of_processes(sim) -> list[str]:
    """Point fields that the point processes offer for output."""
    return [name for process in sim.point_processes for name in process.output]


def _derived(sim) -> dict:
    """What point processes and obstacles make of points: name -> (columns, unit, function of particles and owned)."""
    parts = (*sim.point_processes, *sim.reactions)
    return {name: entry for part in parts for name, entry in getattr(part, "derived", {}).items()}


def values(sim, names) -> dict[str, np.ndarray]:
    """The named fields on the owned points; a point's stress and state are the averages of its bonds.

    What follows from a law's state follows from that of the point.
    """
    p, n = sim.particles, sim.particles.owned
    result = {}
    stored, plain = _of_processes(sim), {name: entry[-1] for name, entry in (_PLAIN | _derived(sim)).items()}
    averaged = [name for name in names if name not in (*plain, *stored) and not name.endswith("_force")]
    if averaged:
        sim.bonds.average(p, np.arange(n))
    for name in names:
        if name in plain:
            result[name] = plain[name](p, n)
        elif name in stored or name.endswith("_force"):
            result[name] = _internal(sim) if name == "internal_force" else getattr(p, name)[:n]
        else:
            result[name] = _averaged(sim, name)
    return result


def _internal(sim):
    """Internal force (owned, d) N; on points that sleep it is what holds them, since not all of it is known."""
    p, n = sim.particles, sim.particles.owned
    if p.awake == n:
        return p.internal_force[:n]
    force = p.internal_force[:n].copy()
    force[p.awake :] -= sim.forces.total()[p.awake :]
    return force


def _averaged(sim, name):
    """Stress, a state field or one derived from it, of each point's law; zero where that does not have it."""
    p, n, c = sim.particles, sim.particles.owned, sim.particles.components
    width = available(sim)[name].columns
    result = np.zeros((n, width))
    for block in sim.bonds.blocks:
        law, average = block.material, getattr(p, block.average)[:n]
        own = np.flatnonzero((p.material[:n] == block.index) & (average[:, 0] > 0.0))
        column = state_column(law, name, c)
        if name == "stress":
            result[own] = average[own, 1 : 1 + c]
        elif column is not None:
            result[own] = average[own, 1 + c + column : 1 + c + column + width]
        elif len(own) and any(field.name == name for field in derived_fields(law)):
            if block.values is not None:
                law = law.for_rows(np.stack([getattr(p, f"parameter_{name}")[own] for name in law.varied], axis=1))
            stress, state = average[own, 1 : 1 + c].copy(), average[own, 1 + c :].copy()
            result[own] = law.derived_state(stress, state)[name].reshape(len(own), width)
    return result if width > 1 else result[:, 0]
