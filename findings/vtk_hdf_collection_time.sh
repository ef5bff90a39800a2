#!/usr/bin/env bash
# VTK 9.7.2 shows the first time of a PartitionedDataSetCollection with point data at every time that is asked for.
#
# A VTKHDF file of version 2.2 holds a collection with one block, an unstructured grid with time steps at 0, 1 and 2 s
# that has 3, 4 and 5 points. vtkHDFReader announces the three times. Asked for them through the pipeline, as ParaView
# and every filter do (UpdateTimeStep), it gives
#
#                                     VTK 9.6.0        VTK 9.7.2
#   a collection with point data      3 4 5 points     3 3 3 points
#   a collection without              3 4 5            3 4 5
#   the same grid at the root, with   3 4 5            3 4 5
#
# With SetStep(k) and Update() 9.7.2 gives 3 4 5 in all of them. So a writer that wants blocks and times cannot rely on
# collections; parts of one grid (NumberOfParts 2) are read at their times by both.
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

COUNTS = np.array([3, 4, 5])


def grid(group, data):
    """Vertices at (k, 0, 0): an unstructured grid with three time steps, with point data or without."""
    group.attrs.create("Version", (2, 2), dtype="i8")
    group.attrs.create("Type", b"UnstructuredGrid", dtype=h5py.string_dtype("ascii", 16))
    steps = group.create_group("Steps", track_order=True)
    steps.attrs.create("NSteps", 3, dtype="i8")
    starts = np.concatenate([[0], np.cumsum(COUNTS)[:-1]])
    for name in ("NumberOfPoints", "NumberOfCells", "NumberOfConnectivityIds"):
        group[name] = COUNTS
    group["Points"] = np.concatenate([np.pad(np.arange(n)[:, None], ((0, 0), (0, 2))) for n in COUNTS]).astype(float)
    group["Connectivity"] = np.concatenate([np.arange(n) for n in COUNTS])
    group["Offsets"] = np.concatenate([np.arange(n + 1) for n in COUNTS])
    group["Types"] = np.ones(COUNTS.sum(), "u1")
    steps["Values"] = np.array([0.0, 1.0, 2.0])
    steps["NumberOfParts"] = np.ones(3, "i8")
    steps["PartOffsets"] = np.arange(3)
    for name in ("PointOffsets", "CellOffsets", "ConnectivityIdOffsets"):
        steps[name] = starts
    if data:
        group["PointData/height"] = np.arange(float(COUNTS.sum()))
        steps["PointDataOffsets/height"] = starts


def collection(name, data):
    with h5py.File(name, "w", track_order=True) as file:
        root = file.create_group("VTKHDF", track_order=True)
        root.attrs.create("Version", (2, 2), dtype="i8")
        root.attrs.create("Type", b"PartitionedDataSetCollection", dtype=h5py.string_dtype("ascii", 28))
        block = root.create_group("soil", track_order=True)
        grid(block, data)
        block.attrs.create("Index", 0, dtype="i8")
        node = root.create_group("Assembly", track_order=True).create_group("soil", track_order=True)
        node["soil"] = h5py.SoftLink("/VTKHDF/soil")


with h5py.File("grid.vtkhdf", "w") as file:
    grid(file.create_group("VTKHDF"), data=True)
collection("bare.vtkhdf", data=False)
collection("collection.vtkhdf", data=True)
PYTHON
cat > read.py <<'PYTHON'
from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline as Pipeline
from vtkmodules.vtkIOHDF import vtkHDFReader


def points(reader):
    output = reader.GetOutputDataObject(0)
    block = output.GetPartitionedDataSet(0).GetPartition(0) if hasattr(output, "GetPartitionedDataSet") else output
    return block.GetNumberOfPoints()


def reader_of(name):
    reader = vtkHDFReader()
    reader.SetFileName(name)
    reader.UpdateInformation()
    return reader


for name in ("grid.vtkhdf", "bare.vtkhdf", "collection.vtkhdf"):
    reader, seen = reader_of(name), []
    times = reader.GetOutputInformation(0).Get(Pipeline.TIME_STEPS())
    assert times == (0.0, 1.0, 2.0), times
    for time in times:
        reader.UpdateTimeStep(time)
        seen.append(points(reader))
    by_step, reader = [], reader_of(name)
    for step in range(3):
        reader.SetStep(step)
        reader.Update()
        by_step.append(points(reader))
    print(name, "by time", *seen, "by step", *by_step)
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
expect 9.6.0 "grid.vtkhdf by time 3 4 5 by step 3 4 5
bare.vtkhdf by time 3 4 5 by step 3 4 5
collection.vtkhdf by time 3 4 5 by step 3 4 5"
expect 9.7.2 "grid.vtkhdf by time 3 4 5 by step 3 4 5
bare.vtkhdf by time 3 4 5 by step 3 4 5
collection.vtkhdf by time 3 3 3 by step 3 4 5"
echo "as before"
