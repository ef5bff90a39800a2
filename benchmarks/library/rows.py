"""Tables of numbered rows that are kept as CSV while a study goes on."""

import csv
from pathlib import Path


def read_rows(table: Path) -> dict[int, dict]:
    """The rows by their column `number`; none if there is no table yet."""
    if not table.exists():
        return {}
    with table.open() as file:
        return {int(row["number"]): row for row in csv.DictReader(file)}


def write_rows(table: Path, rows: dict[int, dict]) -> None:
    """Write the rows, in order; the first has all columns."""
    with table.open("w", newline="") as file:
        writer = csv.DictWriter(file, list(next(iter(rows.values()))))
        writer.writeheader()
        writer.writerows(rows[number] for number in sorted(rows))
