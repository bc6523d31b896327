#!/usr/bin/env bash
# py-minisign writes the id of a key into the comment of its files with the bytes in the order of the file; minisign itself
# prints and writes them as a number, which is the other way round. Signatures and keys work both ways; but a key that one
# laboratory publishes by its id does not seem to be the one that the other has.
#
# Guessed: both write the same sixteen digits for one key.
# Seen with py-minisign 0.21.1 and minisign 0.11 of Debian 12 (2026-12-01), of one key; each run makes another:
#   minisign:    CB6BAFDCBCB70148
#   py-minisign: 4801B7BCDCAF6BCB
# Compare the keys themselves, or read the comment of one program only. Exit code 1 when this changes.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$work"
apt-get download -qq minisign=0.11-1 libsodium23 > /dev/null
for package in ./*.deb; do dpkg -x "$package" root; done
export LD_LIBRARY_PATH=$(dirname "$(find root -name 'libsodium.so.23' | head -1)")
python3 -m venv venv
venv/bin/pip install --quiet py-minisign==0.21.1
cat > seen.py <<'PY'
import subprocess
from pathlib import Path

from minisign import KeyPair

pair = KeyPair.generate()
ours = bytes(pair.public_key).decode().splitlines()[0].split()[-1]
Path("key.sec").write_bytes(bytes(pair.secret_key))
subprocess.run(["root/usr/bin/minisign", "-R", "-W", "-s", "key.sec", "-p", "key.pub"], check=True, capture_output=True)
theirs, key = Path("key.pub").read_text().splitlines()
assert key == bytes(pair.public_key).decode().splitlines()[1]
print(f"minisign:    {theirs.split()[-1]}")
print(f"py-minisign: {ours}")
raise SystemExit(bytes.fromhex(ours)[::-1] != bytes.fromhex(theirs.split()[-1]) or ours in theirs)
PY
venv/bin/python seen.py
