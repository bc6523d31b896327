"""Keys and signatures of submissions, in minisign's format, so that ``minisign`` makes and checks them as well.

A signature covers every byte of the archive: Ed25519 over its BLAKE2b hash. A comment inside is signed too; ours is the
digest that ``rotdrift verify`` prints. Format and cryptography are those of py-minisign and ``cryptography``: the extra
``rotdrift[sign]``, without which this module cannot be imported.
"""

from __future__ import annotations

import base64
import os
import stat
from collections.abc import Callable
from pathlib import Path

import minisign

from host.errors import FileError, UsageError, already_there, unreadable, unwritable
from host.submission.signature import SignatureFinding, Standing, signature_path
from host.text import plain

PUBLIC_SUFFIX = ".pub"
MAX_BYTES = 2**16
"""Of keys and signatures: they have less than 400 bytes, and a comment of at most 8 kB."""
ENCODED_KEY = 56
"""Characters of a public key in base64, which begins with RW."""


def check_signature(data: bytes, archive: Path, key: minisign.PublicKey) -> SignatureFinding:
    """Return whether the signature beside an archive, whose bytes are ``data``, is of this key."""
    beside = signature_path(archive)
    try:
        signature = minisign.Signature.from_bytes(_content(beside))
        comment = plain(signature.trusted_comment, 400)
        signer, wanted = _key_id(bytes(signature).splitlines()[1]), _key_id(key.to_base64())
        if signer != wanted:
            return _bad(f"it is signed by key {signer}, the key given is {wanted}")
        key.verify(data, signature)
    except FileNotFoundError:
        return _bad(f"there is no {plain(beside.name)}")
    except OSError as error:
        raise unreadable(beside, error) from error
    except minisign.VerifyError:
        return _bad(f"{plain(beside.name)} does not fit: the archive or the signature was altered")
    except ValueError as error:  # ParseError, and what is not UTF-8
        return _bad(f"{plain(beside.name)} is not a signature of minisign ({plain(error)})")
    return SignatureFinding(Standing.GOOD, f"signed by key {signer} ({comment})", signer, comment)


def load_public_key(given: str) -> minisign.PublicKey:
    """Return a public key, given as the name of its file or as the key itself (56 characters of base64).

    Raises
    ------
    FileError
        There is no such file, or it is not a public key.
    """
    try:
        if not Path(given).exists() and len(given) == ENCODED_KEY and given.startswith("RW"):
            return minisign.PublicKey.from_base64(given)
        return minisign.PublicKey.from_bytes(_content(Path(given)))
    except OSError as error:
        raise unreadable(plain(given), error) from error
    except ValueError as error:
        raise FileError(
            f"{plain(given)} is not a public key of minisign ({plain(error)})", "give the file that ends in .pub"
        ) from error


def load_secret_key(path: Path, ask_password: Callable[[str], str]) -> minisign.SecretKey:
    """Return a secret key, unlocked; ``ask_password`` gets a prompt and returns the password of a key that has one.

    Raises
    ------
    UsageError
        The password is wrong.
    FileError
        There is no such file, it is not a secret key, or others can read it.
    """
    try:
        if os.name == "posix" and path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise FileError(f"other users can read or change {plain(path)}", f"chmod 600 {plain(path)}")
        key = minisign.SecretKey.from_bytes(_content(path))
    except OSError as error:
        raise unreadable(path, error) from error
    except ValueError as error:
        raise FileError(
            f"{plain(path)} is not a secret key of minisign ({plain(error)})", "make one with `rotdrift keygen`"
        ) from error
    if key.is_encrypted():
        try:
            key.decrypt(ask_password(f"password of {plain(path)}: "))
        except minisign.Error as error:
            raise UsageError(f"{plain(path)} stays locked ({plain(error)})", "try again") from error
    return key


def sign(data: bytes, key: minisign.SecretKey, digest: str) -> bytes:
    """Return the signature of an archive as the content of its ``.minisig``; the same input gives the same bytes.

    Raises
    ------
    FileError
        The key is damaged: its two halves do not belong together.
    """
    signature = key.sign(
        data,
        untrusted_comment=f"signature of a rotdrift submission by key {_key_id(key.get_public_key().to_base64())}",
        trusted_comment=f"rotdrift submission, digest {digest}",
    )
    try:
        key.get_public_key().verify(data, signature)
    except minisign.VerifyError as error:
        raise FileError("the secret key is damaged: it does not fit its public key", "restore it") from error
    return bytes(signature) + b"\n"


def write_keys(secret: Path) -> tuple[Path, str]:
    """Write a new pair of keys, the secret one readable by its owner alone; return the public file, and the key in it.

    Raises
    ------
    FileError
        One of the files exists already, or cannot be written.
    """
    public = secret.with_suffix(PUBLIC_SUFFIX)
    for path in (secret, public):
        if path.exists() or path.is_symlink():
            raise already_there(plain(path), "give another name: a key that is replaced is lost")
    pair = minisign.KeyPair.generate()
    text = pair.public_key.to_base64().decode("ascii")
    # minisign writes the id with its highest byte first; the library's own comment would have it the other way round.
    pair.public_key.untrusted_comment = f"minisign public key {_key_id(text.encode())}"
    pair.secret_key.untrusted_comment = "minisign secret key"
    try:
        # The mode is set when the file is made: at no moment can another user open it.
        descriptor = os.open(secret, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(descriptor, "wb") as file:
            file.write(bytes(pair.secret_key) + b"\n")
        with public.open("xb") as file:
            file.write(bytes(pair.public_key) + b"\n")
    except OSError as error:
        raise unwritable(plain(secret), error) from error
    return public, text


def _bad(why: str) -> SignatureFinding:
    return SignatureFinding(Standing.BAD, f"NOT signed by the key given: {why}")


def _key_id(encoded: bytes) -> str:
    """Return the id inside an encoded key or signature as minisign writes it: 8 bytes, little-endian, hexadecimal."""
    return f"{int.from_bytes(base64.b64decode(encoded)[2:10], 'little'):016X}"


def _content(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(MAX_BYTES)
