"""Calls of a user material with Abaqus' interface: its arguments in one buffer, and the compiled loop over rows."""

import ctypes
import functools

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from periporo.core.numerics.jit import inlined, kernel

_WIDTHS = {
    "STRESS": 6, "DDSDDE": 36, "SSE": 1, "SPD": 1, "SCD": 1, "RPL": 1, "DDSDDT": 6, "DRPLDE": 6, "DRPLDT": 1,
    "STRAN": 6, "DSTRAN": 6, "TIME": 2, "DTIME": 1, "TEMP": 1, "DTEMP": 1, "PREDEF": 1, "DPRED": 1, "COORDS": 3,
    "DROT": 9, "PNEWDT": 1, "CELENT": 1, "DFGRD0": 9, "DFGRD1": 9,
}  # fmt: skip
START = {name: sum(list(_WIDTHS.values())[:k]) for k, name in enumerate(_WIDTHS)}
"""Place of each real argument among the numbers; STATEV and PROPS follow at `STATEV`."""
STATEV = sum(_WIDTHS.values())
_INTEGERS = ("NDI", "NSHR", "NTENS", "NSTATV", "NPROPS", "NOEL", "NPT", "LAYER", "KSPT", "KSTEP", "KINC")
_ORDER = (
    "STRESS", "STATEV", "DDSDDE", "SSE", "SPD", "SCD", "RPL", "DDSDDT", "DRPLDE", "DRPLDT", "STRAN", "DSTRAN", "TIME",
    "DTIME", "TEMP", "DTEMP", "PREDEF", "DPRED", "CMNAME", "NDI", "NSHR", "NTENS", "NSTATV", "PROPS", "NPROPS",
    "COORDS", "DROT", "PNEWDT", "CELENT", "DFGRD0", "DFGRD1", "NOEL", "NPT", "LAYER", "KSPT", "KSTEP", "KINC",
)  # fmt: skip
NOT_GIVEN = ("TEMP", "DTEMP", "PREDEF", "DPRED")
"""Arguments that the program does not know: they are NaN."""

_STRESS, _DDSDDE, _SPD, _SCD = START["STRESS"], START["DDSDDE"], START["SPD"], START["SCD"]
_STRAN, _DSTRAN, _TIME, _DTIME = START["STRAN"], START["DSTRAN"], START["TIME"], START["DTIME"]
_PNEWDT, _CELENT, _COORDS = START["PNEWDT"], START["CELENT"], START["COORDS"]
_DFGRD0, _DFGRD1 = START["DFGRD0"], START["DFGRD1"]
_NAME_LENGTH = 80  # of CMNAME, a hidden argument behind the others
_SHORT = 1e-9  # s, the step in which DDSDDE is asked for: soil does not creep in it
_GUARD = 64  # numbers behind STATEV and behind PROPS
_MOST_PARTS = 64  # of a step that the law wants shorter


class Arguments:
    """Memory of one call's arguments: `numbers` (m,) float64, and `pointers` (37,) int64 to all in their order."""

    def __init__(self, components: int, state_variables: int, props):
        shear = components - 3
        first_prop = STATEV + state_variables + _GUARD
        self.numbers = np.zeros(first_prop + len(props) + _GUARD)
        self.numbers[first_prop - _GUARD :] = np.nan  # a law that reads more than there is tells so
        self.numbers[first_prop : first_prop + len(props)] = props
        self.numbers[START["DROT"] : START["DROT"] + 9] = np.eye(3).ravel()
        for name in NOT_GIVEN:
            self.set(name, np.nan)
        self._integers = np.zeros(len(_INTEGERS) + 3, np.int32)
        self._integers[:5] = 3, shear, components, state_variables, len(props)
        self._integers[5:] = 1  # element, point, layer, section; step, which is a list of four, and increment
        self._name = np.frombuffer(b"PERIPORO".ljust(_NAME_LENGTH), np.uint8).copy()
        base = self.numbers.ctypes.data
        places = {name: base + 8 * start for name, start in START.items()}
        places |= {"STATEV": base + 8 * STATEV, "PROPS": base + 8 * first_prop}
        offsets = [*range(len(_INTEGERS) - 1), len(_INTEGERS) + 2]
        places |= {n: self._integers.ctypes.data + 4 * k for n, k in zip(_INTEGERS, offsets, strict=True)}
        places["CMNAME"] = self._name.ctypes.data
        self.pointers = np.array([places[name] for name in _ORDER], np.int64)

    def set(self, name: str, value) -> None:
        """Give a real argument, all of its numbers, a value."""
        self.numbers[START[name] : START[name] + _WIDTHS[name]] = value


