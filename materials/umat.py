"""Laws of others: a subroutine UMAT with Abaqus' interface in a shared library, written in Fortran, C or C++."""

import contextlib
import ctypes
import functools
import os
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field, model_validator

from periporo.core.numerics.tensors import dimension_of, filled
from periporo.core.points.material import (
    DEFORMATION_GRADIENT,
    OPENED,
    PLACE,
    TIME,
    StateField,
    StepRefused,
    state_column,
    state_columns,
)
from periporo.materials.base import MaterialParameters, units
from periporo.materials.umat_call import (
    NOT_GIVEN,
    Arguments,
    advance,
    fill_moduli,
    initial_variables,
    order_of_variables,
)

_PRESSURE, _DENSITY = units("Pa", "kg/m^3")
_STRAIN = StateField("strain", "1", kind="tensor")
_LENGTH, _DISSIPATION = StateField("length", "m"), StateField("dissipation", "J/m^3")
_BEFORE = StateField("deformation_gradient_before", "1", kind="matrix")
_WORDS = {
    "strain": (("STRAN",), (_STRAIN,)), "time": (("TIME",), (TIME,)), "length": (("CELENT",), (_LENGTH,)),
    "place": (("COORDS",), (PLACE,)),
    "deformation_gradient": (("DFGRD0", "DFGRD1"), (DEFORMATION_GRADIENT, _BEFORE)),
}  # fmt: skip
_COLUMNS = (_STRAIN, TIME, _LENGTH, _DISSIPATION, PLACE, DEFORMATION_GRADIENT, _BEFORE)
UTILITIES = Path(__file__).with_name("umat_utilities.c")
"""Source of the routines that Abaqus offers to laws, to be compiled with those that call them."""

_PROBE = 1e-6  # strain of the call that finds out what a law reads

_Numbers = Annotated[tuple[float, ...], Field(strict=False, max_length=10_000)]
_Place = Annotated[int, Field(ge=1, strict=True)]
_Words = Annotated[
    tuple[Literal["strain", "time", "length", "place", "deformation_gradient"], ...], Field(strict=False)
]


