"""The HTML and PDF reports: everything in one file, every foreign text shown as text, the same bytes every time."""

import base64
import gzip
import html.parser
import json
import re
from dataclasses import replace

import pytest
from msgspec import structs

from analysis.reporting.comparison import forest_bytes
from analysis.reporting.figure_set import draw_figures
from analysis.reporting.html import report_html
from analysis.reporting.interactive import BUNDLE, plotly_base64
from analysis.reporting.pdf import report_pdf
from analysis.reporting.tables import pool
from analysis.reporting.wording import cycle_rows, methods_text
from analysis.scoring.result_parts import ExcludedCycle
from analysis.scoring.trial import score_series
from tests.scored_trials import scored, trial_report

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(2)>\"'{{7*7}} \x1b[31mred & <b>"


@pytest.fixture(scope="module")
def trials():
    first = trial_report(cycles=5, slip_deg=0.0)
    return [first, replace(first, id="t42--cube--pitch--01", motion=HOSTILE, comments=HOSTILE, notes=(HOSTILE,))]


@pytest.fixture(scope="module")
def drawn(trials):
    figures = draw_figures(trials[0], ("png", "svg"))
    return {trial.id: figures for trial in trials}


@pytest.fixture(scope="module")
def forest(trials):
    pooled = pool([trial.figure for trial in trials])
    return {kind: forest_bytes(pooled, kind) for kind in ("svg", "png")}


@pytest.fixture(scope="module")
def page(trials, drawn, forest):
    return report_html(trials, title=f"Submission {HOSTILE}", version="0.1.0", drawn=drawn, forest=forest)


class Reader(html.parser.HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.tags, self.attributes, self.text, self.scripts = [], [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.attributes += attrs
        if tag == "script":
            self.scripts.append(dict(attrs))

    def handle_data(self, data):
        self.text.append(data)


def test_the_file_asks_nothing_of_the_network(page):
    reader = Reader(page)
    for name, value in reader.attributes:
        if name in {"src", "href", "data", "action", "poster", "srcset"}:
            assert value.startswith(("data:", "#")), (name, value[:60])
    assert "link" not in reader.tags
    assert "url(" not in page[: page.index("</style>")]
    policy = dict(reader.attributes)["content"] if False else re.search(r'Policy" content="([^"]+)"', page).group(1)
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy


def test_foreign_text_is_text_and_never_markup(page):
    reader = Reader(page)
    assert len(reader.scripts) == 4  # two scenes, plotly, our own
    assert not [name for name, _ in reader.attributes if name.startswith("on")]
    assert "b" in reader.tags  # our own; none of theirs:
    assert reader.tags.count("b") == page.count("<b>")
    assert "alert(1)" in "".join(reader.text)
    assert "{{7*7}}" in "".join(reader.text)
    assert "<script>alert" not in page


def test_the_score_comes_first_and_trust_before_the_figures(page, trials):
    value = f"θ̄ = {trials[0].result.theta_bar_deg:.3f}°"
    order = [
        page.index(word) for word in (value, "How far to trust it", "Recorded point clouds", "Methods", "Provenance")
    ]
    assert order == sorted(order)
    assert "This submission is incomplete" in page
    assert "object.mass_g" in page
    assert '<span class="missing">missing</span>' in page


def test_the_scenes_hold_the_end_points(page, trials):
    found = re.search(r'id="scenes-t42--cube--roll--01">(.*?)</script>', page, re.DOTALL).group(1)
    scenes = json.loads(found)
    assert [scene["title"] for scene in scenes] == [
        "Rotation (°)",
        "Its end points alone (°)",
        "Object axes on the sphere",
    ]
    points = scenes[0]["data"][-1]
    assert points["text"] == [str(k + 1) for k in range(trials[0].result.n_endpoints)]
    assert points["x"][0] == points["y"][0] == points["z"][0] == 0.0


def test_only_the_3d_bundle_of_plotly_is_embedded_and_its_size_is_stated(page):
    code = gzip.decompress(base64.b64decode(plotly_base64()))
    assert code.startswith(b"/**\n* plotly.js (gl3d - minified)")
    assert BUNDLE.stat().st_size < 600_000
    stated = float(re.search(r"Size: ([\d.]+) MB", page).group(1))
    assert stated == pytest.approx(len(page.encode()) / 1e6, abs=0.011)


def test_reports_are_the_same_every_time(page, trials, drawn, forest):
    again = report_html(trials, title=f"Submission {HOSTILE}", version="0.1.0", drawn=drawn, forest=forest)
    assert again == page
    once = report_pdf(trials, title=HOSTILE, version="0.1.0", drawn=drawn, forest=forest)
    assert once == report_pdf(trials, title=HOSTILE, version="0.1.0", drawn=drawn, forest=forest)
    assert once.startswith(b"%PDF")


def test_a_trial_without_score_claims_none(trials, drawn):
    refused = replace(
        trials[0],
        result=structs.replace(
            trials[0].result, valid=False, theta_bar_deg=None, reasons=("nothing moves",), steps_deg=()
        ),
    )
    page = report_html([refused], title="x", version="0", drawn=drawn, forest={})
    assert "No score is claimed" in page
    assert "nothing moves" in page
    assert "θ̄ = " not in Reader(page).text[0]
    assert 'class="value"' not in page
    assert report_pdf([refused], title="x", version="0", drawn=drawn, forest={}).startswith(b"%PDF")


def test_cycles_left_out_by_a_person_are_named_with_the_reason(trials):
    series, _ = scored(cycles=8, slip_cycle=4)
    score = score_series(series)
    found = [point.time_s for point in score.endpoints]
    left_out = score_series(series, excluded=[ExcludedCycle(found[3], found[4], "slipped <b>hard</b>")])
    report = replace(trials[0], series=series, result=left_out)
    stated = "The operator left out cycle 4 (slipped <b>hard</b>)"
    assert stated in methods_text(report)
    assert [row[0] for row in cycle_rows(report) if "left out by the operator: slipped" in row[-1]] == ["5"]


def test_the_shipped_plotly_is_the_one_its_licence_file_names():
    import hashlib

    stated = (BUNDLE.parent / "plotly-LICENSE.txt").read_text("utf-8")
    assert hashlib.sha256(gzip.decompress(BUNDLE.read_bytes())).hexdigest() in stated
