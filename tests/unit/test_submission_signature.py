"""Signatures: minisign checks ours and we check minisign's; every other key, archive or signature is found."""

import base64
import hashlib
import io
import json
import os
import shutil
import stat
import subprocess
import sys
from contextlib import contextmanager

import pytest

from analysis.formats.named_csv import csv_text
from host.cards.definitions import parse_cards
from host.cli import main
from host.errors import FileError, UsageError
from host.submission import contents
from host.submission.bundle import MANIFEST, archive_at, bundle_bytes, read_bundle
from host.submission.signature import Standing, find_signature, require_extra, signature_path
from host.submission.source import TrialSource
from host.submission.verification import verify_bundle
from tests.scored_trials import scored
from tests.waiting import HANG_S

minisign = pytest.importorskip("minisign", reason="py-minisign is not installed")
from host.submission.signing_keys import check_signature, load_public_key, load_secret_key, sign  # noqa: E402

DATA = b"an archive, as far as a signature knows" * 100


def no_password(prompt):
    raise AssertionError(prompt)


@pytest.fixture(scope="module")
def keys(tmp_path_factory):
    folder = tmp_path_factory.mktemp("keys")
    assert main(["keygen", str(folder / "lab.key")]) == 0
    assert main(["keygen", str(folder / "other.key")]) == 0
    return folder


@pytest.fixture
def signed(keys, tmp_path):
    """An archive of some bytes, signed by the laboratory's key."""
    archive = tmp_path / "s.zip"
    archive.write_bytes(DATA)
    signature_path(archive).write_bytes(sign(DATA, load_secret_key(keys / "lab.key", no_password), "d" * 64))
    return archive


@pytest.fixture(scope="module")
def program():
    """The real ``minisign``."""
    path = shutil.which("minisign")
    if path is None:
        pytest.skip("minisign is not installed (tests/system-packages.sh)")

    def run(*arguments, cwd, answer=""):
        command = [path, *map(str, arguments)]
        return subprocess.run(
            command, cwd=cwd, input=answer, capture_output=True, text=True, timeout=HANG_S, check=False
        )

    return run


def public(folder, name="lab.pub"):
    return load_public_key(str(folder / name))


def test_a_signature_is_good_for_its_archive_and_key_alone(keys, signed):
    found = check_signature(DATA, signed, public(keys))
    assert (found.standing, found.comment) == (Standing.GOOD, f"rotdrift submission, digest {'d' * 64}")
    assert found.key_id in (keys / "lab.pub").read_text().splitlines()[0]
    other = check_signature(DATA, signed, public(keys, "other.pub"))
    assert other.standing is Standing.BAD
    assert f"it is signed by key {found.key_id}, the key given is " in other.sentence
    for changed in (DATA + b"\0", DATA[:-1], b"\1" + DATA[1:], b""):
        altered = check_signature(changed, signed, public(keys))
        assert altered.standing is Standing.BAD
        assert "s.zip.minisig does not fit" in altered.sentence
    signature_path(signed).unlink()
    assert "there is no s.zip.minisig" in check_signature(DATA, signed, public(keys)).sentence


def test_another_key_under_the_same_id_does_not_pass(keys, signed):
    """The id is a name, not a proof."""
    lab = (keys / "lab.pub").read_text().splitlines()
    other = base64.b64decode((keys / "other.pub").read_text().splitlines()[1])
    forged = base64.b64encode(base64.b64decode(lab[1])[:10] + other[10:]).decode()
    assert check_signature(DATA, signed, load_public_key(forged)).standing is Standing.BAD


