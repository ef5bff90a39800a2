"""Discs and cylinders as rings of points: exact volume, on their outline, symmetric about where they stand."""

import numpy as np
import pytest
from scipy.spatial import cKDTree

from periporo.errors import InputError
from periporo.io.geometry import rings
from periporo.io.geometry.lattice import build_lattices, count_points
from periporo.io.input.load import parse_scene


def lattices(*shapes, spacing=0.1):
    """Lattices of bodies with these shapes, all but boxes on rings."""
    law = {"model": "elastic", "density": 1e3, "bulk_modulus": 1e6, "shear_modulus": 1e6}
    bodies = [{"name": f"b{k}", "material": "soil", "shape": s, "lattice": "shared" if s["type"] == "box" else "rings"}
              for k, s in enumerate(shapes)]  # fmt: skip
    scene = {"dimension": 3 if shapes[0]["type"] == "cylinder" else 2, "spacing": spacing, "materials": {"soil": law},
             "bodies": bodies, "stages": [{"name": "s", "type": "dynamics", "duration": 1.0}]}
    return build_lattices(parse_scene(scene))


def test_a_disc_has_its_area_and_no_steps():
    disc = {"type": "disc", "center": [1.0, 2.0], "radius": 1.02}
    (lattice,) = lattices(disc)
    ids, x, volume, _ = lattice.sites(0, lattice.size)
    assert lattice.size == count_points(lattice) == len(ids) == 3 * 10**2
    assert volume.sum() == pytest.approx(np.pi * 1.02**2, rel=1e-14) and np.ptp(volume) == 0.0
    np.testing.assert_allclose((volume[:, None] * (x - [1.0, 2.0])).sum(axis=0), 0.0, atol=1e-15)
    depth = 1.02 - np.sqrt(((x - [1.0, 2.0]) ** 2).sum(axis=1))
    assert depth[-57:] == pytest.approx(0.05 * 1.02, rel=0.02) and depth[:-57].min() > 0.14  # the outermost ring
    mirrored = x * [-1.0, 1.0] + [2.0, 0.0]
    assert cKDTree(x).query(mirrored)[0].max() < 1e-14
    lowest = x[x[:, 1] < 1.04]
    assert np.abs(lowest[:, 0] - 1.0).min() == pytest.approx(0.05, rel=0.08)  # it stands on two points
    assert cKDTree(x).query(x, 2)[0][:, 1].min() > 0.08


@pytest.mark.parametrize("axis", "xyz")
def test_a_cylinder_is_made_of_such_sections(axis):
    bar = {"type": "cylinder", "base": [1.0, 2.0, 3.0], "axis": axis, "radius": 0.3, "height": 0.52}
    (lattice,) = lattices(bar)
    _, x, volume, _ = lattice.sites(0, lattice.size)
    along = "xyz".index(axis)
    assert len(x) == 27 * 5 and volume.sum() == pytest.approx(np.pi * 0.3**2 * 0.52, rel=1e-14)
    heights = np.unique((x - [1.0, 2.0, 3.0])[:, along].round(12))
    np.testing.assert_allclose(heights, (np.arange(5) + 0.5) * 0.104, rtol=1e-12)
    across = np.delete(x - [1.0, 2.0, 3.0], along, axis=1)
    assert np.hypot(*across.T).max() == pytest.approx(0.1 * 2.0 / 3.0 * 19.0 / 5.0)


def test_a_bar_on_rings_takes_no_part_in_the_lattice_of_its_neighbours():
    box = {"type": "box", "lower": [0.0, 0.0], "upper": [1.0, 0.5]}
    ground, disc = lattices(box, {"type": "disc", "center": [0.5, 0.8], "radius": 0.3})
    assert ground.company == [ground] and disc.company == [disc]
    assert disc.first_id == ground.size and len(disc.sites(0, disc.size)[0]) == 27
    ids, *_ = disc.sites_within(np.array([0.0, 0.0]), np.array([1.0, 0.6]))
    assert 2 < len(ids) < 9


def test_too_many_points_are_refused_before_they_are_made():
    with pytest.raises(InputError, match=r"3e\+18 points are too many"):
        lattices({"type": "disc", "center": [0, 0], "radius": 1e6}, spacing=1e-3)


def test_rings_are_for_what_is_round():
    with pytest.raises(InputError, match="rings are for a disc or a cylinder, not for a polygon"):
        lattices({"type": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]]})
    assert len(rings.section(0.04, 0.1)) == 3
