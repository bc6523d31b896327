"""``rotdrift report``: everything the benchmark card asks for, from recordings and cards."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from minisign import SecretKey

    from host.submission.contents import BuiltSubmission
    from host.submission.source import TrialSource


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the subcommand and its arguments."""
    from host.results.arguments import add_exclude_arguments, add_read_arguments, add_window_arguments

    parser = subparsers.add_parser(
        "report",
        help="write a submission: report, figures, data, summary",
        description=(
            "Write everything the benchmark card asks for. Cards come from --cards,\n"
            "from NAME.toml beside the recording NAME.mcap, and from object.toml, hand.toml,\n"
            "trial.toml there or in the folder above. End points chosen by hand come from\n"
            "NAME.endpoints.csv (unless --from or --to is given), a static baseline from\n"
            "NAME.baseline.toml or baseline.toml."
        ),
        epilog="example: rotdrift report trials/*.mcap --out submission.zip",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "trials", nargs="+", type=Path, metavar="TRIAL", help="recordings: any that `rotdrift score` reads"
    )
    parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="submission.zip, report.html, report.pdf, or a folder"
    )
    parser.add_argument(
        "--cards", type=Path, action="append", default=[], metavar="FILE", help="card file for all trials"
    )
    parser.add_argument(
        "--hand", type=Path, metavar="FILE", help="hand card where none is beside a recording (`rotdrift config hand`)"
    )
    parser.add_argument("--title", metavar="TEXT", help="title of the report")
    parser.add_argument("--force", action="store_true", help="replace the file that exists")
    parser.add_argument(
        "--sign", type=Path, metavar="KEY", help="sign submission.zip with this secret key; see `rotdrift keygen`"
    )
    parser.add_argument("--endpoints", metavar="ROWS|FILE", help="end points chosen by hand (one trial only)")
    add_window_arguments(parser, " (one trial only)")
    add_exclude_arguments(parser, " (one trial only)")
    parser.add_argument("--baseline", type=Path, metavar="FILE", help="static baseline of the sensor")
    add_read_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Score, draw and write a submission.

    Returns
    -------
    int
        0; 1 if a trial has no valid score (the submission is written all the same, and marked).

    Raises
    ------
    UsageError
        The options contradict each other.
    FileError
        A file cannot be read or written.
    """
    from host.errors import UsageError
    from host.results.arguments import window
    from host.submission.contents import DEFAULT_TITLE, build_submission

    windowed = window(args.start, args.end) is not None
    if args.endpoints and windowed:
        raise UsageError("--endpoints and --from/--to both choose what to score", "give one of them")
    if len(args.trials) > 1 and (args.endpoints or windowed):
        raise UsageError(
            "--endpoints, --from and --to are for one trial", "put NAME.endpoints.csv beside each recording instead"
        )
    if len(args.trials) > 1 and args.exclude:
        raise UsageError("--exclude is for one trial: each has cycles of its own", "report that trial alone")
    _refuse_existing(args.out, force=args.force)
    key = None if args.sign is None else _secret_key(args)
    sources = [_source(path, args) for path in args.trials]
    built = build_submission(sources, title=args.title or DEFAULT_TITLE)
    _write(args.out, built, key)
    _print(args.out, built, signed=key is not None)
    return 0 if all(trial.valid for trial in built.submission.trials) else 1


def _source(path: Path, args: argparse.Namespace) -> TrialSource:
    from analysis.scoring.choice import load_endpoints, parse_endpoints
    from analysis.series import ReaderError
    from host.cards.files import find_cards
    from host.errors import UsageError
    from host.results.arguments import excluded, window
    from host.submission.source import Choices, load_source

    if not path.name:
        raise UsageError(f"{path} has no name of its own", "name the recording or the bag in full")
    start_s, end_s = _window_s(path, args)
    left_out = excluded(args.exclude, args.because)
    choices = Choices(
        start_s,
        end_s,
        excluded_cycles=tuple(item.step + 1 for item in left_out),
        excluded_because=left_out[0].reason if left_out else "",
        columns=args.columns,
        rate_hz=args.rate,
        topic=args.topic,
        node=args.node,
        sensor=args.sensor,
        channel=args.channel,
        session=args.session,
    )
    beside = path.with_suffix(".endpoints.csv")
    try:
        if args.endpoints:
            choices = choices.with_endpoints(parse_endpoints(args.endpoints))
        elif beside.is_file() and window(args.start, args.end) is None:
            choices = choices.with_endpoints(load_endpoints(beside))
    except ReaderError as error:
        raise UsageError(str(error)) from error
    baselines = (path.with_suffix(".baseline.toml"), path.parent / "baseline.toml")
    baseline = args.baseline or next(filter(Path.is_file, baselines), None)
    cards = find_cards(path, args.cards, [args.hand] if args.hand else [])
    return load_source(path, cards, choices, baseline)


def _window_s(path: Path, args: argparse.Namespace) -> tuple[float | None, float | None]:
    """Return the window in seconds: a submission holds times, not the names of markers."""
    if not isinstance(args.start, str) and not isinstance(args.end, str):
        return args.start, args.end
    from host.results.any_file import read_recording
    from host.results.arguments import reading
    from host.results.window import resolve_window

    how = reading(args.columns, args.rate, args.topic, args.node, args.sensor, args.channel, args.session)
    _, trial = read_recording(path, how)
    return resolve_window((args.start, args.end), trial)


def _refuse_existing(out: Path, *, force: bool) -> None:
    from host.errors import already_there

    if out.exists() and (out.is_dir() or not force):
        remedy = "give another name with --out" + ("" if out.is_dir() else ", or replace it with --force")
        raise already_there(out, remedy)


def _secret_key(args: argparse.Namespace) -> SecretKey:
    """Return the key to sign with, before anything is scored: a wrong password shall not cost minutes."""
    from host.errors import UsageError
    from host.output.lines import ask_secret
    from host.submission.signature import require_extra, signature_path

    if args.out.suffix.lower() != ".zip":
        raise UsageError("--sign signs an archive", "write one with --out submission.zip")
    require_extra()
    from host.submission.signing_keys import load_secret_key

    _refuse_existing(signature_path(args.out), force=args.force)
    return load_secret_key(args.sign, ask_secret)


def _write(out: Path, built: BuiltSubmission, key: SecretKey | None) -> None:
    from host.errors import UsageError, unwritable
    from host.submission.archive import BundleError
    from host.submission.bundle import MANIFEST, bundle_bytes, manifest_text

    single = {".html": "report.html", ".pdf": "report.pdf"}.get(out.suffix.lower())
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        if single is not None:
            out.write_bytes(built.files[single])
        elif out.suffix.lower() == ".zip":
            data = bundle_bytes(built.files)
            out.write_bytes(data)
            if key is not None:
                _write_signature(out, data, manifest_text(built.files), key)
        else:
            for name, content in {**built.files, MANIFEST: manifest_text(built.files).encode()}.items():
                place = out / name
                place.parent.mkdir(parents=True, exist_ok=True)
                place.write_bytes(content)
    except BundleError as error:
        raise UsageError(f"this is too much for one submission ({error})", "make several submissions") from error
    except OSError as error:
        raise unwritable(out, error) from error


def _write_signature(out: Path, data: bytes, manifest: str, key: SecretKey) -> None:
    import hashlib

    from host.submission.signature import signature_path
    from host.submission.signing_keys import sign

    signature_path(out).write_bytes(sign(data, key, hashlib.sha256(manifest.encode()).hexdigest()))


def _print(out: Path, built: BuiltSubmission, *, signed: bool) -> None:
    from analysis.scoring.interval import NO_DRIFT
    from analysis.scoring.summary import degrees
    from host.output.lines import write_lines
    from host.submission.signature import signature_path

    n = len(built.submission.trials)
    alone = out.suffix.lower() in {".html", ".pdf"}
    what = f"{n} trial{'s' if n > 1 else ''}" + ("" if alone else f", {len(built.files) + 1} files")
    lines = [f"wrote {out}: {what}"]
    for trial in built.submission.trials:
        if trial.theta_bar_deg is not None:
            ends = ""
            if trial.interval_low_deg is not None:
                ends = f" ({degrees(trial.interval_low_deg)} … {degrees(trial.interval_high_deg)})"
                ends += f", {NO_DRIFT}" if trial.interval_low_deg <= 0.0 else ""
            lines.append(f"  {trial.id}: θ̄ = {trial.theta_bar_deg:.3f}°{ends}, {trial.n_endpoints} end points")
        else:
            lines.append(f"  {trial.id}: no score: {'; '.join(trial.reasons)}")
        lines += [f"    ! {warning}" for warning in trial.warnings]
        if trial.missing:
            lines.append(f"    missing in the cards: {', '.join(trial.missing)}")
    lines += [f"  {note}" for note in built.notes]
    beside = signature_path(out)
    if signed:
        lines.append(f"signed: {beside}; send it with the archive")
    elif beside.exists():
        lines.append(f"{beside} is the signature of what was there before: sign again with --sign")
    if not built.submission.complete:
        lines.append("the submission is marked incomplete")
    write_lines(lines)
