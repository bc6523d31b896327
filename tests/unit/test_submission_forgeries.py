"""Forged submissions: each trick by itself, under a manifest that fits, so that only making it again finds it."""

import base64
import io
import json
import re
import shutil
import zlib

import pytest

import host.submission.made_with as versions
from host.cli import main
from host.submission import archive
from host.submission.archive import archive_bytes
from host.submission.bundle import MANIFEST, bundle_bytes
from host.submission.contents import build_submission
from host.submission.made_with import is_drawn, made_with
from host.submission.verification import LAST_DIGITS, verify_bundle, verify_files
from tests.verified_submissions import remember, trial_source, under_new_manifest

TRIAL = "trials/t42--cube-60-x-60-x-60-mm--roll--01/"
PDF = "report.pdf"


@pytest.fixture(scope="module")
def sources():
    return [trial_source(seed=5)]


@pytest.fixture(scope="module")
def honest(sources):
    """One trial with everything that is drawn."""
    return build_submission(sources)


@pytest.fixture(scope="module")
def flattering():
    """What the forger would like to have measured: the same trial with less drift. Its files are sound."""
    return build_submission([trial_source(seed=5, drift_deg=0.1)])


@pytest.fixture
def made_again(monkeypatch, sources, honest):
    undrawn = {name: content for name, content in honest.files.items() if not is_drawn(name)}
    remember(monkeypatch, (sources, honest), (sources, type(honest)(undrawn, honest.submission, honest.notes)))


@pytest.fixture
def forged(made_again, honest):
    """Verify the honest files with some of them replaced (None: taken away)."""

    def verify(changed, **settings):
        whole = {name: content for name, content in {**honest.files, **changed}.items() if content is not None}
        return verify_files(under_new_manifest(whole), **settings)

    return verify


def claiming(files, **versions):
    """``submission.json`` that claims other versions (None: not mentioned)."""
    values = json.loads(files["submission.json"])
    claimed = {**values["made_with"], **versions}
    values["made_with"] = {name: version for name, version in claimed.items() if version is not None}
    return (json.dumps(values, indent=1, ensure_ascii=False) + "\n").encode()


def test_the_honest_one_is_equal_to_the_last_byte(forged):
    found = forged({})
    assert (found.equal, found.complete, found.notes) == (True, True, ())


def test_every_drawn_file_with_another_theta_is_found_by_itself(honest, flattering, forged):
    """Sound files of the same program and of the same names: no parser could object to them."""
    names = [name for name in honest.files if is_drawn(name) or name.endswith(".parquet")]
    assert set(names) <= set(flattering.files)
    assert len(names) == 2 + 3 + 3 * 7 + 1
    same = [name for name in names if honest.files[name] == flattering.files[name]]
    assert same == [f"{TRIAL}figures/link.{kind}" for kind in ("png", "svg", "pdf")], "it shows arrivals alone"
    for name in set(names) - set(same):
        found = forged({name: flattering.files[name]})
        assert (found.differences, found.uncompared) == ((f"{name} is not what the data give",), {})


def with_text_chunk(png):
    """Put a text into a PNG that no viewer shows and every metadata reader does."""
    chunk = b"tEXtComment\0theta_bar_deg=0.1"
    whole = len(chunk) - 4
    at = png.index(b"IEND") - 4
    return png[:at] + whole.to_bytes(4) + chunk + zlib.crc32(chunk).to_bytes(4) + png[at:]


def with_other_data_of_the_script(page):
    """Alter one number of the interactive clouds: nothing that is printed changes."""
    number = next(re.finditer(rb"<script[^>]*json[^>]*>.*?(-?\d\.\d+)", page, re.DOTALL))
    digit = b"%d" % ((int(page[number.end() - 1 : number.end()]) + 1) % 10)
    return page[: number.end() - 1] + digit + page[number.end() :]


