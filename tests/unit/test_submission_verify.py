"""Submissions: complete, the same bytes for the same sources, and every single alteration found by verifying."""

import json
import tomllib

import numpy as np
import pytest
from msgspec import structs

from analysis.formats import write_series
from analysis.formats.named_csv import csv_text
from host.cards.definitions import Cards, parse_cards
from host.errors import FileError, UsageError
from host.submission.bundle import MANIFEST, bundle_bytes, manifest_text
from host.submission.contents import build_submission
from host.submission.made_with import is_drawn, made_with
from host.submission.manifest import parse_submission, submission_schema
from host.submission.source import Choices, TrialSource, load_source
from host.submission.trial_labels import trial_labels
from host.submission.verification import verify_bundle
from tests.command_line import rotdrift
from tests.recorded_trials import scenario, virtual_chunks, write_recording
from tests.scored_trials import scored

OLDER_LINK = ("uri", "crc_errors", "malformed", "unknown_types", "skipped_bytes", "resets", "reconnects")

CARDS = parse_cards("""
[object]
type = "cube"
dimensions = { x_mm = 60, y_mm = 60, z_mm = 60 }
surface = "smooth, 100 % & <b>"
mass_g = 180
com_mm = [0, 0, 2.5]
weights = []
[hand]
model = "T42"
aperture_mm = 90
control_mode = "open loop"
[trial]
motion = "roll"
comments = "fine"
""")


def source(name="roll.csv", cards=CARDS, **settings):
    series, _ = scored(**{"cycles": 5, "slip_deg": 0.0, **settings})
    return TrialSource({name: csv_text(series).encode()}, cards)


@pytest.fixture(scope="module")
def sources():
    pitch = parse_cards("[hand]\nmodel = 'T42'\n[trial]\nmotion = 'pitch'")
    return [source(), source("again.csv", seed=1), source("pitch.csv", pitch, drift_deg=0.2)]


@pytest.fixture(scope="module")
def files(sources):
    return build_submission(sources, drawings=False).files


def pack(path, files):
    path.write_bytes(bundle_bytes({name: content for name, content in files.items() if name != MANIFEST}))
    return path


def test_order_does_not_matter_and_the_same_sources_give_the_same_bytes(sources, files):
    assert build_submission(sources[::-1], drawings=False).files == files


def test_the_submission_states_everything_and_pools_only_repeats(files):
    submission = parse_submission(files["submission.json"])
    assert [trial.id for trial in submission.trials] == [
        "t42--cube-60-x-60-x-60-mm--roll--01",
        "t42--cube-60-x-60-x-60-mm--roll--02",
        "t42--unknown-object--pitch--01",
    ]
    assert [(row.motion, row.n_valid, row.interval_kind) for row in submission.summary] == [
        ("roll", 2, "between trials"),
        ("pitch", 1, "within the trial"),
    ]
    values = [trial.theta_bar_deg for trial in submission.trials]
    assert submission.summary[0].theta_bar_mean_deg == pytest.approx((values[0] + values[1]) / 2)
    assert not submission.complete
    assert submission.trials[0].missing == []
    assert "object.mass_g" in submission.trials[2].missing


def test_every_trial_has_its_files_and_they_agree(files):
    folder = "trials/t42--cube-60-x-60-x-60-mm--roll--01/"
    names = {name.removeprefix(folder) for name in files if name.startswith(folder)}
    assert names >= {
        "result.json", "endpoints.csv", "steps.csv", "samples.csv", "samples.parquet", "cards.toml", "choices.json",
    }  # fmt: skip
    result = json.loads(files[folder + "result.json"])
    steps = [float(line.split(",")[1]) for line in files[folder + "steps.csv"].decode().splitlines()[1:]]
    assert steps == result["steps_deg"]
    assert files[folder + "endpoints.csv"].decode().count("\n") == result["n_endpoints"] + 1
    assert tomllib.loads(files[folder + "cards.toml"].decode())["object"]["mass_g"] == 180
    assert "/tmp" not in files[folder + "result.json"].decode()


def test_the_summary_stands_in_three_languages(files):
    assert files["summary.csv"].decode().startswith("hand,object,motion,theta_bar_mean_deg,")
    assert "| T42 | cube 60 × 60 × 60 mm | roll |" in files["summary.md"].decode()
    latex = files["summary.tex"].decode()
    assert "\\toprule" in latex
    assert "60 $\\times$ 60" in latex
    assert latex.count("\\\\") == 3


def test_recordings_of_which_nothing_is_known_are_not_pooled():
    built = build_submission([source("a.csv", Cards()), source("b.csv", Cards(), seed=1)], drawings=False)
    assert [row.n_trials for row in built.submission.summary] == [1, 1]


def test_the_same_recording_twice_is_refused():
    with pytest.raises(UsageError, match=r"a\.csv and b\.csv are the same recording"):
        build_submission([source("a.csv"), source("b.csv")], drawings=False)


