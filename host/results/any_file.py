"""Any recording, ours or anybody's, read and scored: what score, baseline, report, convert and verify start from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from analysis.formats import SeveralStreamsError, SourceFile, StreamChoice, is_mcap, read_series
from analysis.scoring.result import Result
from analysis.series import AnalysisError, OrientationSeries, SeriesError
from firmware_protocol.packets import Info
from host.errors import FileError, UsageError, no_memory, unreadable
from host.links.can.log_kind import can_log_kind
from host.recording.elsewhere.raw_bytes import is_raw_wire, load_raw_wire
from host.recording.load import RecordedTrial, load_trial
from host.recording.reader import is_our_recording
from host.results.result import ScoreOptions, score_plain, score_trial


@dataclass(frozen=True)
class ReadOptions:
    """How to read a file that is not one of our recordings."""

    columns: str | None = None
    """Meaning of the columns, as in ``--columns``."""
    rate_hz: float | None = None
    """Sampling rate where there are no time stamps."""
    topic: str | None = None
    """Which topic of a bag."""
    node: int | None = None
    """Node id of the object in the log of a CAN tool; None for the first that is heard."""
    choice: StreamChoice = StreamChoice()
    """Which sensor, channel or session, where a file holds several."""


class SeveralInFileError(FileError):
    """A file holds several sensors, channels, nodes or sessions, and none was chosen.

    Parameters
    ----------
    message : str
        The sentence about it.
    kind : str
        What there are several of.
    names : tuple of str
        Which there are.
    """

    def __init__(self, message: str, kind: str, names: tuple[str, ...]) -> None:
        super().__init__(message)
        self.kind = kind
        self.names = names

    def __reduce__(self) -> tuple[type[SeveralInFileError], tuple[str, str, tuple[str, ...]]]:
        return type(self), (str(self), self.kind, self.names)  # it travels between processes


@dataclass(frozen=True, eq=False)
class ScoredRecording:
    """A recording and its score."""

    series: OrientationSeries
    result: Result
    """The score, with the path of the file left out: the same file anywhere has the same result."""
    info: Info | None = None
    """The object as it introduced itself; None for other people's files."""
    damage: tuple[str, ...] = ()
    """What is wrong with the file; it is among the warnings of the result too."""


def read_recording(path: Path, reading: ReadOptions | None = None) -> tuple[OrientationSeries, RecordedTrial | None]:
    """Read a recording of any format.

    Returns
    -------
    series, trial
        The samples, their source being the bare name of the file; and for our own recordings what else they hold.

    Raises
    ------
    FileError
        There is no such file, or its format is not known.
    """
    reading = reading or ReadOptions()
    try:
        with SourceFile(path, label=path.name) as source:
            if is_mcap(source.head) and is_our_recording(path):
                trial = load_trial(path)
            elif can_log_kind(source.head) is not None:
                from host.recording.elsewhere.can_logs import load_can_log  # loads python-can

                trial = load_can_log(path, reading.node, source.rewound(), reading.choice)
            elif not is_mcap(source.head) and is_raw_wire(source.head):  # a damaged recording holds such bytes too
                trial = load_raw_wire(path, source.rewound())
            else:
                series = read_series(
                    source,
                    columns=reading.columns,
                    rate_hz=reading.rate_hz,
                    topic=reading.topic,
                    choice=reading.choice,
                )
                return series, None
    except OSError as error:
        raise unreadable(path, error) from error
    except SeveralStreamsError as error:
        raise SeveralInFileError(f"{path.name} holds {error}", error.kind, error.names) from error
    except MemoryError as error:
        raise no_memory(path) from error
    except AnalysisError as error:
        raise FileError(str(error)) from error
    return trial.series, trial


def score_recording(
    path: Path, options: ScoreOptions | None = None, reading: ReadOptions | None = None
) -> ScoredRecording:
    """Read and score a recording of any format.

    Raises
    ------
    FileError
        The file or the baseline is not what it should be.
    UsageError
        Chosen end points or window do not fit the recording.
    """
    series, trial = read_recording(path, reading)
    options = options or ScoreOptions()
    if options.endpoints is not None:
        name = Path(options.endpoints.source).name
        options = replace(options, endpoints=replace(options.endpoints, source=name))
    try:
        result = score_plain(series, options) if trial is None else score_trial(trial, options)
    except SeriesError as error:
        damaged = "" if trial is None else trial.why_unscored
        raise UsageError(
            f"{path.name}: {error}{damaged}", "choose end points or a window inside the recording"
        ) from error
    except MemoryError as error:
        raise no_memory(path) from error
    except AnalysisError as error:
        raise FileError(f"{path.name}: {error}{'' if trial is None else trial.why_unscored}") from error
    return (
        ScoredRecording(series, result) if trial is None else ScoredRecording(series, result, trial.info, trial.damage)
    )
