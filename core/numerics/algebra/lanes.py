"""Tiles: rows that are worked on together."""

from periporo.core.numerics.jit import overload

LANES = 64
"""Rows that are worked on together: a tile is a flat array in which quantity q of lane k is tile[q * LANES + k].

The constant stride lets the compiler see that lanes do not touch each other, and vectorise.
"""


def to_lane(tile, start, lane, value):
    """Write a tuple to the quantities `start` ... of a lane."""


@overload(to_lane)
def _to_lane(tile, start, lane, value):
    if len(value) == 0:
        return lambda tile, start, lane, value: None

    def write(tile, start, lane, value):
        tile[start * LANES + lane] = value[0]
        to_lane(tile, start + 1, lane, value[1:])

    return write


def from_lane(tile, start, lane, like):
    """Quantities `start` ... of a lane as a tuple as long as `like`."""


@overload(from_lane)
def _from_lane(tile, start, lane, like):
    if len(like) == 1:
        return lambda tile, start, lane, like: (tile[start * LANES + lane],)

    def read(tile, start, lane, like):
        return (tile[start * LANES + lane],) + from_lane(tile, start + 1, lane, like[1:])

    return read
