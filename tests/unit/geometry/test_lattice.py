"""Bodies as lattices: volumes against closed forms, pieces, ids, layers, jitter, overlaps."""

import math

import numpy as np
import pytest

from periporo.errors import InputError
from periporo.io.geometry.checks import close_pair, find_overlap
from periporo.io.geometry.lattice import build_lattices, count_points
from periporo.io.geometry.points import PointFileError, read_points
from periporo.io.input.load import parse_scene


def scene(*shapes, dimension=2, spacing=0.1, folder=".", body=None, **keys):
    """A scene with one body for each shape; `body` holds further keys of all bodies."""
    law = {"model": "elastic", "density": 1e3, "bulk_modulus": 1e6, "shear_modulus": 1e6}
    bodies = [{"name": f"b{k}", "material": "soil", "shape": s} | (body or {}) for k, s in enumerate(shapes)]
    data = {
        "dimension": dimension,
        "spacing": spacing,
        "materials": {"soil": law, "rock": law},
        "bodies": bodies,
        "stages": [{"name": "s", "type": "dynamics", "duration": 1.0}],
    }
    return parse_scene(data | keys, folder)


def box(lower, upper):
    return {"type": "box", "lower": lower, "upper": upper}


def all_sites(lattice):
    return lattice.sites(0, lattice.size)


def test_points_of_a_box_stand_in_the_centres_of_its_cells():
    (lattice,) = build_lattices(scene(box([1, 2], [1.3, 2.2])))
    ids, positions, volumes, materials = all_sites(lattice)
    assert lattice.size == count_points(lattice) == 6
    np.testing.assert_array_equal(ids, np.arange(6))
    expected = [[1 + (i + 0.5) * 0.1, 2 + (j + 0.5) * 0.1] for i in range(3) for j in range(2)]
    np.testing.assert_allclose(positions, expected, rtol=1e-15)
    np.testing.assert_allclose(volumes, 0.01, rtol=1e-15)
    assert ids.dtype == np.int64 and not materials.any()


@pytest.mark.parametrize(("side", "cells"), [(0.1, 1), (0.3, 3), (0.34, 3), (0.36, 4), (0.7, 7)])
def test_number_of_cells_is_the_rounded_ratio_and_points_stay_inside(side, cells):
    (lattice,) = build_lattices(scene(box([0, 0], [side, 1])))
    x = all_sites(lattice)[1][:, 0]
    assert lattice.counts == (cells, 10) and x.min() > 0 and x.max() < side


