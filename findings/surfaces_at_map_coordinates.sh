#!/usr/bin/env bash
# trimesh 5.2.0 writes PLY and GLB, and VTK 9.7.2 reads PLY and STL, in single precision, without a word.
#
# One triangle at easting 500 000.123 m, northing 4 000 000.456 m, as surveys give. Every row writes or reads a file whose
# format can hold it (text, or `property double`); what comes back is off by 44 mm, half of the .25 m between
# single-precision numbers there at worst 125 mm:
#
#                                              off by
#   trimesh writes and reads PLY (binary)      44 mm   its header says `property float`
#   trimesh writes and reads PLY (text)        44 mm
#   trimesh writes and reads GLB               44 mm   (the format has no doubles)
#   trimesh writes and reads OBJ, OFF           0
#   meshio writes and reads PLY, STL, OBJ       0
#   trimesh reads PLY with `property double`    0
#   VTK reads PLY with `property double`       44 mm
#   VTK reads STL as text                      44 mm
#   VTK reads OBJ                               0
#
# So a slope that trimesh has repaired and saved as PLY has steps, and a viewer shows steps that the file does not have.
#
# Seen with Python 3.11, numpy 2.4.6, meshio 5.3.5. Exits 0 if that is still so, not 0 if it has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH
python3 -m venv env
env/bin/pip install --quiet --quiet --disable-pip-version-check trimesh==5.2.0 meshio==5.3.5 vtk==9.7.2 numpy==2.4.6
cat > look.py <<'PYTHON'
import meshio
import numpy as np
import trimesh
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOGeometry import vtkOBJReader, vtkSTLReader
from vtkmodules.vtkIOPLY import vtkPLYReader

CORNERS = np.array([[500000.123, 4000000.456, 1.0], [500001.2, 4000000.4, 1.0], [500000.2, 4000001.4, 1.0]])


def told(name, corners):
    print(f"{name}: {1e3 * np.abs(np.asarray(corners)[0] - CORNERS[0]).max():.0f} mm")


def by_trimesh(name):
    return trimesh.load(name, process=False, force="mesh").vertices


def by_vtk(reader, name):
    reader.SetFileName(name)
    reader.Update()
    return vtk_to_numpy(reader.GetOutput().GetPoints().GetData())


mesh = trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False)
for name, options in (("b.ply", {}), ("a.ply", {"encoding": "ascii"}), ("c.glb", {}), ("d.obj", {}), ("e.off", {})):
    mesh.export(name, **options)
    told(f"trimesh {name}", by_trimesh(name))
for name in ("f.ply", "g.stl", "h.obj"):
    meshio.Mesh(CORNERS, [("triangle", [[0, 1, 2]])]).write(name)
    told(f"meshio {name}", meshio.read(name).points)
assert b"property double x" in open("f.ply", "rb").read() and b"500000.123" in open("g.stl", "rb").read()
told("trimesh reads f.ply", by_trimesh("f.ply"))
for reader, name in ((vtkPLYReader(), "f.ply"), (vtkSTLReader(), "g.stl"), (vtkOBJReader(), "h.obj")):
    told(f"VTK reads {name}", by_vtk(reader, name))
PYTHON
env/bin/python look.py 2> /dev/null | tee seen.txt
diff seen.txt - <<'SEEN'
trimesh b.ply: 44 mm
trimesh a.ply: 44 mm
trimesh c.glb: 44 mm
trimesh d.obj: 0 mm
trimesh e.off: 0 mm
meshio f.ply: 0 mm
meshio g.stl: 0 mm
meshio h.obj: 0 mm
trimesh reads f.ply: 0 mm
VTK reads f.ply: 44 mm
VTK reads g.stl: 44 mm
VTK reads h.obj: 0 mm
SEEN
echo "as before"