def test_a_ros_2_bag_is_a_recording_too(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is not installed")
    series, _ = scored(cycles=5, slip_deg=0.0)
    write_series(series, tmp_path / "roll", "ros2")
    bag = load_source(tmp_path / "roll", CARDS, Choices())
    assert bag.n_bytes == sum(place.stat().st_size for place in (tmp_path / "roll").iterdir())
    built = build_submission([bag], drawings=False)
    (trial,) = built.submission.trials
    assert trial.theta_bar_deg == pytest.approx(0.8, abs=0.05)
    assert f"trials/{trial.id}/raw/roll/metadata.yaml" in built.files
    assert verify_bundle(pack(tmp_path / "a.zip", built.files), drawings=False).equal
    (tmp_path / "roll" / "link").symlink_to("/etc/passwd")
    with pytest.raises(UsageError, match="does not belong in a ROS 2 bag"):
        load_source(tmp_path / "roll", CARDS, Choices())
    (tmp_path / "empty").mkdir()
    with pytest.raises(UsageError, match=r"without metadata\.yaml"):
        load_source(tmp_path / "empty", CARDS, Choices())


def changed(table, **values):
    return structs.replace(CARDS, **{table: structs.replace(getattr(CARDS, table), **values)})


def test_only_trials_whose_cards_agree_are_repeats():
    rough = changed("object", surface="rough")
    closed = changed("hand", control_mode="closed loop")
    twin = changed("trial", comments="another day")
    labels = trial_labels([CARDS, rough, closed, twin], ["a", "b", "c", "d"])
    thing = "cube 60 × 60 × 60 mm"
    assert labels == [
        ("T42 (open loop)", f"{thing} (smooth, 100 % & <b>)", "roll"),
        ("T42", f"{thing} (rough)", "roll"),
        ("T42 (closed loop)", f"{thing} (smooth, 100 % & <b>)", "roll"),
        ("T42 (open loop)", f"{thing} (smooth, 100 % & <b>)", "roll"),
    ]
    # Other set points for another motion are no other hand.
    other = structs.replace(changed("hand", set_points="both"), trial=structs.replace(CARDS.trial, motion="pitch"))
    assert [hand for hand, _, _ in trial_labels([CARDS, other], ["a", "b"])] == ["T42", "T42"]
    assert len(set(trial_labels([Cards(), Cards()], ["a", "b"]))) == 2


def test_an_untouched_bundle_is_equal(files, tmp_path):
    found = verify_bundle(pack(tmp_path / "a.zip", files), drawings=False)
    assert (found.equal, found.altered, found.differences, found.n_trials) == (True, (), (), 3)


def test_the_finding_states_what_and_by_how_much(files, tmp_path):
    values = json.loads(files["submission.json"])
    before = values["trials"][0]["theta_bar_deg"]
    values["trials"][0]["theta_bar_deg"] = before - 0.25
    found = verify_bundle(
        pack(tmp_path / "a.zip", {**files, "submission.json": json.dumps(values).encode()}), drawings=False
    )
    (line,) = found.differences
    assert line.startswith("submission.json: trials[0].theta_bar_deg is ")
    assert line.endswith("(differs by -0.25)")


def test_a_hash_a_missing_and_an_added_file_are_found(files, tmp_path):
    text = manifest_text(files)
    tampered = text.replace(text[0], "0" if text[0] != "0" else "1", 1)
    folder = tmp_path / "open"
    for name, content in {**files, MANIFEST: tampered.encode()}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    assert len(verify_bundle(folder, drawings=False).altered) == 1
    less = {name: content for name, content in files.items() if not name.endswith("summary.md")}
    assert "summary.md is missing" in verify_bundle(pack(tmp_path / "a.zip", less), drawings=False).differences
    more = {**files, "extra.txt": b"x"}
    assert "extra.txt does not belong" in str(verify_bundle(pack(tmp_path / "b.zip", more), drawings=False).differences)


@pytest.mark.parametrize(
    "damage",
    [
        {"submission.json": b"{}"},
        {"submission.json": b"[" * 100_000},
        {"submission.json": None},
        {"trials/t42--unknown-object--pitch--01/choices.json": b"{"},
        {"trials/t42--unknown-object--pitch--01/choices.json": b'{"endpoint_kind": "row", "endpoint_values": [5, 2]}'},
        {"trials/t42--unknown-object--pitch--01/choices.json": b'{"from_s": 1e9, "to_s": 2e9}'},
        {"trials/t42--unknown-object--pitch--01/cards.toml": b"\xff"},
        {"trials/t42--unknown-object--pitch--01/raw/pitch.csv": b"nothing"},
        {"trials/t42--unknown-object--pitch--01/raw/pitch.csv": None},
        {"trials/t42--unknown-object--pitch--01/raw/other.csv": b"t_s,qw,qx,qy,qz"},
        {"trials/t42--unknown-object--pitch--01/raw/pitch.csv/in_a_folder.csv": b"t_s,qw,qx,qy,qz"},
        {"trials/t42--unknown-object--pitch--01/raw/a/b/c.csv": b"t_s,qw,qx,qy,qz"},
        {"trials/t42--unknown-object--pitch--01/baseline.toml": b"nonsense"},
    ],
)
def test_nonsense_inside_is_a_finding_and_never_a_crash(files, tmp_path, damage):
    changed = {**files, **damage}
    changed = {name: content for name, content in changed.items() if content is not None}
    found = verify_bundle(pack(tmp_path / "a.zip", changed), drawings=False)
    assert not found.equal
    assert len(found.differences) + len(found.altered) >= 1


def test_what_is_not_a_bundle_is_refused(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"PK")
    with pytest.raises(FileError):
        verify_bundle(tmp_path / "a.zip")
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "link").symlink_to("/etc/passwd")
    with pytest.raises(FileError, match="link"):
        verify_bundle(tmp_path / "folder")


