"""From validated input to a simulation: the only file that knows which features exist."""

import math

import numpy as np

from periporo.contact.rigid import Box, Plane, RigidContact
from periporo.core.boundary import Gravity, PrescribedMotion, ViscousDamping
from periporo.core.correspondence.bond_projected import BondProjected
from periporo.core.correspondence.standard import Standard
from periporo.core.correspondence.sub_horizon import SubHorizon
from periporo.core.correspondence.sub_horizon_published import SubHorizonPublished
from periporo.core.fields import StrainMeasures
from periporo.core.particles import Particles
from periporo.core.simulation import Simulation
from periporo.core.stages import DynamicsStage, RelaxStage
from periporo.core.timestep import StableTimeStep
from periporo.io import geometry

SKIN = 0.3  # spacings

SCHEMES = {s.name: s for s in (BondProjected, Standard, SubHorizon, SubHorizonPublished)}


def build(scene, comm) -> Simulation:
    """The simulation that a `SceneInput` describes, distributed over the ranks of `comm`."""
    particles = Particles(scene.dimension)
    materials = [m.create() for m in scene.materials.values()]
    chosen = scene.correspondence
    scheme = SCHEMES[chosen.scheme](scene.horizon * scene.spacing, scene.influence, **chosen.options())
    time_step = StableTimeStep(scene.time_step.safety, scene.time_step.fixed, scene.time_step.update)
    sim = Simulation(
        comm, particles, materials, scheme, spacing=scene.spacing, skin=SKIN * scene.spacing, time_step=time_step
    )
    sim.forces.need("external")
    strains = StrainMeasures()
    strains.attach(particles)
    sim.point_processes.append(strains)
    contacts = [(c, _contact(scene, c, k, materials)) for k, c in enumerate(scene.contacts)]
    for _, contact in contacts:
        contact.attach(particles, sim.forces)
    for stage in scene.stages:
        if stage.type == "dynamics" and stage.damping.viscous > 0.0:
            sim.forces.need("damping")
    lattices = geometry.build_lattices(scene)
    _place_points(scene, comm, particles, materials, lattices)
    if scene.initial_stress is not None:
        sim.bonds.initial_stress = _initial_stress(scene, materials, lattices)
    sim.stages = [_stage(scene, sim, stage, contacts, lattices) for stage in scene.stages]
    if sim.stages:
        sim.contacts, sim.loads = sim.stages[0].contacts, sim.stages[0].loads
    return sim