def initial_variables(address: int, count: int) -> np.ndarray:
    """State variables (count,) at the start that the subroutine SDVINI at `address` gives."""
    variables, places = np.zeros(count), np.full(3, np.nan)
    whole = np.array([count, 3, 1, 1, 1, 1], np.int32)
    of = ctypes.c_void_p
    integers = [of(whole.ctypes.data + 4 * k) for k in range(6)]
    ctypes.CFUNCTYPE(None, *[of] * 8)(address)(of(variables.ctypes.data), of(places.ctypes.data), *integers)
    return variables


@intrinsic
def _call(typingctx, address, pointers):
    """Call the subroutine at `address` with the addresses in `pointers` and the length of the name."""

    def codegen(context, builder, signature, args):
        array = context.make_array(signature.args[1])(context, builder, args[1])
        byte, word = ir.IntType(8).as_pointer(), ir.IntType(64)
        places = [builder.load(builder.gep(array.data, [ir.Constant(word, k)])) for k in range(len(_ORDER))]
        kind = ir.FunctionType(ir.VoidType(), [byte] * len(_ORDER) + [word])
        function = builder.inttoptr(args[0], kind.as_pointer())
        builder.call(function, [builder.inttoptr(p, byte) for p in places] + [ir.Constant(word, _NAME_LENGTH)])
        return context.get_dummy_value()

    return types.void(types.int64, pointers), codegen


@functools.cache
def order_of_variables(kinds: tuple[str, ...], components: int) -> tuple[np.ndarray, np.ndarray]:
    """Place in STATEV and factor of each of the first columns of the state, which are "scalar", "tensor" or "strain".

    Tensors have as many components as a stress, in Abaqus' order, a "strain" with engineering shear.
    """
    places: list[int] = []
    factors: list[float] = []
    for kind in kinds:
        start = len(places)
        width = 1 if kind == "scalar" else components
        places += [start + (9 - c if c > 3 else c) for c in range(width)]
        factors += [2.0 if kind == "strain" and c > 2 else 1.0 for c in range(width)]
    return np.array(places, np.int64), np.array(factors)


@kernel
def advance(address, pointers, numbers, stress, strain_increment, state, order, columns, dt, refused):
    """Advance all rows by the law at `address`, whose variables, in their `order`, stand first in the state.

    `columns` are those of total strain, time (told for the end of the step), length, dissipation, place, deformation
    gradient (told) and that of before, -1 where the state lacks one. A step that the law wants shorter (PNEWDT < 1) is
    divided; `refused` (n,) tells where that does not help.
    """
    n = stress.shape[1]
    for b in range(stress.shape[0]):
        refused[b] = False
        parts, done, lost = 1, False, 0.0
        while not done and parts <= _MOST_PARTS:
            _load(numbers, stress, state, b, order, columns, dt)
            lost, done = 0.0, True
            for part in range(parts):
                _increase(numbers, strain_increment, b, n, dt, parts)
                if columns[5] >= 0:
                    _deform(numbers, state, b, columns[5], columns[6], part, parts)
                _call(address, pointers)
                lost += numbers[_SPD] + numbers[_SCD]
                if numbers[_PNEWDT] < 1.0:
                    parts *= 2
                    done = False
                    break
                for c in range(n):
                    numbers[_STRAN + c] += numbers[_DSTRAN + c]
                if dt < np.inf:
                    numbers[_TIME] += dt / parts
                    numbers[_TIME + 1] += dt / parts
        if not done:
            refused[b] = True
            continue
        _store(numbers, stress, state, b, order, columns, lost)


