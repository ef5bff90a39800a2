"""Registers in the language of the compiler (LLVM): vectors of float64 loaded, stored and picked from.

`builder` makes the instructions; a vector of `size` numbers lies in a register that may be wider.
"""

from llvmlite import ir
from numba.core.errors import LoweringError

ANY = None  # place: whatever is quickest


def register(size):
    """A register: a power of two, since the compiler takes others apart; what is beyond `size` is undefined."""
    return ir.VectorType(ir.DoubleType(), 1 << (size - 1).bit_length())


def at(context, builder, signature, arguments, place):
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


def load(builder, pointer, size):
    """The vector of `size` numbers from `pointer` on, and nothing beyond."""
    width, whole = register(size).count, None
    for begin, count, place in _parts(builder, pointer, size):
        part = picked(builder, builder.load(place, align=8), [*range(count)] + [ANY] * (width - count))
        joined = [*range(begin), *range(width, width + count)] + [width + count] * (width - begin - count)
        whole = part if whole is None else builder.shuffle_vector(whole, part, _mask(joined))
    return whole


def store(builder, vector, pointer, size):
    """Write the vector's `size` numbers from `pointer` on, and nothing beyond."""
    for begin, count, place in _parts(builder, pointer, size):
        builder.store(picked(builder, vector, range(begin, begin + count)), place, align=8)


def added(builder, vector, places):
    """Sum of the elements of a vector in the given places."""
    first, *others = [builder.extract_element(vector, ir.IntType(32)(k)) for k in places]
    for other in others:
        first = builder.fadd(first, other)
    return first


def picked(builder, vector, places):
    """The elements of a vector in the given places."""
    beyond = vector.type.count  # in the other vector, which is undefined
    places = [beyond if k is ANY else k for k in places]
    return builder.shuffle_vector(vector, ir.Constant(vector.type, ir.Undefined), _mask(places))


def _mask(places):
    return ir.Constant(ir.VectorType(ir.IntType(32), len(places)), list(places))


def filled(places):
    """As many places as a register has; what is beyond the given ones does not matter."""
    places = list(places)
    return places + [ANY] * (register(len(places)).count - len(places))
