"""A run on one page: a self-contained HTML file with pictures, figures, timing and configuration."""

import base64
import html
import tempfile
from pathlib import Path

import numpy as np
import yaml

from periporo.io.output.info import short_attributes
from periporo.io.output.results import open_results
from periporo.io.pictures.plots import INTEGRATION, LEDGER, RESIDUAL, plot_run

_TYPES = {".png": "image/png", ".gif": "image/gif", ".mp4": "video/mp4"}
_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #222;
       max-width: 62rem; margin: 2rem auto; padding: 1rem }
h1 { font-size: 1.6rem; margin-bottom: 0 } h2 { font-size: 1.15rem; margin-top: 2.2rem }
p.sub { color: #777; margin-top: 0.2rem } img, video { max-width: 100%; height: auto }
table { border-collapse: collapse } td, th { padding: 0.15rem 1.4rem 0.15rem 0; text-align: left }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums } tr { border-bottom: 1px solid #eee }
th { color: #777; font-weight: normal }
pre { background: #f6f6f4; padding: 1rem; overflow-x: auto; font-size: 0.85rem; border-radius: 4px }
"""


def write_report(path, out=None, *, field=None, animate=False):
    """Write the report of a result file; the file written, by default `<stem>_report.html` beside it.

    field: what the deposit is coloured by. animate: with a movie.
    """
    path = Path(path)
    out = Path(out) if out is not None else path.with_name(f"{path.stem}_report.html")
    with tempfile.TemporaryDirectory() as folder, open_results(path) as results:
        pictures = plot_run(path, folder, animate, field=field)
        sections = [_summary(results)]
        sections += [_section(file.stem.removeprefix(f"{path.stem}_"), _embedded(file)) for file in pictures]
        sections += [_ledger(results), _histories(results), _timing(results), _run(results),
                     _configuration(results)]
    page = (f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            f"<title>{html.escape(path.name)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
            + "\n".join(section for section in sections if section) + "\n</body>\n</html>\n")
    out.write_text(page, encoding="utf-8")
    return out


def _summary(results):
    last = results.output(-1)
    title = results.configuration.get("title") or results.path.stem
    return (f"<h1>{html.escape(title)}</h1>\n<p class='sub'>{html.escape(results.path.name)}: {results.dimension}D, "
            f"{results.point_counts[last]:,} points, {len(results)} outputs, "
            f"{results.times[0]:.4g} to {results.times[last]:.4g} s, {results.steps[last]:,} steps</p>")


def _section(title, body):
    return f"<section>\n<h2>{html.escape(title.replace('_', ' ').capitalize())}</h2>\n{body}\n</section>"


def _embedded(file):
    """The picture or movie inside the page."""
    kind = _TYPES[file.suffix]
    source = f"data:{kind};base64,{base64.b64encode(file.read_bytes()).decode()}"
    if kind.startswith("video"):
        return f'<video controls loop src="{source}"></video>'
    return f'<img alt="{html.escape(file.stem)}" src="{source}">'


def _table(heads, rows):
    """A table; numbers stand right."""
    def cell(tag, value):
        number = not isinstance(value, str)
        text = f"{value + 0.0:.6g}" if number else html.escape(value)  # + 0.0: no minus before zero
        return f"<{tag}{' class=n' if number else ''}>{text}</{tag}>"

    numeric = [not isinstance(value, str) for value in rows[0]]
    head = "".join(f"<th{' class=n' if right else ''}>{html.escape(text)}</th>"
                   for text, right in zip(heads, numeric, strict=True))
    body = "\n".join(f"<tr>{''.join(cell('td', value) for value in row)}</tr>" for row in rows)
    return f"<table>\n<tr>{head}</tr>\n{body}\n</table>"


def _figures(results, names):
    rows = []
    for name in names:
        values = results.history(name)
        if len(values):
            rows.append((name.replace("_", " "), values[0], values[-1], np.min(values), np.max(values),
                         results.unit(name)))
    return _table(("", "first", "last", "smallest", "largest", "unit"), rows) if rows else ""


def _ledger(results):
    names = [name for name in (*LEDGER, RESIDUAL, INTEGRATION) if name in results.history_names]
    return _section("energy ledger in numbers", _figures(results, names)) if names else ""


def _histories(results):
    names = [name for name in results.history_names if name not in (*LEDGER, RESIDUAL, INTEGRATION)]
    return _section("histories in numbers", _figures(results, names)) if names else ""


def _timing(results):
    """Where the time went: the attribute `timing`, a YAML mapping of seconds by part of the program."""
    if "timing" not in results.attributes:
        return ""
    parts = yaml.safe_load(results.attributes["timing"])
    total = sum(parts.values())
    rows = [(name.replace("_", " "), seconds, round(100 * seconds / total, 1) if total else 0.0)
            for name, seconds in sorted(parts.items(), key=lambda part: -part[1])]
    return _section("timing", _table(("part", "seconds", "%"), rows)) if rows else ""


def _run(results):
    rows = list(short_attributes(results).items())
    return _section("run", _table(("", ""), rows)) if rows else ""


def _configuration(results):
    text = str(results.attributes.get("configuration", ""))
    return _section("configuration", f"<pre>{html.escape(text)}</pre>") if text else ""


def add_arguments(parser):
    """Arguments of `periporo report`."""
    parser.add_argument("path", type=Path, help="result file")
    parser.add_argument("--out", type=Path, help="page to write (default: <result>_report.html)")
    parser.add_argument("--field", help="field to colour by: name, name.component or displacement")
    parser.add_argument("--animate", action="store_true", help="with a movie")


def run(arguments):
    """Run `periporo report`; the exit status."""
    print(write_report(arguments.path, arguments.out, field=arguments.field, animate=arguments.animate))
    return 0
