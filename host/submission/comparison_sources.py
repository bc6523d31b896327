"""Submissions and result files as sources of a comparison."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from analysis.reporting.comparison import ComparedSource
from analysis.reporting.tables import TrialFigure
from analysis.scoring.recorded_parts import RecordedObject
from analysis.scoring.result import RESULT_FORMAT, Result, parse_result
from host.errors import FileError, UsageError, unreadable
from host.submission.archive import BundleError
from host.submission.bundle import check_manifest, read_bundle, read_folder
from host.submission.manifest import CARD, CONVENTIONS, SCORE_VERSION, Submission, parse_submission
from host.submission.verification import verify_files
from host.text import plain

MAX_RESULT_BYTES = 64 * 2**20


def load_sources(paths: Sequence[Path], *, verify: bool = True) -> list[ComparedSource]:
    """Read submissions (zip or unpacked), results (JSON), and folders of these.

    Submissions are scored again from their recordings; without ``verify``, and where that is not possible, the source
    states why it is not verified. Figures and reports are not made: nothing of them is compared.

    Raises
    ------
    UsageError
        There is nothing to compare in a folder.
    FileError
        A file is neither, was altered, is refused, or is not what its recordings give.
    """
    sources = []
    for path in paths:
        if path.is_dir() and not (path / "submission.json").is_file():
            inside = sorted([*path.glob("*.zip"), *path.glob("*.json")])
            if not inside:
                raise UsageError(f"{path} holds neither submissions (.zip) nor results (.json)", "give others")
            sources += [_load(item, verify=verify) for item in inside]
        else:
            sources.append(_load(path, verify=verify))
    return sources


def _load(path: Path, *, verify: bool) -> ComparedSource:
    try:
        if path.is_dir() or path.suffix.lower() != ".json":
            files = read_folder(path) if path.is_dir() else read_bundle(path)
            altered = check_manifest(files)
            if altered:
                raise FileError(f"{path} was altered ({altered[0]})", "see `rotdrift verify`")
            submission = parse_submission(files.get("submission.json", b""))
            return _from_submission(path.stem, submission, _unverified(path, files, submission, verify=verify))
        if path.stat().st_size > MAX_RESULT_BYTES:
            raise FileError(f"{path} is too large for a result", "give what `rotdrift score --json` printed")
        return _from_result(path.stem, parse_result(path.read_bytes()))
    except OSError as error:
        raise unreadable(path, error) from error
    except (BundleError, ValueError, TypeError, KeyError, RecursionError) as error:
        raise FileError(
            f"{path} is neither a submission nor a result ({plain(error)})",
            "give what `rotdrift report` or `rotdrift score --json` wrote",
        ) from error


def _unverified(path: Path, files: Mapping[str, bytes], submission: Submission, *, verify: bool) -> str:
    """Return why the numbers of a submission were not made again; empty where they were, and came out equal.

    Raises
    ------
    FileError
        They came out otherwise.
    """
    if not verify:
        return "left out on request"
    if submission.score_version != SCORE_VERSION:
        return f"made by score version {plain(submission.score_version)}, this program computes {SCORE_VERSION}"
    found = verify_files(files, drawings=False)
    if not found.equal:
        raise FileError(f"{path} is not what its recordings give ({found.differences[0]})", "see `rotdrift verify`")
    return ""


def _from_submission(name: str, submission: Submission, unverified: str) -> ComparedSource:
    rules = {"card": submission.card, "score version": submission.score_version, **submission.conventions}
    trials = tuple(
        _checked(
            plain(trial.hand),
            plain(trial.object),
            plain(trial.motion),
            trial.theta_bar_deg if trial.valid else None,
            trial.interval_deg,
        )
        for trial in submission.trials
    )
    notes = [] if submission.complete else ["the submission is incomplete: its cards lack required fields"]
    unknown = sum(trial.valid and trial.sensor_per_cycle_deg is None for trial in submission.trials)
    if unknown:
        notes.append(
            f"{unknown} of {len(trials)} trials without a static baseline: what the sensor turns by itself is in "
            "θ̄ and not in its interval"
        )
    note = "; ".join(notes)
    return ComparedSource(plain(name), tuple((plain(k), plain(v)) for k, v in rules.items()), trials, note, unverified)


def _from_result(name: str, result: Result) -> ComparedSource:
    version = SCORE_VERSION if result.format == RESULT_FORMAT else f"result format {result.format}"
    thing = result.object.name if isinstance(result.object, RecordedObject) and result.object.name else "unknown object"
    trial = _checked(
        "unknown hand", plain(thing), f"unknown motion ({plain(name)})", result.theta_bar_deg, result.interval_deg
    )
    rules = {"card": CARD, "score version": version, **CONVENTIONS}
    return ComparedSource(
        plain(name),
        tuple(rules.items()),
        (trial,),
        "a bare result: it has no cards",
        "a bare result: its recording is not in it",
    )


def _checked(
    hand: str, thing: str, motion: str, theta_bar_deg: float | None, interval: tuple[float, float] | None
) -> TrialFigure:
    """Refuse numbers that no score can have: they would spoil every table and figure."""
    low, high = interval or (0.0, 180.0)
    if theta_bar_deg is not None and not 0.0 <= theta_bar_deg <= 180.0:
        raise ValueError(f"θ̄ = {theta_bar_deg:g}° is not a valid rotation drift")
    if not 0.0 <= low <= high <= 1000.0:
        raise ValueError(f"{low:g} … {high:g}° is not a valid interval of one")
    return TrialFigure(hand, thing, motion, theta_bar_deg, interval)
