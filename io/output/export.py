"""Export of results for other programs: VTU files with a time table for older readers, CSV of histories."""

import csv
import struct
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from periporo.io.output.results import ResultError, open_results

_VTK_TYPES = {"f8": "Float64", "i8": "Int64", "u1": "UInt8"}
_VERTEX = 1


def export_vtu(results, folder):
    """Write every output as `<stem>_0000.vtu` and a table of them, `<stem>.pvd`, which is returned.

    The layout is that of VTK's XML files (UnstructuredGrid, raw appended data, 64-bit block sizes).
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    stem = results.path.stem
    entries = []
    for k, time in enumerate(results.times):
        name = f"{stem}_{k:04d}.vtu"
        _write_vtu(results, k, folder / name)
        entries.append(f'    <DataSet timestep="{float(time)!r}" part="0" file={quoteattr(name)}/>\n')
    table = folder / f"{stem}.pvd"
    table.write_text('<?xml version="1.0"?>\n<VTKFile type="Collection" version="1.0">\n  <Collection>\n'
                     + "".join(entries) + "  </Collection>\n</VTKFile>\n")
    return table


def export_histories_csv(results, path):
    """Write the histories as a table, a row per recorded step, heads with units such as `time [s]`.

    Numbers keep all their digits. Raises ResultError if the file holds no histories.
    """
    first = [name for name in ("step", "time") if name in results.history_names]
    names = first + [name for name in results.history_names if name not in first]
    if not names:
        raise ResultError(f"{results.path} holds no histories")
    heads = [f"{name} [{results.unit(name)}]" if results.unit(name) else name for name in names]
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(heads)
        table.writerows(zip(*(results.history(name).tolist() for name in names), strict=True))


def _write_vtu(results, k, path):
    position = results.positions(k)
    n = len(position)
    cells = {"connectivity": np.arange(n), "offsets": np.arange(1, n + 1), "types": np.full(n, _VERTEX, "u1")}
    data = {"id": results.ids(k)} | {name: results.field(name, k) for name in results.fields}
    blocks, offset = [], 0

    def array(name, values):
        """The XML element of an array, whose bytes are kept for the end of the file."""
        nonlocal offset
        raw = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
        width = values.shape[1] if values.ndim == 2 else 1
        element = (f'<DataArray type="{_VTK_TYPES[values.dtype.str[1:]]}" Name={quoteattr(name)} '
                   f'NumberOfComponents="{width}" format="appended" offset="{offset}"/>\n')
        blocks.append(struct.pack("<Q", len(raw)) + raw)
        offset += len(blocks[-1])
        return element

    parts = ["<PointData>\n", *(array(name, values) for name, values in data.items()), "</PointData>\n",
             "<Points>\n", array("Points", position), "</Points>\n",
             "<Cells>\n", *(array(name, values) for name, values in cells.items()), "</Cells>\n"]
    head = ('<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="1.0" byte_order="LittleEndian" '
            f'header_type="UInt64">\n<UnstructuredGrid>\n<Piece NumberOfPoints="{n}" NumberOfCells="{n}">\n')
    tail = '</Piece>\n</UnstructuredGrid>\n<AppendedData encoding="raw">\n_'
    with open(path, "wb") as file:
        file.write((head + "".join(parts) + tail).encode())
        file.writelines(blocks)
        file.write(b"\n</AppendedData>\n</VTKFile>\n")


def add_arguments(parser):
    """Arguments of `periporo export`."""
    parser.add_argument("path", type=Path, help="result file")
    parser.add_argument("--out", type=Path, help="folder to write to (default: a new one beside the file)")


def run(arguments):
    """Run `periporo export`: VTU files and a CSV of the histories; the exit status."""
    folder = arguments.out or arguments.path.with_name(f"{arguments.path.stem}_export")
    with open_results(arguments.path) as results:
        print(export_vtu(results, folder))
        if results.history_names:
            table = folder / f"{results.path.stem}_histories.csv"
            export_histories_csv(results, table)
            print(table)
    return 0
