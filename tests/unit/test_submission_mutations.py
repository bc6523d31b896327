"""Every number and file of a submission altered one at a time, under a new manifest: only making it again finds it."""

import csv
import io
import json
import os
import random
import re
import subprocess
import sys
from pathlib import Path

import pytest

from host.cli import main
from host.submission.bundle import MANIFEST, bundle_bytes, manifest_text, read_bundle
from host.submission.contents import build_submission
from host.submission.differences import numbers_equal
from host.submission.made_with import is_drawn
from host.submission.verification import verify_files
from tests.verified_submissions import CARDS, remember, trial_source, under_new_manifest
from tests.waiting import HANG_S


@pytest.fixture(scope="module")
def sources():
    return [
        trial_source(f"{number}.csv", motion, seed=number) for number, motion in enumerate(("roll", "roll", "pitch"))
    ]


@pytest.fixture(scope="module")
def drawn(sources):
    """One trial with everything that is drawn."""
    return build_submission(sources[:1])


@pytest.fixture(scope="module")
def undrawn(sources):
    return build_submission(sources, drawings=False)


@pytest.fixture
def verified(monkeypatch, sources, drawn, undrawn):
    """Verify altered files; what the same sources gave once is not computed again."""

    remember(monkeypatch, (sources[:1], drawn), (sources, undrawn))

    def verify(files, **changes):
        return verify_files(under_new_manifest({**files, **changes.pop("changed", {})}), **changes)

    return verify


def leaves(value, path=()):
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from leaves(item, (*path, key))
    else:
        yield path, value


