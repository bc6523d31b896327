"""What a submission is made from, trial by trial: the recording's bytes, the cards, and what a person chose.

The same sources give the same submission, on any machine with the same versions. A bundle holds its sources, so that
verifying it is making it again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

import msgspec

from analysis.endpoint_choice import EndpointChoice
from analysis.series import AnalysisError
from host.cards import Cards, dump_cards, parse_cards
from host.errors import FileError, UsageError, unreadable
from host.plain_text import plain
from host.result import ScoreOptions
from host.scored_recording import ReadOptions

MAX_RAW_BYTES = 2**30


class Choices(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a person chose for one trial; ``choices.json`` in the bundle."""

    from_s: float | None = None
    to_s: float | None = None
    endpoint_kind: str | None = None
    endpoint_values: tuple[float, ...] = ()
    endpoint_reasons: tuple[str, ...] = ()
    endpoint_source: str = ""
    columns: str | None = None
    rate_hz: float | None = None
    topic: str | None = None

    @property
    def reading(self) -> ReadOptions:
        """How to read the recording."""
        return ReadOptions(self.columns, self.rate_hz, self.topic)

    def options(self, baseline: Path | None) -> ScoreOptions:
        """How to score it."""
        window = None if self.from_s is None and self.to_s is None else (self.from_s, self.to_s)
        points = None
        if self.endpoint_kind is not None:
            points = EndpointChoice(
                self.endpoint_kind, self.endpoint_values, self.endpoint_reasons, self.endpoint_source or "given"
            )
        return ScoreOptions(window, points, baseline)

    def with_endpoints(self, choice: EndpointChoice) -> Choices:
        """Give the choices with these end points."""
        return msgspec.structs.replace(
            self,
            endpoint_kind=choice.kind,
            endpoint_values=choice.values,
            endpoint_reasons=choice.reasons,
            endpoint_source=Path(choice.source).name,
        )


@dataclass(frozen=True)
class TrialSource:
    """One trial before anything is computed."""

    file_name: str
    """Bare name of the recording."""
    data: bytes
    """The recording."""
    cards: Cards
    """As the card files say, before the object fills them."""
    choices: Choices = Choices()
    """What a person chose."""
    baseline: bytes | None = None
    """File of the static baseline."""

    def files(self) -> dict[str, bytes]:
        """Name these sources as they stand in the trial's folder of a bundle."""
        files = {
            f"raw/{self.file_name}": self.data,
            "cards.toml": dump_cards(self.cards).encode(),
            "choices.json": msgspec.json.format(msgspec.json.encode(self.choices), indent=1) + b"\n",
        }
        if self.baseline is not None:
            files["baseline.toml"] = self.baseline
        return files


def load_source(recording: Path, cards: Cards, choices: Choices, baseline: Path | None = None) -> TrialSource:
    """Read a trial's files.

    Raises
    ------
    UsageError
        The recording is a folder, or larger than a bundle may hold.
    FileError
        A file cannot be read.
    """
    if recording.is_dir():
        raise UsageError(
            f"{recording} is a folder; a submission holds single files",
            "convert it first: rotdrift convert FOLDER trial.csv",
        )
    try:
        if recording.stat().st_size > MAX_RAW_BYTES:
            raise UsageError(f"{recording} is larger than {MAX_RAW_BYTES // 2**20} MB", "cut it to the trial")
        data = recording.read_bytes()
        rest = None if baseline is None else baseline.read_bytes()
    except OSError as error:
        raise unreadable(error.filename, error) from error
    return TrialSource(safe_name(recording.name), data, cards, choices, rest)


def sources_in(files: Mapping[str, bytes]) -> dict[str, TrialSource]:
    """Find the sources of every trial in a bundle, by trial id.

    Raises
    ------
    ValueError
        A trial without exactly one recording, or cards or choices that are not such.
    """
    ids = sorted({name.split("/")[1] for name in files if name.startswith("trials/") and name.count("/") >= 2})
    found = {}
    for trial_id in ids:
        folder = f"trials/{trial_id}/"
        raw = [name for name in files if name.startswith(f"{folder}raw/")]
        if len(raw) != 1:
            raise ValueError(f"trial {trial_id} has {len(raw)} recordings, not one")
        try:
            cards = parse_cards(files[f"{folder}cards.toml"].decode("utf-8"), f"{folder}cards.toml")
            choices = msgspec.json.decode(files[f"{folder}choices.json"], type=Choices)
            choices.options(None)
        except (KeyError, UnicodeDecodeError, msgspec.MsgspecError, FileError, AnalysisError) as error:
            raise ValueError(f"trial {trial_id}: {plain(error)}") from error
        source = TrialSource(PurePosixPath(raw[0]).name, files[raw[0]], cards, choices)
        found[trial_id] = replace(source, baseline=files.get(f"{folder}baseline.toml"))
    return found


def safe_name(name: str) -> str:
    """Make a file name that every system and the bundle accept."""
    kept = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "_" for c in name)
    return kept.lstrip(".")[-120:] or "recording"
