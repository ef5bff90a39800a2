"""Parameters of laws that vary from place to place: from the scene's fields to the laws of rows."""

import numpy as np
from pydantic import BaseModel, ValidationError

from periporo.core.motion.nonlocal_strain import FEWEST, averaged
from periporo.core.points.material import Material
from periporo.core.points.particles import Field
from periporo.core.points.varied import VariedLaw
from periporo.core.ranks.patience import wait_for_all
from periporo.core.ranks.reductions import any_rank
from periporo.core.scene.geostatic import GeostaticStress
from periporo.errors import InputError, Problem, place_text
from periporo.io.geometry.fields import FieldError, field_values, typical_value
from periporo.io.schema.errors import problems_of
from periporo.io.schema.fields import DepthField, LevelField, ParameterField, RandomField
from periporo.io.schema.scene import POINT_SCHEMES

_PLACE_DIGITS = 4


def create_laws(scene) -> list[Material]:
    """The laws of a scene's materials in their order; those with fields are `VariedLaw`s that know no rows yet.

    Raises InputError where a law wants its strain averaged over a length, and the scene cannot do that.
    """
    laws = [_create(model) for model in scene.materials.values()]
    for key, law in zip(scene.materials, laws, strict=True):
        wanted = averaged(law)
        if wanted is not None:
            _refuse_length(scene, key, law, wanted[1])
    return laws


def _refuse_length(scene, key, law, length: float) -> None:
    """Raise InputError unless there is a row for each point, and points lie close enough."""
    reason = ""
    if scene.correspondence.scheme not in POINT_SCHEMES:
        reason = f"averaging needs a row for each point: choose correspondence {' or '.join(POINT_SCHEMES)}, not "
        reason += scene.correspondence.scheme
    elif "length" in getattr(law, "varied", ()):
        reason = "may not vary within a material; make several materials"
    elif length < FEWEST * scene.spacing * (1.0 - 1e-9):
        reason = f"must be at least {FEWEST:g} spacings ({FEWEST * scene.spacing:g} m), not {length:g}, or bands would "
        reason += "not see it: make the spacing finer, or give reference_spacing instead"
    if reason:
        raise InputError("scene", [Problem(("materials", key, "length"), reason)])


def _create(model) -> Material:
    if not model.fields:
        return model.create()
    names = tuple(model.fields)
    base = model.create(**{name: typical_value(field) for name, field in model.fields.items()})

    def make(values):
        law = model.create(**dict(zip(names, values, strict=True)))
        if law.state_fields != base.state_fields:
            raise ValueError("decides what the law remembers, so it must not be zero in one place and not in another")
        return law

    return VariedLaw(base, names, make)


