"""The printed report: every text and number of the page on screen, set well, the same bytes in any process."""

import hashlib
import io
import os
import re
import subprocess
import sys
import unicodedata
from dataclasses import replace
from pathlib import Path

import pytest
from msgspec import structs
from pypdf import PdfReader

from analysis.reporting import wording
from analysis.reporting.figure_set import CAPTIONS, NamedFigure, draw_figures
from analysis.reporting.pdf import Pages, report_pdf
from analysis.reporting.trial_report import CardRow, CardTable
from analysis.scoring.summary import interval_text, trust_rows
from tests.scored_trials import trial_report

HOSTILE = "{nb} **bold** \0{nb}\0 \x1b[31mred 漢 <b> --x-- __y__"
HEADINGS = ("How far to trust it", "Cards", "Comments", "Methods", "Cycles", "Provenance", "Recorded point clouds")


@pytest.fixture(scope="module")
def trial():
    return trial_report(cycles=5, slip_deg=0.0)


@pytest.fixture(scope="module")
def figures(trial):
    return draw_figures(trial, ("png",))


def pdf(trials, figures, title="Submission"):
    forest = {"png": figures[0].files["png"]}
    drawn = {trial.id: figures for trial in trials}
    found = report_pdf(trials, title=title, version="0.1.0", drawn=drawn, forest=forest)
    return PdfReader(io.BytesIO(found))


def texts(reader):
    """Text of each page, spaces and line ends as one space."""
    return [" ".join(page.extract_text().split()) for page in reader.pages]


def squeezed(text):
    """A text without spaces: a line of a page may end between any two letters."""
    return "".join(unicodedata.normalize("NFC", text).split())


def test_every_text_and_number_of_the_report_is_printed(trial, figures):
    whole = squeezed("".join(texts(pdf([trial], figures))))
    expected = [
        trial.title,
        f"θ̄ = {trial.result.theta_bar_deg:.3f}° per cycle",
        f"95 % interval {interval_text(trial.result)}°; {trial.result.n_endpoints} end points",
        wording.ABOUT,
        wording.methods_text(trial),
        *(cell for row in trust_rows(trial.result) for cell in row),
        *(cell for row in wording.cycle_rows(trial) for cell in row),
        *(cell for row in trial.provenance for cell in row),
        *(text for card in trial.cards for row in card.rows for text in (row.label, row.value or "not given")),
        *(figure.caption for figure in figures),
        *HEADINGS,
    ]
    for text in expected:
        assert squeezed(text) in whole, text


def test_every_figure_is_there_once_and_no_larger_than_it_was_drawn(trial, figures):
    reader = pdf([trial], figures)
    assert [figure.name for figure in figures] == [name for name in CAPTIONS if name != "translation_cloud"]
    assert sum(len(page.images) for page in reader.pages) == len(figures)
    largest = sum(len(figure.files["png"]) for figure in figures) + 100_000
    assert len(report_pdf([trial], title="x", version="0", drawn={trial.id: figures}, forest={})) < largest


def test_pages_are_numbered_and_name_the_report(trial, figures):
    trials = [replace(trial, id=f"t42--cube--roll--{number:02d}") for number in (1, 2, 3)]
    pages = texts(pdf(trials, figures, title="A title"))
    assert len(pages) >= 4
    for number, page in enumerate(pages, start=1):
        assert f"rotdrift 0.1.0 · {wording.CARD_REFERENCE} · page {number} of {len(pages)}" in page
        assert page.count("A title") == 1
    assert "3 trials" in pages[0]
    assert "Repeats of one hand, object and motion pooled" in pages[0]
    assert all(trial.id in pages[0] for trial in trials)


def test_the_outline_leads_to_every_trial(trial, figures):
    outline = pdf([trial], figures).outline
    assert [entry.title for entry in outline if not isinstance(entry, list)][-1] == trial.title
    (parts,) = [entry for entry in outline if isinstance(entry, list)]
    assert [entry.title for entry in parts] == [*HEADINGS[:-1], "Recorded point clouds with end points, and figures"]


@pytest.mark.parametrize("n_lines", range(0, 45, 3))
def test_a_heading_stays_with_what_follows(trial, figures, n_lines):
    comments = "\n".join(f"line {number}" for number in range(n_lines)) or "none"
    pages = [page.extract_text().splitlines() for page in pdf([replace(trial, comments=comments)], figures[:1]).pages]
    for page in pages:
        body = [line.strip() for line in page if line.strip() and "· page" not in line]
        assert body[-1] not in HEADINGS, page