class Umat(MaterialParameters):
    """A law in a shared library with Abaqus' interface UMAT.

    Components and shear are passed as Abaqus does. Stress arrives turned to the end of the step, as do state variables
    that are tensors, so DROT is the identity. What the program does not know is NaN, and a law that reads it is
    refused.
    """

    density: float = Field(gt=0, description="dry bulk density", json_schema_extra=_DENSITY)
    library: str = Field(min_length=1, description="file of the shared library, from the folder of the run")
    symbol: str = Field("umat", min_length=1, description="name of the subroutine in the source")
    props: _Numbers = Field((), description="PROPS, the constants of the law")
    props_count: int | None = Field(
        None, ge=0, description="how many constants the law wants, if that is to be checked"
    )
    state_variables: int = Field(
        0, ge=0, le=10_000, description="numbers and tensors that the law remembers in STATEV; a tensor counts once"
    )
    tensors: tuple[_Place, ...] = Field(
        (), strict=False, description="which of them, from 1, are tensors as stress, which turn with the soil"
    )
    strain_tensors: tuple[_Place, ...] = Field(
        (), strict=False, description="the same, of tensors as strain, with engineering shear"
    )
    initial_state_variables: _Numbers | None = Field(
        None, description="their values at the start, if the library has no SDVINI; 0; a tensor is isotropic"
    )
    strength_props: tuple[_Place, ...] = Field(
        (), strict=False, description="numbers, from 1, of the props that a search for a factor of safety divides"
    )
    reads: _Words = Field(
        (),
        description="what the law reads besides: strain (STRAN), time (TIME), length (CELENT), place (COORDS), "
        "deformation_gradient (DFGRD0 and DFGRD1)",
    )
    largest_mean_stress: float | None = Field(
        None, ge=0, description="mean stress at which the soil comes apart; none for a law that bears tension",
        json_schema_extra=_PRESSURE,
    )  # fmt: skip
    bulk_modulus: float | None = Field(
        None, gt=0, description="bulk modulus of unloading, in place of DDSDDE", json_schema_extra=_PRESSURE
    )
    shear_modulus: float | None = Field(
        None, gt=0, description="shear modulus of unloading, in place of DDSDDE", json_schema_extra=_PRESSURE
    )
    report_dissipation: bool = Field(False, description="keep SPD and SCD of the last step in the state")

    exchanges_stress: ClassVar[bool] = False
    weakened_by: ClassVar[str] = "strength_props"

    @model_validator(mode="after")
    def _suits(self):
        if self.props_count is not None and len(self.props) != self.props_count:
            raise ValueError(f"the law wants {self.props_count} props, not {len(self.props)}")
        start = self.initial_state_variables
        if start is not None and len(start) != self.state_variables:
            raise ValueError(
                f"initial_state_variables must be {self.state_variables} numbers, as state_variables says, not "
                f"{len(start)}"
            )
        beyond = [k for k in self.strength_props if k > len(self.props)]
        if beyond:
            raise ValueError(f"strength_props name prop {beyond[0]}, but there are {len(self.props)} props")
        tensors = (*self.tensors, *self.strain_tensors)
        wrong = [k for k in tensors if k > self.state_variables or tensors.count(k) > 1]
        if wrong:
            raise ValueError(
                f"tensors and strain_tensors name state variable {wrong[0]}; each is to be one of the "
                f"{self.state_variables} state_variables, once"
            )
        if (self.bulk_modulus is None) != (self.shear_modulus is None):
            raise ValueError("give bulk_modulus and shear_modulus together, or neither")
        self._find_what_it_reads()
        return self

    def weakened(self, factor: float) -> "Umat":
        """The law with the props that `strength_props` names divided by `factor`.

        A cohesion and a tangent, or the numbers of a cone, keep the apex, so `largest_mean_stress` stays.
        """
        divided = (p / factor if k in self.strength_props else p for k, p in enumerate(self.props, 1))
        return self.model_copy(update={"props": tuple(divided)})

    @property
    def _address(self) -> int:
        return _find(os.path.abspath(self.library), self.symbol)

    def _find_what_it_reads(self) -> None:
        """Raise ValueError if a step depends on an argument that is not given."""
        unknown = (*NOT_GIVEN, *self._not_read)
        stress, strain = np.zeros((1, 6)), np.full((1, 6), _PROBE)
        state = self.initial_state(stress, np.zeros((1, 2), np.int64), np.ones(1))

        def answer(values):
            arguments = self._arguments(6)
            for name in unknown:
                arguments.set(name, values.get(name, 1.0))
            new, its, refused = stress.copy(), state.copy(), np.zeros(1, np.bool_)
            self._take(arguments, new, strain, its, 1.0, refused)
            return np.concatenate([new[0], its[0], [float(refused[0])]])

        usual = answer({})
        if not np.isfinite(usual).all():
            raise ValueError(
                f"{self.library}: from no stress a strain of {_PROBE:g} gives {usual[:6]} Pa; are props and "
                "state_variables those of the law?"
            )
        moduli = np.concatenate(self.elastic_moduli(stress, state))
        if not (np.isfinite(moduli) & (moduli > 0.0)).all():
            raise ValueError(
                f"{self.library}: DDSDDE at no stress gives bulk and shear modulus {moduli[0]:g} and {moduli[1]:g} Pa; "
                "are props those of the law? If it fills no DDSDDE, give bulk_modulus and shear_modulus"
            )
        for name in unknown:
            if not np.array_equal(answer({name: np.nan}), usual, equal_nan=True):
                words = [word for word, (arguments, _) in _WORDS.items() if name in arguments]
                cure = f"write reads: [{words[0]}]" if words else "the program does not know it, take another law"
                raise ValueError(f"{self.library}: {self.symbol} reads {name}; {cure}")

    @property
    def _kinds(self) -> tuple[str, ...]:
        """Whether each state variable is a "scalar", a "tensor" as stress, or a "strain"."""
        tensors = dict.fromkeys(self.tensors, "tensor") | dict.fromkeys(self.strain_tensors, "strain")
        return tuple(tensors.get(k, "scalar") for k in range(1, self.state_variables + 1))

    def _arguments(self, components: int) -> Arguments:
        arguments = Arguments(components, len(self._order(components)[0]), self.props)
        for name in self._not_read:
            arguments.set(name, np.nan)
        return arguments

    @property
    def _not_read(self) -> list[str]:
        """Arguments that the law could be given, but does not read."""
        return [name for word, (names, _) in _WORDS.items() if word not in self.reads for name in names]

    @property
    def state_fields(self) -> tuple[StateField, ...]:
        """The law's own variables, and what is kept for it."""
        fields = [
            StateField(f"state_{k}", "1", kind="scalar" if kind == "scalar" else "tensor")
            for k, kind in enumerate(self._kinds, 1)
        ]
        fields += [field for word, (_, kept) in _WORDS.items() if word in self.reads for field in kept]
        fields += [OPENED] if self.largest_mean_stress is not None else []
        return (*fields, *([_DISSIPATION] if self.report_dissipation else []))

    @property
    def tension_limit(self):
        """Function of stress and state that gives the largest mean stress (n,) Pa; none without one."""
        limit = self.largest_mean_stress
        return None if limit is None else lambda stress, state: filled(len(stress), limit)

    def _order(self, components: int) -> tuple[np.ndarray, np.ndarray]:
        return order_of_variables(self._kinds, components)

    def _columns(self, components: int) -> tuple[int, ...]:
        found = (state_column(self, field.name, components) for field in _COLUMNS)
        return tuple(-1 if column is None else column for column in found)

    def initial_state(self, stress, ids, volume):
        """What SDVINI says, or the values of the input, or zeros; the length is that of a row's cube or square."""
        components = stress.shape[1]
        state = np.zeros((len(stress), state_columns(self, components)))
        places, factors = self._order(components)
        if self.initial_state_variables is not None:
            isotropic = np.arange(components) < 3
            pairs = zip(self._kinds, self.initial_state_variables, strict=True)
            state[:, : len(places)] = np.hstack([v if kind == "scalar" else v * isotropic for kind, v in pairs])
        elif len(places) and (start := _find_optional(os.path.abspath(self.library), "sdvini")):
            for row in range(len(stress)):
                state[row, : len(places)] = initial_variables(start, len(places))[places] / factors
        length = self._columns(components)[2]
        if length >= 0:
            state[:, length] = volume ** (1.0 / dimension_of(stress))
        return state

    def compute_stress(self, stress, strain_increment, state, dt):
        """Advance `stress` (n, 4|6) Pa by `strain_increment` in place over `dt` s.

        Raises StepRefused where the law wants a shorter step (PNEWDT < 1) however often it is divided.
        """
        refused = np.zeros(len(stress), np.bool_)
        self._take(self._arguments(stress.shape[1]), stress, strain_increment, state, dt, refused)
        if refused.any():
            raise StepRefused(np.flatnonzero(refused), f"{self.symbol} wants a shorter step (PNEWDT)")

    def _take(self, arguments, stress, strain_increment, state, dt, refused):
        advance(
            self._address, arguments.pointers, arguments.numbers, stress, strain_increment, state,
            self._order(stress.shape[1]), self._columns(stress.shape[1]), dt, refused,
        )  # fmt: skip

    def elastic_moduli(self, stress, state):
        """Moduli, two (n,) arrays in Pa: those of the input, or from DDSDDE of a step without strain."""
        n = len(stress)
        if self.bulk_modulus is not None:
            return filled(n, self.bulk_modulus), filled(n, self.shear_modulus)
        bulk, shear, arguments = np.empty(n), np.empty(n), self._arguments(stress.shape[1])
        fill_moduli(
            self._address, arguments.pointers, arguments.numbers, stress, state, self._order(stress.shape[1]),
            self._columns(stress.shape[1]), bulk, shear,
        )  # fmt: skip
        return bulk, shear


