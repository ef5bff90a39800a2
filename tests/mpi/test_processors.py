"""Ranks on different processors: refused, or compiled for what they have in common."""

import platform
from pathlib import Path

import h5py
import pytest
import yaml

MIXED = Path(__file__).parent / "mixed.py"


@pytest.mark.skipif(platform.machine() != "x86_64", reason="names of processors are those of x86")
def test_ranks_on_different_processors_are_refused_or_agree(mpirun, scene_of, tmp_path):
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(scene_of(counts=(6, 4))))
    done = mpirun(2, MIXED, "own.yaml", "--no-plot", folder=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr
    text = " ".join(done.stderr.split())
    assert "cpu_target: ranks compile for different processors" in text and "rank 1 for x86-64" in text
    assert "give 'cpu_target: common'" in text and not (tmp_path / "own.vtkhdf").exists()
    (tmp_path / "common.yaml").write_text(yaml.safe_dump(scene_of(counts=(6, 4)) | {"cpu_target": "common"}))
    done = mpirun(2, MIXED, "common.yaml", "--no-plot", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    with h5py.File(tmp_path / "common.vtkhdf") as file:
        assert file["Run"].attrs["cpu"] == "generic" and file["Run"].attrs["ranks"] == 2
