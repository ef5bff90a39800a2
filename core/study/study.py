"""`periporo study STUDY.yaml`, and `periporo.study`: all variants, their table and page."""

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from periporo.core.study.runner import run_variants
from periporo.core.study.table import PAGE, TABLE, collect, to_dataset, write_page, write_table
from periporo.core.study.variants import read_study
from periporo.errors import InputError

if TYPE_CHECKING:
    import xarray

_INPUT_ERROR, _RUN_ERROR = 2, 3


def study(
    file: str | Path, folder: str | Path | None = None, *, cores: int | None = None, run: bool = True,
    say: Callable[[str], None] = print,
) -> "xarray.Dataset":  # fmt: skip
    """Run the variants of a study that are not finished, and give their results along the dimension `variant`.

    - `file`: YAML file of the study
    - `folder`: where each variant has a folder of its own; by default the name of the file without its end
    - `cores`: runs at a time, by default one for each core that this process may use
    - `run`: or only collect what is there
    - `say`: what is told is passed to it

    The folder receives `study.csv` and `study.html`, too. Results of variants that have not finished are nan.
    Raises `InputError` for a study that cannot be used, with all its scenes checked, before any of them is run, and
    ImportError without xarray.
    """
    read, rows, _ = _carried_out(Path(file), folder, cores, run, say)
    return to_dataset(read, rows)


def _carried_out(file: Path, folder, cores, run, say):
    """The study, its rows, and the names of variants that failed."""
    read = read_study(file)
    target = Path(folder) if folder is not None else Path(file.stem)
    target.mkdir(parents=True, exist_ok=True)
    failed = run_variants(read, target, cores or len(os.sched_getaffinity(0)), say) if run else []
    rows = collect(read, target)
    write_table(rows, target / TABLE)
    write_page(read, rows, target / PAGE)
    say(f"{target / TABLE}\n{target / PAGE}")
    return read, rows, failed


def add_arguments(parser) -> None:
    """Arguments of `periporo study`."""
    parser.add_argument("study", help="YAML file of the study")
    parser.add_argument("-o", "--output", help="folder of the runs (default: the study's name)")
    parser.add_argument("--cores", type=int, help="runs at a time (default: one for each core)")
    parser.add_argument("--list", action="store_true", help="print the variants, and run nothing")
    parser.add_argument("--collect", action="store_true", help="run nothing: table and page of what is there")


def run(arguments) -> int:
    """Carry out `periporo study`: exit status 2 if the study is wrong, 3 if a variant failed."""
    try:
        if arguments.cores is not None and arguments.cores < 1:
            print(f"--cores must be at least 1, not {arguments.cores}", file=sys.stderr)
            return _INPUT_ERROR
        if arguments.list:
            print("\n".join(variant.name for variant in read_study(arguments.study).variants))
            return 0
        _, _, failed = _carried_out(
            Path(arguments.study), arguments.output, arguments.cores, not arguments.collect,
            lambda text: print(text, flush=True),
        )  # fmt: skip
    except InputError as error:
        print(error, file=sys.stderr)
        return _INPUT_ERROR
    for name in failed:
        print(f"failed: {name}", file=sys.stderr)
    return _RUN_ERROR if failed else 0