@pytest.mark.parametrize(
    ("shape", "dimension", "measure"),
    [
        ({"type": "disc", "center": [1, 2], "radius": 1}, 2, math.pi),
        ({"type": "sphere", "center": [1, 2, 3], "radius": 1}, 3, 4 / 3 * math.pi),
        (
            {"type": "cylinder", "base": [1, 2, 3], "axis": "x", "radius": 1, "height": 0.48},
            3,
            0.48 * math.pi,
        ),
        (
            {"type": "cylinder", "base": [1, 2, 3], "axis": "z", "radius": 1, "height": 0.48},
            3,
            0.48 * math.pi,
        ),
        ({"type": "polygon", "vertices": [[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]}, 2, 3.0),
        ({"type": "polygon", "vertices": [[0, 0], [3, 0], [0, 2]]}, 2, 3.0),
        ({"type": "polygon", "vertices": [[0, 0], [3, 0], [0, 2]], "extrude": [-1, 1]}, 3, 6.0),
        ({"type": "polygon", "vertices": [[0, 0], [2, 2], [2, 0], [0, 2]]}, 2, 2.0),
    ],
    ids=["disc", "sphere", "cylinder x", "cylinder z", "L", "triangle", "prism", "bow tie"],
)
def test_volumes_add_up_to_that_of_the_shape(shape, dimension, measure):
    (lattice,) = build_lattices(scene(shape, dimension=dimension, spacing=0.04))
    _, positions, volumes, _ = all_sites(lattice)
    assert volumes.sum() == pytest.approx(measure, rel=0.02)
    assert count_points(lattice) == len(positions) <= lattice.size


@pytest.mark.parametrize("spacing", [0.1, 0.09, 0.07])
def test_round_bodies_are_symmetric_for_any_spacing(spacing):
    disc = {"type": "disc", "center": [1, 2], "radius": 0.5}
    can = {"type": "cylinder", "base": [0, 0, 5], "axis": "z", "radius": 0.5, "height": 1}
    ball = {"type": "sphere", "center": [1, 2, 3], "radius": 0.5}
    for shape, d, middle in [(disc, 2, [1, 2]), (ball, 3, [1, 2, 3]), (can, 3, [0, 0])]:
        (lattice,) = build_lattices(scene(shape, dimension=d, spacing=spacing))
        offset = all_sites(lattice)[1][:, : len(middle)] - middle
        assert np.sqrt((offset**2).sum(axis=1)).max() <= 0.5
        rows = np.unique(offset.round(9), axis=0)
        np.testing.assert_allclose(rows, -rows[::-1], atol=1e-8)


def test_a_cylinder_stands_on_its_base_along_its_axis():
    shape = {"type": "cylinder", "base": [0, 5, 0], "axis": "y", "radius": 0.5, "height": 0.3}
    (lattice,) = build_lattices(scene(shape, dimension=3))
    y = np.unique(all_sites(lattice)[1][:, 1].round(9))
    np.testing.assert_allclose(y, [5.05, 5.15, 5.25])


def test_pieces_give_the_same_points_as_the_whole():
    disc = {"type": "disc", "center": [0, 0], "radius": 1}
    lattices = build_lattices(scene(box([2, 0], [3, 1]), disc, body={"jitter": 0.2}, seed=5))
    assert [lattice.first_id for lattice in lattices] == [0, 100]
    whole = all_sites(lattices[1])
    for size in (1, 7, 150):
        pieces = [lattices[1].sites(k, k + size) for k in range(0, lattices[1].size, size)]
        for column, entire in enumerate(whole):
            np.testing.assert_array_equal(np.concatenate([piece[column] for piece in pieces]), entire)
    chunks = list(lattices[1].chunks())
    np.testing.assert_array_equal(np.concatenate([c[0] for c in chunks]), whole[0])
    assert whole[0].min() >= 100 and len(np.unique(whole[0])) == len(whole[0])


def test_sites_within_a_box_are_those_of_the_whole_that_lie_in_it():
    (lattice,) = build_lattices(scene({"type": "disc", "center": [0, 0], "radius": 1}))
    ids, positions, *_ = all_sites(lattice)
    for lower, upper in [
        ([-0.33, 0.1], [0.4, 0.77]),
        ([-9, -9], [9, 9]),
        ([0.5, 0.5], [0.51, 0.51]),
        ([3, 3], [4, 4]),
    ]:
        inside = ((positions >= lower) & (positions <= upper)).all(axis=1)
        np.testing.assert_array_equal(lattice.sites_within(np.array(lower), np.array(upper))[0], ids[inside])


def test_layers_lie_against_gravity():
    layers = {"layers": [{"above": 0.5, "material": "rock"}, {"above": 0.8, "material": "soil"}]}
    for gravity, axis, sign in [([0, -9.81], 1, 1), ([3.0, 0], 0, -1)]:
        (lattice,) = build_lattices(scene(box([-1, -1], [1, 1]), body=layers, gravity=gravity))
        _, positions, _, materials = all_sites(lattice)
        level = sign * positions[:, axis]
        np.testing.assert_array_equal(materials == 1, (level > 0.5) & (level < 0.8))


def test_jitter_is_bounded_centred_and_depends_on_id_and_seed_only():
    plain = all_sites(build_lattices(scene(box([0, 0], [5, 5])))[0])[1]
    drawn = [
        all_sites(build_lattices(scene(box([0, 0], [5, 5]), body={"jitter": 0.2}, seed=s))[0])[1] - plain
        for s in (1, 1, 2)
    ]
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert (drawn[0] != drawn[2]).mean() > 0.99
    assert 0.0199 < np.abs(drawn[0]).max() <= 0.02
    np.testing.assert_allclose(drawn[0].mean(axis=0), 0.0, atol=4 * 0.02 / math.sqrt(3 * 2500))
    np.testing.assert_allclose(drawn[0].std(axis=0), 0.02 / math.sqrt(3), rtol=0.05)


def test_points_from_csv(tmp_path):
    (tmp_path / "p.csv").write_text("y,x, volume\n0.0,0.1,1e-2\n0.5,0.2,2e-2\n")
    (lattice,) = build_lattices(scene({"type": "points", "file": "p.csv"}, folder=tmp_path))
    ids, positions, volumes, _ = all_sites(lattice)
    np.testing.assert_array_equal(ids, [0, 1])
    np.testing.assert_array_equal(positions, [[0.1, 0.0], [0.2, 0.5]])
    np.testing.assert_array_equal(volumes, [0.01, 0.02])
    np.testing.assert_array_equal(lattice.sites(1, 9)[0], [1])
    assert count_points(lattice) == 2
    np.testing.assert_array_equal(lattice.sites_within(np.array([0, 0.4]), np.array([1, 1]))[0], [1])


@pytest.mark.parametrize(
    "text",
    [
        "X,Y,Z\n1,2,3\n4,5,6\n",
        "X Y Z\n1 2 3\n4 5 6\n",  # GDAL, -of XYZ -co ADD_HEADER_LINE=YES
        "//X,Y,Z,R,G,B,Intensity\n1,2,3,255,0,0,.5\n4,5,6,0,0,9,.5\n",  # CloudCompare
        "//X Y Z Nx Ny Nz\n1 2 3 0 0 1\n4 5 6 0 0 1\n",
        'X,Y,Z,id,"name"\n1,2,3,7,"sand, wet"\n4,5,6,8,clay\n',  # ogr2ogr -lco GEOMETRY=AS_XYZ
        "\ufeffz; Y ;x\r\n3;2;1\r\n6;5;4\r\n",
    ],
)
def test_tables_of_other_programs(tmp_path, text):
    (tmp_path / "p.xyz").write_text(text, encoding="utf-8", newline="")
    (lattice,) = build_lattices(scene({"type": "points", "file": "p.xyz"}, folder=tmp_path, dimension=3))
    np.testing.assert_array_equal(all_sites(lattice)[1], [[1, 2, 3], [4, 5, 6]])


CELLS = {
    "hexahedron": ([0, 4, 6, 2, 1, 5, 7, 3], [0.5, 0.5, 0.5], 1.0),
    "wedge": ([8, 9, 10, 11, 12, 13], [10 / 3, 1 / 3, 0.5], 0.5),
    "pyramid": ([14, 15, 16, 17, 18], [6.375, 0.375, 0.75], 1.0),
    "tetra": ([14, 16, 15, 18], [6.5, 0.25, 0.75], 0.5),
}


def corners():
    """Of a unit cube, a wedge, and a pyramid."""
    rest = [(3, 0, 0), (4, 0, 0), (3, 1, 0), (3, 0, 1), (4, 0, 1), (3, 1, 1),
            (6, 0, 0), (7, 0, 0), (7, 1, 0), (6, 1, 0), (6, 0, 3)]  # fmt: skip
    return np.array([*np.ndindex(2, 2, 2), *rest], float)


@pytest.mark.parametrize(("name", "without"), [("m.msh", ()), ("m.vtu", ()), ("m.inp", ("pyramid",))])
def test_points_from_the_cells_of_a_mesh(tmp_path, name, without):
    meshio = pytest.importorskip("meshio")
    kinds = [kind for kind in CELLS if kind not in without]
    cells = [(kind, np.array([CELLS[kind][0]])) for kind in kinds] + [("triangle", np.array([[0, 4, 6]]))]
    meshio.Mesh(corners(), cells).write(tmp_path / name, file_format="gmsh22" if name == "m.msh" else None)
    table = read_points(str(tmp_path / name), 3, cells=True)
    assert table.positions == pytest.approx(np.array([CELLS[kind][1] for kind in kinds]), abs=1e-12)
    assert table.volumes == pytest.approx([CELLS[kind][2] for kind in kinds])
    with pytest.raises(PointFileError, match="corners do not lie in one x-y plane"):
        read_points(str(tmp_path / name), 2, cells=True)


def test_cells_in_the_plane_and_bodies_of_them(tmp_path):
    meshio = pytest.importorskip("meshio")
    places = np.array([[0, 0], [2, 0], [2, 1], [0, 1], [4, 0]], float)
    cells = [("line", [[0, 1]]), ("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2]])]
    meshio.Mesh(np.column_stack([places, np.zeros(5)]), cells).write(tmp_path / "m.msh", file_format="gmsh22")
    body = scene({"type": "points", "file": "m.msh"}, folder=tmp_path, spacing=1.4)
    _, positions, volumes, _ = all_sites(build_lattices(body)[0])
    assert positions == pytest.approx(np.array([[1.0, 0.5], [8 / 3, 1 / 3]]))
    assert volumes == pytest.approx([2.0, 1.0])


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        ([("hexahedron", [[0, 4, 6, 2, 5, 1, 7, 3]])], r"the hexahedron 1 at \(0.5, 0.5, 0.5\) is flat or turned"),
        ([("tetra", [[0, 1, 4, 7], [0, 1, 4, 5]])], "the tetra 2 at .* is flat"),
        ([("triangle", [[0, 1, 4]])], "it has no cells of 3 dimensions; allowed: tetra, pyramid"),
    ],
)
def test_cells_that_cannot_be_used(tmp_path, cells, says):
    meshio = pytest.importorskip("meshio")
    meshio.Mesh(corners(), cells).write(tmp_path / "m.vtu")
    with pytest.raises(PointFileError, match=says):
        read_points(str(tmp_path / "m.vtu"), 3, cells=True)


def test_cells_that_gmsh_lists_once_for_each_of_their_groups_count_once(tmp_path):
    """Two squares of 1 x 1, dam and foundation, which are soil together: MSH 2.2 has each element in both groups."""
    pytest.importorskip("meshio")
    nodes = ["1 0 0 0", "2 1 0 0", "3 2 0 0", "4 0 1 0", "5 1 1 0", "6 2 1 0"]
    dam, foundation = "1 2 5 4", "2 3 6 5"
    tags = [(1, 1, dam), (3, 1, dam), (2, 2, foundation), (3, 2, "5 2 3 6")]  # the last one goes round from elsewhere
    cells = [f"{k} 3 2 {group} {entity} {quad}" for k, (group, entity, quad) in enumerate(tags, 1)]
    names = ['2 1 "dam"', '2 2 "foundation"', '2 3 "soil"']
    parts = {"PhysicalNames": names, "Nodes": nodes, "Elements": cells}
    text = "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    for part, lines in parts.items():
        text += "\n".join([f"${part}", str(len(lines)), *lines, f"$End{part}\n"])
    (tmp_path / "m.msh").write_text(text)
    table = read_points(str(tmp_path / "m.msh"), 2)
    assert table.positions == pytest.approx(np.array([[0.5, 0.5], [1.5, 0.5]]))
    assert table.volumes == pytest.approx([1.0, 1.0])


def test_points_without_volumes_stand_for_a_cell_each(tmp_path):
    (tmp_path / "p.csv").write_text("x,y,z\n0,0,0\n1,1,1\n")
    (lattice,) = build_lattices(scene({"type": "points", "file": "p.csv"}, folder=tmp_path, dimension=3))
    np.testing.assert_allclose(all_sites(lattice)[2], 1e-3)


def test_points_from_vtk(tmp_path):
    vtk = pytest.importorskip("vtk")
    points, grid, volume = vtk.vtkPoints(), vtk.vtkUnstructuredGrid(), vtk.vtkDoubleArray()
    points.SetDataTypeToDouble()
    volume.SetName("volume")
    for x in (0.0, 0.25, 0.5):
        points.InsertNextPoint(x, 1.0, 0.0)
        volume.InsertNextValue(0.02 + x)
    grid.SetPoints(points)
    grid.GetPointData().AddArray(volume)
    for name, writer in [
        ("p.vtu", vtk.vtkXMLUnstructuredGridWriter()),
        ("p.vtk", vtk.vtkUnstructuredGridWriter()),
    ]:
        writer.SetFileName(str(tmp_path / name))
        writer.SetInputData(grid)
        writer.Write()
        (lattice,) = build_lattices(scene({"type": "points", "file": name}, folder=tmp_path))
        _, positions, volumes, _ = all_sites(lattice)
        np.testing.assert_array_equal(positions, [[0, 1], [0.25, 1], [0.5, 1]])
        np.testing.assert_allclose(volumes, [0.02, 0.27, 0.52])


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("p.csv", "", "first line must name the columns x,y"),
        ("p.csv", "a,b\n1,2\n", "first line must name the columns x,y"),
        ("p.csv", "x,y,z\n1,2,3\n", "first line must name the columns x,y"),
        ("p.csv", "x,y,Vol\n1,2,3\n", "column 'vol' is not read; name it volume"),
        ("p.csv", "1,2\n1,3\n", "first line must name the columns x,y"),
        ("p.csv", "x,y,x\n1,2,1\n", "first line must name the columns x,y"),
        ("p.msh", "no mesh", "cannot be read as a mesh"),
        ("p.csv", "x,y\n", "no points"),
        ("p.csv", "x,y\n1,2\n1,b\n", "below the header"),
        ("p.csv", "x,y\n1,2,3\n", "2 columns, the rows have 3"),
        ("p.csv", "x,y\n1,2\n3\n", "below the header"),
        ("p.csv", "x,y\n1,2\nnan,3\n", "row 3 has a coordinate"),
        ("p.csv", "x,y,volume\n1,2,0\n", "row 2 has a volume"),
        ("p.csv", "x,y\n1,2\n1,2.04\n", "closer than half a spacing"),
        ("p.csv", "x,y\n1,2\n1,2e8\n", "beyond 1e+07 m"),
        ("p.csv", b"x,y\n\xff\xfe,1\n", "not text"),
        ("p.vtu", "<broken", "not readable VTK"),
        ("p.txt", "x,y\n1,2\n", "unknown kind of file"),
    ],
)
def test_point_files_that_cannot_be_used(tmp_path, name, content, says, capfd):
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match="bodies") as caught:
        scene({"type": "points", "file": name}, folder=tmp_path)
    assert says in caught.value.problems[0].message


