"""Mutations of a submission, file by file; its manifest has the hashes of what they have become.

What a verification may never do is to call altered numbers equal. Which files of an input still follow from their
sources is judged here by reading the numbers again, without the product's own comparison.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import io
import json
import math
import os
import re
import zipfile
from collections.abc import Callable, Iterator
from random import Random
from typing import Any, TypeAlias

import host.submission.made_with
from analysis.scoring.choice import EndpointChoice
from firmware_protocol.serial.framing import encode_frame
from host.cards.definitions import parse_cards
from host.errors import FileError
from host.links.transport import Chunk
from host.recording import format as fmt
from host.submission.contents import build_submission
from host.submission.source import Choices, TrialSource
from host.submission.verification import Verification, verify_bundle
from tests.fuzz.result.layouts import FLOATS, HOSTILE_TEXTS, edge_integer
from tests.fuzz.result.mcap_file import numbered, whole
from tests.fuzz.result.recorded import folder
from tests.fuzz.result.records import TEXTS, beginning, message, mutated
from tests.fuzz.result.road import REFUSED, demand
from tests.fuzz.result.sessions import Session, sessions
from tests.fuzz.targets import one_sentence

# Reading the installed versions is half of the time of a verification, and they do not change.
host.submission.made_with.version = functools.cache(host.submission.made_with.version)

Files: TypeAlias = dict[str, bytes]
MANIFEST = "SHA256SUMS"
SOURCES = re.compile(r"trials/[^/]+/(raw/.*|cards\.toml|choices\.json|baseline\.toml)")
DRAWN = re.compile(r"(.*/)?figures/.*|report\.(html|pdf)")
NUMBER = re.compile(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?")
FREE = ("title", "made_with")
"""Of ``submission.json``, what is a choice and follows from nothing."""
MAX_SENTENCE = 2000
CARDS = """
[object]
type = "cube"
dimensions = { x_mm = 60, y_mm = 60, z_mm = 60 }
mass_g = 180.5
com_mm = [0, 0, 2.5]
[hand]
model = "T42"
aperture_mm = 90
[trial]
motion = "roll"
comments = "fine"
"""
BASELINES = (b"", b"[baseline]\n", b"x = 1e999\n", b"\xff")
JSON_VALUES: tuple[Any, ...] = (None, True, -1, 0, 1, 2**63, 10**400, 1e-9, 1e300, "", "x", "\x1b[2J", [], {}, [[[]]])


def recording_of(session: Session) -> bytes:
    """Return a plain recording of a session."""
    line = [*beginning()]
    for each in session.deliveries:
        chunk = Chunk(b"".join(map(encode_frame, each.packets)), each.host_time_ns)
        line.append(message(fmt.RECEIVED, fmt.encode_raw(chunk), chunk.host_time_ns))
    return whole(numbered(line))[0]


@functools.cache
def submissions() -> tuple[Files, ...]:
    """Return the files of three small submissions: one trial, two repeats, and one with end points chosen by hand."""
    cards = parse_cards(CARDS)
    one, again, _, other, slow = (recording_of(session) for session in sessions())
    chosen = Choices().with_endpoints(EndpointChoice("time_s", (0.5, 0.9, 1.3, 1.7), ("", "a pause", "", "")))
    found = (
        [TrialSource({"a.mcap": one}, cards)],
        [TrialSource({"a.mcap": one}, cards), TrialSource({"b.mcap": again}, cards, Choices(from_s=0.2))],
        [TrialSource({"c.mcap": other}, cards, chosen), TrialSource({"d.mcap": slow}, parse_cards(""))],
    )
    return tuple(build_submission(sources, drawings=False).files for sources in found)


def _json_value(files: Files, rng: Random) -> None:
    """An edge value, or another kind of value, anywhere in a JSON file; or a key less, more, or twice."""
    name = rng.choice([name for name in files if name.endswith(".json")] or [""])
    if not name:
        return
    try:
        values = json.loads(files[name])
    except ValueError:
        return
    places = list(_places(values))
    if not places:
        return
    inside, key = rng.choice(places)
    now = inside[key]
    if isinstance(now, float) and rng.random() < 0.7:
        inside[key] = rng.choice((now + 2e-9, -now, now * 1.001, math.nextafter(now, 1e9), *FLOATS))
    elif isinstance(now, int) and rng.random() < 0.7:
        inside[key] = edge_integer(rng, -(2**63), 2**63, now)
    elif isinstance(inside, dict) and rng.random() < 0.15:
        inside[rng.choice(("x", "θ", "__class__"))] = inside.pop(key)
    else:
        inside[key] = rng.choice((*JSON_VALUES, *TEXTS))
    indent = 1 if files[name][2:4] == b' "' else 2
    files[name] = (json.dumps(values, indent=indent, ensure_ascii=False) + "\n").encode("utf-8", "surrogatepass")


def _places(value: Any) -> Iterator[tuple[Any, Any]]:
    keys = list(value) if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ()
    for key in keys:
        yield value, key
        yield from _places(value[key])


def _cell(files: Files, rng: Random) -> None:
    """Another number or text in a cell of a table."""
    name = rng.choice([name for name in files if name.endswith(".csv")] or [""])
    rows = list(csv.reader(io.StringIO(files.get(name, b"").decode("utf-8", "replace"))))
    rows = [row for row in rows if row]
    if not rows:
        return
    row = rng.choice(rows)
    at = rng.randrange(len(row))
    try:
        number = float(row[at])
        row[at] = repr(rng.choice((number + 2e-9, -number, number * 1.001, *FLOATS)))
    except ValueError:
        row[at] = rng.choice((row[at] + "x", *TEXTS))
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows(rows)
    files[name] = buffer.getvalue().encode()


def _card_value(files: Files, rng: Random) -> None:
    """Another value of a key in the cards."""
    name = rng.choice([name for name in files if name.endswith(".toml")] or [""])
    lines = files.get(name, b"").decode("utf-8", "replace").splitlines()
    places = [place for place, line in enumerate(lines) if " = " in line]
    if not places:
        return
    place = rng.choice(places)
    values = ("nan", "inf", "-1", "1e300", "9" * 400, '""', '"x"', '"\\u001B[2J"', "[]", "{}", "true", "[" * 2000)
    key = lines[place].partition(" = ")[0]
    lines[place] = f"{rng.choice((key, key, key, 'x'))} = {rng.choice(values)}"
    files[name] = ("\n".join(lines) + "\n").encode()


def _choice(files: Files, rng: Random) -> None:
    """What a person chose, at its edges: window, end points, reading."""
    name = rng.choice([name for name in files if name.endswith("choices.json")] or [""])
    if not name:
        return
    times = (*FLOATS[:3], 0.5, 1.0, 2.0, 1e9, -1e9)
    chosen: dict[str, Any] = {
        "from_s": rng.choice(times),
        "to_s": rng.choice(times),
        "endpoint_kind": rng.choice(("time_s", "row", "sequence", "index", "x")),
        "endpoint_values": sorted(rng.choice((0.5, 1.0, 1.5, 2.0, 3.0, 10.0, 1e18)) for _ in range(rng.randrange(5))),
        "columns": rng.choice(("t,w,x,y,z", "", "\x1b", "t,t")),
        "rate_hz": rng.choice((0.0, -1.0, 1e-300, 1e300, 100.0)),
        "node": rng.choice((-1, 0, 3, 31, 32, 2**64)),
        "topic": rng.choice(TEXTS),
    }
    kept = rng.sample(sorted(chosen), rng.choice((1, 1, 2, 3)))
    if "endpoint_values" in kept:
        kept.append("endpoint_kind")
    files[name] = json.dumps({key: chosen[key] for key in kept}).encode()


def _recording(files: Files, rng: Random) -> None:
    """A recording of odd records in the place of a trial's."""
    name = rng.choice([name for name in files if "/raw/" in name] or [""])
    if name:
        files[name] = mutated(rng)[0]


