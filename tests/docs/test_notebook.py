"""The notebook of the documentation runs, and gives what is printed in it."""

import re
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import analysis
from analysis.series import OrientationSeries
from tests.scored_trials import scored
from tests.waiting import HANG_S

ROOT = Path(__file__).parents[2]


@pytest.mark.filterwarnings("ignore")  # the notebook's machinery warns of itself; nothing of ours runs in this process
def test_the_notebook_runs_and_gives_what_it_shows():
    nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
    nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
    stored = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    fresh = nbformat.read(ROOT / "docs" / "notebook.ipynb", as_version=4)
    for cell in fresh.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    nbclient.NotebookClient(fresh, timeout=int(HANG_S), resources={"metadata": {"path": str(ROOT)}}).execute()
    for was, now in zip(stored.cells, fresh.cells, strict=True):
        kinds = [(out.output_type, sorted(out.get("data", {})), out.get("text")) for out in now.get("outputs", [])]
        assert kinds == [
            (out.output_type, sorted(out.get("data", {})), out.get("text")) for out in was.get("outputs", [])
        ]
    everything = [out for cell in fresh.cells for out in cell.get("outputs", [])]
    assert everything[0]["text"] == "0.800\n"
    assert "θ̄ = 0.800°" in everything[1]["data"]["text/html"]
    assert sum("image/png" in out.get("data", {}) for out in everything) == 2


def test_the_three_functions_of_the_library(tmp_path):
    from analysis.formats.named_csv import csv_text

    series, result = scored(cycles=5, slip_deg=0.0)
    (tmp_path / "trial.csv").write_text(csv_text(series))
    loaded = analysis.load(tmp_path / "trial.csv")
    assert re.fullmatch(r"Result\(θ̄ = .{5}° \(.{5} … .{5}\), \d end points\)", repr(analysis.score(loaded)))
    assert analysis.score(loaded).theta_bar_deg == pytest.approx(result.theta_bar_deg, abs=1e-9)
    assert analysis.plot(analysis.score(loaded), loaded, "steps")._repr_png_().startswith(b"\x89PNG")
    with pytest.raises(ValueError, match="there is no figure 'pie'"):
        analysis.plot(analysis.score(loaded), loaded, "pie")
    with pytest.raises(ValueError, match="nothing to show"):
        analysis.plot(analysis.score(loaded), loaded, "translation_cloud")


def test_a_result_without_score_shows_why_and_foreign_text_as_text():
    n = 500
    still = OrientationSeries(np.arange(n) / 100, np.tile([1.0, 0, 0, 0], (n, 1)), np.arange(n))
    assert repr(analysis.score(still)).startswith("Result(no score: ")
    shown = analysis.score(still)._repr_html_()
    assert shown.startswith("<b>no score: ")
    hostile = structs.replace(analysis.score(still), reasons=("<script>",), warnings=("<script>",))
    assert "<script>" not in hostile._repr_html_()
