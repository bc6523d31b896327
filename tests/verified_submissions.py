"""Submissions to forge: made once, and verified without making again what the same sources gave before."""

from dataclasses import replace

from msgspec import structs

import host.submission.verification
from analysis.formats.named_csv import csv_text
from host.cards.definitions import parse_cards
from host.submission.bundle import MANIFEST, manifest_text
from host.submission.contents import build_submission
from host.submission.made_with import made_with
from host.submission.manifest import submission_json
from host.submission.source import TrialSource
from tests.scored_trials import scored

CARDS = """
[object]
type = "cube"
dimensions = {{ x_mm = 60, y_mm = 60, z_mm = 60 }}
mass_g = 180.5
com_mm = [0, 0, 2.5]
[hand]
model = "T42"
aperture_mm = 90
[trial]
motion = "{motion}"
"""


def trial_source(name="0.csv", motion="roll", **settings):
    """One recorded trial with its cards."""
    series, _ = scored(**{"cycles": 5, "slip_deg": 0.0, **settings})
    return TrialSource({name: csv_text(series).encode()}, parse_cards(CARDS.format(motion=motion)))


def remember(monkeypatch, *known):
    """Let verifying find what it would make again in ``known``: pairs of sources and what they gave.

    Other sources, and what another release of the program is claimed to have made, are made again indeed.
    """

    def remembered(found, *, title, versions, drawings):
        for sources, made in known:
            ours = made.submission.made_with
            same = sorted(found, key=lambda source: source.file_name) == sources and title == made.submission.title
            if not same or ("report.pdf" in made.files) != drawings or versions.get("rotdrift") != ours["rotdrift"]:
                continue
            if ("pyarrow" in versions and "pyarrow" in made_with()) != ("pyarrow" in ours):
                continue
            # Only what it was made with is written otherwise.
            claimed = submission_json(structs.replace(made.submission, made_with=versions))
            return replace(made, files={**made.files, "submission.json": claimed})
        return build_submission(found, title=title, versions=versions, drawings=drawings)

    monkeypatch.setattr(host.submission.verification, "build_submission", remembered)


def under_new_manifest(files):
    """The files with checksums that fit them, as anybody who alters a file would write them."""
    return {**files, MANIFEST: manifest_text(files).encode()}