def test_the_head_of_a_table_stands_on_every_page_and_no_row_is_lost(figures):
    long = trial_report(cycles=150, slip_deg=0.0)
    pages = texts(pdf([long], figures[:1]))
    head = " ".join(wording.CYCLE_COLUMNS)
    rows = [" ".join(filter(None, row)) for row in wording.cycle_rows(long)]
    having = [page for page in pages if any(row in page for row in rows)]
    assert len(having) >= 3
    assert all(page.count(head) == 1 for page in having)
    assert all(sum(row in page for page in pages) == 1 for row in rows)


def test_a_cell_longer_than_a_page_is_set_on_several(trial, figures):
    words = [f"word{number}" for number in range(3000)]
    cards = (CardTable("Object", (CardRow("surface", " ".join(words)), CardRow("mass", "", required=True))),)
    pages = texts(pdf([replace(trial, cards=cards)], figures[:1]))
    found = re.findall(r"word\d+", " ".join(pages))
    assert found == words
    assert sum("word" in page for page in pages) > 1
    assert any("mass MISSING" in page for page in pages)


def test_foreign_text_is_text(trial, figures):
    hostile = replace(trial, comments=HOSTILE, notes=(HOSTILE,), motion=HOSTILE)
    pages = texts(pdf([hostile], figures, title=HOSTILE * 9))
    whole = " ".join(pages)
    assert "{nb} **bold** �{nb}� �[31mred � <b> --x-- __y__" in whole
    assert all(f"of {len(pages)}" in page for page in pages)


def test_a_trial_without_score_states_why(trial, figures):
    result = structs.replace(
        trial.result, valid=False, theta_bar_deg=None, reasons=("nothing moves",), warnings=("odd",)
    )
    (first, *_) = texts(pdf([replace(trial, result=result, missing=("object.mass_g",))], figures))
    assert "No score is claimed. – nothing moves ! odd" in first
    assert "object.mass_g" in first
    assert "θ̄ = " not in first


def test_the_macron_stands_over_the_middle_of_the_theta():
    pages = Pages("title", "program")
    for font in pages.fonts.values():
        glyphs = font.ttfont["glyf"]
        theta, macron = glyphs["theta"], glyphs["uni0304"]
        macron.recalcBounds(glyphs)
        # A mark has no width: it is drawn from where the letter in front of it ended.
        start = font.ttfont["hmtx"]["theta"][0]
        assert abs((macron.xMin + macron.xMax) / 2 + start - (theta.xMin + theta.xMax) / 2) <= 1
        assert theta.yMax < macron.yMin < theta.yMax + font.ttfont["head"].unitsPerEm / 8
    pages.finished()


SCRIPT = """
import sys
from analysis.reporting.figure_set import NamedFigure
from analysis.reporting.pdf import report_pdf
from analysis.scoring.summary import interval_text, trust_rows
from tests.scored_trials import trial_report
trial = trial_report(cycles=5, slip_deg=0.0)
figures = (NamedFigure("a", "caption", {"png": open(sys.argv[1], "rb").read()}),)
data = report_pdf([trial], title="θ̄", version="0.1.0", drawn={trial.id: figures}, forest={})
print(__import__("hashlib").sha256(data).hexdigest())
"""


def test_two_processes_write_the_same_bytes(trial, figures, tmp_path):
    picture = tmp_path / "a.png"
    picture.write_bytes(figures[-1].files["png"])
    one = (NamedFigure("a", "caption", {"png": figures[-1].files["png"]}),)
    here = report_pdf([trial], title="θ̄", version="0.1.0", drawn={trial.id: one}, forest={})
    for seed, zone in (("0", "UTC"), ("7", "Asia/Kathmandu")):
        folder = tmp_path / seed
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(picture)],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), "PYTHONHASHSEED": seed, "TZ": zone},
            capture_output=True,
            text=True,
            timeout=120,
            check=True,
        )
        assert done.stdout.strip() == hashlib.sha256(here).hexdigest()
    assert set(re.findall(rb"D:\d{14}", here)) == {b"D:19800101000000"}