def with_other_plotly(page):
    """Exchange the library that draws the clouds for code of one's own."""
    start, end = re.search(rb'id="plotly-gz"[^>]*>(.*?)<', page, re.DOTALL).span(1)
    code = base64.b64encode(zlib.compress(b"document.title='0.1'", wbits=31))
    return page[:start] + code + page[end:]


def with_metadata(parquet):
    arrow, tables = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    table = tables.read_table(arrow.BufferReader(parquet))
    buffer = io.BytesIO()
    metadata = {**table.schema.metadata, b"theta_bar_deg": b"0.1"}
    tables.write_table(table.replace_schema_metadata(metadata), buffer, compression="zstd")
    again = tables.read_table(arrow.BufferReader(buffer.getvalue()))
    assert again.equals(table), "the rows are the same"
    return buffer.getvalue()


def with_other_title(pdf):
    """Rewrite a PDF with another title and producer: every page is the same."""
    pypdf = pytest.importorskip("pypdf")
    writer = pypdf.PdfWriter(clone_from=io.BytesIO(pdf))
    writer.add_metadata({"/Title": "theta 0.1", "/Keywords": "0.1"})
    buffer = io.BytesIO()
    writer.write(buffer)
    return buffer.getvalue()


HIDDEN = {
    "text of a PNG": (f"{TRIAL}figures/steps.png", with_text_chunk),
    "bytes behind a PNG": (f"{TRIAL}figures/steps.png", lambda data: data + b"0.1"),
    "data of the page's script": ("report.html", with_other_data_of_the_script),
    "code of the page": ("report.html", with_other_plotly),
    "comment in the page": ("report.html", lambda data: data.replace(b"</body>", b"<!-- 0.1 --></body>")),
    "comment in an SVG": (f"{TRIAL}figures/drift.svg", lambda data: data.replace(b"</svg>", b"<!-- 0.1 --></svg>")),
    "title of an SVG": (f"{TRIAL}figures/drift.svg", lambda data: data.replace(b"</svg>", b"<title>0.1</title></svg>")),
    "metadata of a PDF": (PDF, with_other_title),
    "bytes behind a PDF": (PDF, lambda data: data + b"%0.1\n"),
    "bytes before a PDF": (PDF, lambda data: b"%!\n" + data),
    "metadata of a PDF figure": (f"{TRIAL}figures/link.pdf", with_other_title),
    "metadata of a parquet's footer": (f"{TRIAL}samples.parquet", with_metadata),
}  # fmt: skip


@pytest.mark.parametrize("trick", HIDDEN)
def test_what_no_viewer_shows_is_found(honest, forged, trick):
    name, hide = HIDDEN[trick]
    changed = hide(honest.files[name])
    assert changed != honest.files[name]
    found = forged({name: changed})
    assert (found.differences, found.uncompared) == ((f"{name} is not what the data give",), {})


def respelled(data, old, new):
    assert data.count(old) >= 1, old
    return data.replace(old, new, 1)


def shortest(files, name):
    """A number in a file, as it stands there."""
    return next(re.finditer(rb"(?<=[ ,])\d\.\d{3,}(?=[,\n])", files[name]))[0]


def test_the_same_numbers_in_another_layout_are_found(honest, forged):
    for name in ("submission.json", f"{TRIAL}result.json", f"{TRIAL}steps.csv", f"{TRIAL}samples.csv"):
        content, number = honest.files[name], shortest(honest.files, name)
        spellings = [number + b"0", number + b"e0", number.replace(b"0.", b".", 1), number + b"E+00"]
        spellings = [spelling for spelling in spellings if spelling != number]
        assert len(spellings) >= 3
        for other in (respelled(content, number, spelling) for spelling in spellings):
            found = forged({name: other}, drawings=False)
            assert len(found.differences) == 1, (name, other[:200])
            assert name in found.differences[0]
        for other in (b"\xef\xbb\xbf" + content, content + b"\n", content.replace(b"\n", b"\r\n"), content[:-1]):
            assert not forged({name: other}, drawings=False).equal, name
    values = json.loads(honest.files["submission.json"])
    for layout in ({"indent": 2}, {"separators": (",", ":")}, {"sort_keys": True, "indent": 1}):
        other = json.dumps(values, ensure_ascii=False, **layout).encode() + b"\n"
        (line,) = forged({"submission.json": other}, drawings=False).differences
        assert line.startswith("submission.json: the same values are written otherwise"), layout
    escaped = json.dumps(values, indent=1).encode() + b"\n"
    assert escaped != honest.files["submission.json"], "θ and × may stand as escapes"
    assert not forged({"submission.json": escaped}, drawings=False).equal


