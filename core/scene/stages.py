"""From the stages of a scene to those of a simulation, with the boundary conditions and contacts of each."""

import numpy as np

from periporo.core.loads.absorbing import Absorbing
from periporo.core.loads.boundary import Gravity, MeanVelocity, PrescribedMotion, ViscousDamping, without_overlaps
from periporo.core.loads.tied import Tied
from periporo.core.motion.quasi_static import QuasiStaticStage
from periporo.core.motion.stages import DynamicsStage, RelaxStage
from periporo.core.scene.boundaries import build_boundary, hold, over_time, selected_ids
from periporo.core.scene.contacts import is_present
from periporo.core.watch import state as states
from periporo.core.watch.strength import StrengthReductionStage
from periporo.core.water.boundaries import WaterBoundary
from periporo.core.water.flow import flowing_water
from periporo.io.schema.stages import STILL


def build_stage(scene, sim, stage, contacts, free_water, lattices):
    """The stage that the model `stage` describes, of those `contacts` (model, contact) that are present in it."""
    motions, ties, loads, inflows = [], [], [*free_water], []
    if scene.gravity is not None:
        loads.append(Gravity(scene.vector(scene.gravity), over_time(stage.gravity_factor)))
    obstacles = {model.name: contact for model, contact in contacts if getattr(model, "name", None) is not None}
    for name in stage.boundaries:
        boundary = build_boundary(scene, name, lattices, stage.type not in STILL, sim.comm, obstacles)
        if isinstance(boundary, Tied):
            ties.append(boundary)
            continue
        if isinstance(boundary, Absorbing):
            boundary.attach(sim.particles, sim.forces)
        kind = motions if isinstance(boundary, PrescribedMotion) else loads
        (inflows if isinstance(boundary, WaterBoundary) else kind).append(boundary)
    flying = flying_bodies(scene) if stage in scene.stages[: _first_motion(scene) + 1] else []
    if stage.type in STILL:
        motions += [hold(lattices[body]) for body, _ in flying]  # until their first motion
    motions = without_overlaps(motions)
    motions += [tie.beside(motions) for tie in ties]
    present = [c for model, c in contacts if is_present(model, stage)]
    if stage.type == "relax":
        sides = np.array([(lattice.upper - lattice.lower).min() for lattice in lattices])
        return RelaxStage(
            stage.name, motions, present, loads, inflows, stage.tolerance, stage.max_steps,
            np.maximum(stage.max_displacement * sides, scene.spacing), tuple(b.name for b in scene.bodies),
            stage.reset_displacement,
        )  # fmt: skip
    if stage.type == "quasi_static":
        increments = flowing_water(sim).increments
        return QuasiStaticStage(
            stage.name, motions, present, loads, inflows, stage.duration, stage.accuracy, stage.tolerance,
            stage.max_steps, increments, states,
        )  # fmt: skip
    if stage.damping.viscous > 0.0:
        base = None
        if stage.damping.relative_to is not None:
            where = scene.boundaries[stage.damping.relative_to].where
            base = MeanVelocity(sim.comm, selected_ids(scene, where, lattices))
        loads.append(ViscousDamping(stage.damping.viscous, lambda: sim.dt, base))
    if stage.type == "strength_reduction":
        speed = stage.moving * float(np.linalg.norm(scene.vector(scene.gravity))) / stage.damping.viscous
        trials = {"trial": stage.trial, "speed": speed, "accuracy": stage.accuracy, "largest": stage.largest}
        return StrengthReductionStage(stage.name, motions, present, loads, inflows, **trials)
    dynamics = DynamicsStage(stage.name, motions, present, loads, inflows, stage.duration, stage.stop_when_at_rest)
    dynamics.launches = flying
    return dynamics


def _first_motion(scene) -> int:
    """Number of the first stage in which bodies move, or of stages if there is none."""
    return next((k for k, stage in enumerate(scene.stages) if stage.type == "dynamics"), len(scene.stages))


def flying_bodies(scene) -> list[tuple[int, np.ndarray]]:
    """Bodies (number, velocity (d,) m/s) that are held until their first motion, since relaxation comes before it."""
    if _first_motion(scene) == 0:
        return []
    return [(k, scene.vector(body.velocity)) for k, body in enumerate(scene.bodies) if any(body.velocity or ())]
