"""Natural ground in pictures: shaded by light from the north-west, drawn again only where it moves."""

import json

import numpy as np
from mpi4py import MPI

from periporo.core.numerics import cells
from periporo.io.output.results import open_results
from periporo.io.output.writer import ResultWriter
from periporo.io.pictures import drawing


def roof():
    """A ridge from south-west to north-east, with a face to either side."""
    corners = np.array([[0, 0, 1], [4, 0, 0], [4, 4, 1], [0, 4, 0]], float)
    return corners, [(cells.POLYGON, (0, 1, 2)), (cells.POLYGON, (0, 2, 3))]


def test_ground_is_shaded_and_drawn_once(tmp_path):
    box = np.array([[x, y, z] for z in (0, 1) for x, y in ((5, 0), (6, 0), (6, 1), (5, 1))], float)
    scene = {"spacing": 0.5, "gravity": [0, 0, -9.81], "contacts": [{"type": "terrain"}, {"type": "box"}]}
    with ResultWriter(tmp_path / "run.vtkhdf", MPI.COMM_SELF, dimension=3, fields={"depth": (1, "m")},
                      attributes={"configuration": json.dumps(scene)}, obstacles=True) as writer:  # fmt: skip
        for k in range(2):
            shapes = {0: roof(), 1: (box + [k, 0, 0], [(cells.HEXAHEDRON, range(8))])}
            writer.write(float(k), k, [0, 1], [[1, 1, 2], [3, 3, 2 + k]], {"depth": [0.0, 1.0]}, cells.joined(shapes))
    with open_results(tmp_path / "run.vtkhdf") as results:
        picture = drawing.PointPicture(results, "depth")
        picture.show(0)
        front, top = picture._reliefs
        assert len(picture.obstacles[1][0].get_paths()) == 6  # the box, and not the ground
        mesh, contours, *labels = top._drawn
        assert contours.get_paths() and len(front._drawn) == 1
        plan = mesh._triangulation
        grey = {(x, y): shade for x, y, shade in zip(plan.x, plan.y, mesh.get_array(), strict=True)}
        assert grey[0, 4] > grey[0, 0] > grey[4, 0]  # towards the light, on the ridge, away from it
        picture.show(1)
        assert top._drawn[0] is mesh and picture.figure.savefig(tmp_path / "a.png") is None
