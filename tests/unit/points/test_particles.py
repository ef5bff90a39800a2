"""The table of fields, and rows that come and go."""

import numpy as np
import pytest

from periporo.core.points.particles import Field, Particles, joined, picked


def filled(dimension=2, n=4):
    particles = Particles(dimension)
    owned = {}
    for k, f in enumerate(particles.migrating()):
        shape = (n,) if f.columns is None else (n, f.columns)
        owned[f.name] = (100 * k + np.arange(np.prod(shape)).reshape(shape)).astype(f.dtype)
    return particles, owned


@pytest.mark.parametrize("dimension", [2, 3])
def test_replace_installs_owned_rows_and_room_for_ghosts(dimension):
    particles, owned = filled(dimension)
    particles.replace(dict(owned), 3)
    assert (particles.owned, particles.total) == (4, 7)
    for name, field in particles.fields.items():
        array = getattr(particles, name)
        assert array.dtype == field.dtype
        assert array.shape == ((7 if field.sent else 4),) + (() if field.columns is None else (field.columns,))
        if field.migrates:
            assert (array[:4] == owned[name]).all() and not array[4:].any()
        else:
            assert not array.any()
    assert particles.position.shape[1] == dimension and particles.components == (4 if dimension == 2 else 6)


def test_take_is_the_inverse_of_replace():
    particles, owned = filled()
    particles.replace(dict(owned), 2)
    taken = particles.take(np.array([2, 0]))
    assert taken.keys() == owned.keys()
    assert all((taken[name] == owned[name][[2, 0]]).all() for name in owned)


def test_fields_of_eight_bytes_only_so_that_messages_can_be_packed():
    assert all(np.dtype(f.dtype).itemsize == 8 for f in Particles(3).fields.values())


def test_added_field_is_zero_and_migrates():
    particles, owned = filled()
    particles.replace(dict(owned), 1)
    particles.add_field(Field("suction", None, "Pa"))
    particles.add_field(Field("spring", 2, "m", sent=False))
    assert particles.suction.shape == (5,) and particles.spring.shape == (4, 2)
    assert not particles.suction.any()
    assert "suction" in [f.name for f in particles.migrating()]


def test_a_name_is_taken_once():
    with pytest.raises(ValueError, match="point field 'volume' is declared twice"):
        Particles(2).add_field(Field("volume", None, "m^3"))


def test_a_sparse_field_takes_memory_where_it_is_not_zero():
    particles, owned = filled()
    particles.add_field(Field("touch", 2, "m", sent=False, sparse=True))
    owned["touch"] = np.zeros((4, 2))
    particles.replace(dict(owned), 3)
    assert particles.touch.shape == (4, 2) and not particles.touch.flags.writeable
    few = particles.take(np.array([2, 0]))["touch"]
    more = joined(few, np.zeros((3, 2)))
    assert few.shape == (2, 2) and more.shape == (5, 2) and not few.flags.writeable and not more.flags.writeable
    assert joined(few, np.ones((1, 2))).tolist() == [[0, 0], [0, 0], [1, 1]]
    particles.own("touch")[1] = 5.0
    owned["touch"] = picked(particles.touch, np.array([3, 1, 0, 2]))
    particles.replace(owned, 0)
    assert particles.touch.flags.writeable and particles.touch[:, 0].tolist() == [0, 5, 0, 0]
    assert particles.own("touch") is particles.touch
