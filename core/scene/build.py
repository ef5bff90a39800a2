"""From validated input to a simulation: the only file that knows which features exist."""

from functools import partial
from typing import Any

import numpy as np
from mpi4py import MPI

from periporo.contact.faces import Faces
from periporo.contact.search import Search
from periporo.contact.touching import Touching
from periporo.core.correspondence.balance import balance, tilt_field
from periporo.core.correspondence.bond_projected import BondProjected
from periporo.core.correspondence.point_state import PointState
from periporo.core.correspondence.standard import Standard
from periporo.core.correspondence.sub_horizon import SubHorizon
from periporo.core.correspondence.sub_horizon_published import SubHorizonPublished
from periporo.core.loads.boundary import Traction
from periporo.core.loads.reactions import BoundaryReactions
from periporo.core.motion.added_inertia import AddedInertia
from periporo.core.motion.construction import Construction
from periporo.core.motion.dissipation import PlasticDissipation, reports
from periporo.core.motion.nonlocal_strain import NonlocalStrain, averaged
from periporo.core.motion.quasi_static import QuasiStaticStage
from periporo.core.motion.sleep import Sleep
from periporo.core.motion.stages import RelaxStage
from periporo.core.motion.timestep import StableTimeStep
from periporo.core.points import fields
from periporo.core.points.departures import Departures
from periporo.core.points.extent import Extent
from periporo.core.points.material import OPENED, moduli_without_stress
from periporo.core.points.particles import RING, Field, Particles
from periporo.core.scene.boundaries import middle_of, region_corners
from periporo.core.scene.construction import bodies_at_start, build_constructions
from periporo.core.scene.contacts import (
    build_bodies_contact,
    build_contact,
    build_repulsion,
    fit_jittered,
    is_present,
    refuse_overlaps,
    refuse_penetration,
)
from periporo.core.scene.fields import ParameterFields, agreed, create_laws
from periporo.core.scene.geostatic import GeostaticStress, uniform_stress
from periporo.core.scene.grounds import share_grounds
from periporo.core.scene.images import build_images
from periporo.core.scene.points import PointMaker
from periporo.core.scene.stages import build_stage, flying_bodies
from periporo.core.scene.water import build_water, refuse_hasty_flow, refuse_inner_inflows, wetted
from periporo.core.simulation import Simulation
from periporo.core.watch.reactions import Reactions
from periporo.core.watch.strength import StrengthReductionStage
from periporo.core.water.flow import FlowingWater
from periporo.errors import InputError, Problem
from periporo.io.geometry import lattice as geometry
from periporo.io.geometry.origin import relative, scene_origin
from periporo.io.schema.scene import SceneInput
from periporo.io.schema.stages import STILL

SKIN = 0.3  # spacings

SCHEMES = {s.name: s for s in (BondProjected, PointState, Standard, SubHorizon, SubHorizonPublished)}


def build(scene: SceneInput, comm: MPI.Comm) -> Simulation:
    """The simulation that a `SceneInput` describes, distributed over the ranks of `comm`.

    Its places are counted from `Simulation.origin`, see `io.geometry.origin`.
    """
    origin = scene_origin(scene)
    scene = relative(scene, origin)
    share_grounds(scene, comm)
    materials = create_laws(scene)
    water = None if scene.pore_water is None else build_water(scene, materials)
    sim = _empty(scene, comm, wetted(scene, materials, water))
    particles = sim.particles
    _attach_processes(scene, sim, water)
    contacts, between = _attach_contacts(scene, sim)
    _attach_stages(scene, sim)
    repulsion = build_repulsion(sim)
    repulsion.attach(particles, sim.forces)
    lattices = geometry.build_lattices(scene)
    sim.origin, sim.extent = origin, _extent(scene, lattices)
    sim.departures = _departures(scene)
    maker = _place_points(scene, sim, water, lattices)
    refuse_penetration(scene, contacts, sim)
    fit_jittered(scene, contacts, particles)
    if scene.initial_stress is not None:
        stress, images = _initial_stress(scene, sim.materials, water, lattices), sim.halo.images
        sim.bonds.initial_stress = stress if images is None else lambda places: stress(images.within(places))
        sim.bonds.initial_stress_is_total = water is not None and scene.initial_stress.type == "geostatic"
    free_water = [] if water is None or water.free is None else [water.free]
    sim.stages = [build_stage(scene, sim, stage, contacts, free_water, lattices) for stage in scene.stages]
    if isinstance(water, FlowingWater) and any(stage.type not in STILL for stage in scene.stages):
        sim.refusals_of_step.append(lambda sim: refuse_hasty_flow(scene, sim, water))
    build_constructions(scene, sim, lattices, maker)
    if any(stage.inflows for stage in sim.stages):
        if sim.stages[0].construction is None:
            sim.preparations.append(lambda sim: refuse_inner_inflows(scene, sim))
        for k, built in enumerate(sim.stages):
            if built.construction is not None:
                built.construction.doubt = partial(refuse_inner_inflows, scene, first=k)
    for model, built in zip(scene.stages, sim.stages, strict=True):
        built.contacts += [between[m] for m in [_bodies_models(scene, model)] if m]
        built.contacts.append(repulsion)
        for load in built.loads:
            if isinstance(load, Traction):
                load.attach(particles, sim.forces, sim.point_processes)
    _tell_reactions(scene, sim, [c for _, c in contacts], lattices)
    if sim.stages:
        sim.contacts, sim.loads = sim.stages[0].contacts, sim.stages[0].loads
    return sim


