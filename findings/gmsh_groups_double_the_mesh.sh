#!/usr/bin/env bash
# A mesh of gmsh 4.15.2 whose surfaces are in two physical groups has twice its area in MSH 2.2, and half of its groups
# in the cell data that meshio 5.3.5 makes of MSH 4.1.
#
# Two squares of 1 x 1 share an edge, "dam" and "foundation"; a third group, "soil", holds both, as one does to give both
# a common property. gmsh itself has one mesh of area 2. What meshio reads of the two files that gmsh writes:
#
#   format   cells over cells of the mesh   area   cells of soil by cell_data["gmsh:physical"]   by cell_sets["soil"]
#   2.2      2                              4      all of them, once more beside the others      no sets
#   4.1      1                              2      none: an entity keeps its first group         all
#
# So a program that takes soil from the cells of a 2.2 file weighs it twice without a word, and one that asks the cell
# data of a 4.1 file for "soil" finds nothing, while the names in field_data list it in both.
#
# Seen with Python 3.11, numpy 2.4.6. Exits 0 if that is still so, not 0 if it has changed.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
unset PYTHONPATH
python3 -m venv env
env/bin/pip install --quiet --quiet --disable-pip-version-check gmsh==4.15.2 meshio==5.3.5 numpy==2.4.6
cat > look.py <<'PYTHON'
import gmsh
import meshio
import numpy as np

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
dam = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
foundation = gmsh.model.occ.addRectangle(1, 0, 0, 1, 1)
gmsh.model.occ.fragment([(2, dam)], [(2, foundation)])
gmsh.model.occ.synchronize()
for tag, (name, surfaces) in enumerate({"dam": [dam], "foundation": [foundation], "soil": [dam, foundation]}.items(), 1):
    gmsh.model.addPhysicalGroup(2, surfaces, tag, name)
gmsh.option.setNumber("Mesh.MeshSizeMax", 0.5)
gmsh.model.mesh.generate(2)
cells = len(gmsh.model.mesh.getElementsByType(2)[0])
for version in (2.2, 4.1):
    gmsh.option.setNumber("Mesh.MshFileVersion", version)
    gmsh.write("mesh.msh")
    mesh = meshio.read("mesh.msh")
    corners = mesh.points[np.concatenate([block.data for block in mesh.cells])]
    (ax, ay), (bx, by) = ((corners[:, k] - corners[:, 0])[:, :2].T for k in (1, 2))
    by_data = sum(np.count_nonzero(tags == 3) for tags in mesh.cell_data["gmsh:physical"])
    by_sets = sum(len(rows) for rows in mesh.cell_sets["soil"]) if "soil" in mesh.cell_sets else "no sets"
    print(f"{version}: cells {len(corners) / cells:g}, area {np.abs(ax * by - ay * bx).sum() / 2:.6g}, "
          f"soil by data {by_data / cells:g}, by sets {by_sets if by_sets == 'no sets' else by_sets / cells}, "
          f"named {'soil' in mesh.field_data}")
PYTHON
env/bin/python look.py | grep ": cells" | tee seen.txt
diff seen.txt - <<'SEEN'
2.2: cells 2, area 4, soil by data 1, by sets no sets, named True
4.1: cells 1, area 2, soil by data 0, by sets 1.0, named True
SEEN
echo "as before"
