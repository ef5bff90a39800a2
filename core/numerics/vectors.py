"""Vectors and matrices of a pair in machine registers: all components are loaded, combined and stored at once.

A loop over pairs fetches a handful of numbers from the rows of two points and adds some to them. The compiler cannot
know that these rows overlap nothing else, so with tuples (`periporo.core.numerics.algebra`) it moves them one by one.
A `Vector` holds a row; +, - and * by a number act on all of it. Matrices are in row order.
"""

import operator

from llvmlite import ir
from numba import types
from numba.core.datamodel import models
from numba.core.errors import LoweringError
from numba.extending import intrinsic, overload, register_model

from periporo.core.numerics.jit import inlined

WIDTH = 8
"""Numbers kept for each pair: 1, the components of xi, those of dv, and padding."""

# Factors of the products xi_a xi_b, in the order of a shape tensor.
_SHAPE = {2: ([0, 1, 0], [0, 1, 1]), 3: ([0, 1, 2, 0, 1, 0], [0, 1, 2, 1, 2, 2])}
_ORDER = {4: 2, 9: 3}  # of a matrix with so many numbers
_ANY = None  # place: whatever is quickest


class Vector(types.Type):
    """Type of `size` float64 that kernels hold in registers."""

    def __init__(self, size: int):
        self.size = size
        super().__init__(name=f"vector of {size} float64")


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _machine(kind.size))


@intrinsic
def row(typingctx, rows, i, like):
    """Row i of an array (n, size), contiguous, with the size of `like`, a tuple or a vector."""
    size = like.size if isinstance(like, Vector) else len(like)

    def code(context, builder, signature, arguments):
        place = builder.mul(arguments[1], arguments[1].type(size))
        return _load(builder, _at(context, builder, signature, arguments, place), size)

    return Vector(size)(rows, types.intp, like), code


@intrinsic
def put(typingctx, rows, i, value):
    """Write row i of an array (n, size), contiguous."""

    def code(context, builder, signature, arguments):
        place = builder.mul(arguments[1], arguments[1].type(value.size))
        _store(builder, arguments[2], _at(context, builder, signature, arguments, place), value.size)
        return context.get_dummy_value()

    return types.void(rows, types.intp, value), code


@intrinsic
def put_at(typingctx, numbers, place, value):
    """Write to the places `place`, `place` + 1, ... of a flat array."""

    def code(context, builder, signature, arguments):
        _store(builder, arguments[2], _at(context, builder, signature, arguments, arguments[1]), value.size)
        return context.get_dummy_value()

    return types.void(numbers, types.intp, value), code


@intrinsic
def zero(typingctx, like):
    """As many zeros as `like`, a tuple, has numbers."""

    def code(context, builder, signature, arguments):
        kind = _machine(len(like))
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
        pair = _load(builder, _at(context, builder, signature, arguments, place), WIDTH)
        return builder.fmul(_picked(builder, pair, left), _picked(builder, pair, right))

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
        return builder.fmul(*(_picked(builder, arguments[0], _filled(places)) for places in _SHAPE[x.size]))

    return Vector(len(_SHAPE[x.size][0]))(x), code


@intrinsic
def trace(typingctx, a):
    """Trace of a matrix."""
    diagonal = range(0, a.size, _ORDER[a.size] + 1)
    return types.float64(a), lambda context, builder, signature, arguments: _added(builder, arguments[0], diagonal)


@intrinsic
def full(typingctx, s):
    """In-space part of a symmetric tensor (4|6) as a matrix."""
    places = {4: [0, 3, 3, 1], 6: [0, 3, 5, 3, 1, 4, 5, 4, 2]}[s.size]

    def code(context, builder, signature, arguments):
        return _picked(builder, arguments[0], _filled(places))

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
        return builder.fmul(arguments[0], _picked(builder, one, [0] * one.type.count))

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
    return types.float64(a), lambda context, builder, signature, arguments: _added(builder, arguments[0], range(a.size))


@intrinsic
def _row_sums(typingctx, a):
    """Sums along the rows of a matrix."""
    d = _ORDER[a.size]

    def code(context, builder, signature, arguments):
        columns = [_picked(builder, arguments[0], _filled(range(k, a.size, d))) for k in range(d)]
        total = columns[0]
        for column in columns[1:]:
            total = builder.fadd(total, column)
        return total

    return Vector(d)(a), code


@intrinsic
def _repeated(typingctx, x):
    """A matrix with the rows x."""

    def code(context, builder, signature, arguments):
        return _picked(builder, arguments[0], _filled([*range(x.size)] * x.size))

    return Vector(x.size**2)(x), code


@intrinsic
def _stretched(typingctx, x):
    """A matrix with the columns x."""

    def code(context, builder, signature, arguments):
        return _picked(builder, arguments[0], _filled(k for k in range(x.size) for _ in range(x.size)))

    return Vector(x.size**2)(x), code


def _machine(size):
    """A register: a power of two, since the compiler takes others apart; what is beyond `size` is undefined."""
    return ir.VectorType(ir.DoubleType(), 1 << (size - 1).bit_length())


def _at(context, builder, signature, arguments, place):
    """Pointer to a place of the array that is the first argument."""
    if signature.args[0].layout != "C":
        raise LoweringError(f"rows of a vector must follow each other in memory, not those of {signature.args[0]}")
    return builder.gep(context.make_array(signature.args[0])(context, builder, arguments[0]).data, [place])


def _parts(builder, pointer, size):
    """The powers of two that make up `size`, largest first: where each begins, how many it is, and a pointer to it."""
    begin = 0
    while begin < size:
        count = 1 << (size - begin).bit_length() - 1
        place = builder.gep(pointer, [ir.IntType(64)(begin)])
        yield begin, count, builder.bitcast(place, ir.VectorType(ir.DoubleType(), count).as_pointer())
        begin += count


def _load(builder, pointer, size):
    """The vector of `size` numbers from `pointer` on, and nothing beyond."""
    width, whole = _machine(size).count, None
    for begin, count, place in _parts(builder, pointer, size):
        part = _picked(builder, builder.load(place, align=8), [*range(count)] + [_ANY] * (width - count))
        joined = [*range(begin), *range(width, width + count)] + [width + count] * (width - begin - count)
        whole = part if whole is None else builder.shuffle_vector(whole, part, _mask(joined))
    return whole


def _store(builder, vector, pointer, size):
    """Write the vector's `size` numbers from `pointer` on, and nothing beyond."""
    for begin, count, place in _parts(builder, pointer, size):
        builder.store(_picked(builder, vector, range(begin, begin + count)), place, align=8)


def _added(builder, vector, places):
    """Sum of the elements of a vector in the given places."""
    first, *others = [builder.extract_element(vector, ir.IntType(32)(k)) for k in places]
    for other in others:
        first = builder.fadd(first, other)
    return first


def _picked(builder, vector, places):
    """The elements of a vector in the given places."""
    beyond = vector.type.count  # in the other vector, which is undefined
    places = [beyond if k is _ANY else k for k in places]
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), _mask(places))


def _mask(places):
    return ir.Constant(ir.VectorType(ir.IntType(32), len(places)), list(places))


def _filled(places):
    """As many places as a register has; what is beyond the given ones does not matter."""
    places = list(places)
    return places + [_ANY] * (_machine(len(places)).count - len(places))