def test_other_versions_are_named(sources, tmp_path):
    built = build_submission(sources[:1], drawings=False, versions={**made_with(), "matplotlib": "1.0"})
    found = verify_bundle(pack(tmp_path / "a.zip", built.files), drawings=False)
    assert found.equal
    assert "matplotlib 1.0 (here " in found.notes[0]


def test_keys_that_an_older_program_did_not_write_are_not_compared_and_its_numbers_are(tmp_path):
    trial = tmp_path / "trial.mcap"
    write_recording(trial, virtual_chunks(scenario(motion={"cycles": 4, "period_s": 1.6}), duration_s=9.0)[0])
    files = build_submission([load_source(trial, CARDS, Choices())], drawings=False).files
    name = next(name for name in files if name.endswith("/result.json"))
    whole = json.loads(files[name])

    def found(*removed, code=None, crc_errors=0):
        kept = {key: value for key, value in whole["link"].items() if key not in removed}
        result = {**whole, "link": {**kept, "crc_errors": crc_errors}}
        submission = json.loads(files["submission.json"])
        submission["made_with"] |= {} if code is None else {"code": code}
        changed = {
            **files,
            name: (json.dumps(result, indent=2, ensure_ascii=False) + "\n").encode(),
            "submission.json": (json.dumps(submission, indent=1, ensure_ascii=False) + "\n").encode(),
        }
        return verify_bundle(pack(tmp_path / "a.zip", changed), drawings=False)

    counters = [key for key in whole["link"] if key not in OLDER_LINK]
    assert "frames" in counters
    assert (found().equal, found().rounded, found().notes) == (True, (), ())
    older = found(*counters, code="0123456789ab")
    assert older.differences == ()
    assert older.uncompared == {name: "made with another code: numbers equal, words or keys are not"}
    assert any(note.startswith(f"{name}: ") and "; link.frames is missing" in note for note in older.notes)
    # The same program writes all of them, and no program another number.
    assert "link.frames is missing" in found("frames").differences[0]
    assert "link.crc_errors is 1, recomputed 0" in str(found(*counters, code="0", crc_errors=1).differences)


def test_chosen_end_points_travel_with_the_bundle(tmp_path):
    base = source()
    rows = tuple(float(700 + 400 * k) for k in range(5))
    chosen = TrialSource(base.raw, CARDS, Choices(endpoint_kind="row", endpoint_values=rows))
    built = build_submission([chosen], drawings=False)
    name = next(name for name in built.files if name.endswith("result.json"))
    result = json.loads(built.files[name])
    assert result["window"]["kind"] == "endpoints"
    assert [point["row"] for point in result["endpoints"]] == list(rows)
    assert verify_bundle(pack(tmp_path / "a.zip", built.files), drawings=False).equal


def test_the_published_schema_is_the_code_s_own():
    from pathlib import Path

    published = (Path(__file__).parents[2] / "docs" / "submission.schema.json").read_text("utf-8")
    assert published == submission_schema(), "renew it: see docs/submission.md"


def test_another_processor_gives_the_same_numbers_and_is_named_where_last_digits_differ(files, tmp_path):
    """Numpy without what this processor can do more than the first of its kind, in a process of its own."""
    found = np._core._multiarray_umath
    features = [name for name in found.__cpu_dispatch__ if found.__cpu_features__.get(name)]
    path = pack(tmp_path / "a.zip", files)
    done = rotdrift("verify", path, "--no-drawings", "--json", NPY_DISABLE_CPU_FEATURES=" ".join(features))
    assert done.returncode == 0, done.stdout + done.stderr
    values = json.loads(done.stdout)
    assert (values["equal"], values["differences"]) == (True, [])
    # Which digits differ depends on the processor; wherever bytes do, the file is named.
    assert all(name.endswith((".json", ".csv")) for name in values["rounded"])
    assert {name for name in values["uncompared"] if not is_drawn(name)} <= {
        name for name in files if name.endswith(".parquet")
    }
