"""Surfaces of triangles from files: their outside is known, and what has none is refused with the place."""

import numpy as np
import pytest

from periporo.io.geometry.meshes import read_mesh
from periporo.io.geometry.rasters import GroundFileError

trimesh = pytest.importorskip("trimesh")

CORNERS = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0], [2, 2, 3]], float)
PYRAMID = np.array([[0, 2, 1], [0, 3, 2], [0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def written(path, triangles=PYRAMID, corners=CORNERS):
    trimesh.Trimesh(corners, triangles, process=False).export(path)
    return str(path)


def volume(mesh):
    a, b, c = (mesh.tree.corners[mesh.tree.triangles[:, k]] for k in range(3))
    return float((a * np.cross(b, c)).sum() / 6.0)


@pytest.mark.parametrize("name", ["a.stl", "a.ply", "a.obj"])
@pytest.mark.parametrize("way", [1, -1])
def test_a_closed_surface_has_its_outside_outside_however_it_is_turned(tmp_path, name, way):
    mesh = read_mesh(written(tmp_path / name, PYRAMID[:, ::way]), closed=True)
    assert mesh.closed and len(mesh.tree.triangles) == 6 and len(mesh.tree.corners) == 5
    assert volume(mesh) == pytest.approx(16.0)
    assert mesh.inside(np.array([[2.0, 2.0, 1.0], [2.0, 2.0, 3.1], [0.2, 0.2, 1.0]])).tolist() == [True, False, False]


def test_an_open_surface_has_its_outside_above_and_knows_its_border(tmp_path):
    for way in (1, -1):
        mesh = read_mesh(written(tmp_path / f"roof{way}.ply", PYRAMID[2:, ::way]))
        assert not mesh.closed
        a, b, c = (mesh.tree.corners[mesh.tree.triangles[:, k]] for k in range(3))
        assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()
        for row, bits in zip(mesh.tree.triangles, mesh.tree.borders, strict=True):
            edges = [bool(bits >> k & 1) for k in range(3)]
            assert edges == [mesh.tree.corners[[row[k], row[(k + 1) % 3]], 2].max() == 0.0 for k in range(3)]
            assert [bool(bits >> (3 + k) & 1) for k in range(3)] == [z == 0.0 for z in mesh.tree.corners[row, 2]]
    with pytest.raises(GroundFileError, match=r"open: an edge at \(.*close it"):
        read_mesh(str(tmp_path / "roof1.ply"), closed=True)


def test_triangles_that_disagree_about_the_outside_are_refused_with_the_place(tmp_path):
    turned = PYRAMID.copy()
    turned[3] = turned[3, ::-1]
    with pytest.raises(GroundFileError, match=r"disagree about which side is outside, at \(.*fix_normals"):
        read_mesh(written(tmp_path / "a.ply", turned))


def test_single_precision_far_from_the_origin_is_refused_with_the_remedy(tmp_path):
    """At 4 000 000 m the numbers of binary STL are .25 or .5 m apart, as are those of the PLY that trimesh writes."""
    far = CORNERS * 10.0 + [500_000.0, 4_000_000.0, 300.0]
    for name in ("a.stl", "a.ply"):
        with pytest.raises(GroundFileError, match="at 4000040 m are 0.25 m apart.*local origin, or as OBJ, or as PLY"):
            read_mesh(written(tmp_path / name, corners=far))
    double = tmp_path / "double.ply"
    text = trimesh.Trimesh(far, PYRAMID, process=False).export(file_type="ply", encoding="ascii").decode()
    double.write_text(text.replace("property float ", "property double "))
    for name in (str(double), written(tmp_path / "a.obj", corners=far)):
        mesh = read_mesh(name, (500_000.0, 4_000_000.0, 0.0), closed=True)
        assert mesh.tree.corners.max(axis=0) == pytest.approx([40.0, 40.0, 330.0], abs=1e-9)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.stl").write_text("not a surface")
    (tmp_path / "b.obj").write_text("v 0 0 0\n")
    for name, reason in (("a.stl", "cannot be read|no triangles"), ("b.obj", "cannot be read|no triangles"),
                         ("c.ply", "cannot be read: No such file")):
        with pytest.raises(GroundFileError, match=reason):
            read_mesh(str(tmp_path / name))
