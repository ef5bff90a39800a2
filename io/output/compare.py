"""Comparison of two result files, number by number."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from periporo.io.output.results import open_results


@dataclass
class Difference:
    """How one quantity differs between two files."""

    name: str
    problem: str = ""  # why the numbers cannot be compared; empty if they can
    absolute: float = 0.0  # largest difference
    relative: float = 0.0  # that difference over the largest magnitude of the quantity
    output: int | None = None  # where it is largest

    @property
    def equal(self):
        """True if every number is the same."""
        return not self.problem and self.absolute == 0.0


def compare_results(first, second):
    """Differences of all quantities of two opened result files: outputs, points, fields and histories.

    Numbers are equal only if they are the same in every bit that counts: NaN equals NaN, 0 equals -0.
    Attributes such as the wall time and the number of ranks are left out.
    """
    differences = [_compare("times", [(first.times, second.times)]),
                   _compare("steps", [(first.steps, second.steps)])]
    outputs = range(min(len(first), len(second)))
    readers = {"ids": lambda results, k: results.ids(k), "positions": lambda results, k: results.positions(k)}
    for name, of_first, of_second in _names(first.fields, second.fields):
        if of_first and of_second:
            readers[name] = lambda results, k, name=name: results.field(name, k)
        else:
            differences.append(_only_in(f"field {name}", first if of_first else second))
    for name, read in readers.items():
        differences.append(_compare(name, ((read(first, k), read(second, k)) for k in outputs)))
    for name, of_first, of_second in _names(first.history_names, second.history_names):
        label = f"history {name}"
        if of_first and of_second:
            differences.append(_compare(label, [(first.history(name), second.history(name))]))
        else:
            differences.append(_only_in(label, first if of_first else second))
    return differences


def _names(first, second):
    """All names with whether the first and the second file have them."""
    return [(name, name in first, name in second) for name in dict.fromkeys((*first, *second))]


def _only_in(name, results):
    return Difference(name, f"only in {results.path}")


def _compare(name, pairs):
    """The difference over all outputs, given as pairs of arrays."""
    found, scale = Difference(name), 0.0
    for k, (a, b) in enumerate(pairs):
        if a.shape != b.shape:
            return Difference(name, f"{_count(a)} and {_count(b)}", output=k)
        a, b = a.astype(np.float64), b.astype(np.float64)
        differ = (a != b) & ~(np.isnan(a) & np.isnan(b))
        scale = max(scale, np.nanmax(np.abs(a), initial=0.0), np.nanmax(np.abs(b), initial=0.0))
        if differ.any():
            gap = np.abs(a[differ] - b[differ])
            largest = np.inf if np.isnan(gap).any() else gap.max()  # a NaN in one file only
            if largest > found.absolute:
                found.absolute, found.output = float(largest), k
    found.relative = found.absolute / scale if scale > 0 else found.absolute
    return found


def _count(rows):
    return f"{len(rows)} rows" if rows.ndim == 1 else f"{len(rows)} rows of {rows.shape[1]}"


def describe(differences):
    """Text of a comparison: a line for each quantity and a verdict."""
    lines = [f"{'quantity':<34}{'largest difference':>20}{'relative':>12}  output"]
    for d in differences:
        where = "" if d.output is None else str(d.output)
        if d.problem:
            lines.append(f"{d.name:<34}{d.problem:>32}  {where}")
        elif d.equal:
            lines.append(f"{d.name:<34}{'equal':>20}")
        else:
            lines.append(f"{d.name:<34}{d.absolute:>20.6g}{d.relative:>12.3g}  {where}")
    unequal = [d.name for d in differences if not d.equal]
    lines.append(f"DIFFERENT: {', '.join(unequal)}" if unequal else "EQUAL: every number is the same")
    return "\n".join(lines)


def add_arguments(parser):
    """Arguments of `periporo compare`."""
    parser.add_argument("first", type=Path, help="result file")
    parser.add_argument("second", type=Path, help="result file to compare with")


def run(arguments):
    """Run `periporo compare`; the exit status is 0 if all numbers are equal, else 1."""
    with open_results(arguments.first) as first, open_results(arguments.second) as second:
        differences = compare_results(first, second)
    print(describe(differences))
    return 0 if all(difference.equal for difference in differences) else 1
