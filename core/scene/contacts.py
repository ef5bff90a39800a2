"""From the contacts of a scene to the objects that make their forces."""

from itertools import combinations

import numpy as np

from periporo.contact.bodies import BodiesContact
from periporo.contact.repulsion import Repulsion
from periporo.contact.rigid import RigidContact
from periporo.contact.search import Search
from periporo.contact.short_range_published import ShortRangePublished
from periporo.core.correspondence.influence import influences
from periporo.core.points.material import moduli_without_stress
from periporo.core.scene.obstacles import build_obstacle
from periporo.errors import InputError, Problem, place_text

_TOUCH = 0.01  # spacings by which cells and obstacles may overlap when motion begins
_MEET = 0.05  # spacings by which bodies may overlap when their contact appears; what they do presses from there on
_UNKNOWN = 0.5  # the same where the surface is that of a file's points
_PUSHED_OUT = 0.6  # the same when relaxation begins


def build_contact(scene, model, number: int, sim, search: Search):
    """The contact that entry `number` of the scene's contacts describes; obstacles share a `search`."""
    spacing = scene.spacing
    if model.type == "short_range_published":
        substrate = model.substrate
        return ShortRangePublished(
            substrate.lower, substrate.upper, substrate.spacing * spacing, spacing=spacing, stiffness=model.stiffness,
            friction=model.friction, cutoff=model.cutoff * spacing, name=str(number),
        )  # fmt: skip
    stiffness, modulus = model.stiffness, None
    if stiffness is None:
        modulus = max(_p_wave_modulus(m) for m in sim.materials)
        stiffness = modulus / spacing
    return build_obstacle(scene, model, number, sim, stiffness, modulus, search)


def build_bodies_contact(scene, models, faces, sim) -> BodiesContact:
    """The contact between bodies that the entries `models` describe; one for two bodies overrules one for all."""
    n, h = len(scene.bodies), scene.spacing
    names = [b.name for b in scene.bodies]
    stiffness, friction, damping = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    for model in sorted(models, key=lambda m: m.between is None):
        k = model.stiffness
        for first, second in model.pairs(names):
            both = [names.index(first), names.index(second)]
            place = both, both[::-1]
            stiffness[place] = (_in_series(scene, sim, both) if k is None else k) * h ** (scene.dimension - 1)
            friction[place], damping[place] = model.friction, model.damping
    return BodiesContact(faces, names, stiffness, friction, damping)


def _in_series(scene, sim, bodies):
    """Stiffness (N/m^3) of half cells of two bodies (numbers), one behind the other; of several layers the stiffest."""
    softness = 0.0
    for number in bodies:
        body = scene.bodies[number]
        names = {body.material, *(layer.material for layer in body.layers)}
        own = [m for name, m in zip(scene.materials, sim.materials, strict=True) if name in names]
        softness += 0.5 * scene.spacing / max(map(_p_wave_modulus, own))
    return 1.0 / softness


def is_present(model, stage) -> bool:
    """Whether the contact of an input model acts in a stage of the scene."""
    return model.stages is None or stage.name in model.stages


def refuse_penetration(scene, contacts, sim) -> None:
    """Raise InputError, on all ranks alike, if a body reaches into an obstacle where that appears, whatever the stage.

    contacts: pairs of input model and contact. A cell that overlaps an obstacle would be shot out of it. Relaxation
    pushes out what overlaps by about half a cell; motion may begin with the overlap of the jitter only.
    """
    p, comm = sim.particles, sim.comm
    jitter = np.array([body.jitter for body in scene.bodies])
    problems = []
    for model, contact in contacts:
        stage = next((s for s in scene.stages if is_present(model, s)), None)
        if stage is None or (model.cleared and stage is not scene.stages[0]):
            continue
        allowed = np.full(len(jitter), _PUSHED_OUT) if stage.type == "relax" else jitter + _TOUCH
        gap, _ = contact.surface.gap(p.position[: p.owned])
        excess = 0.5 - gap / scene.spacing - allowed[p.body[: p.owned]]
        worst = int(np.argmax(excess)) if p.owned else -1
        mine = (excess[worst], gap[worst], p.body[worst], p.position[worst].tolist()) if p.owned else (-np.inf,)
        excess, *found = max(comm.allgather(mine))
        if excess > 0.0:
            message = _penetration(scene, model, stage, sim.origin, *found)
            problems.append(Problem(("contacts", scene.contacts.index(model)), message))
    if problems:
        raise InputError("scene", problems)


