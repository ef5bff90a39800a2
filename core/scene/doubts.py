"""What looks wrong about a scene that can be run, worst first."""

import numpy as np

from periporo.core.motion.timestep import highest_frequency
from periporo.core.numerics import jit
from periporo.core.numerics.gravity import vertical_axis
from periporo.core.points import fields
from periporo.core.ranks.reductions import maximum, minimum
from periporo.core.scene.build import output_names
from periporo.core.scene.water_doubts import doubts_about_water
from periporo.io.geometry.lattice import build_lattices
from periporo.io.schema.base import History, SceneModel
from periporo.io.schema.bodies import Cylinder, Disc

_SOFT = 0.05  # weight over bulk modulus
_STEPPED = 0.01  # of the volume of a round body
_LARGE = 1e9  # B, of an output
_STORED = {2: 3, 4: 6}  # columns of a vector and a tensor of the plane in a file
_SHORTER = 0.8  # of the bodies' own time step: what a contact may leave of it


def doubts_about(scene, sim) -> list[str]:
    """Remarks on a simulation that has just started, worst first; the same on all ranks."""
    return [
        *without_company(sim, scene),
        *_step_too_long(sim),
        *_too_soft(sim, scene),
        *_histories_before_their_stage(scene),
        *_rest_that_cannot_be(scene),
        *_thin_obstacles(scene),
        *_stepped_outlines(sim, scene),
        *_seams(scene),
        *_stiff_contacts(sim, scene),
        *_doubts_of_laws(sim, scene),
        *doubts_about_water(scene, sim),
        *_unused_boundaries(scene),
        *_large_outputs(sim, scene),
        *jit.remarks,
    ]


def _large_outputs(sim, scene) -> list[str]:
    """A remark on outputs that one rank would write for long."""
    available = fields.available(sim)
    widths = [available[name].columns for name in output_names(scene, sim)]
    columns = 4 + sum(_STORED.get(width, width) for width in widths)  # id and place, too
    size = 8 * columns * sim.comm.allreduce(sim.particles.owned)
    if scene.output.parts is not None or size < _LARGE:
        return []
    return [
        f"an output has {size / 1e9:.2g} GB, and rank 0 writes it alone: with output.parts as many ranks as that says "
        "write side by side, and checkpoints, too"
    ]


def without_company(sim, scene) -> list[str]:
    """A remark on each body with points that have no regular company and so bear no stress."""
    p, n = sim.particles, sim.particles.owned
    alone = p.share[:n, 1] == 0.0
    remarks = []
    for k, body in enumerate(scene.bodies):
        mine = np.array([(alone & (p.body[:n] == k)).sum(), (p.body[:n] == k).sum()])
        count, points = (int(c) for c in sim.comm.allreduce(mine))
        if count:
            remarks.append(
                f"{count:,} of the {points:,} points of body '{body.name}' bear no stress: they stand alone, in a pair "
                "or in a row; make it two points thick or more, by a smaller spacing"
            )
    return remarks


def _step_too_long(sim) -> list[str]:
    """A remark on a fixed time step beyond the stability limit of the initial state."""
    fixed = sim.time_step.fixed
    if fixed is None:
        return []
    frequency = highest_frequency(sim)
    if not fixed * frequency > 2.0:
        return []
    return [f"the fixed time step of {fixed:.3g} s is longer than the stability limit of {2.0 / frequency:.3g} s"]


def _too_soft(sim, scene) -> list[str]:
    """A remark on each soil that what stands on it would compress by more than `_SOFT`."""
    gravity = scene.vector(scene.gravity)
    strength = float(np.sqrt((gravity**2).sum()))
    if strength == 0.0:
        return []
    depth = _weight_above(sim, scene) / strength  # kg/m^2
    doubts = []
    for k, block in enumerate(sim.bonds.blocks):
        bulk, _ = block.elastic_moduli()
        index, first, second, _ = sim.bonds.layout.ends(block, sim.bonds.pairs)
        mine = block.active & (first[index] < sim.particles.owned)
        strain = np.zeros(len(bulk))
        strain[mine] = depth[first[index][mine]] * strength / bulk[mine]
        worst = maximum(sim.comm, float(strain.max(initial=0.0)))
        if worst > _SOFT:
            at = int(strain.argmax()) if len(strain) else 0
            found = (strain[at], bulk[at], depth[first[index][at]]) if len(strain) else (0.0, 0.0, 0.0)
            _, modulus, mass = max(sim.comm.allgather(tuple(map(float, found))))
            doubts.append(
                f"the weight of {mass / block.material.density:.3g} m of soil is {worst:.2g} of the bulk modulus, "
                f"{modulus:.3g} Pa, of material '{list(scene.materials)[k]}'; are its moduli in Pa?"
            )
    return doubts


