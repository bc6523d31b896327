#!/bin/sh
# What tests/integration/test_can_socketcan.py needs on Debian and Ubuntu (x86-64); without it that test is skipped.
set -eu
command -v apt-get >/dev/null || { echo "no apt-get here: see docs/can.md"; exit 1; }
apt-get update
apt-get install -y --no-install-recommends user-mode-linux can-utils iproute2