def fit_jittered(scene, contacts, p) -> None:
    """Have displaced points reach just to the first obstacles beside them: their body's shape is where its cells end.

    contacts: pairs of input model and contact.
    """
    slack = (np.array([body.jitter for body in scene.bodies]) * scene.spacing)[p.body[: p.owned]]
    if slack.any():
        for model, contact in contacts:
            if isinstance(contact, RigidContact) and is_present(model, scene.stages[0]):
                contact.fit(p, slack * (1.0 + 1e-9))


def refuse_overlaps(scene, between, sim) -> None:
    """Raise InputError, on all ranks alike, if bodies overlap at the start whose contact appears in any stage.

    between: the contacts between bodies by the numbers of their entries.
    """
    problems = {}
    for numbers, contact in between.items():
        for first, second, overlap, place in contact.deepest_overlaps(sim.particles):
            bodies = scene.bodies[first], scene.bodies[second]
            cloudy = any(b.shape.type in ("points", "raster", "mesh") for b in bodies)
            number = _entry_of(scene, numbers, bodies)
            entry = scene.contacts[number]
            if entry.cleared and not is_present(entry, scene.stages[0]):
                continue
            if overlap > (_UNKNOWN if cloudy else _MEET) * scene.spacing:
                at = place_text(place, sim.origin, 4)
                problems[number, first, second] = Problem(
                    ("contacts", number),
                    f"the bodies '{bodies[0].name}' and '{bodies[1].name}' overlap by {overlap:.3g} m at ({at}), and "
                    "would be shot apart; move one of them",
                )
    if problems:
        raise InputError("scene", list(problems.values()))


def _entry_of(scene, numbers, bodies):
    """Which of the entries of these numbers is between two bodies."""
    names = {b.name for b in bodies}
    own = [k for k in numbers if {scene.contacts[k].first, scene.contacts[k].second} == names]
    return (own or [k for k in numbers if scene.contacts[k].between is not None])[-1]


def _penetration(scene, model, stage, origin, gap, body, place) -> str:
    at = place_text(place, origin, 4)
    message = (
        f"the body '{scene.bodies[body].name}' reaches {0.5 * scene.spacing - gap:.3g} m into this {model.type}: the "
        f"point at ({at}) stands for a cell of {scene.spacing:g} m; move one of them apart"
    )
    if stage is not scene.stages[0]:
        return f"{message}, or say cleared: true if they have moved away when '{stage.name}' begins"
    if gap >= (0.5 - _PUSHED_OUT) * scene.spacing:
        return f"{message}, or begin with a relax stage, which pushes the points out"
    return f"{message}, or leave the contact out of '{stage.name}'"


def build_repulsion(sim) -> Repulsion:
    """The soft repulsion that keeps points from clumping in a flow: below .3 spacings, .01 of the P-wave modulus."""
    distance = 0.3 * sim.spacing
    modulus = max(_p_wave_modulus(m) for m in sim.materials)
    closest = influences(np.array([1.0 - distance / sim.scheme.horizon]), sim.scheme.table)[0]
    stiffness = 0.01 * modulus * sim.spacing ** (sim.particles.dimension - 2)
    return Repulsion(sim.bonds.pairs, distance=distance, stiffness=stiffness, closest=closest)


def _p_wave_modulus(material):
    """K + 4 mu / 3 of a material without stress, Pa."""
    bulk, shear = moduli_without_stress(material)
    return bulk + 4.0 / 3.0 * shear


def bonding_groups(scene) -> np.ndarray:
    """Group of each body (bodies,): points of different groups do not bond.

    A body that a bodies contact names bonds with no other; all others may bond. Raises InputError if two bodies
    would neither bond nor touch, since they would pass through each other.
    """
    names = [b.name for b in scene.bodies]
    touching = scene.touching_bodies()
    named = scene.bodies_in_contact()
    for pair in combinations(names, 2):
        if named.intersection(pair) and frozenset(pair) not in touching:
            first, second = pair
            message = (
                f"'{first}' and '{second}' would pass through each other: a body in a contact of type 'bodies' bonds "
                f"with no other body; add {{type: bodies, first: {first}, second: {second}, friction: ..}}, or say "
                "between: all"
            )
            raise InputError("scene", [Problem(("contacts",), message)])
    groups = np.zeros(len(names), np.int64)
    for k, name in enumerate(names):
        if name in named:
            groups[k] = k + 1
    return groups
