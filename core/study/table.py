"""What a study has found: one table, one xarray.Dataset, one page."""

import base64
import csv
import html
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from periporo.core.study.runner import RESULT, is_finished
from periporo.core.study.variants import Study
from periporo.errors import InputError, Problem, choice
from periporo.io.output.results import Results, open_results

if TYPE_CHECKING:
    import xarray

TABLE, PAGE = "study.csv", "study.html"
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222; max-width: 62rem; margin: 2rem auto; padding: 1rem }
h1 { font-size: 1.6rem } h2 { font-size: 1.15rem; margin-top: 2rem } img { max-width: 100% }
table { border-collapse: collapse; font-variant-numeric: tabular-nums } tr { border-bottom: 1px solid #eee }
td, th { padding: 0.15rem 1.2rem 0.15rem 0; text-align: right } th { color: #777; font-weight: normal }
"""


def collect(study: Study, folder: Path) -> list[dict[str, Any]]:
    """A row for each variant: its name, factors, whether it is finished, and its results (nan if not).

    Raises InputError for a result that runs do not have.
    """
    rows = []
    for variant in study.variants:
        place = folder / variant.name
        row: dict[str, Any] = {"variant": variant.name} | {name: variant.factors.get(name) for name in study.factors}
        row["finished"] = is_finished(place)
        figures = dict.fromkeys(study.model.results, math.nan)
        if row["finished"]:
            with open_results(place / RESULT) as results:
                figures = {name: _figure(results, name) for name in study.model.results}
        rows.append(row | figures)
    return rows


def _figure(results: Results, name: str) -> float:
    """A number of a run: an attribute of the whole, or the largest or last value of a history."""
    attributes = {n: v for n, v in results.attributes.items() if isinstance(v, float | int | np.number)}
    if name in attributes:
        return float(attributes[name])
    kind, _, history = name.partition("_")
    if kind in ("max", "last") and history in results.history_names:
        values = results.history(history)
        return float(values.max() if kind == "max" else values[-1])
    known = [*attributes, *(f"{k}_{n}" for n in results.history_names for k in ("max", "last"))]
    raise InputError("study", [Problem(("results",), f"runs have no figure '{name}'; {choice(name, known)}")])


def write_table(rows: list[dict[str, Any]], file: Path) -> None:
    """Write rows as CSV; numbers with all their digits."""
    with open(file, "w", newline="", encoding="utf-8") as out:
        writer = csv.DictWriter(out, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def to_dataset(study: Study, rows: list[dict[str, Any]]) -> "xarray.Dataset":
    """Results along `variant`, with the factors as coordinates. Raises ImportError without xarray."""
    try:
        import xarray
    except ImportError as error:
        raise ImportError("a dataset needs xarray (pip install 'periporo[xarray]')") from error

    def column(name):
        values = [row[name] for row in rows]
        number = all(isinstance(v, float | int) and not isinstance(v, bool) for v in values)
        return ("variant", np.array(values, float) if number else np.array([str(v) for v in values]))

    return xarray.Dataset(
        {name: column(name) for name in study.model.results},
        {"variant": [row["variant"] for row in rows], **{name: column(name) for name in study.factors}},
    )


def write_page(study: Study, rows: list[dict[str, Any]], file: Path) -> None:
    """Write one page: table, and pictures of each result, of its distribution and over factors; they lie beside it."""
    title = html.escape(study.model.title or f"Study of {Path(study.model.scene).stem}")
    finished = sum(row["finished"] for row in rows)
    parts = [f"<h1>{title}</h1>", f"<p>{finished} of {len(rows)} variants are finished.</p>"]
    for name in study.model.results:
        picture = _picture(study, rows, name, file.with_name(f"study_{name}.png"))
        if picture:
            parts.append(f"<h2>{html.escape(name)}</h2>\n{_statistics(rows, name)}\n{picture}")
    head = "".join(f"<th>{html.escape(name.split('.')[-1])}</th>" for name in rows[0])
    lines = ["".join(f"<td>{html.escape(_shown(value))}</td>" for value in row.values()) for row in rows]
    body = "\n".join(f"<tr>{line}</tr>" for line in lines)
    parts.append(f"<h2>Variants</h2>\n<table>\n<tr>{head}</tr>\n{body}\n</table>")
    file.write_text(
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{title}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n" + "\n".join(parts) + "\n</body>\n</html>\n",
        encoding="utf-8",
    )


def _shown(value: Any) -> str:
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _known(rows, name) -> np.ndarray:
    return np.array([row[name] for row in rows if row["finished"] and math.isfinite(row[name])], float)


def _statistics(rows, name) -> str:
    values = _known(rows, name)
    if len(values) < 2:
        return ""
    quantiles = ", ".join(f"{q:.0%}: {np.quantile(values, q):.4g}" for q in (0.05, 0.5, 0.95))
    return f"<p>mean {values.mean():.4g}, deviation {values.std(ddof=1):.4g}; quantiles {quantiles}</p>"


def _picture(study, rows, name, file) -> str:
    """Panels in a file, and as an image within the page; nothing without matplotlib, or without numbers."""
    values = _known(rows, name)
    if len(values) < 2:
        return ""
    try:
        from matplotlib.figure import Figure
    except ImportError:
        return ""
    done = [row for row in rows if row["finished"] and math.isfinite(row[name])]
    # seeds only name draws: there is nothing along their axis
    factors = [f for f in study.factors if len({str(row[f]) for row in done}) > 1 and f.split(".")[-1] != "seed"]
    figure = Figure(figsize=(4.0 * (1 + len(factors[:3])), 3.2), layout="constrained")
    panels = figure.subplots(1, 1 + len(factors[:3]), squeeze=False)[0]
    panels[0].hist(values, bins=max(5, int(np.sqrt(len(values)))), color="#7f9fbf")
    panels[0].plot(np.sort(values), np.arange(1, len(values) + 1) * panels[0].get_ylim()[1] / len(values), color="#333")
    panels[0].set(xlabel=name, ylabel="variants; line: cumulative")
    for panel, factor in zip(panels[1:], factors, strict=False):
        panel.plot([row[factor] if row[factor] is not None else "" for row in done], values, "o", markersize=4)
        panel.set(xlabel=factor, ylabel=name)
    figure.savefig(file, dpi=110)
    return f'<img alt="{html.escape(name)}" src="data:image/png;base64,{base64.b64encode(file.read_bytes()).decode()}">'
