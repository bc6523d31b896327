"""What a submission is made from, trial by trial: the recording's bytes, the cards, and what a person chose.

The same sources give the same submission, on any machine with the same versions. A bundle holds its sources, so that
verifying it is making it again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, TypeAlias

import msgspec

from analysis.formats import StreamChoice
from analysis.scoring.choice import EndpointChoice
from analysis.scoring.result_parts import ExcludedCycle
from analysis.series import AnalysisError
from host.cards.definitions import Cards, dump_cards, parse_cards
from host.errors import FileError, UsageError, unreadable
from host.results.any_file import ReadOptions
from host.results.result import ScoreOptions
from host.text import plain

MAX_RAW_BYTES = 2**30


CycleNumber: TypeAlias = Annotated[int, msgspec.Meta(ge=1)]


class Choices(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """What a person chose for one trial; ``choices.json`` in the bundle."""

    from_s: float | None = None
    to_s: float | None = None
    endpoint_kind: str | None = None
    endpoint_values: tuple[float, ...] = ()
    endpoint_reasons: tuple[str, ...] = ()
    endpoint_source: str = ""
    excluded_cycles: tuple[CycleNumber, ...] = ()
    """Numbers, from 1, of cycles left out after the fact."""
    excluded_because: str = ""
    columns: str | None = None
    rate_hz: float | None = None
    topic: str | None = None
    node: int | None = None
    sensor: str | None = None
    channel: str | None = None
    session: int | None = None

    @property
    def reading(self) -> ReadOptions:
        """How to read the recording."""
        choice = StreamChoice(self.sensor, self.channel, self.session)
        return ReadOptions(self.columns, self.rate_hz, self.topic, self.node, choice)

    def options(self, baseline: Path | None) -> ScoreOptions:
        """Return how to score it, for a result that is written."""
        window = None if self.from_s is None and self.to_s is None else (self.from_s, self.to_s)
        points = None
        if self.endpoint_kind is not None:
            points = EndpointChoice(
                self.endpoint_kind, self.endpoint_values, self.endpoint_reasons, self.endpoint_source or "given"
            )
        left_out = tuple(ExcludedCycle.numbered(cycle, self.excluded_because) for cycle in self.excluded_cycles)
        return ScoreOptions(window, points, baseline, excluded=left_out, clock=True)

    def with_endpoints(self, choice: EndpointChoice) -> Choices:
        """Return the choices with these end points."""
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

    raw: Mapping[str, bytes]
    """The recording by its name; of a ROS 2 bag, which is a folder, every file as ``folder/file``, sorted."""
    cards: Cards
    """As read from the card files, before the object fills them."""
    choices: Choices = Choices()
    baseline: bytes | None = None

    @property
    def file_name(self) -> str:
        """Bare name of the recording."""
        return next(iter(self.raw)).partition("/")[0]

    @property
    def n_bytes(self) -> int:
        """Size of the recording."""
        return sum(map(len, self.raw.values()))

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the recording; of a folder that of its list of checksums, as ``sha256sum *`` prints it."""
        if self.file_name in self.raw:
            return hashlib.sha256(self.raw[self.file_name]).hexdigest()
        sums = {name.partition("/")[2]: hashlib.sha256(content).hexdigest() for name, content in self.raw.items()}
        return hashlib.sha256("".join(f"{digest}  {name}\n" for name, digest in sums.items()).encode()).hexdigest()

    def written_to(self, place: Path) -> Path:
        """Write the recording into an empty folder, for readers that need a path; return it."""
        for name, content in self.raw.items():
            (place / name).parent.mkdir(exist_ok=True)
            (place / name).write_bytes(content)
        return place / self.file_name

    def files(self) -> dict[str, bytes]:
        """Return these sources by name, as they stand in the trial's folder of a bundle."""
        files = {f"raw/{name}": content for name, content in self.raw.items()}
        files["cards.toml"] = dump_cards(self.cards).encode()
        files["choices.json"] = msgspec.json.format(msgspec.json.encode(self.choices), indent=1) + b"\n"
        if self.baseline is not None:
            files["baseline.toml"] = self.baseline
        return files


