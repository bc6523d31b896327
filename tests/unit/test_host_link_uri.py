"""Links as people type them."""

import pytest

from host.errors import UsageError
from host.links import open_transport
from host.links.uri import parse_link_uri


@pytest.mark.parametrize(
    ("text", "scheme", "target", "options"),
    [
        ("serial:/dev/ttyACM0", "serial", "/dev/ttyACM0", {}),
        ("serial:/dev/ttyACM0?baud=1000000", "serial", "/dev/ttyACM0", {"baud": "1000000"}),
        ("/dev/serial/by-id/usb-a:b", "serial", "/dev/serial/by-id/usb-a:b", {}),
        ("COM3", "serial", "COM3", {}),
        ("com12?baud=9600", "serial", "com12", {"baud": "9600"}),
        ("serial:socket://127.0.0.1:5000", "serial", "socket://127.0.0.1:5000", {}),
        ("socket://127.0.0.1:5000", "serial", "socket://127.0.0.1:5000", {}),
        ("tcp:5000", "serial", "socket://127.0.0.1:5000", {}),
        ("tcp:10.0.0.2:5000", "serial", "socket://10.0.0.2:5000", {}),
        ("pty:/tmp/object", "serial", "/tmp/object", {}),
        ("can:socketcan:can0?bitrate=500000&node=2", "can", "socketcan:can0", {"bitrate": "500000", "node": "2"}),
        ("replay:trial.mcap", "replay", "trial.mcap", {}),
        ("/home/a/trial.mcap", "replay", "/home/a/trial.mcap", {}),
        ("replay:C:\\trials\\a.mcap", "replay", "C:\\trials\\a.mcap", {}),
    ],
)
def test_links_are_taken_apart(text, scheme, target, options):
    uri = parse_link_uri(text)
    assert (uri.scheme, uri.target, uri.options) == (scheme, target, options)


@pytest.mark.parametrize("text", ["", "   ", "serial:", "ttyACM0", "42"])
def test_what_is_no_link_says_how_links_look(text):
    with pytest.raises(UsageError, match="serial:/dev/ttyACM0"):
        parse_link_uri(text)


def test_an_unknown_kind_of_link_lists_the_known_ones():
    with pytest.raises(UsageError, match=r"bluetooth.*serial:"):
        open_transport("bluetooth:00:11:22")


def test_a_misspelt_option_is_refused():
    with pytest.raises(UsageError, match=r"option baudrate.*options here: baud"):
        open_transport("serial:/dev/null?baudrate=9600")


@pytest.mark.parametrize("baud", ["fast", "0", "-1", "99999999999999"])
def test_an_impossible_baud_rate_is_refused(baud):
    with pytest.raises(UsageError, match="baud="):
        open_transport(f"serial:/dev/null?baud={baud}")