def test_every_bit_of_a_signature_counts_but_those_of_its_untrusted_comment(keys, signed):
    path, key = signature_path(signed), public(keys)
    lines = path.read_bytes().splitlines()
    for number in (1, 3):
        raw = base64.b64decode(lines[number])
        for bit in range(0, 8 * len(raw), 3):
            flipped = bytearray(raw)
            flipped[bit // 8] ^= 1 << bit % 8
            path.write_bytes(b"\n".join([*lines[:number], base64.b64encode(flipped), *lines[number + 1 :]]) + b"\n")
            assert check_signature(DATA, signed, key).standing is Standing.BAD, (number, bit)
    path.write_bytes(b"\n".join([*lines[:2], lines[2].replace(b"digest d", b"digest e"), lines[3]]) + b"\n")
    assert check_signature(DATA, signed, key).standing is Standing.BAD
    path.write_bytes(b"\n".join([b"untrusted comment: \x1b[2Janything", *lines[1:]]) + b"\n")
    found = check_signature(DATA, signed, key)
    assert found.standing is Standing.GOOD
    assert "anything" not in found.sentence


@pytest.mark.parametrize("content", [b"", b"\xff\xfe" * 50, b"untrusted comment: x\nRU\ntrusted comment: y\nzz\n"])
def test_what_is_not_a_signature_is_bad_and_no_crash(keys, signed, content):
    signature_path(signed).write_bytes(content)
    found = check_signature(DATA, signed, public(keys))
    assert (found.standing, "not a signature of minisign" in found.sentence) == (Standing.BAD, True)


def test_the_signature_is_ed25519_over_blake2b_as_the_format_defines(keys, signed):
    """Read by the format's description and ``cryptography`` alone."""
    ed25519 = pytest.importorskip("cryptography.hazmat.primitives.asymmetric.ed25519")
    encoded = base64.b64decode((keys / "lab.pub").read_text().splitlines()[1])
    assert (encoded[:2], len(encoded)) == (b"Ed", 42)
    key = ed25519.Ed25519PublicKey.from_public_bytes(encoded[10:])
    _, first, comment, second = signature_path(signed).read_bytes().splitlines()
    first = base64.b64decode(first)
    assert (first[:2], first[2:10]) == (b"ED", encoded[2:10])
    key.verify(first[10:], hashlib.blake2b(DATA).digest())
    key.verify(base64.b64decode(second), first[10:] + comment.removeprefix(b"trusted comment: "))


def test_keys_of_minisign_sign_and_its_program_checks(program, tmp_path, keys, signed):
    there = program("-V", "-p", keys / "lab.pub", "-m", "s.zip", cwd=tmp_path)
    assert (there.returncode, there.stderr) == (0, "")
    assert f"Trusted comment: rotdrift submission, digest {'d' * 64}" in there.stdout
    text = (keys / "lab.pub").read_text().splitlines()[1]
    assert program("-V", "-P", text, "-m", "s.zip", cwd=tmp_path).returncode == 0
    assert program("-V", "-p", keys / "other.pub", "-m", "s.zip", cwd=tmp_path).returncode != 0
    signed.write_bytes(DATA + b"\0")
    assert program("-V", "-p", keys / "lab.pub", "-m", "s.zip", cwd=tmp_path).returncode != 0
    # The other way: its key, and then its signature.
    signed.write_bytes(DATA)
    assert program("-G", "-W", "-p", "their.pub", "-s", "their.key", cwd=tmp_path).returncode == 0
    signature_path(signed).write_bytes(sign(DATA, load_secret_key(tmp_path / "their.key", no_password), "0"))
    assert program("-V", "-p", "their.pub", "-m", "s.zip", cwd=tmp_path).returncode == 0
    made = program("-S", "-s", keys / "lab.key", "-m", "s.zip", "-t", "by hand", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    found = check_signature(DATA, signed, public(keys))
    assert (found.standing, found.comment) == (Standing.GOOD, "by hand")
    printed = program("-R", "-s", keys / "lab.key", "-p", "again.pub", cwd=tmp_path)
    assert printed.returncode == 0, printed.stderr
    again, ours = (
        (folder / name).read_text().splitlines() for folder, name in ((tmp_path, "again.pub"), (keys, "lab.pub"))
    )
    assert again == ours, "the id in the comment, too"


def test_a_key_with_a_password_is_unlocked_before_anything_else(tmp_path):
    pair = minisign.KeyPair.generate()
    pair.secret_key.encrypt("correct horse", opslimit=2**15, memlimit=2**24)
    path = tmp_path / "locked.key"
    path.write_bytes(bytes(pair.secret_key) + b"\n")
    path.chmod(0o600)
    asked = []
    key = load_secret_key(path, lambda prompt: asked.append(prompt) or "correct horse")
    assert asked == [f"password of {path}: "]
    archive = tmp_path / "s.zip"
    signature_path(archive).write_bytes(sign(DATA, key, "0"))
    assert check_signature(DATA, archive, pair.public_key).standing is Standing.GOOD
    with pytest.raises(UsageError, match="locked"):
        load_secret_key(path, lambda _: "wrong")


def test_a_secret_key_whose_halves_do_not_fit_signs_nothing(keys, tmp_path):
    mine, other = (base64.b64decode((keys / f"{name}.key").read_text().splitlines()[1]) for name in ("lab", "other"))
    path = tmp_path / "mixed.key"
    path.write_bytes(b"untrusted comment: x\n" + base64.b64encode(mine[:94] + other[94:126] + mine[126:]) + b"\n")
    path.chmod(0o600)
    with pytest.raises(FileError, match="damaged"):
        sign(DATA, load_secret_key(path, no_password), "0")


def test_new_keys_are_the_owner_s_alone_and_replace_none(keys, tmp_path, capsys):
    if os.name == "posix":
        assert stat.S_IMODE((keys / "lab.key").stat().st_mode) == 0o600
    before = (keys / "lab.key").read_bytes()
    assert main(["keygen", str(keys / "lab.key")]) == 4
    (tmp_path / "half.pub").write_text("")
    assert main(["keygen", str(tmp_path / "half.key")]) == 4
    assert not (tmp_path / "half.key").exists()
    assert main(["keygen", str(tmp_path / "lab.pub")]) == 2
    assert main(["keygen", str(tmp_path / "none" / "lab.key")]) == 4
    assert (keys / "lab.key").read_bytes() == before
    assert before not in capsys.readouterr().out.encode()


@pytest.mark.skipif(os.name != "posix", reason="permissions are those of POSIX")
def test_a_secret_key_that_others_can_read_is_refused(keys, tmp_path):
    path = tmp_path / "open.key"
    shutil.copy(keys / "lab.key", path)
    for mode in (0o640, 0o604, 0o620):
        path.chmod(mode)
        with pytest.raises(FileError, match=r"other users can read or change .*: chmod 600"):
            load_secret_key(path, no_password)


def test_what_is_not_a_key_is_refused(keys, tmp_path):
    with pytest.raises(FileError, match="no file"):
        load_public_key(str(tmp_path / "none.pub"))
    with pytest.raises(FileError, match="not a public key"):
        load_public_key(str(keys / "lab.key"))
    with pytest.raises(FileError, match="not a public key"):
        load_public_key("RW" + "A" * 53 + "!")
    shutil.copy(keys / "lab.pub", tmp_path / "a.key")
    (tmp_path / "a.key").chmod(0o600)
    with pytest.raises(FileError, match="not a secret key"):
        load_secret_key(tmp_path / "a.key", no_password)


def test_without_the_extra_it_names_the_command_that_installs_it(monkeypatch):
    def version(name):
        from importlib.metadata import PackageNotFoundError

        raise PackageNotFoundError(name)

    monkeypatch.setattr("host.submission.signature.version", version)
    with pytest.raises(UsageError, match=r"pip install 'rotdrift\[sign\]'"):
        require_extra()


@contextmanager
def undrawn():
    """Let ``rotdrift report`` leave out the drawings: what is signed is the archive, whatever it holds."""
    whole = contents.build_submission
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contents, "build_submission", lambda found, title: whole(found, title=title, drawings=False))
        yield


@pytest.fixture(scope="module")
def submission(keys, tmp_path_factory):
    """A submission without drawings, its archive signed by ``rotdrift report``."""
    folder = tmp_path_factory.mktemp("submission")
    series, _ = scored(cycles=5, slip_deg=0.0)
    (folder / "roll.csv").write_text(csv_text(series))
    out = folder / "s.zip"
    with undrawn():
        assert main(["report", str(folder / "roll.csv"), "--out", str(out), "--sign", str(keys / "lab.key")]) == 0
    return out


def verdict(capsys, *arguments):
    capsys.readouterr()
    code = main(["verify", *map(str, arguments), "--no-drawings"])
    return code, capsys.readouterr()


def test_a_submission_that_is_signed_shows_who_made_it(submission, keys, capsys):
    code, printed = verdict(capsys, submission, "--key", keys / "lab.pub")
    *_, digest, sentence = printed.out.splitlines()
    assert (code, sentence.startswith("signed by key ")) == (0, True)
    # The signed comment is the digest that is printed: nobody has to believe the file it stands in.
    assert digest.removeprefix("digest of the submission: ") in sentence
    assert digest.endswith(hashlib.sha256(read_bundle(submission)[MANIFEST]).hexdigest())
    key = (keys / "lab.pub").read_text().splitlines()[1]
    code, printed = verdict(capsys, submission, "--key", key, "--json")
    assert (code, json.loads(printed.out)["signature"]["standing"]) == (0, "good")
    code, printed = verdict(capsys, submission)
    assert (code, printed.out.splitlines()[-1]) == (
        0,
        "signature not checked: give the maker's public key with --key (s.zip.minisig)",
    )


def test_another_s_submission_of_the_same_data_does_not_pass(submission, keys, tmp_path, capsys):
    copy = tmp_path / "s.zip"
    shutil.copy(submission, copy)
    code, printed = verdict(capsys, copy, "--key", keys / "lab.pub")
    assert (code, printed.out.splitlines()[-1]) == (1, "NOT signed by the key given: there is no s.zip.minisig")
    assert verdict(capsys, copy)[1].out.splitlines()[-1] == "not signed: who made it is not known"
    signature_path(copy).write_bytes(sign(archive_at(copy), load_secret_key(keys / "other.key", no_password), "0"))
    code, printed = verdict(capsys, copy, "--key", keys / "lab.pub", "--json")
    values = json.loads(printed.out)
    assert (code, values["equal"], values["signature"]["standing"]) == (1, True, "bad")
    assert verdict(capsys, copy, "--key", keys / "other.pub")[0] == 0


def test_a_submission_made_again_from_other_data_keeps_no_signature(submission, keys, tmp_path, capsys):
    """The attack that only a signature finds: all of it made again."""
    series, _ = scored(cycles=5, slip_deg=0.0, drift_deg=0.1)
    (source,) = [TrialSource({"roll.csv": csv_text(series).encode()}, cards_of(submission))]
    copy = tmp_path / "s.zip"
    copy.write_bytes(bundle_bytes(contents.build_submission([source], drawings=False).files))
    shutil.copy(signature_path(submission), signature_path(copy))
    assert verify_bundle(copy, drawings=False).equal
    code, printed = verdict(capsys, copy, "--key", keys / "lab.pub")
    assert code == 1
    assert "s.zip.minisig does not fit: the archive or the signature was altered" in printed.out


def cards_of(archive):
    files = read_bundle(archive)
    return parse_cards(next(content for name, content in files.items() if name.endswith("cards.toml")).decode())


def test_a_folder_has_no_signature(submission, keys, tmp_path, capsys):
    for name, content in read_bundle(submission).items():
        (tmp_path / "open" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "open" / name).write_bytes(content)
    code, printed = verdict(capsys, tmp_path / "open", "--key", keys / "lab.pub")
    assert (code, "the archive is what is signed: give the zip" in printed.err) == (2, True)
    assert find_signature(tmp_path / "open").standing is Standing.NONE


@undrawn()
def test_a_signature_is_not_replaced_unasked_and_a_stale_one_is_named(submission, keys, tmp_path, capsys):
    recording = str(submission.with_name("roll.csv"))
    out = tmp_path / "s.zip"
    signature_path(out).write_text("of something")
    sign_it = ["--sign", str(keys / "lab.key")]
    assert main(["report", recording, "--out", str(out), *sign_it]) == 4
    assert not out.exists()
    assert main(["report", recording, "--out", str(out)]) == 0
    assert "s.zip.minisig is the signature of what was there before" in capsys.readouterr().out
    assert main(["report", recording, "--out", str(out), *sign_it, "--force"]) == 0
    assert "signed: " in capsys.readouterr().out
    assert verify_bundle(out, drawings=False, key=public(keys)).signature.standing is Standing.GOOD
    first = signature_path(out).read_bytes()
    assert main(["report", recording, "--out", str(out), *sign_it, "--force"]) == 0
    assert signature_path(out).read_bytes() == first, "the same archive and key give the same bytes"
    for name in ("page.html", "page.pdf", "folder"):
        assert main(["report", recording, "--out", str(tmp_path / name), *sign_it]) == 2


@undrawn()
def test_a_submission_that_nobody_could_read_is_not_written(submission, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("host.submission.archive.MAX_TOTAL_BYTES", 100_000)
    assert main(["report", str(submission.with_name("roll.csv")), "--out", str(tmp_path / "s.zip")]) == 2
    assert "too much for one submission" in capsys.readouterr().err
    assert not (tmp_path / "s.zip").exists()


@undrawn()
def test_a_password_comes_from_the_input_where_there_is_no_terminal(submission, tmp_path, monkeypatch):
    pair = minisign.KeyPair.generate()
    pair.secret_key.encrypt("pass word", opslimit=2**15, memlimit=2**24)
    (tmp_path / "a.key").write_bytes(bytes(pair.secret_key) + b"\n")
    (tmp_path / "a.key").chmod(0o600)
    arguments = ["report", str(submission.with_name("roll.csv")), "--out", str(tmp_path / "s.zip")]
    arguments += ["--sign", str(tmp_path / "a.key")]
    monkeypatch.setattr(sys, "stdin", io.StringIO("wrong\n"))
    assert main(arguments) == 2
    assert not (tmp_path / "s.zip").exists()
    monkeypatch.setattr(sys, "stdin", io.StringIO("pass word\n"))
    assert main(arguments) == 0
    assert verify_bundle(tmp_path / "s.zip", drawings=False, key=pair.public_key).signature.standing is Standing.GOOD
