"""The table of speed by commit: a line for each measurement of each commit, as ratios to another commit.

Ratios of runs in turns can be compared between machines and days, which seconds cannot.
"""

import csv
import datetime
from pathlib import Path

import numpy as np

FILE = Path(__file__).resolve().parents[1] / "speed.csv"
COLUMNS = ("date", "commit", "against", "measurement", "ratio", "lower_quartile", "upper_quartile", "ms")


def append(before: str, after: str, samples: dict, file: Path = FILE) -> None:
    """Add the ratios of commit `after` over `before`, from samples (n, 2) s by measurement."""
    new = not file.exists()
    with file.open("a", newline="") as table:
        writer = csv.DictWriter(table, COLUMNS, lineterminator="\n")
        if new:
            writer.writeheader()
        for what, pairs in samples.items():
            low, middle, high = (f"{q:.4f}" for q in np.quantile(pairs[:, 1] / pairs[:, 0], (0.25, 0.5, 0.75)))
            milliseconds = f"{1e3 * np.median(pairs[:, 1]):.4g}"
            values = (datetime.date.today(), after, before, what, middle, low, high, milliseconds)
            writer.writerow(dict(zip(COLUMNS, values, strict=True)))


def lines(file: Path = FILE) -> list[str]:
    """What is kept, in Markdown: a row for each measurement, a column for each commit over another."""
    if not file.exists():
        return [f"nothing is kept in {file.name} yet: python -m benchmarks regress A B --append"]
    with file.open() as table:
        rows = list(csv.DictReader(table))
    columns = list(dict.fromkeys((row["commit"], row["against"]) for row in rows))
    ratio = {(row["measurement"], row["commit"], row["against"]): row["ratio"] for row in rows}
    head = [f"{commit} / {against}" for commit, against in columns]
    table = [f"| {what} | " + " | ".join(ratio.get((what, *column), "") for column in columns) + " |"
             for what in dict.fromkeys(row["measurement"] for row in rows)]  # fmt: skip
    return ["| measurement | " + " | ".join(head) + " |", "|---" * (len(columns) + 1) + "|", *table]