class ParameterFields:
    """Point fields `parameter_NAME` with what varies; points of materials where it does not have that one's number.

    A point process without an update: a point keeps what it began with.
    """

    def __init__(self, scene, laws: list[Material], lattices, origin):
        self._scene, self._laws, self._origin = scene, laws, origin
        self.names = list(dict.fromkeys(n for law in laws for n in getattr(law, "varied", ())))
        self.output = tuple(map(field_name, self.names))
        gravity = scene.vector(scene.gravity)
        if not gravity.any():
            _refuse_heights(scene)
            return
        strength = float(np.sqrt((gravity**2).sum()))
        self._up = -gravity / strength
        self._above = GeostaticStress(lattices, np.zeros(len(laws)), gravity, 0.0)

    def attach(self, sim) -> None:
        """Declare the point fields."""
        for name in self.names:
            sim.particles.add_field(Field(field_name(name), None, self._unit(name)))

    def _unit(self, name: str) -> str:
        for law in self._laws:
            info = getattr(type(getattr(law, "base", law)), "model_fields", {}).get(name)
            if info is not None and isinstance(info.json_schema_extra, dict):
                return str(info.json_schema_extra.get("unit", ""))
        return ""

    def update(self, p, bonds, dt: float) -> None:
        """Nothing changes."""

    def initial_fields(self, owned: dict[str, np.ndarray]) -> None:
        """Set the fields of new points, given `id`, `position` and `material`, and their mass by the law of each.

        Raises InputError with place and value where a law refuses one, for the first of the points.
        """
        for name in self.names:
            owned[field_name(name)] = np.zeros(len(owned["id"]))
        for number, (key, law) in enumerate(zip(self._scene.materials, self._laws, strict=True)):
            mine = np.flatnonzero(owned["material"] == number)
            varied = getattr(law, "varied", ())
            for name in set(self.names) - set(varied):
                value = getattr(law, name, None)
                owned[field_name(name)][mine] = value if isinstance(value, float | int) else 0.0
            for name in varied:
                owned[field_name(name)][mine] = self._values(key, name, owned["position"][mine])
            if varied:
                owned["mass"][mine] = owned["volume"][mine] * self._densities(key, law, owned, mine)

    def _values(self, key, name, position):
        model: ParameterField = self._scene.materials[key].fields[name]
        try:
            return field_values(model, position, self._depth, self._level)
        except FieldError as error:
            raise InputError("scene", [Problem(("materials", key, name), str(error))]) from None

    def _level(self, position):
        return (position * self._up).sum(axis=1)

    def _depth(self, position):
        return self._above.cover(position)

    def _densities(self, key, law, owned, mine):
        """Density (m,) kg/m^3 of the points `mine`, each of which has a law of its own."""
        values = np.stack([owned[field_name(name)][mine] for name in law.varied], axis=1)
        found = np.empty(len(mine))
        for k, row in enumerate(values):
            try:
                found[k] = law.law(row).density
            except (ValidationError, TypeError, ValueError) as error:
                place = place_text(owned["position"][mine[k]], self._origin, _PLACE_DIGITS)
                raise _Refused(int(owned["id"][mine[k]]), self._problem(key, law, row, place, error)) from None
            if getattr(law.law(row), "porosity", None) != getattr(law.base, "porosity", None):
                self._refuse_variation(key, law, "porosity", self._scene.pore_water, "pore_water")
        if (found != law.base.density).any():
            initial = self._scene.initial_stress
            geostatic = initial if initial is not None and initial.type == "geostatic" else None
            self._refuse_variation(key, law, "density", geostatic, "geostatic stress")
        return found

    def _refuse_variation(self, key, law, what: str, user, name: str) -> None:
        """Raise InputError for what must be the same in all of a material if there is a `user` of it."""
        if user is not None:
            message = f"the {what} may not vary within a material that {name} knows; make several materials"
            raise InputError("scene", [Problem(("materials", key, law.varied[0]), message)])

    def _problem(self, key, law, row, place, error) -> Problem:
        given = dict(zip(law.varied, row.tolist(), strict=True))
        path: tuple = ("materials", key)
        message = str(error)
        if isinstance(error, ValidationError):
            model = type(law.base)
            schema = model.model_json_schema() if issubclass(model, BaseModel) else {}
            found = problems_of(error, schema, given | self._scene.materials[key].parameters)[0]
            path, message = (*path, *found.path[:1]), found.message
        else:
            path = (*path, law.varied[0])
        values = ", ".join(f"{name} = {value:.6g}" for name, value in given.items())
        return Problem(path, f"at ({place}) m, {values}: {message}")

    def ranges(self, sim) -> list[tuple[str, str, float, float, int]]:
        """(material, parameter, least, largest, points) of what varies; collective."""
        p, n, found = sim.particles, sim.particles.owned, []
        for number, (key, law) in enumerate(zip(self._scene.materials, self._laws, strict=True)):
            mine = p.material[:n] == number
            for name in getattr(law, "varied", ()):
                values = getattr(p, field_name(name))[:n][mine]
                parts = sim.comm.allgather((values.min(initial=np.inf), values.max(initial=-np.inf), len(values)))
                least, largest, counts = zip(*parts, strict=True)
                found.append((key, name, float(min(least)), float(max(largest)), sum(counts)))
        return found


class _Refused(Exception):
    """A law refuses the values at the point of an id."""

    def __init__(self, number: int, problem: Problem):
        super().__init__(number, problem)
        self.number, self.problem = number, problem


def agreed(comm, make):
    """What `make()` gives on this rank; a refusal on any rank is an InputError on all, of the point with the lowest id.

    Collective.
    """
    result, refusal, error = None, None, None
    try:
        result = make()
    except _Refused as found:
        refusal = (found.number, found.problem)
    except InputError as found:
        error = found
    wait_for_all(comm)
    if not any_rank(comm, refusal is not None or error is not None):
        return result
    refusals = comm.allgather((refusal, error))
    errors = [e for _, e in refusals if e is not None]
    if errors:
        raise errors[0]
    _, problem = min((r for r, _ in refusals if r is not None), key=lambda r: r[0])
    raise InputError("scene", [problem])


def field_name(parameter: str) -> str:
    """The point field that holds a parameter that varies."""
    return f"parameter_{parameter}"


def _refuse_heights(scene) -> None:
    """Raise InputError for fields along gravity in a scene without any."""
    problems = []
    for key, model in scene.materials.items():
        for name, field in model.fields.items():
            kinds = [field, field.mean] if isinstance(field, RandomField) else [field]
            if any(isinstance(kind, DepthField | LevelField) for kind in kinds):
                message = "depth and level need gravity, which says where 'up' is; give 'gravity'"
                problems.append(Problem(("materials", key, name, "field"), message))
    if problems:
        raise InputError("scene", problems)