def test_whole_numbers_are_neither_fractions_nor_truths(honest, forged):
    name = f"{TRIAL}result.json"
    count = json.loads(honest.files[name])["n_endpoints"]
    for other in (f"{count}.0", f"{count}.0000000001", "true"):
        changed = respelled(honest.files[name], f'"n_endpoints": {count}'.encode(), f'"n_endpoints": {other}'.encode())
        assert not forged({name: changed}, drawings=False).equal, other


def test_sources_are_written_as_the_program_writes_them(honest, forged):
    """What a person gave stands there once: no second value, no words that nobody scores."""
    cards, choices = f"{TRIAL}cards.toml", f"{TRIAL}choices.json"
    for name, other in (
        (cards, honest.files[cards] + b"# theta_bar_deg = 0.1\n"),
        (choices, b'{"from_s": null}\n'),
        (choices, honest.files[choices] + b" "),
        (f"{TRIAL}CARDS.toml", honest.files[cards]),
        (f"{TRIAL}notes.txt", b"0.1"),
    ):
        found = forged({name: other}, drawings=False)
        assert not found.equal, (name, other)
        assert name in str(found.differences)


@pytest.mark.parametrize(
    "name", ["ROLL\u0301.csv", "r\u00f6ll.csv", "ro\u0308ll.csv", "a b.csv", ".csv", "0.csv ", "0\u200b.csv"]
)
def test_a_recording_has_a_name_that_a_report_gives(honest, forged, name):
    """Two names that appear the same are one too many; in an unpacked folder the archive's rules do not help."""
    raw = f"{TRIAL}raw/0.csv"
    for taken in ({}, {raw: None}):
        found = forged({f"{TRIAL}raw/{name}": honest.files[raw], **taken}, drawings=False)
        assert not found.equal
        assert "recording" in found.differences[0]


def test_figures_that_do_not_belong_are_found_even_where_drawings_are_left_out(honest, forged):
    extra = ("figures/evil.png", f"{TRIAL}figures/evil.svg", "REPORT.html", "report.html.pdf", "figures/summary.PNG")
    for name in extra:
        for drawings in (True, False):
            found = forged({name: b"0.1"}, drawings=drawings)
            assert found.differences == (f"{name} does not belong to this submission",), (name, drawings)
    for name in (PDF, "report.html", f"{TRIAL}figures/steps.png", "figures/summary.pdf"):
        assert forged({name: None}).differences == (f"{name} is missing",)
        left_out = forged({name: None}, drawings=False)
        assert (left_out.equal, left_out.complete) == (True, False)


@pytest.mark.parametrize("claimed", [*(name for name in made_with() if name != "rotdrift"), "anything"])
def test_a_version_claimed_to_dodge_the_comparison_dodges_only_it(honest, flattering, forged, claimed):
    changed = {"submission.json": claiming(honest.files, **{claimed: "0.0"}), PDF: flattering.files[PDF]}
    found = forged(changed)
    if claimed == "pyarrow":
        assert found.differences == (f"{PDF} is not what the data give",), "pyarrow draws nothing"
    else:
        assert (found.equal, found.complete) == (True, False)
        assert found.uncompared[PDF] == f"made with another {claimed}"
        # Numbers are compared whatever versions are claimed.
        name = f"{TRIAL}result.json"
        flattered = forged({**changed, name: flattering.files[name]})
        assert f"{name}: theta_bar_deg is " in str(flattered.differences)
        for table in ("summary.tex", "summary.md", "summary.csv"):
            assert not forged({**changed, table: flattering.files[table]}).equal, table