def test_bodies_that_touch_do_not_overlap_but_bodies_half_a_spacing_inside_each_other_do():
    first = box([0, 0], [1, 1])
    scene(first, box([1, 0], [2, 1]), box([0, 1], [1, 2]))
    scene(first, box([1.0, 0.05], [2, 1.05]))
    for second in (box([0.86, 0], [2, 1]), first, box([0.3, 0.3], [0.6, 0.6])):
        with pytest.raises(InputError, match="overlaps the body 'b0'"):
            scene(first, second)


def test_boxes_around_bodies_may_overlap_if_the_bodies_do_not():
    lower = {"type": "polygon", "vertices": [[0, 0], [1, 0], [0, 1]]}
    upper = {"type": "polygon", "vertices": [[1.1, 0.2], [1.1, 1.2], [0.1, 1.2]]}
    scene(lower, upper)
    first, second = build_lattices(scene(lower, upper))
    assert find_overlap(first, second) is None and find_overlap(second, first) is None
    upper["vertices"][1] = [0.2, 0.2]
    with pytest.raises(InputError, match="overlaps"):
        scene(lower, upper)


def test_a_body_from_a_file_may_overlap_a_box(tmp_path):
    (tmp_path / "p.csv").write_text("x,y\n5,5\n0.47,0.55\n")
    points = {"type": "points", "file": "p.csv"}
    for shapes in [(box([0, 0], [1, 1]), points), (points, box([0, 0], [1, 1]))]:
        with pytest.raises(InputError, match="overlaps"):
            scene(*shapes, folder=tmp_path)
    scene(box([0, 0], [0.3, 1]), points, folder=tmp_path)


