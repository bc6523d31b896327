"""docs/can.md says what the code does: ids, options, error bound, bus load."""

import re
from pathlib import Path

import pytest

from emulator.links.can.slcan_adapter import slcan_line
from firmware_protocol.can.frames import CanFrame
from firmware_protocol.can.mapping import WHOLE_ORIENTATION_BYTES, CanFunction, arbitration_id, time_interval
from firmware_protocol.codec import encode_packet
from firmware_protocol.packets import Status
from firmware_protocol.quantization import SMALLEST_THREE_MAX_ERROR_DEG, SMALLEST_THREE_PLAIN_MAX_ERROR_DEG
from host.links.can.drivers import can_settings
from host.links.can.log_kind import CANDUMP_LINE
from host.links.uri import parse_link_uri
from tests.can_traffic import object_at, sample_packets

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "can.md").read_text()


def test_the_table_of_ids_is_the_mapping() -> None:
    told = {}
    for numbers, ids in re.findall(r"^\| ([\d, ]+) \| ((?:`0x[0-9A-F]+ \+ n`(?:, )?)+) \|", PAGE, re.MULTILINE):
        for number, identifier in zip(numbers.split(","), re.findall(r"0x[0-9A-F]+", ids), strict=True):
            told[int(number)] = int(identifier, 16)
    assert told == {int(function): arbitration_id(function, 0) for function in CanFunction}


def test_every_link_and_option_of_the_page_is_accepted() -> None:
    links = re.findall(r"`(can:[a-z_]+:[^`\s…]+)`", PAGE)
    assert len(links) > 10
    for link in links:
        if "INTERFACE" not in link:
            assert can_settings(parse_link_uri(link)).channel
    options = re.findall(r"^\| `([a-z_]+)` \| .* \| .* \|$", PAGE, re.MULTILINE)
    assert set(options) == {"node", "bitrate", "fd", "data_bitrate", "listen_only", "baud"}


def test_the_error_bounds_are_those_of_the_code() -> None:
    bounds = re.search(r"off by at most ([\d.]+)° \(([\d.]+)° from", PAGE)
    assert SMALLEST_THREE_MAX_ERROR_DEG <= float(bounds[1]) < 1.02 * SMALLEST_THREE_MAX_ERROR_DEG
    assert SMALLEST_THREE_PLAIN_MAX_ERROR_DEG <= float(bounds[2]) < 1.05 * SMALLEST_THREE_PLAIN_MAX_ERROR_DEG


CLASSIC_BITS = 8 * 8 + 44 + 3 + (34 + 8 * 8 - 1) // 4
FD_SLOW_BITS = 17 + (17 - 1) // 4 + 1 + 1 + 1 + 7 + 3
"""SOF, id and control bits up to BRS, their stuff bits, CRC delimiter, ACK and its delimiter, EOF, intermission."""
_FD_DATA = 1 + 4 + 8 * WHOLE_ORIENTATION_BYTES  # ESI, DLC, data
FD_FAST_BITS = _FD_DATA + _FD_DATA // 4 + 4 + 21 + 7
"""With stuff bits, stuff bit count, CRC-21 and its fixed stuff bits (ISO 11898-1:2015)."""


def frames_per_second(rate_hz: int) -> tuple[float, int]:
    """TIME and SAMPLE_STATE frames for each sample, and STATUS frames a second: as an object sends them."""
    end = object_at(1, rate_hz=rate_hz)
    frames = end.encode(sample_packets(10 * rate_hz, rate_hz))
    return len(frames) / (10 * rate_hz) - 1.0, len(end.encode([encode_packet(Status(1))]))


def test_the_bus_load_follows_from_what_an_object_sends() -> None:
    assert f"at most {CLASSIC_BITS} with stuff bits" in PAGE
    assert f"at most {FD_SLOW_BITS} bits at the slow and {FD_FAST_BITS} at the fast rate" in PAGE
    rows = re.findall(r"^\| (\d+) Hz \|" + r" (\d+) \|" * 6, PAGE, re.MULTILINE)
    assert len(rows) == 4
    for rate, *objects in (map(int, row) for row in rows):
        others, status = frames_per_second(rate)
        assert others == pytest.approx(2 / time_interval(rate), abs=2 / rate)
        frames = rate * (1 + 2 / time_interval(rate)) + status
        for bitrate, told in zip((125e3, 250e3, 500e3, 1e6), objects[:4], strict=True):
            assert told == min(31, int(0.8 * bitrate / (frames * CLASSIC_BITS)))
        for (slow, fast), told in zip(((500e3, 2e6), (1e6, 5e6)), objects[4:], strict=True):
            sample_s = FD_SLOW_BITS / slow + FD_FAST_BITS / fast
            classic_s = 2 / time_interval(rate) * CLASSIC_BITS / slow
            status_s = FD_SLOW_BITS / slow + (FD_FAST_BITS + 200) / fast
            assert told == min(31, int(0.8 / (rate * (sample_s + classic_s) + status_s)))


def test_an_slcan_adapter_wants_the_uart_the_page_says() -> None:
    line = slcan_line(CanFrame(0x181, bytes(8))) + b"\r"
    assert f"a classic\nframe is {len(line)} characters" in PAGE
    others, status = frames_per_second(1000)
    told = int(re.search(r"1000 Hz wants (\d+) kbit/s", PAGE)[1])
    assert 0 <= told - (1000 * (1 + others) + status) * len(line) * 10 / 1000 < 5


def test_candump_lines_are_recognised() -> None:
    assert CANDUMP_LINE.match("(1700000000.123456) can0 183#0011223344556677")
    assert CANDUMP_LINE.match("(1700000000.123456) vcan0 583##1" + "00" * 20)
    assert not CANDUMP_LINE.match("(1700000000.123456) can0")


def test_the_sentences_of_the_page_are_those_of_the_code() -> None:
    root = Path(__file__).resolve().parents[2]
    sources = [*root.glob("host/links/can/*.py"), *root.glob("host/stream/*.py")]
    code = "\n".join(path.read_text() for path in [*sources, root / "firmware_protocol/can/decoder.py"])
    code = re.sub(r'"\s*f?"', "", code)
    rows = re.findall(r"^\| (\*.*?\*) \|", PAGE, re.MULTILINE)
    assert len(rows) > 8
    for row in rows:
        for sentence in re.findall(r"\*([^*]+)\*", row):
            for part in sentence.split("…"):
                assert part.strip(" :") in code, sentence
