"""Vectors and matrices of a pair in machine registers: all components are loaded, combined and stored at once.

A loop over pairs fetches a handful of numbers from the rows of two points and adds some to them. The compiler cannot
know that these rows overlap nothing else, so with tuples (`periporo.core.numerics.algebra`) it moves them one by one.
A `Vector` holds a row; +, - and * by a number act on all of it. Matrices are in row order.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core.datamodel import models
from numba.extending import intrinsic, register_model

from periporo.core.numerics.jit import inlined, overload
from periporo.core.numerics.registers import added, at, filled, load, picked, register, store

WIDTH = 8
"""Numbers kept for each pair: 1, the components of xi, those of dv, and padding."""

# Factors of the products xi_a xi_b, in the order of a shape tensor.
_SHAPE = {2: ([0, 1, 0], [0, 1, 1]), 3: ([0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2])}
_ORDER = {4: 2, 9: 3}  # of a matrix with so many numbers


class Vector(types.Type):
    """Type of `size` float64 that kernels hold in registers."""

    def __init__(self, size: int):
        self.size = size
        super().__init__(name=f"vector of {size} float64")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, register(kind.size))


@intrinsic
def row(typingctx, rows, i, like):
    """Row i of an array (n, size), contiguous, with the size of `like`, a tuple or a vector."""
    size = like.size if isinstance(like, Vector) else len(like)

    def code(context, builder, signature, arguments):
        place = builder.mul(arguments[1], arguments[1].type(size))
        return load(builder, at(context, builder, signature, arguments, place), size)

    return Vector(size)(rows, types.intp, like), code


@intrinsic
def put(typingctx, rows, i, value):
    """Write row i of an array (n, size), contiguous."""

    def code(context, builder, signature, arguments):
        place = builder.mul(arguments[1], arguments[1].type(value.size))
        store(builder, arguments[2], at(context, builder, signature, arguments, place), value.size)
        return context.get_dummy_value()

    return types.void(rows, types.intp, value), code


@intrinsic
def put_at(typingctx, numbers, place, value):
    """Write to the places `place`, `place` + 1, ... of a flat array."""

    def code(context, builder, signature, arguments):
        store(builder, arguments[2], at(context, builder, signature, arguments, arguments[1]), value.size)
        return context.get_dummy_value()

    return types.void(numbers, types.intp, value), code


@intrinsic
def zero(typingctx, like):
    """As many zeros as `like`, a tuple, has numbers."""

    def code(context, builder, signature, arguments):
        kind = register(len(like))
        return ir.Constant(kind, [0.0] * kind.count)

    return Vector(len(like))(like), code


@intrinsic
def moments(typingctx, pairs, k, dim):
    """(1, xi (x) xi, dv (x) xi) of pair k, 8 or 16 numbers; xi (x) xi as a shape tensor.

    `pairs` is a flat array with (1, xi, dv) of pair k in its places WIDTH k, WIDTH k + 1, ...; `dim` as in
    `periporo.core.numerics.algebra`.
    """
    d = len(dim)
    first, second = _SHAPE[d]
    # factors of the products 1, xi_a xi_b and dv_a xi_b, as places in (1, xi, dv)
    left = [0, *(1 + a for a in first), *(1 + d + a for a in range(d) for _ in range(d))]
    right = [0, *(1 + b for b in second), *(1 + b for _ in range(d) for b in range(d))]

    def code(context, builder, signature, arguments):
        place = builder.mul(arguments[1], arguments[1].type(WIDTH))
        pair = load(builder, at(context, builder, signature, arguments, place), WIDTH)
        return builder.fmul(picked(builder, pair, left), picked(builder, pair, right))

    return Vector(len(left))(pairs, types.intp, dim), code


@inlined
def difference(rows, i, j, like):
    """Row j less row i."""
    return row(rows, j, like) - row(rows, i, like)


@inlined
def add_to_ends(rows, i, j, to_i, to_j, last, own):
    """Add a vector to row i and one to row j; returns `last` and `own` for the next pair.

    Pairs of the same first point follow each other. Its sum `own` stays in registers as long as it is the `last` one's,
    so that no pair waits for what the one before has stored. Begin with -1 and zeros.
    """
    if i != last:
        own = row(rows, i, to_i)
    own += to_i
    put(rows, i, own)
    put(rows, j, row(rows, j, to_j) + to_j)
    return i, own


@inlined
def dot(a, b):
    """a . b"""
    return _total(_product(a, b))


@inlined
def apply(a, x):
    """Matrix times vector."""
    return _row_sums(_product(a, _repeated(x)))


@inlined
def dyad(x, y):
    """x (x) y"""
    return _product(_stretched(x), _repeated(y))


@intrinsic
def square(typingctx, x):
    """x (x) x as a symmetric d x d matrix (3|6)."""

    def code(context, builder, signature, arguments):
        return builder.fmul(*(picked(builder, arguments[0], filled(places)) for places in _SHAPE[x.size]))

    return Vector(len(_SHAPE[x.size][0]))(x), code


@intrinsic
def trace(typingctx, a):
    """Trace of a matrix."""
    diagonal = range(0, a.size, _ORDER[a.size] + 1)
    return types.float64(a), lambda context, builder, signature, arguments: added(builder, arguments[0], diagonal)


@intrinsic
def full(typingctx, s):
    """In-space part of a symmetric tensor (4|6) as a matrix."""
    places = {4: [0, 3, 3, 1], 6: [0, 3, 5, 3, 1, 4, 5, 4, 2]}[s.size]

    def code(context, builder, signature, arguments):
        return picked(builder, arguments[0], filled(places))

    return Vector(len(places))(s), code


def _elementwise(opcode):
    @intrinsic
    def combine(typingctx, a, b):
        return a(a, b), lambda context, builder, signature, arguments: getattr(builder, opcode)(*arguments)

    return combine


_sum, _less, _product = _elementwise("fadd"), _elementwise("fsub"), _elementwise("fmul")


@intrinsic
def _multiple(typingctx, a, number):
    def code(context, builder, signature, arguments):
        one = builder.insert_element(ir.Constant(arguments[0].type, ir.Undefined), arguments[1], ir.IntType(32)(0))
        return builder.fmul(arguments[0], picked(builder, one, [0] * one.type.count))

    return a(a, types.float64), code


@overload(operator.add)
@overload(operator.iadd)
def _add(a, b):
    if isinstance(a, Vector) and a == b:
        return lambda a, b: _sum(a, b)


@overload(operator.sub)
def _subtract(a, b):
    if isinstance(a, Vector) and a == b:
        return lambda a, b: _less(a, b)


@overload(operator.mul)
def _multiply(a, b):
    if isinstance(a, Vector) and isinstance(b, types.Float):
        return lambda a, b: _multiple(a, b)


@intrinsic
def _total(typingctx, a):
    return types.float64(a), lambda context, builder, signature, arguments: added(builder, arguments[0], range(a.size))


@intrinsic
def _row_sums(typingctx, a):
    """Sums along the rows of a matrix."""
    d = _ORDER[a.size]

    def code(context, builder, signature, arguments):
        columns = [picked(builder, arguments[0], filled(range(k, a.size, d))) for k in range(d)]
        total = columns[0]
        for column in columns[1:]:
            total = builder.fadd(total, column)
        return total

    return Vector(d)(a), code


@intrinsic
def _repeated(typingctx, x):
    """A matrix with the rows x."""

    def code(context, builder, signature, arguments):
        return picked(builder, arguments[0], filled([*range(x.size)] * x.size))

    return Vector(x.size**2)(x), code


@intrinsic
def _stretched(typingctx, x):
    """A matrix with the columns x."""

    def code(context, builder, signature, arguments):
        return picked(builder, arguments[0], filled(k for k in range(x.size) for _ in range(x.size)))

    return Vector(x.size**2)(x), code