@pytest.mark.parametrize("dimension", [2, 3])
def test_close_pairs_against_all_distances(dimension):
    draw = np.random.default_rng(3)
    outcomes = []
    for k in range(60):
        a, b = draw.random((15, dimension)), draw.random((20, dimension))
        radius = 0.02 * 1.05**k
        shortest = np.sqrt(((a[:, None] - b) ** 2).sum(axis=2)).min(axis=1)
        place = close_pair(a, b, radius)
        assert (place is not None) == (shortest.min() < radius)
        outcomes.append(place is not None)
        if place is not None:
            assert shortest[(a == place).all(axis=1)] < radius
        alone = np.sqrt(((a[:, None] - a) ** 2).sum(axis=2)) + 9 * np.eye(15)
        assert (close_pair(a, a, radius, same=True) is not None) == (alone.min() < radius)
    assert 0 < sum(outcomes) < 60


def test_no_points_have_no_close_pair():
    assert close_pair(np.zeros((0, 2)), np.zeros((1, 2)), 1.0) is None


def together(*shapes, **keys):
    """Positions (n, d) of all points of a scene, and the body of each."""
    lattices = build_lattices(scene(*shapes, **keys))
    sites = [all_sites(lattice)[1] for lattice in lattices]
    ids = np.concatenate([all_sites(lattice)[0] for lattice in lattices])
    assert len(np.unique(ids)) == len(ids)
    return np.concatenate(sites), np.repeat(np.arange(len(sites)), list(map(len, sites)))


