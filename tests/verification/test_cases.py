"""The verification cases of `benchmarks/library/verification_cases` at small size: every figure meets its target."""

import pytest

from benchmarks.library.verification_cases import CASES, Figure

RUNS = [(case, scheme) for case in CASES for scheme in case.schemes]


@pytest.mark.parametrize("case, scheme", RUNS, ids=[f"{c.name}-{c.function.__name__}-{s}" for c, s in RUNS])
def test_case(case, scheme):
    """Figures with a target meet it; the full sizes are in docs/reference/verification."""
    figures = case.run(full=False, scheme=scheme)
    assert any(figure.target != "recorded" for figure in figures)
    missed = [f"{f.what}: {f.value:.4g}, not {f.target}" for f in figures if not f.met]
    assert not missed, "\n".join(missed)


def test_a_figure_outside_its_bounds_or_nan_is_not_met():
    assert Figure("error", 1.0, at_most=1.0).met and Figure("order", 2.0, at_least=1.9, at_most=2.1).met
    assert not Figure("error", 1.01, at_most=1.0).met
    assert not Figure("order", 1.8, at_least=1.9).met
    assert not Figure("error", float("nan"), at_most=1.0).met
    assert not Figure("order", float("nan"), at_least=1.0).met


def test_every_case_says_what_it_is():
    for case in CASES:
        assert case.what
        assert case.name == "collapse" or case.function.__doc__.startswith(case.name)
