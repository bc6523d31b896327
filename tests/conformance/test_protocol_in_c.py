"""The C code of docs/protocol.md, compiled as it stands there, against the golden vectors."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from firmware_protocol.serial.framing import FrameDecoder
from tests.vectors.files import load_vectors
from tests.waiting import HANG_S

PAGE = Path(__file__).resolve().parents[2] / "docs" / "protocol.md"
VECTORS = load_vectors()
HARNESS = """
#include <stdio.h>
#include <string.h>

static void print_hex(const uint8_t *data, size_t n)
{
    while (n--) printf("%02x", *data++);
    printf("\\n");
}

int main(void)
{
    static char word[8192];
    static uint8_t data[4096], frame[300];
    while (scanf("%15s", word) == 1) {
        const char kind = word[0];
        size_t n = 0;
        if (kind == 's') {
            unsigned sequence, time_us, flags;
            float q[4];
            if (scanf("%u %u %f %f %f %f %u", &sequence, &time_us, q, q + 1, q + 2, q + 3, &flags) != 7) return 1;
            orientation_packet(data, (uint16_t)sequence, time_us, q, (uint8_t)flags);
            print_hex(data, 16);
            continue;
        }
        if (scanf("%8191s", word) != 1) return 1;
        for (unsigned byte; sscanf(word + 2 * n, "%2x", &byte) == 1; n++) data[n] = (uint8_t)byte;
        if (kind == 'f') print_hex(frame, make_frame(frame, data, n));
        if (kind == 'c') printf("%04x\\n", crc16(data, n));
        if (kind == 'b') {
            const uint8_t *packet;
            for (size_t k = 0; k < n; k++) {
                const size_t size = take_byte(data[k], &packet);
                if (size) print_hex(packet, size);
            }
        }
    }
    return 0;
}
"""


@pytest.fixture(scope="module")
def c_code(tmp_path_factory):
    """Run the compiled code on lines of input; return its lines of output."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("the C code needs a C compiler")
    folder = tmp_path_factory.mktemp("c")
    (code,) = re.findall(r"```c\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (folder / "wire.c").write_text(code + HARNESS, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O1"]
    subprocess.run([compiler, *flags, "-o", "wire", "wire.c", "-lm"], cwd=folder, check=True, timeout=HANG_S)

    def run(*lines):
        done = subprocess.run(
            [folder / "wire"], input="\n".join(lines), capture_output=True, text=True, check=True, timeout=HANG_S
        )
        return done.stdout.splitlines()

    return run


def test_checksums(c_code):
    vectors = [vector for vector in VECTORS["crc16"] if vector["bytes"]]
    assert c_code(*(f"c {vector['bytes']}" for vector in vectors)) == [vector["crc"] for vector in vectors]


def test_every_packet_gets_its_frame(c_code):
    packets = VECTORS["packets"]
    assert c_code(*(f"f {vector['packet']}" for vector in packets)) == [vector["frame"] for vector in packets]


def test_the_longest_packet_without_a_zero(c_code):
    (frame,) = c_code("f " + "55" * 252)
    assert len(frame) == 2 * 257
    assert FrameDecoder().feed(bytes.fromhex(frame)) == [b"\x55" * 252]


def test_samples_are_the_bytes_of_the_vectors(c_code):
    samples = [vector for vector in VECTORS["packets"] if vector["packet_type"] == "ORIENTATION"]
    assert len(samples) >= 3
    lines = []
    for vector in samples:
        fields = vector["fields"]
        quat = " ".join(map(repr, fields["q_wxyz"]))
        lines.append(f"s {fields['sequence']} {fields['device_time_us']} {quat} {fields['flags']}")
    assert c_code(*lines) == [vector["packet"] for vector in samples]


def test_frames_are_received(c_code):
    packets = VECTORS["packets"]
    assert c_code(*(f"b {vector['frame']}" for vector in packets)) == [vector["packet"] for vector in packets]


def test_good_and_bad_streams_give_the_packets_that_ours_gives(c_code):
    """One receiver for all of them, a delimiter between: what is bad in one does not spoil the next."""
    streams = [bytes.fromhex(vector["bytes"]) + b"\0" for vector in VECTORS["streams"]]
    received = c_code(*(f"b {stream.hex()}" for stream in streams))
    decoder = FrameDecoder()
    assert received == [packet.hex() for stream in streams for packet in decoder.feed(stream) if packet]
    assert len(received) > 30