def assert_without_seams(position, whole, spacing=0.1):
    """The points are those of one lattice, none twice, and as many as one body of both shapes has."""
    cells = (position - position.min(axis=0)) / spacing
    assert np.abs(cells - np.rint(cells)).max() < 1e-9
    cells = np.rint(cells).astype(int)
    assert len(np.unique(cells, axis=0)) == len(cells) == whole


@pytest.mark.parametrize("angle", range(5, 180, 10))
def test_polygons_share_an_inclined_edge_without_holes(angle):
    """A square cut in two by a line through its middle, at any angle; one point of the edge may be in either."""
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    along = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    ends = [1.0 + s * along / np.abs(along).max() for s in (-1.0, 1.0)]
    halves = []
    for sign in (1.0, -1.0):
        side = sign * ((square - 1.0) @ [-along[1], along[0]])
        corners = [*square[side > 1e-12].tolist(), *(end.tolist() for end in ends)]
        order = np.argsort([math.atan2(y - m[1], x - m[0]) for x, y in corners for m in [np.mean(corners, axis=0)]])
        halves.append({"type": "polygon", "vertices": [corners[k] for k in order]})
    position, body = together(*halves)
    assert_without_seams(position, 400)
    assert abs((body == 0).sum() - 200) <= 20


def test_zones_of_a_dam_have_no_holes():
    """Shell, core and shell, whose edges pass through points of the lattice."""
    zones = [[[0, 0], [3, 0], [4, 2]], [[3, 0], [5, 0], [4, 2]], [[5, 0], [8, 0], [4, 2]]]
    position, body = together(*({"type": "polygon", "vertices": z} for z in zones), spacing=0.25)
    dam = {"type": "polygon", "vertices": [[0, 0], [8, 0], [4, 2]]}
    assert_without_seams(position, len(together(dam, spacing=0.25)[0]), 0.25)
    assert (body == 1).sum() == pytest.approx(2.0 / 0.25**2, abs=8)