def _find(library: str, symbol: str) -> int:
    """Address of the subroutine. Raises ValueError if there is no such library, or no such symbol in it."""
    address = _find_optional(library, symbol)
    if address is None:
        tried = ", ".join(_spellings(symbol))
        raise ValueError(f"{library} has no subroutine {symbol} (looked for {tried}); give its name as symbol")
    return address


def _spellings(symbol: str) -> tuple[str, ...]:
    """Names that compilers make of that of a subroutine."""
    return f"{symbol.lower()}_", symbol, symbol.upper(), symbol.lower()


@functools.cache
def _find_optional(library: str, symbol: str) -> int | None:
    handle = _loaded(library)
    for name in _spellings(symbol):
        with contextlib.suppress(AttributeError):
            return ctypes.cast(getattr(handle, name), ctypes.c_void_p).value
    return None


@functools.cache
def _loaded(library: str) -> ctypes.CDLL:
    if not os.path.isfile(library):
        raise ValueError(f"there is no library {library}; compile the law with cc or gfortran -shared -fPIC -O2")
    try:
        return ctypes.CDLL(library)
    except OSError as error:
        raise ValueError(
            f"{library} cannot be loaded: {error}; what it lacks (XIT, ROTSIG, SINV, SPRIND) comes from compiling "
            f"{UTILITIES} with it"
        ) from None
