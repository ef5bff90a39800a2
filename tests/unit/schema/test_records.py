"""Histories from files, and what is wrong with them."""

import numpy as np
import pytest

from periporo.errors import InputError
from periporo.io.input.load import parse_scene
from periporo.io.schema.records import G, read_record

AT2 = "PEER NGA\nSomewhere\nACCELERATION IN UNITS OF G\n{}\n  .1E-01 -.2E-01\n .3E-01\n"


@pytest.mark.parametrize("head", ["NPTS=   3, DT=   .0050 SEC", "3   0.005  NPTS, DT"])
def test_records_of_the_peer_database_become_metres(tmp_path, head):
    (tmp_path / "a.AT2").write_text(AT2.format(head))
    times, values = read_record(tmp_path / "a.AT2")
    assert times == pytest.approx([0.0, 0.005, 0.01]) and values == pytest.approx([0.01 * G, -0.02 * G, 0.03 * G])


@pytest.mark.parametrize("name, text, reason", [
    ("a.csv", "time,value\n0,1\n1;2\n", "line 3 is not a time and a value: '1;2'"),
    ("a.at2", AT2.format("NPTS= 4, DT= .005"), "promises 4 values, it has 3"),
    ("a.at2", "one line", "does not say NPTS= and DT="),
    ("a.txt", "0,1", "unknown kind of file '.txt'"),
    ("a.csv", "time,value\n", "holds no times and values"),
    ("a.csv", "0,1\n0.5,nan\n1,2\n", "value 2, nan at 0.5 s, is not a finite number"),
])
def test_files_that_are_no_records_are_refused(tmp_path, name, text, reason):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=reason):
        read_record(tmp_path / name)


def scene(folder, **boundary):
    return parse_scene({
        "dimension": 2, "spacing": 1.0, "gravity": [0, -9.81],
        "materials": {"soil": {"model": "elastic", "density": 1800, "bulk_modulus": 25e6, "shear_modulus": 15e6}},
        "bodies": [{"name": "b", "material": "soil", "shape": {"type": "box", "lower": [0, 0], "upper": [4, 8]}}],
        "boundaries": {"base": {"where": {"upper": [None, 1]}, **boundary}},
        "stages": [{"name": "settle", "type": "relax", "boundaries": ["base"] if "absorb" in boundary else []},
                   {"name": "shake", "type": "dynamics", "duration": 1.0, "boundaries": ["base"]}],
    }, folder)  # fmt: skip


def test_a_history_may_be_a_file(tmp_path):
    (tmp_path / "v.csv").write_text("# velocity\ntime,velocity\n0,0\n1,2\n\n3,0\n")
    history = scene(tmp_path, velocity={"x": {"file": "v.csv", "scale": 0.5}}).boundaries["base"].velocity.x
    assert history.times == (0.0, 1.0, 3.0) and history.values == (0.0, 1.0, 0.0)
    with pytest.raises(InputError, match=r"nothing.csv: the file cannot be read"):
        scene(tmp_path, velocity={"x": {"file": "nothing.csv"}})


def test_a_record_with_drift_is_refused_with_its_size_or_corrected(tmp_path):
    times = np.linspace(0.0, 10.0, 501)
    values = np.sin(4.0 * np.pi * times) + 0.01
    x = {"times": times.tolist(), "values": values.tolist()}
    with pytest.raises(InputError, match=r"(?s)acceleration.x: has a drift: its end is \d+% of its largest velocity"):
        scene(tmp_path, acceleration={"x": x})
    assert scene(tmp_path, acceleration={"x": x, "baseline": "correct"})
    with pytest.raises(InputError, match=r"(?s)absorb.acceleration.x: has a drift"):
        scene(tmp_path, absorb={"side": "y-", "acceleration": {"x": x}})


def test_what_absorbs_holds_nothing_in_relaxation(tmp_path):
    with pytest.raises(InputError, match=r"(?s)stages\[0\].boundaries\[0\]: absorbs waves"):
        scene(tmp_path, absorb={"side": "y-"})