def _weight_above(sim, scene) -> np.ndarray:
    """Weight per area (owned,) Pa of the points above each one and of half of itself, in columns a spacing wide."""
    p, n, h = sim.particles, sim.particles.owned, sim.spacing
    axis = vertical_axis(scene.gravity, scene.dimension)
    down = float(scene.vector(scene.gravity)[axis])
    level = -np.sign(down) * p.position[:n, axis]
    columns = np.floor(np.delete(p.position[:n], axis, axis=1) / h).astype(np.int64)
    tables = sim.comm.allgather((columns, level, p.mass))
    everywhere, levels, masses = (np.concatenate(parts) for parts in zip(*tables, strict=True))
    _, column = np.unique(everywhere, axis=0, return_inverse=True)
    order = np.lexsort((-levels, column.ravel()))  # column by column from the top
    column, masses = column.ravel()[order], masses[order]
    total = np.cumsum(masses)
    begins = np.flatnonzero(np.concatenate([[True], column[1:] != column[:-1]])[: len(column)])
    before = np.repeat((total - masses)[begins], np.diff([*begins, len(column)]))
    above = np.empty(len(order))
    above[order] = total - before - 0.5 * masses
    start = sum(len(t[1]) for t in tables[: sim.comm.rank])
    return above[start : start + n] * abs(down) / h ** (p.dimension - 1)


def _histories_before_their_stage(scene) -> list[str]:
    """A remark on each history of a boundary or a contact that is over when the first stage begins that uses it."""
    begins, begin = {}, 0.0
    for stage in scene.stages:
        begins[stage.name] = begin
        begin += getattr(stage, "duration", 0.0)  # of a quasi-static stage the longest
    used = {name: [stage.name for stage in scene.stages if name in stage.boundaries] for name in scene.boundaries}
    users = [(f"boundary '{name}'", scene.boundaries[name], stages) for name, stages in used.items()]
    users += [(f"contacts[{k}] ({m.type})", m, list(m.stages or ())) for k, m in enumerate(scene.contacts)]
    doubts = []
    for user, model, stages in users:
        first = next((name for name in begins if name in stages), None)
        for name in type(model).model_fields if first is not None else ():
            ends = [h.times[-1] for h in _histories(getattr(model, name)) if len(set(h.values)) > 1]
            if ends and begins[first] > 0.0 and max(ends) <= begins[first]:
                doubts.append(
                    f"the {name} of {user} ends at {max(ends):g} s, before stage '{first}' begins at "
                    f"{begins[first]:g} s: it is over; times count from the start of the run"
                )
    return doubts


def _histories(value) -> list[History]:
    """All histories in a part of a scene."""
    if isinstance(value, History):
        return [value]
    parts = value if isinstance(value, tuple) else [part for _, part in value] if isinstance(value, SceneModel) else ()
    return [history for part in parts for history in _histories(part)]


def _unused_boundaries(scene) -> list[str]:
    """A remark on boundaries that no stage names."""
    named = {name for stage in scene.stages for name in stage.boundaries}
    idle = [f"'{name}'" for name in scene.boundaries if name not in named]
    return [f"no stage names boundary {', '.join(idle)}: without that it does nothing"] if idle else []


def _rest_that_cannot_be(scene) -> list[str]:
    """A remark on each stage that is to end at rest while something goes on to its end."""
    doubts, begin = [], 0.0
    for stage in scene.stages:
        if stage.type != "dynamics":
            continue
        end = begin + stage.duration
        for name in stage.boundaries if stage.stop_when_at_rest is not None else ():
            parts = scene.boundaries[name].velocity
            if parts is None:
                continue
            if any(np.interp(end, h.times, h.values) != 0.0 for h in (parts.x, parts.y, parts.z) if h is not None):
                doubts.append(f"stage '{stage.name}' is to stop at rest, but boundary '{name}' moves until its end")
        begin = end
    return doubts


