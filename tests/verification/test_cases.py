"""The verification cases of `benchmarks/verification_cases` at small size: every figure meets its target."""

import importlib.util
import sys
from pathlib import Path

import pytest

_FOLDER = Path(__file__).parents[2] / "benchmarks" / "verification_cases"


def _library():
    """The package of the cases, loaded by its path: it belongs to the checkout, not to the installed package."""
    name = "verification_cases"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, _FOLDER / "__init__.py")
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


LIBRARY = _library()
RUNS = [(case, scheme) for case in LIBRARY.CASES for scheme in case.schemes]


@pytest.mark.parametrize("case, scheme", RUNS, ids=[f"{c.name}-{c.function.__name__}-{s}" for c, s in RUNS])
def test_case(case, scheme):
    """Figures with a target meet it; the full sizes are in docs/verification.md."""
    figures = case.run(full=False, scheme=scheme)
    assert any(figure.target != "recorded" for figure in figures)
    missed = [f"{f.what}: {f.value:.4g}, not {f.target}" for f in figures if not f.met]
    assert not missed, "\n".join(missed)


def test_a_figure_outside_its_bounds_or_nan_is_not_met():
    figure = LIBRARY.Figure
    assert figure("error", 1.0, at_most=1.0).met and figure("order", 2.0, at_least=1.9, at_most=2.1).met
    assert not figure("error", 1.01, at_most=1.0).met
    assert not figure("order", 1.8, at_least=1.9).met
    assert not figure("error", float("nan"), at_most=1.0).met
    assert not figure("order", float("nan"), at_least=1.0).met


def test_every_case_says_what_it_is():
    for case in LIBRARY.CASES:
        assert case.what
        assert case.name == "collapse" or case.function.__doc__.startswith(case.name)