def load_source(recording: Path, cards: Cards, choices: Choices, baseline: Path | None = None) -> TrialSource:
    """Read a trial's files.

    Raises
    ------
    UsageError
        The recording is larger than a bundle may hold, or a folder that is not a ROS 2 bag.
    FileError
        A file cannot be read.
    """
    try:
        rest = None if baseline is None else baseline.read_bytes()
        name = safe_name(recording.name or recording.resolve().name)
        if recording.is_dir():
            return TrialSource(_bag(recording, name), cards, choices, rest)
        _refuse_large(recording, recording.stat().st_size)
        return TrialSource({name: recording.read_bytes()}, cards, choices, rest)
    except OSError as error:
        raise unreadable(error.filename, error) from error


def _bag(folder: Path, name: str) -> dict[str, bytes]:
    """Return the files of a ROS 2 bag; names must be harmless, because ``metadata.yaml`` refers to them."""
    places = sorted(place for place in folder.iterdir() if not place.name.startswith("."))
    if not (folder / "metadata.yaml").is_file():
        raise UsageError(f"{folder} is a folder without metadata.yaml, so not a ROS 2 bag", "name the recordings in it")
    for place in places:
        if place.is_symlink() or not place.is_file() or safe_name(place.name) != place.name:
            raise UsageError(
                f"{plain(place)} does not belong in a ROS 2 bag",
                "convert it first: rotdrift convert FOLDER trial.csv",
            )
    _refuse_large(folder, sum(place.stat().st_size for place in places))
    return {f"{name}/{place.name}": place.read_bytes() for place in places}


def _refuse_large(recording: Path, n_bytes: int) -> None:
    if n_bytes > MAX_RAW_BYTES:
        raise UsageError(f"{recording} is larger than {MAX_RAW_BYTES // 2**20} MB", "cut it to the trial")


def sources_in(files: Mapping[str, bytes]) -> dict[str, TrialSource]:
    """Return the sources of every trial in a bundle, by trial id.

    Raises
    ------
    ValueError
        A trial without exactly one recording, or cards or choices that are not valid.
    """
    ids = sorted({name.split("/")[1] for name in files if name.startswith("trials/") and name.count("/") >= 2})
    found = {}
    for trial_id in ids:
        folder = f"trials/{trial_id}/"
        raw = {name[len(f"{folder}raw/") :]: files[name] for name in sorted(files) if name.startswith(f"{folder}raw/")}
        names = {name.partition("/")[0] for name in raw}
        mixed = len(raw) > 1 and not names.isdisjoint(raw)  # a file, and a folder of the same name
        if len(names) != 1 or mixed or any(name.count("/") > 1 for name in raw):
            raise ValueError(f"trial {plain(trial_id)} has {len(names)} recordings, not one")
        odd = [part for name in raw for part in name.split("/") if safe_name(part) != part]
        if odd:
            raise ValueError(f"trial {plain(trial_id)}: a recording is named '{plain(odd[0])}', as no report names it")
        try:
            cards = parse_cards(files[f"{folder}cards.toml"].decode("utf-8"), f"{folder}cards.toml")
            choices = msgspec.json.decode(files[f"{folder}choices.json"], type=Choices)
            choices.options(None)
        except (KeyError, UnicodeDecodeError, msgspec.MsgspecError, FileError, AnalysisError) as error:
            raise ValueError(f"trial {plain(trial_id)}: {plain(error)}") from error
        found[trial_id] = TrialSource(raw, cards, choices, files.get(f"{folder}baseline.toml"))
    return found


def safe_name(name: str) -> str:
    """Return a file name that every system and the bundle accept."""
    kept = "".join(c if c.isascii() and (c.isalnum() or c in "._-") else "_" for c in name)
    return kept.lstrip(".")[-120:] or "recording"
