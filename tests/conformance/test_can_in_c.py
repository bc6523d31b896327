"""The C code of docs/can.md, compiled as it stands there, against the frames of the emulator's object."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from analysis.geometry.rotations import distance
from firmware_protocol.can.decoder import CanStreamDecoder
from firmware_protocol.can.frames import CanFrame, pack_frames
from firmware_protocol.can.mapping import boot_tag
from firmware_protocol.quantization import SMALLEST_THREE_PLAIN_MAX_ERROR_DEG
from tests.can_traffic import is_sample, joined, object_at, sample_packets, unit_quaternions
from tests.vectors.files import load_vectors
from tests.waiting import HANG_S

PAGE = Path(__file__).resolve().parents[2] / "docs" / "can.md"
NODE = 5
HARNESS = """
#include <stdio.h>

void can_send(uint16_t id, const uint8_t data[8])
{
    printf("%03x ", id);
    for (int k = 0; k < 8; k++) printf("%02x", data[k]);
    printf("\\n");
}

int main(void)
{
    unsigned tag, rate, counter, time_us, flags;
    float q[4];
    while (scanf("%u %u %u %u %f %f %f %f %u", &tag, &rate, &counter, &time_us, q, q + 1, q + 2, q + 3, &flags) == 9)
        send_sample(5, (uint8_t)tag, (uint16_t)rate, counter, time_us, q, (uint8_t)flags);
    return 0;
}
"""


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None:
        pytest.skip("the C code needs a C compiler")
    folder = tmp_path_factory.mktemp("c")
    (code,) = re.findall(r"```c\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    (folder / "object.c").write_text(code + HARNESS, encoding="utf-8")
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-O1"]
    subprocess.run([compiler, *flags, "-o", "object", "object.c", "-lm"], cwd=folder, check=True, timeout=HANG_S)
    return folder / "object"


def sent(program: Path, rate_hz: int, times_us: np.ndarray, quats: np.ndarray, flags: np.ndarray) -> list[CanFrame]:
    """What the C code sends of samples 0, 1, 2 …"""
    tag = boot_tag(7, 9)  # those of info_packet
    lines = [
        f"{tag} {rate_hz} {k} {times_us[k]} {' '.join(map(repr, quats[k].tolist()))} {flags[k]}"
        for k in range(len(quats))
    ]
    done = subprocess.run([program], input="\n".join(lines), capture_output=True, text=True, check=True, timeout=HANG_S)
    pairs = [line.split() for line in done.stdout.splitlines()]
    return [CanFrame(int(identifier, 16), bytes.fromhex(data)) for identifier, data in pairs]


@pytest.mark.parametrize("rate_hz", [10, 200, 300, 1000])
def test_the_frames_are_those_of_our_object_and_the_host_reads_them(program: Path, rate_hz: int) -> None:
    n = 700
    quats = np.concatenate([unit_quaternions(n - 8), np.eye(4), -np.eye(4)])
    flags = np.where(np.arange(n) % 150 < 20, 9, 8)
    times_us = (100 + np.arange(n) * 1_000_000 // rate_hz) & 0xFFFFFFFF
    frames = sent(program, rate_hz, times_us, quats, flags)
    ours = object_at(NODE, rate_hz=rate_hz).encode(sample_packets(n, rate_hz, flags=flags, quats=quats))
    assert [frame.arbitration_id for frame in frames] == [frame.arbitration_id for frame in ours]
    for frame, own in zip(frames, ours, strict=True):
        assert frame.data[:1] == own.data[:1]
        assert is_sample(frame) or frame == own
    decoder = CanStreamDecoder(NODE)
    got = joined(decoder.feed(pack_frames(frames)))
    assert np.array_equal(got.sequence, np.arange(n))
    assert np.abs(got.device_time_us - times_us.astype(np.int64)).max() <= 1
    assert np.array_equal(got.flags, flags)
    assert np.degrees(distance(got.quats_wxyz, quats).max()) <= SMALLEST_THREE_PLAIN_MAX_ERROR_DEG
    assert decoder.counters.malformed == 0


def test_an_imu_on_a_clock_of_its_own_keeps_its_times_by_more_time_frames(program: Path) -> None:
    n = 500
    jitter = np.random.default_rng(1).integers(-4, 5, n)
    times_us = (1000 + np.arange(n) * 1_000_000 / 993.7 + jitter).astype(np.int64)
    flags = np.full(n, 8)
    frames = sent(program, 1000, times_us, unit_quaternions(n), flags)
    decoder = CanStreamDecoder(NODE)
    got = joined(decoder.feed(pack_frames(frames)))
    assert np.abs(got.device_time_us - times_us).max() <= 1
    assert 0.8 * n < len(frames) - n < n  # a TIME for nearly every sample, nothing else


def test_the_codes_are_those_of_the_vectors(program: Path) -> None:
    vectors = load_vectors()["quaternions"]
    quats = np.array([vector["q_wxyz"] for vector in vectors])
    frames = sent(program, 1000, 1000 * np.arange(len(quats)), quats, np.zeros(len(quats), int))
    codes = [frame.data[1:] for frame in frames if is_sample(frame)]
    for code, vector in zip(codes, vectors, strict=True):
        exact = int(vector["smallest_three"], 16)
        given = int.from_bytes(code, "little")
        assert given >> 54 == exact >> 54
        for shift in (0, 18, 36):  # plain rounding may be another neighbour
            assert abs((given >> shift & 0x3FFFF) - (exact >> shift & 0x3FFFF)) <= 1
