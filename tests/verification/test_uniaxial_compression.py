"""The block under uniaxial compression at small size: `standard` oscillates, the stable schemes do not."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks import uniaxial_compression as study
from periporo.io.input.load import parse_scene


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The quick cases, run, by loading and scheme."""
    folder, cases = tmp_path_factory.mktemp("uniaxial"), study.quick_cases()
    for case in cases:
        study.run(case, folder / case.name)
    return {case: study.measure(case, folder / case.name) for case in cases}, folder


def test_the_cases_of_the_publication_are_there_and_valid():
    cases = study.all_cases()
    assert len({c.name for c in cases}) == len(cases)
    plain = {(c.loading, c.scheme, c.horizon) for c in cases if c.counts == (200, 60) and c.influence == "constant"}
    schemes = ("standard", *study.STABLE, "sub_horizon_published")
    assert plain == {(loading, s, m) for loading in ("static", "dynamic") for s in schemes for m in (2.1, 3.1)}
    finer = [np.prod(c.counts) for c in cases if c.push == 1e-3]
    assert finer == pytest.approx([15_000, 30_000, 50_000], rel=5e-3)
    for case in cases:
        scene = parse_scene(case.scene())
        lower, upper = np.array(scene.bodies[0].shape.lower), np.array(scene.bodies[0].shape.upper)
        assert (upper - lower) / case.spacing == pytest.approx(case.counts, rel=1e-12)
        assert (upper - lower)[0] - 5 * case.spacing == pytest.approx(0.975)
        assert (upper - lower)[1] == pytest.approx(0.3, rel=0.07 if case.counts == study.QUICK else 0.01)


def test_oscillations_are_gone_and_the_stress_is_right(measured):
    done, _ = measured
    lines, sound = study.table(done)
    assert sound and len(lines) == 2 + len(done) == 14
    for case, m in done.items():
        if case.scheme in study.STABLE:
            reference = study.oscillation(case, done[replace(case, scheme="standard")])
            assert study.oscillation(case, m) < min(reference / study.TIMES_LOWER, 0.2)
            middle = m.axial[24:36].mean()  # -E'/(1 m) x 0.5 mm / 0.975; waves add a few per cent
            assert middle == pytest.approx(-40e6 * 0.5e-3 / 0.975, rel=0.02 if case.loading == "static" else 0.06)


def test_the_published_force_bursts_in_motion_and_oscillates_at_rest(measured):
    done, _ = measured
    for case, m in done.items():
        if case.scheme == "sub_horizon_published" and case.loading == "dynamic":
            time, kinetic, bound = m.growth
            assert kinetic[-1] > 1e5 * bound and time[-1] < 0.1 and 0.0 < m.time < time[-1]
        elif case.scheme == "sub_horizon_published":
            assert m.growth is None and study.oscillation(case, m) > 1.0
        else:
            assert m.growth is None


def test_the_measure_is_the_variation_beyond_a_monotone_profile(measured):
    case, m = next(iter(measured[0].items()))
    steady = np.linspace(-3.0, -1.0, len(m.axial)) * case.stress
    assert study.oscillation(case, replace(m, axial=steady)) == pytest.approx(0.0, abs=1e-12)
    bumpy = steady.copy()
    bumpy[20] += 5.0 * case.stress  # up and down again: twice, less the slope of two intervals
    slope = 2.0 / (len(m.axial) - 1)
    assert study.oscillation(case, replace(m, axial=bumpy)) == pytest.approx(10.0 - 2.0 * slope, rel=1e-12)


def test_finished_and_failed_cases_are_skipped(measured):
    done, folder = measured
    for case, m in done.items():
        if case.loading == "dynamic" and case.scheme in ("bond_projected", "sub_horizon_published"):
            file = folder / case.name / (study.RESULT if m.growth is None else study.FAILURE)
            before = file.stat().st_mtime_ns
            study.run(case, folder / case.name)
            assert file.stat().st_mtime_ns == before


def test_pictures(measured, tmp_path):
    study.draw(measured[0], tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {
        "uniaxial_static.png", "uniaxial_static_axis.png", "uniaxial_dynamic.png", "uniaxial_dynamic_axis.png",
        "uniaxial_published.png",
    }  # fmt: skip