def altered(value):
    """Another value of the same kind, as near as may be."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, float):
        return value + 2e-9 + 1e-13 * abs(value)
    return 0.5 if value is None else f"{value}x"


def put(values, path, value):
    for key in path[:-1]:
        values = values[key]
    values[path[-1]] = value


def laid_out(values, like):
    """JSON in the layout of another."""
    indent = 1 if like[2:4] == b' "' else 2
    text = (json.dumps(values, indent=indent, ensure_ascii=False) + "\n").encode()
    assert text.count(b"\n") == like.count(b"\n")
    return text


def json_mutants(data):
    for path, value in list(leaves(json.loads(data))):
        values = json.loads(data)
        put(values, path, altered(value))
        yield path, laid_out(values, data)


def csv_mutants(data, rng, most):
    rows = list(csv.reader(io.StringIO(data.decode())))
    cells = [(r, c) for r in range(len(rows)) for c in range(len(rows[r]))]
    for row, column in rng.sample(cells, min(most, len(cells))):
        changed = [list(line) for line in rows]
        cell = changed[row][column]
        try:
            changed[row][column] = repr(altered(int(cell) if cell.isdigit() else float(cell)))
        except ValueError:
            changed[row][column] = cell + "x"
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="\n").writerows(changed)
        yield (row, column), buffer.getvalue().encode()


def test_every_value_of_every_json_file_is_found(undrawn, verified):
    assert verified(undrawn.files, drawings=False).equal
    count = 0
    for name in [name for name in undrawn.files if name.endswith(("submission.json", "roll--01/result.json"))]:
        for path, content in json_mutants(undrawn.files[name]):
            if path[0] == "made_with":
                continue  # claims of the maker, see below
            found = verified(undrawn.files, changed={name: content}, drawings=False)
            count += 1
            # The title is the maker's own choice: it stands in the report as well, and is found there.
            assert not found.equal or path == ("title",), (name, path)
            assert "written otherwise" not in str(found.differences)
    assert count > 250


def test_other_versions_claimed_are_named_and_hide_nothing(drawn, undrawn, verified):
    for package in json.loads(undrawn.files["submission.json"])["made_with"]:
        whole = drawn if package in {"matplotlib", "pyarrow"} else undrawn
        values = json.loads(whole.files["submission.json"])
        values["made_with"][package] = "0.0"
        changed = {"submission.json": json.dumps(values).encode()}
        altered_files = [name for name in whole.files if name.endswith(("steps.png", "report.html", "report.pdf"))]
        changed |= {name: whole.files[name] + b" " for name in altered_files}
        found = verified(whole.files, changed=changed, drawings=whole is drawn)
        assert f"{package} 0.0 (here" in found.notes[0]
        if package == "pyarrow":
            assert not set(altered_files) & set(found.uncompared), "pyarrow draws nothing"
            assert {line.split()[0] for line in found.differences} >= set(altered_files)
        else:
            assert dict.fromkeys(altered_files, f"made with another {package}") == found.uncompared


def test_equal_bytes_are_equal_whatever_made_them(drawn, verified):
    values = json.loads(drawn.files["submission.json"])
    values["made_with"]["matplotlib"] = "0.0"
    again = (json.dumps(values, indent=1, ensure_ascii=False) + "\n").encode()
    found = verified(drawn.files, changed={"submission.json": again})
    assert (found.equal, found.uncompared) == (True, {})


def test_parquet_is_compared_as_its_library_writes_it(drawn, verified):
    pytest.importorskip("pyarrow", reason="pyarrow is not installed")
    name = next(name for name in drawn.files if name.endswith(".parquet"))
    for package, reason in (("pyarrow", "made with another pyarrow"), ("matplotlib", None)):
        values = json.loads(drawn.files["submission.json"])
        values["made_with"][package] = "0.0"
        changed = {"submission.json": json.dumps(values).encode(), name: drawn.files[name] + b" "}
        found = verified(drawn.files, changed=changed)
        assert found.uncompared.get(name) == reason
        assert (f"{name} is not what the data give" in found.differences) == (reason is None)


def test_where_numbers_differ_in_their_last_digits_drawings_are_not_judged(drawn, verified):
    name = next(name for name in drawn.files if name.endswith("/result.json"))
    values = json.loads(drawn.files[name])
    values["theta_bar_deg"] += 1e-12
    figure = next(name for name in drawn.files if name.endswith("steps.svg"))
    changed = {name: laid_out(values, drawn.files[name]), figure: drawn.files[figure] + b" "}
    found = verified(drawn.files, changed=changed)
    assert found.equal
    assert found.uncompared == {
        figure: "the numbers differ in their last digits, as between processors: so do drawings of them"
    }


def test_values_of_the_tables_are_found(undrawn, verified):
    rng = random.Random(1)
    for name in [name for name in undrawn.files if name.endswith(".csv") and "/raw/" not in name]:
        for place, content in csv_mutants(undrawn.files[name], rng, 25):
            assert not verified(undrawn.files, changed={name: content}, drawings=False).equal, (name, place)


def test_every_file_with_an_altered_byte_taken_away_or_added_is_found(drawn, verified):
    rng = random.Random(2)
    assert verified(drawn.files).equal
    for name, content in drawn.files.items():
        rest = {key: value for key, value in drawn.files.items() if key != name}
        assert not verified(rest).equal, name
        assert not verified(drawn.files, changed={name: content + b"1"}).equal, name
        if name.startswith("trials/") and not name.endswith((".json", ".toml")) and "/raw/" not in name:
            flipped = bytearray(content)
            flipped[rng.randrange(len(flipped))] ^= 1 << rng.randrange(7)
            if name.endswith(".csv") and not differs(content, bytes(flipped)):
                continue
            assert not verified(drawn.files, changed={name: bytes(flipped)}).equal, name
    assert not verified(drawn.files, changed={"extra.txt": b""}).equal


def differs(one, other):
    """Whether two tables differ by more than verifying tolerates: the last of 17 digits may."""

    def values(data):
        return [
            float(cell) if re.fullmatch(r"[-+.\de]+", cell) else cell for cell in re.split(rb"[,\n]".decode(), data)
        ]

    try:
        first, second = values(one.decode()), values(other.decode())
    except (UnicodeDecodeError, ValueError):
        return True
    return len(first) != len(second) or any(
        type(a) is not type(b) or (a != b and (isinstance(a, str) or abs(a - b) > max(1e-9, 1e-14 * abs(a))))
        for a, b in zip(first, second, strict=True)
    )


def test_numbers_and_words_of_the_reports_are_found(drawn, verified):
    rng = random.Random(3)
    page = drawn.files["report.html"].decode()
    body = page[: page.index('id="plotly-gz"')]
    places = [m for m in re.finditer(r"\d+\.\d+", body) if "base64" not in body[max(m.start() - 30, 0) : m.start()]]
    for match in rng.sample(places, 40):
        digit = str((int(page[match.end() - 1]) + 1) % 10)
        changed = page[: match.end() - 1] + digit + page[match.end() :]
        assert not verified(drawn.files, changed={"report.html": changed.encode()}).equal


def test_whole_numbers_are_exact_and_large_ones_nearly(undrawn, verified):
    name = next(name for name in undrawn.files if name.endswith("roll--01/endpoints.csv"))
    rows = undrawn.files[name].decode().splitlines(keepends=True)
    number, row, *rest = rows[-1].split(",")
    changed = "".join([*rows[:-1], ",".join((number, f"{row}.0000001", *rest))])
    (difference,) = verified(undrawn.files, changed={name: changed.encode()}, drawings=False).differences
    assert ", row: " in difference
    assert not numbers_equal(2260724430, 2260724431)
    assert not numbers_equal(1.6e9, 1.6e9 + 1e-4)  # s since 1970
    assert numbers_equal(1.6e9, 1.6e9 + 5e-7)
    assert numbers_equal(0.5, 0.5 + 5e-10)
    assert not numbers_equal(0.5, 0.5 + 2e-9)


def test_the_same_values_in_another_layout_are_found(undrawn, verified):
    for name in ("submission.json", "summary.csv"):
        for content in (undrawn.files[name] + b"\n", undrawn.files[name].replace(b"\n", b"\r\n")):
            found = verified(undrawn.files, changed={name: content}, drawings=False)
            assert not found.equal
            assert name in found.differences[0]


def test_a_name_that_stands_twice_is_found(undrawn, verified):
    text = undrawn.files["submission.json"].decode()
    twice = text.replace('"theta_bar_deg"', '"theta_bar_deg": 0.001, "theta_bar_deg"', 1)
    found = verified(undrawn.files, changed={"submission.json": twice.encode()}, drawings=False)
    assert found.differences == ("submission.json: cannot be read (a name stands twice in one object)",)


def test_a_manifest_in_another_order_is_found(undrawn):
    from host.submission.bundle import check_manifest

    lines = manifest_text(undrawn.files).splitlines(keepends=True)
    found = check_manifest({**undrawn.files, MANIFEST: "".join(lines[::-1]).encode()})
    assert found == (f"{MANIFEST} is not written as rotdrift writes it: it was altered",)


def test_the_command_makes_the_same_bytes_in_another_folder_zone_locale_and_mask(sources, tmp_path, capsys, drawn):
    (tmp_path / "far" / "away").mkdir(parents=True)
    (tmp_path / "far" / "0.csv").write_bytes(next(iter(sources[0].raw.values())))
    (tmp_path / "far" / "0.toml").write_text(CARDS.format(motion="roll"))
    setting = {"TZ": "Asia/Kathmandu", "LC_ALL": "C", "PYTHONHASHSEED": "7", "PYTHONIOENCODING": "ascii:strict"}
    done = subprocess.run(
        [sys.executable, "-m", "rotdrift", "report", "../0.csv", "--out", "s.zip"],
        cwd=tmp_path / "far" / "away",
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), **setting},
        umask=0o077,
        capture_output=True,
        timeout=HANG_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    bundle = tmp_path / "far" / "away" / "s.zip"
    assert bundle.read_bytes() == bundle_bytes(drawn.files)
    files = read_bundle(bundle)
    assert {"report.html", "report.pdf", "CITATION.txt", "summary.tex", "figures/summary.svg"} <= set(files)
    assert sum(name.endswith((".png", ".svg", ".pdf")) for name in files) == 1 + 3 + 3 * 7
    assert main(["report", str(tmp_path / "far" / "0.csv"), "--out", str(bundle)]) == 4
    capsys.readouterr()
    assert main(["verify", str(bundle), "--no-drawings"]) == 0
    first, *named, verdict, _, signed = capsys.readouterr().out.splitlines()
    assert first == "NOT compared: figures/ (3 files), report.html, report.pdf, trials/*/figures/ (21 files)"
    assert named[0] == "  left out on request:"
    assert "    report.html, report.pdf" in named
    assert all(kind in str(named) for kind in ("figures/ drift.pdf, drift.png", "sphere.svg", "figures/ summary.pdf"))
    assert verdict.startswith("equal as far as compared: 14 of 40 files byte by byte; ")
    assert signed == "not signed: who made it is not known"
    # Whoever leaves out what is not looked at gets no better verdict.
    assert main(["verify", str(bundle), "--no-drawings", "--strict"]) == 1
    bundle.write_bytes(bundle_bytes({name: content for name, content in files.items() if not is_drawn(name)}))
    capsys.readouterr()
    assert main(["verify", str(bundle), "--no-drawings", "--strict"]) == 1
    assert capsys.readouterr().out.startswith("NOT compared: figures and reports\n")
