"""``rotdrift score`` as a person types it, on the benchmark authors' recordings."""

import json
import os
from pathlib import Path

import pytest

from host.cli import main

FOLDER = Path(os.environ.get("ROTDRIFT_RECORDINGS", Path(__file__).parents[3] / "shared" / "recordings"))

pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(not (FOLDER / "endpoints.json").is_file(), reason=f"no recordings at {FOLDER}"),
]


def known():
    path = FOLDER / "endpoints.json"
    return json.loads(path.read_text())["recordings"] if path.is_file() else {}


@pytest.mark.parametrize("name", sorted(known()))
def test_the_authors_end_points_given_by_row_give_the_cards_score(name, capsys, tmp_path):
    truth = known()[name]
    (path,) = FOLDER.glob(f"*/{name}")
    rows = ",".join(map(str, truth["endpoints_row"]))
    assert main(["score", str(path), "--endpoints", rows, "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["theta_bar_deg"] == pytest.approx(truth["theta_bar_deg"], abs=1e-4)
    assert [point["row"] for point in result["endpoints"]] == truth["endpoints_row"]
    assert result["n_endpoints"] == len(result["steps_deg"]) + 1 == len(truth["endpoints_row"])

    listed = tmp_path / "endpoints.csv"
    listed.write_text("row\n" + "\n".join(map(str, truth["endpoints_row"])) + "\n")
    assert main(["score", str(path), "--endpoints", str(listed), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["theta_bar_deg"] == result["theta_bar_deg"]


def test_a_grasp_and_release_trial_is_not_claimed(capsys):
    (path,) = FOLDER.glob("*/*_GR_*.csv")
    assert main(["score", str(path)]) == 1
    assert "grasp-and-release" in capsys.readouterr().out


def test_a_row_that_is_not_there_is_wrong_use(capsys):
    name = sorted(known())[0]
    (path,) = FOLDER.glob(f"*/{name}")
    assert main(["score", str(path), "--endpoints", "1,2,3,99999999"]) == 2
    assert "99999999" in capsys.readouterr().err