@pytest.fixture
def command(made_again, tmp_path, capsys):
    """Run ``rotdrift verify`` on files, return exit code and lines."""

    def verify(files, *options):
        path = tmp_path / "s.zip"
        path.write_bytes(files if isinstance(files, bytes) else bundle_bytes(files))
        code = main(["verify", str(path), *options])
        return code, capsys.readouterr().out.splitlines()

    return verify


def test_the_first_line_names_what_was_not_compared_and_strict_does_not_pass(honest, flattering, command):
    files = {**honest.files, "submission.json": claiming(honest.files, matplotlib="0.0"), PDF: flattering.files[PDF]}
    code, (first, *_, verdict, _, _) = command(files)
    assert (code, first) == (0, f"NOT compared: {PDF}")
    assert verdict.startswith("equal as far as compared: 39 of 40 files byte by byte")
    assert command(files, "--strict")[0] == 1
    values = json.loads("\n".join(command(files, "--strict", "--json")[1]))
    assert (values["equal"], values["complete"], values["uncompared"]) == (True, False, [PDF])
    code, lines = command(honest.files, "--strict")
    assert (code, lines[0]) == (0, "equal: 40 files, 1 trial scored again from the raw bytes")
    code, lines = command(honest.files, "--strict", "--no-drawings")
    assert (code, lines[0]) == (
        1, "NOT compared: figures/ (3 files), report.html, report.pdf, trials/*/figures/ (21 files)"
    )  # fmt: skip


def test_last_digits_altered_to_dodge_the_comparison_are_named_and_strict_does_not_pass(honest, flattering, command):
    name = f"{TRIAL}result.json"
    theta = json.loads(honest.files[name])["theta_bar_deg"]
    nearly = respelled(honest.files[name], repr(theta).encode(), repr(theta + 1e-12).encode())
    files = {**honest.files, name: nearly, PDF: flattering.files[PDF]}
    code, lines = command(files)
    assert code == 0
    assert lines[0] == f"NOT compared: {PDF}; the last digits of trials/*/result.json (numbers equal within 1e-9)"
    assert f"  {LAST_DIGITS}:" in lines
    assert command(files, "--strict")[0] == 1
    assert command({**honest.files, name: nearly}, "--strict")[0] == 1


def test_an_archive_packed_otherwise_is_found_or_named(honest, command, monkeypatch):
    """The one thing that headers and content leave open: how a content is deflated."""
    whole = under_new_manifest(honest.files)
    older = under_new_manifest({**honest.files, "submission.json": claiming(honest.files, zlib="1.2.3")})
    with monkeypatch.context() as patch:
        patch.setattr(archive, "DEFLATE_LEVEL", 9)
        packed, packed_by_another = archive_bytes(whole), archive_bytes(older)
    code, lines = command(packed)
    assert (code, lines[0]) == (1, "altered: the archive is packed otherwise than its files give")
    code, lines = command(packed_by_another)
    assert (code, lines[0]) == (0, "NOT compared: how the archive is packed (made with another zlib)")
    assert command(packed_by_another, "--strict")[0] == 1
    values = json.loads("\n".join(command(packed_by_another, "--json")[1]))
    assert (values["equal"], values["complete"]) == (True, False)
    assert command(archive_bytes(older), "--strict")[0] == 0, "equal bytes are equal whatever made them"


def test_an_unpacked_folder_is_verified_as_the_archive_is(honest, made_again, tmp_path):
    for name, content in under_new_manifest(honest.files).items():
        (tmp_path / "open" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "open" / name).write_bytes(content)
    assert verify_bundle(tmp_path / "open").complete
    shutil.copy(tmp_path / "open" / PDF, tmp_path / "open" / "RÉPORT.pdf")
    found = verify_bundle(tmp_path / "open")
    assert found.altered == (f"RÉPORT.pdf is not in {MANIFEST}",)
    assert found.differences == ("RÉPORT.pdf does not belong to this submission",)


