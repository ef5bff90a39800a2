"""Sums over pairs with machine vectors: all components of a term are added to a point at once.

A loop over pairs adds a handful of numbers to the rows of two points. The compiler cannot know that these rows
overlap nothing else, so it adds them one by one. Here one vector instruction does it; the order of the pairs, and with
it every bit of the sums, stays as it is.
"""

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

WIDTH = 8
"""Numbers kept for each pair: 1, the components of xi, those of dv, and padding."""

# Factors of the products 1, xi_a xi_b (order of a shape tensor) and dv_a xi_b (a matrix, row by row), as places in
# (1, xi, dv).
_FACTORS = {
    2: ([0, 1, 2, 1, 3, 3, 4, 4], [0, 1, 2, 2, 1, 2, 1, 2]),
    3: ([0, 1, 2, 3, 1, 2, 1, 4, 4, 4, 5, 5, 5, 6, 6, 6], [0, 1, 2, 3, 2, 3, 3, 1, 2, 3, 1, 2, 3, 1, 2, 3]),
}


@intrinsic
def add_moments(typingctx, sums, i, j, pairs, k, factor, dim):
    """Add `factor` times (1, xi (x) xi, dv (x) xi) to the rows i and j of `sums`, (n, 8|16) contiguous.

    `pairs` is a flat array with (1, xi, dv) of pair k in its places WIDTH k, WIDTH k + 1, ...; `dim` as in
    `periporo.core.algebra`.
    """
    left, right = _FACTORS[len(dim)]

    def code(context, builder, signature, arguments):
        pair = builder.load(_vector_at(context, builder, signature, arguments, 3, arguments[4], WIDTH), align=8)
        term = builder.fmul(_picked(builder, pair, left), _picked(builder, pair, right))
        one = builder.insert_element(ir.Constant(term.type, ir.Undefined), arguments[5], ir.IntType(32)(0))
        term = builder.fmul(term, _picked(builder, one, [0] * len(left)))
        for end in (arguments[1], arguments[2]):
            _add(builder, _vector_at(context, builder, signature, arguments, 0, end, len(left)), term)
        return context.get_dummy_value()

    return types.void(sums, types.intp, types.intp, pairs, types.intp, types.float64, dim), code


@intrinsic
def add_tuple(typingctx, target, i, value):
    """Add a tuple to the first numbers of row i of `target`, (n, m) contiguous."""
    width = len(value)

    def code(context, builder, signature, arguments):
        term = ir.Constant(ir.VectorType(ir.DoubleType(), width), ir.Undefined)
        for k in range(width):
            term = builder.insert_element(term, builder.extract_value(arguments[2], k), ir.IntType(32)(k))
        _add(builder, _row_at(context, builder, signature, arguments, 0, arguments[1], width), term)
        return context.get_dummy_value()

    return types.void(target, types.intp, value), code


@intrinsic
def add_scaled(typingctx, target, i, source, j, factor, like):
    """Add `factor` times the first numbers of row j of `source` to row i of `target`, as many as `like` has.

    Both arrays are contiguous, (n, m) and (n', m').
    """
    width = len(like)

    def code(context, builder, signature, arguments):
        term = builder.load(_row_at(context, builder, signature, arguments, 2, arguments[3], width), align=8)
        one = builder.insert_element(ir.Constant(term.type, ir.Undefined), arguments[4], ir.IntType(32)(0))
        term = builder.fmul(term, _picked(builder, one, [0] * width))
        _add(builder, _row_at(context, builder, signature, arguments, 0, arguments[1], width), term)
        return context.get_dummy_value()

    return types.void(target, types.intp, source, types.intp, types.float64, like), code


@intrinsic
def add_row(typingctx, target, i, terms, k, dim):
    """Add row k of the flat array `terms` to row i of `target`, (n, d*d) contiguous."""
    width = len(dim) ** 2

    def code(context, builder, signature, arguments):
        term = builder.load(_vector_at(context, builder, signature, arguments, 2, arguments[3], width), align=8)
        _add(builder, _vector_at(context, builder, signature, arguments, 0, arguments[1], width), term)
        return context.get_dummy_value()

    return types.void(target, types.intp, terms, types.intp, dim), code


def _vector_at(context, builder, signature, arguments, number, row, width):
    """Pointer to `width` numbers from place width*row on of the array that is argument `number`."""
    array = context.make_array(signature.args[number])(context, builder, arguments[number])
    place = builder.gep(array.data, [builder.mul(row, row.type(width))])
    return builder.bitcast(place, ir.VectorType(ir.DoubleType(), width).as_pointer())


def _row_at(context, builder, signature, arguments, number, row, width):
    """Pointer to the first `width` numbers of a row of the array (n, m) that is argument `number`."""
    array = context.make_array(signature.args[number])(context, builder, arguments[number])
    place = builder.gep(array.data, [builder.mul(row, builder.extract_value(array.shape, 1))])
    return builder.bitcast(place, ir.VectorType(ir.DoubleType(), width).as_pointer())


def _add(builder, place, term):
    builder.store(builder.fadd(builder.load(place, align=8), term), place, align=8)


def _picked(builder, vector, places):
    """The elements of a vector in the given places."""
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(places)), places)
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), mask)