def _empty(scene, comm, materials) -> Simulation:
    """A simulation with scheme and time step, but without points."""
    chosen = scene.correspondence
    options = chosen.options()
    if "sharpened" in options:
        options["sharpened"] *= scene.spacing  # of the grid
    if "regular" in options:  # only what may come apart flows
        options["regular"] &= any(OPENED in material.state_fields for material in materials)
    scheme: Any = SCHEMES[chosen.scheme](scene.horizon * scene.spacing, scene.influence, **options)
    time_step = StableTimeStep(scene.time_step.safety, scene.time_step.fixed, scene.time_step.update)
    particles, skin = Particles(scene.dimension), SKIN * scene.spacing
    sim = Simulation(comm, particles, materials, scheme, spacing=scene.spacing, skin=skin, time_step=time_step)
    sim.halo.images = build_images(scene, particles)
    if scene.axisymmetric:
        scheme.axisymmetric = True
        particles.add_field(Field(RING, None, "m"))
    return sim


def _attach_processes(scene, sim, water):
    """What is kept up for the points of the scene: balance, sleep, strains, dissipation, lengths, water."""
    if scene.correspondence.balance:
        sim.particles.add_field(tilt_field(scene.dimension))
        sim.preparations.append(balance)
    sim.forces.need("external")
    if scene.sleep is not None:
        sim.sleep = Sleep(scene.sleep.speed, scene.sleep.steps)
        sim.sleep.attach(sim.particles)
    if scene.time_step.added_inertia:
        sim.added_inertia = AddedInertia(scene.time_step.added_inertia)
        sim.added_inertia.attach(sim.particles, sim.forces)
    processes = [fields.StrainMeasures()]
    if any(reports(m) for m in sim.materials):
        processes.append(PlasticDissipation())
    for process in processes:
        process.attach(sim.particles)
    sim.point_processes += processes
    if any(averaged(m) for m in sim.materials):
        shared = NonlocalStrain()
        shared.attach(sim)
        sim.point_processes.append(shared)
    if water is not None:
        water.attach(sim)
        sim.point_processes.append(water)


def _attach_contacts(scene, sim):
    """Contacts with obstacles (entry, contact), and those between bodies by the entries that are present together."""
    search = Search()
    rigid = [(k, c) for k, c in enumerate(scene.contacts) if c.type != "bodies"]
    contacts = [(c, build_contact(scene, c, k, sim, search)) for k, c in rigid]
    faces = Faces(sim, np.array([moduli_without_stress(m) for m in sim.materials]))
    between = _between_bodies(scene, faces, sim)
    for contact in (*(c for _, c in contacts), *between.values()):
        contact.attach(sim.particles, sim.forces)
    if between:
        sim.point_processes.append(faces)
        sim.reaches.append(faces.find_reach)
        sim.preparations += [faces.share_out, lambda sim: refuse_overlaps(scene, between, sim)]
    return contacts, between