def _bytes(files: Files, rng: Random) -> None:
    name = rng.choice(sorted(files))
    hurt = bytearray(files[name])
    for _ in range(rng.choice((1, 1, 5))):
        at = rng.randrange(len(hurt) + 1)
        hurt[at : at + rng.choice((0, 1, 1, 30))] = rng.choice(
            (b"", rng.randbytes(1), b"\xff", b"\0", b"[", *HOSTILE_TEXTS)
        )
    files[name] = bytes(hurt)


def _dropped(files: Files, rng: Random) -> None:
    del files[rng.choice(sorted(files))]


def _spliced(files: Files, rng: Random) -> None:
    """A file of another submission in the place of one of the same name, or beside it."""
    other = rng.choice(submissions())
    name = rng.choice(sorted(other))
    here = [mine for mine in files if mine.rpartition("/")[2] == name.rpartition("/")[2]]
    files[rng.choice((*here, name))] = other[name]


def _renamed(files: Files, rng: Random) -> None:
    """A file under another name: one that means another place, one that is there already, one in another folder."""
    name = rng.choice(sorted(files))
    stem, slash, last = name.rpartition("/")
    names = (
        f"{stem}{slash}x{last}", f"../{name}", f"/{name}", f"{name}/x", name.upper(), "x" * 300, f"{stem}\\{last}",
        "trials/x/raw/a.mcap", f"{stem}{slash}\x1b{last}", "figures/summary.svg", rng.choice(sorted(files)),
    )  # fmt: skip
    content = files[name]
    if rng.random() < 0.5:
        del files[name]
    files[rng.choice(names)] = content


