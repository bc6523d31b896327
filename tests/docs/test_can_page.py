"""docs/can.md says what the code does: ids, options, error bound, bus load."""

import re
from pathlib import Path

from firmware_protocol.can_mapping import CanFunction, arbitration_id, time_interval
from firmware_protocol.quantization import SMALLEST_THREE_MAX_ERROR_DEG, SMALLEST_THREE_PLAIN_MAX_ERROR_DEG
from host.link_uri import parse_link_uri
from host.transports.can_bus_drivers import can_settings
from host.transports.can_log_kind import CANDUMP_LINE

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


def test_the_bus_load_follows_from_the_mapping() -> None:
    bits = 8 * 8 + 44 + 3 + (34 + 8 * 8 - 1) // 4
    assert f"at most {bits} with stuff bits" in PAGE
    rows = re.findall(r"^\| (\d+) Hz \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|", PAGE, re.MULTILINE)
    assert len(rows) == 4
    for rate, *objects in (map(int, row) for row in rows):
        frames = rate * (1 + 2 / time_interval(rate)) + 5
        for bitrate, told in zip((125e3, 250e3, 500e3, 1e6), objects, strict=True):
            assert told == min(31, int(0.8 * bitrate / (frames * bits)))


def test_candump_lines_are_recognised() -> None:
    assert CANDUMP_LINE.match("(1700000000.123456) can0 183#0011223344556677")
    assert CANDUMP_LINE.match("(1700000000.123456) vcan0 583##1" + "00" * 20)
    assert not CANDUMP_LINE.match("(1700000000.123456) can0")