@inlined
def _place(c):
    """Place of a component in Abaqus' order, in which yz and xz are exchanged."""
    return 9 - c if c > 3 else c


@inlined
def _load(numbers, stress, state, b, order, columns, dt):
    strain, time, length, _, place, _, _ = columns
    for c in range(stress.shape[1]):
        numbers[_STRESS + _place(c)] = stress[b, c]
        if strain >= 0:
            numbers[_STRAN + _place(c)] = state[b, strain + c] * (1.0 if c < 3 else 2.0)
    places, factors = order
    for v in range(len(places)):
        numbers[STATEV + places[v]] = factors[v] * state[b, v]
    if time >= 0:
        numbers[_TIME] = numbers[_TIME + 1] = state[b, time] - (dt if dt < np.inf else 0.0)
    if length >= 0:
        numbers[_CELENT] = state[b, length]
    if place >= 0:
        for c in range(3):
            numbers[_COORDS + c] = state[b, place + c]


@inlined
def _deform(numbers, state, b, gradient, before, part, parts):
    """Deformation gradients at both ends of a part of the step, even in between; Fortran's order is by columns."""
    begun = False
    for c in range(9):
        begun |= state[b, before + c] != 0.0
    for i in range(3):
        for j in range(3):
            last = state[b, gradient + 3 * i + j]
            first = state[b, before + 3 * i + j] if begun else (1.0 if i == j else 0.0)
            numbers[_DFGRD0 + 3 * j + i] = first + part / parts * (last - first)
            numbers[_DFGRD1 + 3 * j + i] = first + (part + 1) / parts * (last - first)


@inlined
def _increase(numbers, strain_increment, b, n, dt, parts):
    for c in range(n):
        numbers[_DSTRAN + _place(c)] = strain_increment[b, c] * (1.0 if c < 3 else 2.0) / parts
    numbers[_DTIME] = dt / parts
    numbers[_PNEWDT] = 1.0
    numbers[_SPD] = numbers[_SCD] = 0.0


@inlined
def _store(numbers, stress, state, b, order, columns, lost):
    strain, _, _, dissipation, _, gradient, before = columns
    for c in range(stress.shape[1]):
        stress[b, c] = numbers[_STRESS + _place(c)]
        if strain >= 0:
            state[b, strain + c] = numbers[_STRAN + _place(c)] * (1.0 if c < 3 else 0.5)
    places, factors = order
    for v in range(len(places)):
        state[b, v] = numbers[STATEV + places[v]] / factors[v]
    if gradient >= 0:
        for c in range(9):
            state[b, before + c] = state[b, gradient + c]
    if dissipation >= 0:
        state[b, dissipation] = lost


@kernel
def fill_moduli(address, pointers, numbers, stress, state, order, columns, bulk, shear):
    """Fill bulk and shear modulus (n,) Pa from DDSDDE where nothing is strained; the stiffest of the shears counts."""
    n = stress.shape[1]
    for b in range(stress.shape[0]):
        _load(numbers, stress, state, b, order, columns, 0.0)
        if columns[5] >= 0:
            _deform(numbers, state, b, columns[5], columns[6], 0, 1)
        for c in range(n):
            numbers[_DSTRAN + c] = 0.0
        numbers[_DTIME], numbers[_PNEWDT] = _SHORT, 1.0
        _call(address, pointers)
        total = stiffest = 0.0
        for i in range(3):
            for j in range(3):
                entry = numbers[_DDSDDE + n * j + i]
                total += entry
                if i == j:
                    stiffest = max(stiffest, 0.5 * (entry - numbers[_DDSDDE + n * ((i + 1) % 3) + i]))
        for i in range(3, n):
            stiffest = max(stiffest, numbers[_DDSDDE + n * i + i])
        bulk[b], shear[b] = total / 9.0, stiffest