def _baseline(files: Files, rng: Random) -> None:
    trial = rng.choice([name for name in files if name.endswith("cards.toml")] or [""])
    if trial:
        files[trial.replace("cards.toml", "baseline.toml")] = rng.choice(BASELINES)


MUTATIONS: tuple[Callable[[Files, Random], None], ...] = (
    _json_value,
    _json_value,
    _json_value,
    _cell,
    _cell,
    _card_value,
    _choice,
    _recording,
    _recording,
    _bytes,
    _dropped,
    _spliced,
    _renamed,
    _baseline,
)


def zipped(files: Files) -> bytes:
    """Return files as the one zip that they give, whatever their names; the manifest is one of them."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files):
            entry = zipfile.ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr = 0o100644 << 16
            entry.create_system = 3
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name], compresslevel=6)
    return buffer.getvalue()


def manifest(files: Files) -> bytes:
    """Return the manifest of files, as ``sha256sum`` writes it."""
    return "".join(f"{hashlib.sha256(files[name]).hexdigest()}  {name}\n" for name in sorted(files)).encode(
        "utf-8", "surrogateescape"
    )


def submission(rng: Random) -> str:
    """A submission whose files are odd, verified without its drawings."""
    whole_files = rng.choice(submissions())
    files = dict(whole_files)
    for _ in range(min(int(rng.expovariate(0.7)), 6)):
        rng.choice(MUTATIONS)(files, rng)
        if not files:
            return REFUSED
    listed = manifest(files)
    stale = rng.random() < 0.1
    if stale:
        name = rng.choice(sorted(files))
        files[name] += b" "
    path = folder() / f"{os.getpid()}.zip"
    path.write_bytes(zipped({**files, MANIFEST: listed}))
    try:
        found = verify_bundle(path, drawings=False)
    except FileError as error:
        one_sentence(error)
        return REFUSED
    check(found, files, whole_files, stale)
    return "equal" if found.equal else "not equal"


def check(found: Verification, files: Files, whole_files: Files, stale: bool) -> None:
    """Demand that what differs is found, that what does not is not, and that all of it can be printed."""
    for sentence in (*found.altered, *found.differences, *found.notes, *found.uncompared.values()):
        demand(sentence.isprintable() and len(sentence) < MAX_SENTENCE, "sentences of a verification", ascii(sentence))
    demand(found.altered if stale else not found.altered, "what does not fit the manifest is found", found.altered)
    if stale or any(files.get(name) != content for name, content in whole_files.items() if SOURCES.fullmatch(name)):
        return  # with other sources another submission may be right: what of it is, making it again shows
    if any(SOURCES.fullmatch(name) and name not in whole_files for name in files):
        return
    names = {name for name in {*files, *whole_files} if not DRAWN.fullmatch(name)}
    wrong = [name for name in sorted(names) if not follows(name, files.get(name), whole_files.get(name))]
    wrong = [name for name in wrong if name not in found.uncompared]
    demand(not wrong or not found.equal, "an altered file is found", wrong)
    demand(wrong or found.equal, "nothing is found where nothing differs", found.differences)


def follows(name: str, claimed: bytes | None, made: bytes | None) -> bool:
    """Return whether a file has the numbers and words of the one that was made, but for last digits."""
    if claimed == made:
        return True
    if claimed is None or made is None or not name.endswith((".json", ".csv")):
        return False
    try:
        if name == "submission.json":
            one, other = json.loads(claimed), json.loads(made)
            return _free(one) and _same({**one, **dict.fromkeys(FREE)}, {**other, **dict.fromkeys(FREE)})
        numbers = [NUMBER.findall(data.decode()) for data in (claimed, made)]
        words = [NUMBER.sub("#", data.decode()) for data in (claimed, made)]
    except (ValueError, TypeError, KeyError):
        return False
    return words[0] == words[1] and all(_near(one, other) for one, other in zip(*numbers, strict=True))


def _free(values: Any) -> bool:
    """Return whether what is free to choose is at least of the right kind."""
    versions = values["made_with"]
    texts = [values["title"], *versions, *versions.values()] if isinstance(versions, dict) else [None]
    return all(isinstance(text, str) for text in texts)


def _near(one: str, other: str) -> bool:
    if one == other:
        return True
    if one.lstrip("-").isdigit() and other.lstrip("-").isdigit():
        return False
    return math.isclose(float(one), float(other), rel_tol=1e-14, abs_tol=1e-9)


def _same(one: Any, other: Any) -> bool:
    if isinstance(one, dict) and isinstance(other, dict):
        return list(one) == list(other) and all(_same(one[key], other[key]) for key in one)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(_same, one, other))
    if isinstance(one, float) and isinstance(other, float):
        return math.isclose(one, other, rel_tol=1e-14, abs_tol=1e-9)
    return type(one) is type(other) and bool(one == other)
