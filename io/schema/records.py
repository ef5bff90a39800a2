"""Histories from files: tables of times and values, and records of ground motion."""

import csv
import math
import re
from pathlib import Path

G = 9.80665  # m/s^2
_POINTS = re.compile(r"NPTS\s*=\s*([0-9]+)", re.I)
_STEP = re.compile(r"DT\s*=\s*([0-9.eE+-]+)", re.I)
_BOTH = re.compile(r"^\s*([0-9]+)\s+([0-9.eE+-]+)\s+NPTS\s*,\s*DT", re.I)


def read_record(path: Path) -> tuple[list[float], list[float]]:
    """Times (s) and values of a file: .csv with two columns, or .at2 of the PEER database, whose g become m/s^2.

    Raises ValueError if it cannot be used.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"the file cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise ValueError("the file is not text") from None
    match path.suffix.lower():
        case ".csv":
            times, values = _from_csv(text)
        case ".at2":
            times, values = _from_at2(text)
        case other:
            raise ValueError(f"unknown kind of file '{other}'; allowed: .csv, .at2")
    if not times:
        raise ValueError("it holds no times and values")
    for number, (time, value) in enumerate(zip(times, values, strict=True), 1):
        if not (math.isfinite(time) and math.isfinite(value)):
            raise ValueError(f"value {number}, {value:g} at {time:g} s, is not a finite number")
    return times, values


def _from_csv(text: str) -> tuple[list[float], list[float]]:
    """A line for each time: time and value; the first may name them; a # begins a remark."""
    times: list[float] = []
    values: list[float] = []
    named = False
    for number, row in enumerate(csv.reader(text.splitlines()), 1):
        if not row or row[0].lstrip().startswith("#"):
            continue
        try:
            time, value = map(float, row)
        except ValueError:
            if not times and not named:
                named = True
                continue
            raise ValueError(f"line {number} is not a time and a value: {','.join(row)[:40]!r}") from None
        times.append(time)
        values.append(value)
    return times, values


def _from_at2(text: str) -> tuple[list[float], list[float]]:
    """Four lines of header, the last with the number of values and their distance in time; then the values."""
    lines = text.splitlines()
    head = lines[3] if len(lines) > 3 else ""
    found = (_POINTS.search(head), _STEP.search(head))
    both = _BOTH.search(head)
    if both is not None:
        count, step = int(both[1]), float(both[2])
    elif found[0] is not None and found[1] is not None:
        count, step = int(found[0][1]), float(found[1][1])
    else:
        raise ValueError("its fourth line does not say NPTS= and DT=")
    try:
        values = [G * float(word) for line in lines[4:] for word in line.split()]
    except ValueError as error:
        raise ValueError(f"below the header: {error}") from None
    if len(values) != count:
        raise ValueError(f"its header promises {count} values, it has {len(values)}")
    return [k * step for k in range(count)], values