def _place_points(scene, comm, particles, materials, lattices):
    """Each rank makes its part of every body's lattice; the first rebuild hands points to their owners."""
    parts = {name: [] for name in ("id", "position", "volume", "material", "body", "velocity")}
    for number, (body, lattice) in enumerate(zip(scene.bodies, lattices, strict=True)):
        begin, end = (lattice.size * r // comm.size for r in (comm.rank, comm.rank + 1))
        for start in range(begin, end, geometry.CHUNK):
            ids, position, volume, material = lattice.sites(start, min(start + geometry.CHUNK, end))
            parts["id"].append(ids)
            parts["position"].append(position)
            parts["volume"].append(volume)
            parts["material"].append(material)
            parts["body"].append(np.full(len(ids), number))
            parts["velocity"].append(np.tile(scene.vector(body.velocity), (len(ids), 1)))
    owned = {name: np.concatenate(arrays) if arrays else None for name, arrays in parts.items()}
    if owned["id"] is None:
        owned = _no_points(particles)
    owned["mass"] = owned["volume"] * np.array([m.density for m in materials])[owned["material"]]
    for field in particles.migrating():
        shape = (len(owned["id"]),) if field.columns is None else (len(owned["id"]), field.columns)
        owned.setdefault(field.name, np.zeros(shape, field.dtype))
    owned["jacobian"] = np.ones(len(owned["id"]))
    owned["initial_position"] = owned["position"].copy()
    owned["reference_position"] = owned["position"].copy()
    particles.replace(owned, 0)


def _no_points(particles):
    names = ("id", "position", "volume", "material", "body", "velocity")
    fields = [particles.fields[n] for n in names]
    return {f.name: np.zeros(0 if f.columns is None else (0, f.columns), f.dtype) for f in fields}


def _initial_stress(scene, materials, lattices):
    """Stress of bonds at the start as a function of their midpoints (n, d)."""
    initial = scene.initial_stress
    components = 4 if scene.dimension == 2 else 6
    if initial.type == "uniform":
        c = initial.components
        row = np.array([c.xx, c.yy, c.zz, c.xy, c.yz, c.xz])[:components]
        return lambda position: np.tile(row, (len(position), 1))
    gravity = scene.vector(scene.gravity)
    strength = math.sqrt(float(gravity @ gravity))
    up = -gravity / strength
    vertical = vertical_axis(scene)
    level = initial.surface
    if level is None:
        level = max(float(max(lattice.lower @ up, lattice.upper @ up)) for lattice in lattices)
    density = materials[0].density

    def geostatic(position):
        depth = np.maximum(level - (position * up).sum(axis=1), 0.0)
        stress = np.zeros((len(position), components))
        stress[:, :3] = (-initial.K0 * density * strength * depth)[:, None]
        stress[:, vertical] = -density * strength * depth
        return stress

    return geostatic


def vertical_axis(scene) -> int:
    """Axis along gravity, the last one without gravity."""
    gravity = scene.vector(scene.gravity)
    return int(np.argmax(np.abs(gravity))) if gravity.any() else scene.dimension - 1


def _contact(scene, contact, number, materials):
    match contact.type:
        case "plane":
            surface = Plane(contact.point, contact.normal)
        case "box":
            surface = Box(contact.lower, contact.upper)
    spacing, d = scene.spacing, scene.dimension
    stiffness = contact.stiffness
    if stiffness is None:
        stiffness = max(_p_wave_modulus(m) for m in materials) / spacing
    return RigidContact(
        str(number), surface, spacing=spacing, stiffness=stiffness * spacing ** (d - 1), friction=contact.friction,
        damping=contact.damping, velocity=None if contact.velocity is None else scene.vector(contact.velocity),
    )  # fmt: skip


def _p_wave_modulus(material):
    """K + 4 mu / 3 of a material without stress, Pa."""
    stress = np.zeros((1, 6))
    state = material.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))
    bulk, shear = material.elastic_moduli(stress, state)
    return float(bulk[0] + 4.0 / 3.0 * shear[0])


def _stage(scene, sim, stage, contacts, lattices):
    motions, loads = [], []
    if scene.gravity is not None:
        loads.append(Gravity(scene.vector(scene.gravity)))
    for name in stage.boundaries:
        motions.append(_motion(scene, scene.boundaries[name], lattices))
    present = [c for model, c in contacts if model.stages is None or stage.name in model.stages]
    if stage.type == "relax":
        return RelaxStage(stage.name, motions, present, loads, stage.tolerance, stage.max_steps)
    if stage.damping.viscous > 0.0:
        loads.append(ViscousDamping(stage.damping.viscous))
    return DynamicsStage(stage.name, motions, present, loads, stage.duration, stage.stop_when_at_rest)


def _motion(scene, boundary, lattices):
    region = boundary.where
    d = scene.dimension
    lower = np.array([-np.inf if v is None else v for v in region.lower or (None,) * d])
    upper = np.array([np.inf if v is None else v for v in region.upper or (None,) * d])
    ids = []
    for body, lattice in zip(scene.bodies, lattices, strict=True):
        if region.body in (None, body.name):
            corners = np.maximum(lower, lattice.lower - 1), np.minimum(upper, lattice.upper + 1)
            ids.append(lattice.sites_within(*corners)[0])
    ids = np.sort(np.concatenate(ids))
    if boundary.fix:
        return PrescribedMotion(ids, {"xyz".index(a): (lambda t: 0.0) for a in boundary.fix})
    velocities = {}
    for axis, name in enumerate("xyz"[:d]):
        history = getattr(boundary.velocity, name)
        if history is not None:
            velocities[axis] = lambda t, h=history: float(np.interp(t, h.times, h.values))
    return PrescribedMotion(ids, velocities)