def test_a_parquet_that_contradicts_its_maker_is_found_without_pyarrow(honest, forged, monkeypatch):
    name = f"{TRIAL}samples.parquet"
    unnamed = {"submission.json": claiming(honest.files, pyarrow=None)}
    assert f"{name} does not belong to this submission" in forged(unnamed, drawings=False).differences
    assert forged({name: None}, drawings=False).differences == (f"{name} is missing",)
    # Also where this program cannot make one.
    monkeypatch.setattr(versions, "PACKAGES", tuple(name for name in versions.PACKAGES if name != "pyarrow"))
    assert forged({name: None}, drawings=False).differences == (f"{name} is missing",)
    assert name in forged({}, drawings=False).uncompared


def test_words_of_another_release_are_not_compared_and_its_numbers_are(honest, forged):
    """A submission of an older version: it knew fewer keys and worded a note otherwise."""
    name = f"{TRIAL}result.json"
    values = json.loads(honest.files[name])
    values["sensor"]["note"] = "no baseline"
    del values["settings"]
    older = {
        name: (json.dumps(values, indent=2, ensure_ascii=False) + "\n").encode(),
        "submission.json": claiming(honest.files, rotdrift="0.0.9", code=None),
        "CITATION.txt": honest.files["CITATION.txt"].replace(made_with()["rotdrift"].encode(), b"0.0.9"),
    }
    found = forged(older, drawings=False)
    assert found.differences == ()
    assert found.uncompared[name] == "made with another code, rotdrift: numbers equal, words or keys are not"
    assert any("sensor.note is no baseline, recomputed " in note for note in found.notes)
    # Under the versions of here the same words are a difference.
    assert not forged({name: older[name]}, drawings=False).equal
    # And no release writes another name, number or key.
    for key, other in (("hand", "Another"), ("theta_bar_deg", 0.1), ("invented", 0.1)):
        submission = json.loads(older["submission.json"])
        submission["trials"][0][key] = other
        claimed = {**older, "submission.json": (json.dumps(submission, indent=1, ensure_ascii=False) + "\n").encode()}
        assert not forged(claimed, drawings=False).equal, key


def test_trials_that_have_changed_places_are_found():
    """Both are sound, and each is what its folder gives; only the ids are the other's."""
    sources = [trial_source("0.csv", seed=5), trial_source("1.csv", seed=6)]
    files = build_submission(sources, drawings=False).files
    first, second = TRIAL, TRIAL.replace("--01/", "--02/")
    names = {first: second, second: first}
    swapped = {
        next((name.replace(old, new) for old, new in names.items() if name.startswith(old)), name): content
        for name, content in files.items()
    }
    assert swapped[f"{first}raw/1.csv"] == files[f"{second}raw/1.csv"]
    found = verify_files(under_new_manifest(swapped), drawings=False)
    assert any(line.startswith(f"{first}raw/1.csv does not belong") for line in found.differences)
    assert any(line.startswith(f"{first}result.json: ") for line in found.differences)
    assert verify_files(under_new_manifest(files), drawings=False).equal


def test_the_code_has_a_digest_that_follows_it_and_not_its_line_ends(tmp_path, monkeypatch):
    """Between two releases the version stands still."""
    package = tmp_path / "analysis"
    package.mkdir()
    monkeypatch.setattr(versions, "_ROOT", tmp_path)
    seen = []
    for name, content in (("a.py", b"x = 1\n"), ("a.py", b"x = 2\n"), ("b.py", b""), ("c.html", b"<p>\n")):
        (package / name).write_bytes(content)
        seen.append(versions.code_digest.__wrapped__())
    assert len(set(seen)) == 4
    (package / "a.py").write_bytes(b"x = 2\r\n")
    (package / "a.pyc").write_bytes(b"\0")
    assert versions.code_digest.__wrapped__() == seen[-1]
    assert versions.code_digest() == made_with()["code"] not in seen