def _attach_stages(scene, sim):
    """Fields and forces that the stages of the scene need."""
    if any(stage.type not in STILL and stage.damping.viscous > 0.0 for stage in scene.stages):
        sim.forces.need("damping")
    if any(stage.change for stage in scene.stages):
        Construction.attach(sim.particles)
    types = {stage.type for stage in scene.stages}
    for kind, stage in (
        ("relax", RelaxStage), ("quasi_static", QuasiStaticStage), ("strength_reduction", StrengthReductionStage),
    ):  # fmt: skip
        if kind in types:
            stage.attach(sim.particles)


def _departures(scene) -> Departures | None:
    """How points leave the scene, if they may."""
    if scene.domain is None and scene.failed_points != "remove":
        return None
    lower, upper = np.full(scene.dimension, -np.inf), np.full(scene.dimension, np.inf)
    if scene.domain is not None:
        lower, upper = region_corners(scene.domain, scene.dimension)
    return Departures(lower, upper, failed=scene.failed_points == "remove")


def _place_points(scene, sim, water, lattices) -> PointMaker:
    """Place the points that are there at the start; what places those that come later."""
    comm, materials = sim.comm, sim.materials
    parameters = _parameter_fields(scene, materials, lattices, sim)
    flying = [body for body, _ in flying_bodies(scene)]
    maker = PointMaker(scene, sim.particles, materials, water, lattices, flying, parameters)
    first = bodies_at_start(scene)
    sim.particles.replace(agreed(comm, lambda: maker.part_of(comm, first)), 0)
    if parameters is not None:  # what is placed later must be right now
        agreed(comm, lambda: maker.part_of(comm, sorted(set(range(len(lattices))) - set(first))))
    return maker


def _tell_reactions(scene, sim, contacts, lattices):
    """Have what obstacles and boundaries bear added up and told."""
    told = [c for c in contacts if getattr(c, "reaction", None) is not None]
    if told:
        sim.observers.append(Reactions(told, Touching() if any(c.feelers for c in told) else None))
    sim.reactions = [c.reaction for c in told]
    held = {name: boundary.where for name, boundary in scene.boundaries.items() if boundary.holds}
    if held:
        sim.reactions.append(BoundaryReactions({n: middle_of(scene, where, lattices) for n, where in held.items()}))


def _parameter_fields(scene, materials, lattices, sim) -> ParameterFields | None:
    """The parameters that vary, if any do, as a point process."""
    if not any(model.fields for model in scene.materials.values()):
        return None
    parameters = ParameterFields(scene, materials, lattices, sim.origin)
    parameters.attach(sim)
    sim.point_processes.append(parameters)
    return parameters


def _bodies_models(scene, stage):
    """Numbers of the contacts between bodies that are present in a stage."""
    return tuple(k for k, c in enumerate(scene.contacts) if c.type == "bodies" and is_present(c, stage))


def _between_bodies(scene, faces, sim):
    """A contact for each set of entries that are present together."""
    sets = dict.fromkeys(filter(None, (_bodies_models(scene, stage) for stage in scene.stages)))
    return {s: build_bodies_contact(scene, [scene.contacts[k] for k in s], faces, sim) for s in sets}


def _extent(scene, lattices):
    gravity = scene.vector(scene.gravity)
    strength = float(np.sqrt((gravity**2).sum()))
    up = -gravity / strength if strength else np.eye(scene.dimension)[-1]
    lower, upper = np.min([b.lower for b in lattices], axis=0), np.max([b.upper for b in lattices], axis=0)
    return Extent(lower, upper, up + 0.0)  # no minus zero


def _initial_stress(scene, materials, water, lattices):
    """Stress of rows at the start as a function of their places (n, d): effective if uniform, total if geostatic."""
    initial = scene.initial_stress
    if initial.type == "uniform":
        return uniform_stress(initial.components, scene.dimension)
    density = np.array([m.density for m in materials])
    return GeostaticStress(lattices, density, scene.vector(scene.gravity), initial.K0, initial.surface, water)


def output_names(scene, sim) -> tuple[str, ...]:
    """Names of the fields that the scene writes. Raises InputError if it does not have one."""
    known = fields.available(sim)
    names = scene.output.fields or fields.default(sim)
    for name in names:
        if name not in known:
            allowed = ", ".join(sorted(known))
            raise InputError("scene", [Problem(("output", "fields"), f"no field '{name}'; this scene has: {allowed}")])
    return tuple(names)
