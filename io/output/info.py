"""One-screen summary of a result file."""

from pathlib import Path

import numpy as np

from periporo.io.output.mend import mend
from periporo.io.output.results import open_results
from periporo.io.output.vtkhdf_layout import folder_of

_MOST_TEXT = 120


def describe_results(results):
    """Text: the run, its outputs, the range of the fields at the last one, the histories."""
    files = [results.path, *folder_of(results.path).glob("*.h5")]
    size = sum(file.stat().st_size for file in files) / 1e6
    parts = f" in {len(files) - 2} parts" if len(files) > 1 else ""
    lines = [f"{results.path}  ({size:.1f} MB{parts}, {results.dimension}D)"]
    lines += [f"  {name:<28}{text}" for name, text in short_attributes(results).items()]
    if "finished" not in results.attributes:
        lines.append("unfinished: the run still goes on, or ended early; --resume goes on from its checkpoint")
    if not len(results):
        return "\n".join([*lines, "no output yet"])
    lines.append(f"outputs: {len(results)}, time {results.times[0]:.6g} ... {results.times[-1]:.6g} s, "
                 f"step {results.steps[0]} ... {results.steps[-1]}, points {results.point_counts[-1]:,}")
    position = results.positions()[:, : results.dimension]
    if len(position):
        low, high = position.min(axis=0), position.max(axis=0)
        lines.append("extent: " + ", ".join(f"{axis} {a:.4g} ... {b:.4g}" for axis, a, b in
                                            zip("xyz", low, high, strict=False)) + " m")
    lines.append(f"{'fields at the last output':<30}{'smallest':>14}{'largest':>14}  unit")
    for name in results.fields:
        values = results.field(name)
        components = results.components(name) or ("",)
        columns = values.reshape(-1, len(components)).T
        for component, column in zip(components, columns, strict=True):
            label = f"{name} {component}".strip()
            low, high = (np.min(column), np.max(column)) if len(column) else (np.nan, np.nan)
            lines.append(f"  {label:<28}{low + 0.0:>14.5g}{high + 0.0:>14.5g}  {results.unit(name)}")
    if results.history_names and len(results.history("step")):
        lines.append(f"{'histories':<30}{'first':>14}{'last':>14}  unit")
        for name in results.history_names:
            values = results.history(name)
            lines.append(f"  {name:<28}{values[0] + 0.0:>14.5g}{values[-1] + 0.0:>14.5g}  {results.unit(name)}")
    return "\n".join(lines)


def short_attributes(results):
    """Attributes of the run as text, without the configuration, the timing and other long ones."""
    short = {name: value for name, value in results.attributes.items() if name not in ("configuration", "timing")}
    texts = {name: f"{value:.6g}" if isinstance(value, float) else str(value) for name, value in short.items()}
    return {name: text for name, text in texts.items() if len(text) <= _MOST_TEXT and "\n" not in text}


def add_arguments(parser):
    """Arguments of `periporo info`."""
    parser.add_argument("path", type=Path, help="result file")


def run(arguments):
    """Run `periporo info`; the exit status."""
    remark = mend(arguments.path)
    with open_results(arguments.path) as results:
        print(describe_results(results))
    if remark is not None:
        print(remark)
    return 0
