"""The report page."""

import argparse
import base64
import re
from html.parser import HTMLParser

import pytest

from periporo.io.pictures import report

pytest.importorskip("matplotlib")


class Page(HTMLParser):
    """Collects the rows of tables, the headings and the pictures; notes tags that are not closed."""

    def __init__(self, text):
        super().__init__()
        self.rows, self.headings, self.pictures, self.open = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.pictures.append(dict(attributes)["src"])
        elif tag != "meta":
            self.open.append(tag)
        if tag == "tr":
            self.rows.append([])

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, text):
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1].append(text)
        elif self.open and self.open[-1] == "h2":
            self.headings.append(text)


def test_page_holds_everything_by_itself(tmp_path, heap):
    path = heap(tmp_path / "run.h5")
    file = report.write_report(path)
    assert file == tmp_path / "run_report.html"
    text = file.read_text(encoding="utf-8")
    page = Page(text)
    assert page.open == []
    assert page.headings == ["Deposit", "Histories", "Energy", "Energy ledger in numbers",
                             "Histories in numbers", "Timing", "Run", "Configuration"]
    assert len(page.pictures) == 3
    for source in page.pictures:
        kind, data = source.split(",")
        assert kind == "data:image/png;base64" and base64.b64decode(data).startswith(b"\x89PNG")
    assert not re.search(r'(src|href)="(?!data:)', text)  # nothing from outside
    assert ["height", "0.5", "0.3", "0.3", "0.5", "m"] in page.rows
    assert ["kinetic energy", "0", "20", "0", "20", "J"] in page.rows
    assert ["bonds", "3", "75"] in page.rows and ["output", "1", "25"] in page.rows
    assert ["version", "1.2"] in page.rows
    assert "50 points, 3 outputs, 0 to 2 s, 20 steps" in text
    assert "&quot;spacing&quot;: 0.1" in text
    assert set(tmp_path.iterdir()) == {path, file}  # no pictures left behind


def test_text_is_escaped(tmp_path, heap):
    path = heap(tmp_path / "a<b>.h5", histories=False)
    parser = argparse.ArgumentParser()
    report.add_arguments(parser)
    out = tmp_path / "page.html"
    words = [str(path), "--out", str(out), "--animate", "--field", "velocity"]
    assert report.run(parser.parse_args(words)) == 0
    text = out.read_text()
    assert "a&lt;b&gt;" in text and "a<b>" not in text
    assert ("data:image/gif" in text) != ("data:video/mp4" in text)
    assert "ledger" not in text
