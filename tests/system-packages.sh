#!/bin/sh
# Installs what some tests need beside Python, on Debian and Ubuntu: a browser, GNU Octave, a C compiler, minisign, the
# user-mode kernel with SocketCAN, tools of ext4; last, as they are large (100 MB to download), what compiles C for a
# Cortex-M and emulates it, and a fuzzer. Best effort: it asks nothing, ends within LIMIT_S seconds, and always with 0,
# because a test whose program is missing skips and says so.   LIMIT_S=300 tests/system-packages.sh
set -u
DEADLINE=$(($(date +%s) + ${LIMIT_S:-300}))
LOG=$(mktemp)
trap 'rm -f "$LOG"' EXIT

any() { for program; do PATH="$PATH:/usr/sbin:/sbin" command -v "$program" >/dev/null && return 0; done; return 1; }

wanted=""
any chromium chromium-browser google-chrome google-chrome-stable chrome || wanted="$wanted chromium"
any octave-cli octave || wanted="$wanted octave"
any gcc cc || wanted="$wanted gcc libc6-dev"
any unzip || wanted="$wanted unzip"
any ip || wanted="$wanted iproute2"
any candump || wanted="$wanted can-utils"
any minisign || wanted="$wanted minisign"
any debugfs || wanted="$wanted e2fsprogs"
[ "$(uname -m)" != x86_64 ] || any linux.uml || wanted="$wanted user-mode-linux"
large=""
any arm-none-eabi-gcc || large="$large gcc-arm-none-eabi"
[ -e /usr/lib/arm-none-eabi/newlib ] || large="$large libnewlib-arm-none-eabi"
any qemu-system-arm || large="$large qemu-system-arm"
any clang || large="$large clang libclang-rt-dev"
[ -n "$wanted$large" ] || exit 0

if [ "$(id -u)" = 0 ]; then root=""; else root="sudo -n"; fi
if ! any apt-get || ! $root true 2>/dev/null; then
  echo "system packages: no apt-get, or not allowed to use it; tests that need$wanted$large will skip"
  exit 0
fi

apt() { # in the time that is left
  left=$((DEADLINE - $(date +%s)))
  [ "$left" -gt 0 ] || return 1
  $root timeout --kill-after=10 "$left" env DEBIAN_FRONTEND=noninteractive apt-get -qq -y --no-install-recommends \
    -o DPkg::Lock::Timeout=60 -o Acquire::Retries=2 -o Acquire::http::Timeout=20 "$@" </dev/null >"$LOG" 2>&1
}

install() { # all at once; where that fails one by one, as one that cannot be had must not cost the others
  [ "$#" -gt 0 ] || return 0
  apt install "$@" && return 0
  for package; do
    apt install "$package" || echo "system packages: no $package ($(tail -n 1 "$LOG")); its tests will skip"
  done
}

echo "system packages: installing$wanted$large"
apt update || echo "system packages: the lists could not be renewed"
# shellcheck disable=SC2086 # lists of names
install $wanted
# shellcheck disable=SC2086
install $large
exit 0