@pytest.mark.filterwarnings("error")
def test_polygons_that_touch_themselves_have_no_holes():
    """A square ring that is cut along its diagonal, closed by its first corner, around a core; points on the cut."""
    ring = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0], [0.3, 0.3], [0.3, 0.7], [0.7, 0.7], [0.7, 0.3], [0.3, 0.3], [0, 0]]
    position, body = together({"type": "polygon", "vertices": ring}, box([0.3, 0.3], [0.7, 0.7]), spacing=0.05)
    assert_without_seams(position, 400, 0.05)
    assert (body == 1).sum() == 64


@pytest.mark.parametrize("gap", [0.0, 0.03, 0.05, 0.07])
def test_boxes_that_meet_off_the_lattice_continue_it(gap):
    """A box of 1.0 x 1.0 on one whose height is no multiple of the spacing."""
    position, body = together(box([0, 0], [1, 1 + gap]), box([0, 1 + gap], [1, 2]))
    assert_without_seams(position, 200)
    assert (body == 0).sum() == (100 if gap < 0.05 else 110)


def test_a_body_that_bridges_two_brings_them_on_one_lattice():
    position, body = together(box([0, 0], [0.5, 1]), box([1.53, 0], [2.03, 1]), box([0.5, 0], [1.53, 1]))
    assert_without_seams(position, 200)
    apart, _ = together(box([0, 0], [0.5, 1]), box([1.53, 0], [2.03, 1]))
    assert np.unique(apart[:, 0]) == pytest.approx([*np.arange(0.05, 0.5, 0.1), *np.arange(1.58, 2.03, 0.1)])


