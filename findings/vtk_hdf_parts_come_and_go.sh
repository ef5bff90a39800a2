#!/usr/bin/env bash
# VTK 9.6 and 9.7 lose parts of an unstructured grid where the number of parts changes between time steps.
#
# A VTKHDF file of version 2.0 holds an unstructured grid at 0, 1, 2 and 3 s: one part of 3 points at 0 and 3 s, two
# parts of 3 and 2 points at 1 and 2 s (`Steps/NumberOfParts` is 1 2 2 1, as the format allows). Asked for these times
# in turn, vtkHDFReader shows, in points of each part,
#
#   VTK 9.3.1: 3 | 5 | 5 | 3        parts are merged, all is there
#   VTK 9.6.0: 3 | 3 | 3 | 3        the second part is missing
#   VTK 9.7.2: 3 | 2 | 2 | 3        the first part is missing
#
# The type of the output is chosen once, from the first step. With an empty second part in the steps that have one part
# (an empty cell without points, so that no part is without cells) all versions show everything:
#
#   VTK 9.3.1: 3 | 5 | 5 | 3        VTK 9.6.0, 9.7.2: 3 0 | 3 2 | 3 2 | 3 0
#
# Seen with Python 3.11, h5py 3.16.0, numpy 2.4.6. Exits 0 if that is still so, not 0 if it has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH
cat > write.py <<'PYTHON'
import h5py
import numpy as np


def part(n):
    """Points, connectivity, offsets and types of n vertices; of none, of an empty cell."""
    if n == 0:
        return np.zeros((0, 3)), np.zeros(0, int), np.array([0, 0]), np.array([0])
    points = np.pad(np.arange(float(n))[:, None], ((0, 0), (0, 2)))
    return points, np.arange(n), np.arange(n + 1), np.ones(n, int)


def write(name, outputs):
    """outputs: for each time the numbers of points of its parts."""
    parts = [part(n) for output in outputs for n in output]
    counts = np.array([[len(p), len(t), len(c)] for p, c, _, t in parts])
    first = np.concatenate([[0], np.cumsum([len(output) for output in outputs])[:-1]])
    before = np.concatenate([[[0, 0, 0]], np.cumsum(counts, axis=0)])[first]
    with h5py.File(name, "w") as file:
        grid = file.create_group("VTKHDF")
        grid.attrs.create("Version", (2, 0), dtype="i8")
        grid.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
        for k, kind in enumerate(("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds")):
            grid[kind] = counts[:, k]
        for k, (kind, number) in enumerate((("Points", "f8"), ("Connectivity", "i8"), ("Offsets", "i8"), ("Types", "u1"))):
            grid[kind] = np.concatenate([p[k] for p in parts]).astype(number)
        steps = grid.create_group("Steps")
        steps.attrs.create("NSteps", len(outputs), dtype="i8")
        steps["Values"] = np.arange(float(len(outputs)))
        steps["NumberOfParts"] = np.array([len(output) for output in outputs])
        steps["PartOffsets"] = first
        for k, kind in enumerate(("PointOffsets", "CellOffsets", "ConnectivityIdOffsets")):
            steps[kind] = before[:, k]


write("changing.vtkhdf", [[3], [3, 2], [3, 2], [3]])
write("constant.vtkhdf", [[3, 0], [3, 2], [3, 2], [3, 0]])
PYTHON
cat > read.py <<'PYTHON'
from vtkmodules.vtkIOHDF import vtkHDFReader

for name in ("changing.vtkhdf", "constant.vtkhdf"):
    reader, seen = vtkHDFReader(), []
    reader.SetFileName(name)
    for time in range(4):
        reader.UpdateTimeStep(float(time))
        output = reader.GetOutputDataObject(0)
        parts = [output]
        if hasattr(output, "GetNumberOfPartitions"):
            parts = [output.GetPartition(k) for k in range(output.GetNumberOfPartitions())]
        seen.append(" ".join(str(part.GetNumberOfPoints()) for part in parts))
    print(name.split(".")[0], " | ".join(seen))
PYTHON
expect() { # version of VTK, what it should print
    python3 -m venv "$1"
    "$1/bin/pip" install --quiet --quiet --disable-pip-version-check "vtk==$1" h5py==3.16.0 numpy==2.4.6
    "$1/bin/python" write.py
    "$1/bin/python" read.py > "$1.txt"
    echo "VTK $1"
    cat "$1.txt"
    diff "$1.txt" - <<< "$2"
}
expect 9.3.1 "changing 3 | 5 | 5 | 3
constant 3 | 5 | 5 | 3"
expect 9.6.0 "changing 3 | 3 | 3 | 3
constant 3 0 | 3 2 | 3 2 | 3 0"
expect 9.7.2 "changing 3 | 2 | 2 | 3
constant 3 0 | 3 2 | 3 2 | 3 0"
echo "as before"
