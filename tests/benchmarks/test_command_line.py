"""The command line of the benchmarks: a list with a line for each, and one that runs."""

import importlib

import pytest

from benchmarks.__main__ import benchmarks, main


def test_the_list_has_a_line_for_each(capsys):
    assert main([]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(benchmarks()) > 25
    for name, line in benchmarks().items():
        assert f"{name} " in "\n".join(lines) and line.endswith((".", "?")) and len(line) < 120, name


@pytest.mark.parametrize("name", benchmarks())
def test_each_explains_its_options(name, capsys):
    with pytest.raises(SystemExit) as end:
        importlib.import_module(f"benchmarks.{name}").main(["--help"])
    assert end.value.code == 0 and f"usage: python -m benchmarks {name}" in capsys.readouterr().out


def test_a_name_that_is_not_there_is_answered_with_the_nearest(capsys):
    assert main(["step_tme"]) == 2
    assert "did you mean step_time" in capsys.readouterr().err


def test_one_runs_with_its_options(capsys):
    assert main(["material_rows", "50"]) is None
    assert "elastic" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["material_rows", "--no-such-option"])