def test_discs_in_contact_and_bodies_that_ask_for_it_have_lattices_of_their_own():
    discs = [{"type": "disc", "center": center, "radius": 0.53} for center in ([0, 0], [1.06, 0.02])]
    touching = [{"type": "bodies", "first": "b0", "second": "b1", "friction": 0.1}]
    for keys in ({"contacts": touching}, {"body": {"lattice": "own"}}):
        position, body = together(*discs, **keys)
        for k, disc in enumerate(discs):
            assert position[body == k].mean(axis=0) == pytest.approx(disc["center"], rel=0, abs=1e-12)
    position, body = together(*discs)
    assert np.abs(np.mod(position[body == 1] - position[0], 0.1) - 0.05).min() > 0.04


def test_layers_and_regions_take_rows_on_their_bound():
    """Bounds computed in another way than the rows' places: 692 of 2400 selections lost a row."""
    for cells in range(3, 40):
        for spacing in (0.1, 0.3, 1 / 3, 0.07):
            (lattice,) = build_lattices(scene(box([0.1, 0], [0.1 + cells * spacing, spacing]), spacing=spacing))
            for k in range(cells):
                bound = (k + 0.5) * spacing + 0.1
                for rounding in (-1e-9, 0.0, 1e-9):
                    upper = np.array([bound + rounding * spacing, 1.0])
                    assert len(lattice.sites_within(np.array([-1.0, -1.0]), upper)[0]) == k + 1
                    assert len(lattice.sites_within(upper * [1, -1], np.array([99.0, 1.0]))[0]) == cells - k
    layered = {"layers": [{"above": 0.35, "material": "rock"}], "material": "soil"}
    (lattice,) = build_lattices(scene(box([0, 0], [1, 1]), body=layered, gravity=[0, -9.81]))
    assert sum(all_sites(lattice)[3]) == 70