def _thin_obstacles(scene) -> list[str]:
    """A remark on each obstacle that is thinner than a spacing: beyond its middle the way out is the other side's."""
    doubts = []
    for number, model in enumerate(scene.contacts):
        sizes = {
            "box": lambda m: min(np.subtract(m.upper, m.lower)), "disc": lambda m: 2.0 * m.radius,
            "cylinder": lambda m: min(2.0 * m.radius, m.height),
        }  # fmt: skip
        thickness = float(sizes[model.type](model)) if model.type in sizes else np.inf
        if thickness < scene.spacing * (1.0 - 1e-6):
            doubts.append(
                f"contacts[{number}] ({model.type}) is {thickness:.3g} m thick, less than a spacing: a point that is "
                "pressed to its middle comes out on the other side; make it thicker"
            )
    return doubts


def _stepped_outlines(sim, scene) -> list[str]:
    """A remark on each round body, alone on its lattice, whose steps give it another volume than its shape has."""
    p, n = sim.particles, sim.particles.owned
    doubts = []
    for k, lattice in enumerate(build_lattices(scene)):
        shape = lattice.body.shape
        if not isinstance(shape, Disc | Cylinder) or len(lattice.company) > 1 or scene.axisymmetric:
            continue
        volume = sim.comm.allreduce(float(p.volume[:n][p.body[:n] == k].sum()))
        exact = np.pi * shape.radius**2 * (shape.height if isinstance(shape, Cylinder) else 1.0)
        if volume > 0.0 and abs(volume / exact - 1.0) > _STEPPED:
            doubts.append(
                f"the points of body '{lattice.body.name}' have {volume / exact:.3g} times the volume of its shape, "
                "whose outline the lattice cuts in steps; 'lattice: rings' follows it"
            )
    return doubts


def _seams(scene) -> list[str]:
    """A remark on each periodic axis along which rows of points do not go on at their distance."""
    doubts = []
    for axis in range(scene.dimension):
        lower, upper = scene.periodic.along(axis) if scene.periodic else (None, None)
        if lower is not None and upper is not None:
            rows = (upper - lower) / scene.spacing
            if abs(rows - round(rows)) > 1e-6:
                doubts.append(
                    f"periodic: {rows:.6g} spacings along {'xyz'[axis]}, so points across the seam stand closer or "
                    "farther than others; make it a whole number"
                )
    return doubts


def _stiff_contacts(sim, scene) -> list[str]:
    """A remark on each contact, of any stage, that makes the time step shorter than the bodies need."""
    contacts, sim.contacts = sim.contacts, []
    frequency = highest_frequency(sim)
    sim.contacts = contacts
    lightest = minimum(sim.comm, float(sim.particles.mass.min(initial=np.inf)))
    doubts = []
    for number, model in enumerate(scene.contacts):
        if frequency == 0.0 or model.stiffness is None or model.type == "short_range_published":
            continue
        stiffness = model.stiffness * scene.spacing ** (scene.dimension - 1) * (2.0 if model.type == "bodies" else 1.0)
        share = frequency / np.sqrt(frequency**2 + stiffness / lightest)
        if share < _SHORTER:
            doubts.append(
                f"the stiffness of contacts[{number}] ({model.type}), {model.stiffness:.3g} N/m^3, makes the time step "
                f"{1.0 / share:.2g} times as short as the bodies need while it acts; leave it out, or make it less"
            )
    return doubts


def _doubts_of_laws(sim, scene) -> list[str]:
    """What the laws find wrong with their parameters and rows; of several ranks the lowest that has a doubt speaks."""
    doubts = []
    for name, block in zip(scene.materials, sim.bonds.blocks, strict=True):
        found = {}
        if hasattr(block.material, "doubts"):
            law = block.law_of(np.flatnonzero(block.active))
            stress = block.stress[block.active]
            if scene.axisymmetric:  # its friction is not that of plane strain
                stress = np.pad(stress, ((0, 0), (0, 2)))
            found = law.doubts(stress, block.state[block.active])
        merged: dict[str, str] = {}
        for mine in reversed(sim.comm.allgather(found)):
            merged |= mine
        doubts += [f"material '{name}': {text}" for text in merged.values()]
    return doubts
