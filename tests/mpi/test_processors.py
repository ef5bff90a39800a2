"""Ranks on different processors: refused, or compiled for what they have in common."""

import platform
from pathlib import Path

import pytest
import yaml

MIXED = Path(__file__).parent / "mixed.py"


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of processors are those of x86")
def test_ranks_on_different_processors_are_refused_or_agree(mpirun, scene_of, tmp_path):
    """Those that agree go on, to compile, and to find that the block reaches into the floor."""
    plane = {"type": "plane", "point": [0, 0.004], "normal": [0, 1], "friction": 0.5}
    for name, keys in (("own", {}), ("common", {"cpu_target": "common", "contacts": [plane]})):
        (tmp_path / f"{name}.yaml").write_text(yaml.safe_dump(scene_of(counts=(6, 4), **keys)))
    done = mpirun(2, MIXED, "own.yaml", "common.yaml", folder=tmp_path)
    assert done.returncode == 0 and "own.yaml 2 x86-64" in done.stdout, done.stderr
    assert done.stdout.count("common.yaml 2 generic") == 2
    text = " ".join(done.stderr.split())
    assert "cpu_target: ranks compile for different processors" in text and "rank 1 for x86-64" in text
    assert "give 'cpu_target: common'" in text and "Traceback" not in text
    assert text.count("reaches 0.004 m into this plane") == 1
