"""The column collapse, coarse and short, for a job that continuous integration runs and reads back.

python short_collapse.py write column.yaml     the scene
python short_collapse.py read column.vtkhdf    check of its results, by h5py and by VTK's own reader
"""

import sys
from importlib import resources
from pathlib import Path

import h5py
import numpy as np
import yaml

POINTS = 400  # of the column 0.1 m x 0.1 m at a spacing of 5 mm


def write(path):
    """The shipped scene at twice the spacing, for 60 ms."""
    scene = yaml.safe_load((resources.files("periporo.configs") / "column_collapse.yaml").read_text())
    scene["spacing"] = 5e-3
    scene["stages"][-1]["duration"] = 0.06
    Path(path).write_text(yaml.safe_dump(scene))


def read(path):
    """Fail unless both readers find a column that has begun to fall, its floor, and a picture of it."""
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkIOHDF import vtkHDFReader

    with h5py.File(path) as file:
        steps = int(file["VTKHDF/Steps"].attrs["NSteps"])
        start = int(file["VTKHDF/Steps/PointOffsets"][steps - 1])
        position = file["VTKHDF/Points"][start : start + POINTS]
        assert file["Run"].attrs["ranks"] == 2
        last = {name: float(values[-1]) for name, values in file["History"].items()}
    assert steps > 5 and position.shape == (POINTS, 3) and np.isfinite(position).all()
    assert last["time"] >= 0.06 and 0.05 < last["height"] < 0.099 and last["front"] > 0.052
    unexplained = abs(last["energy_residual"] - last["integration_term"])
    assert unexplained < 1e-12 * abs(last["external_work"])

    reader = vtkHDFReader()
    reader.SetFileName(path)
    reader.UpdateInformation()
    reader.SetStep(reader.GetNumberOfSteps() - 1)
    reader.Update()
    parts = reader.GetOutputDataObject(0)
    data, floor = parts.GetPartition(0), parts.GetPartition(1)
    assert reader.GetNumberOfSteps() == steps and data.GetNumberOfPoints() == POINTS
    assert floor.GetNumberOfPoints() == 2 and floor.GetBounds()[2:4] == (0.0, 0.0)
    assert (vtk_to_numpy(data.GetPoints().GetData()) == position).all()
    assert vtk_to_numpy(data.GetPointData().GetArray("stress")).shape == (POINTS, 6)

    pictures = list(Path(path).parent.glob("*.png"))
    assert pictures and all(picture.stat().st_size > 1000 for picture in pictures)
    print(f"{path}: {steps} outputs of {POINTS} points, the same by h5py and VTK; {len(pictures)} pictures")


if __name__ == "__main__":
    {"write": write, "read": read}[sys.argv[1]](sys.argv[2])
