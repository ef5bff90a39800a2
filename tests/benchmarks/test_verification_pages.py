"""The pages of verification figures: what is measured anew takes its place, the rest stays."""

from benchmarks import verification

ROWS = ["| point_state | error | 0.1 | <= 1 | yes | 3 |"]


def test_sections_are_put_in_their_places(tmp_path, monkeypatch):
    monkeypatch.setattr(verification, "FOLDER", tmp_path)
    first = {name: verification.section(name, [("a thing", ROWS)]) for name in ("V15", "V2", "V1")}
    verification.write(first)
    verification.write({"V2": verification.section("V2", [("another thing", ROWS)])})
    invariants, ground = (tmp_path / f"{page}.md" for page in ("invariants", "ground"))
    assert ground.read_text().endswith(first["V15"])
    text = invariants.read_text()
    assert first["V1"] in text and "Another thing." in text and "V15" not in text
    assert text.count("A thing.") == 1 and text.index("## V1\n") < text.index("## V2\n")
