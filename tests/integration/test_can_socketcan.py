"""Real SocketCAN: a user-mode kernel with CAN boots as an ordinary process, and our links are checked inside it.

What is checked stands in ``tests/uml/guest_checks.py``; ``tests/system-packages.sh`` installs what it needs.
"""

from __future__ import annotations

import pytest

from tests.uml.boot import boot, missing

CHECKS = [
    "vcan_classic",
    "vcan_fd",
    "kernel_slcan_against_our_adapter",
    "the_same_trial_by_capture_candump_and_canplayer",
    "link_down_and_up_during_a_capture",
    "two_objects_on_one_bus_are_captured_at_once",
    "error_frames_of_the_kernel_are_told",
    "filters_are_in_the_kernel",
    "an_interface_that_is_pulled_and_comes_back_is_opened_again",
    "interfaces_that_are_missing_or_down_are_told_at_once",
    "ports_lists_the_interfaces",
]
LIMIT_S = 480


@pytest.fixture(scope="module")
def said(tmp_path_factory: pytest.TempPathFactory) -> str:
    """What the guest printed."""
    reason = missing(("candump", "canplayer", "slcand", "ip"), "vcan")
    if reason:
        pytest.skip(reason)
    text = boot("tests.uml.guest_checks", tmp_path_factory.mktemp("uml"), LIMIT_S)
    if "CHECK" not in text:
        pytest.skip(f"the user-mode kernel does not run here: {text.strip().splitlines()[-1:]}")
    return text


@pytest.mark.parametrize("check", CHECKS)
def test_real_socketcan(check: str, said: str) -> None:
    assert f"CHECK {check} ok" in said, said[-4000:]
