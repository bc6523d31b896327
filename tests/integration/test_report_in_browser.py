"""The report of an emulated trial, made by the command and opened in headless Chromium."""

import html
import re
import shutil
import subprocess
from urllib.parse import urlparse

import pytest

from host.cli import main
from tests.emulated_submission import write_trials
from tests.waiting import HANG_S

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
HOSTILE = "<script>document.title='taken'</script><img src=http://192.0.2.1/x onerror=alert(1)> \\u001b[31mred"
OWN_SERVICES = re.compile(r"(^|\.)(google|googleapis|gstatic|gvt1|google-analytics)\.com$")
"""What the browser itself calls, whatever page it shows."""
FLAGS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-default-apps",
    "--disable-extensions",
    "--hide-scrollbars",
    "--window-size=1200,3000",
    "--virtual-time-budget=20000",
    "--enable-logging=stderr",
]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (path,), truths = write_trials(folder / "trials", cycles=5)
    card = path.with_suffix(".toml")
    lines = card.read_text().splitlines()
    lines = [f'comments = "{HOSTILE}"' if line.startswith("comments") else line for line in lines]
    card.write_text("\n".join(lines))
    assert main(["report", str(path), "--out", str(folder / "s.zip"), "--title", "A trial of <b>one</b> object"]) == 0
    return folder, truths[path.name]


def test_the_score_is_near_the_built_in_drift_and_the_cards_are_complete(made, capsys):
    from host.submission.bundle import read_bundle
    from host.submission.manifest import parse_submission

    folder, truth = made
    submission = parse_submission(read_bundle(folder / "s.zip")["submission.json"])
    (trial,) = submission.trials
    assert submission.complete
    assert trial.theta_bar_deg == pytest.approx(truth["theta_bar_deg"], abs=0.15)  # the sensor's heading drift is in it
    assert trial.cards["object"]["mass_g"] == 142.5
    assert main(["verify", str(folder / "s.zip"), "--no-drawings"]) == 0
    assert "equal" in capsys.readouterr().out


def test_the_page_draws_its_3d_figure_offline_and_shows_foreign_text_as_text(made):
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        pytest.skip("no Chromium is installed")
    folder, _ = made
    subprocess.run(["unzip", "-q", "-o", "s.zip", "report.html"], cwd=folder, check=True, timeout=HANG_S)
    page, log, picture = folder / "report.html", folder / "net.json", folder / "page.png"
    common = [browser, *FLAGS, "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={folder / 'profile'}"]
    dom = subprocess.run(
        [*common, f"--log-net-log={log}", f"--screenshot={picture}", "--dump-dom", page.as_uri()],
        capture_output=True,
        text=True,
        timeout=HANG_S,
        check=True,
    )
    console = [line for line in dom.stderr.splitlines() if ":CONSOLE" in line]
    complaints = [line for line in console if "GL Driver Message" not in line and "willReadFrequently" not in line]
    assert complaints == []
    shown = (
        dom.stdout
        or subprocess.run(
            [*common, "--dump-dom", page.as_uri()], capture_output=True, text=True, timeout=HANG_S, check=True
        ).stdout
    )
    assert re.search(r'<html[^>]* data-drawn="1"', shown), shown[:300]
    assert "data-failed" not in shown[:500]
    assert "<canvas" in shown
    assert "<title>A trial of &lt;b&gt;one&lt;/b&gt; object</title>" in shown
    assert html.escape("<script>document.title='taken'</script>", quote=False) in shown
    assert "\x1b" not in shown
    asked = {urlparse(url).hostname or "" for url in re.findall(r'"url":"(https?://[^"]+)"', log.read_text())}
    assert {host for host in asked if not OWN_SERVICES.search(host)} == set()
    if picture.is_file():
        assert coloured_pixels(picture) > 2000


def coloured_pixels(picture):
    """Pixels of the end points' vermilion: the cloud was drawn, not a white box."""
    import numpy as np
    from matplotlib.image import imread

    image = imread(picture)[:, :, :3]
    return int((np.abs(image - np.array([0xD5, 0x5E, 0x00]) / 255).max(axis=2) < 0.08).sum())
