"""What a run on several ranks says: one display with the imbalance, one refusal."""

import yaml

from periporo.io.output.results import open_results


def test_plain_lines_show_energies_speed_rebuilds_and_imbalance(mpirun, scene_of, tmp_path):
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_of(counts=(30, 8))))
    done = mpirun(2, "-m", "periporo.core.cli", "scene.yaml", "--no-plot", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    lines = [line for line in done.stdout.splitlines() if line.startswith("fall  ")]
    assert len(lines) >= 1
    for words in ("t = ", "step 1", "dt ", "kinetic ", "internal ", "residual ", "max speed ", "rebuilds 1"):
        assert words in lines[0]
    assert 1.0 <= float(lines[0].split("imbalance ")[1].split()[0]) < 1.3
    assert done.stdout.count("energy ledger") == 1


def test_a_refusal_while_building_comes_once_with_the_line(mpirun, scene_of, tmp_path):
    plane = {"type": "plane", "point": [0, 0.004], "normal": [0, 1], "friction": 0.5}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene_of(contacts=[plane])))
    done = mpirun(3, "-m", "periporo.core.cli", "scene.yaml", folder=tmp_path)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.count("reaches 0.004 m into this plane") == 1 and "scene.yaml: 1 problem\n  line" in done.stderr


def test_monitored_points_have_the_same_histories_on_any_number_of_ranks(mpirun, scene_of, tmp_path):
    scene = scene_of(counts=(30, 8)) | {"monitor": {"points": [[-0.1, 0.08], [0.1, 0.0]]}}
    found = []
    for ranks in (1, 3):
        (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene | {"output": {"file": f"on_{ranks}.vtkhdf"}}))
        done = mpirun(ranks, "-m", "periporo.core.cli", "scene.yaml", "--no-plot", "--quiet", folder=tmp_path)
        assert done.returncode == 0, done.stderr
        with open_results(tmp_path / f"on_{ranks}.vtkhdf") as results:
            found.append({n: results.history(n).tolist() for n in results.history_names if n.startswith("point_")})
    assert found[0] == found[1] and len(found[0]) == 8
    assert any(found[0]["point_0_velocity_y"]) and found[0]["point_0_velocity_y"] != found[0]["point_1_velocity_y"]
