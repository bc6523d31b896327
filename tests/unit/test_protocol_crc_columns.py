"""CRC of many packets at once, both ways, against the standard library."""

from binascii import crc_hqx

import numpy as np
import pytest

from firmware_protocol.serial.batch import FEW_PACKETS, crc_columns


@pytest.mark.parametrize("n", [1, 2, 300, FEW_PACKETS, FEW_PACKETS + 1])
@pytest.mark.parametrize("length", [1, 2, 15, 16, 17, 48])
def test_equal_to_crc_hqx(n, length):
    columns = np.random.default_rng(n + length).integers(0, 256, (length, n), dtype=np.uint8)
    columns[:, 0] = 0xFF
    before = columns.copy()
    low, high = crc_columns(columns)
    expected = [crc_hqx(packet.tobytes(), 0xFFFF) for packet in columns.T]
    assert (low + 256 * high.astype(int)).tolist() == expected
    assert low.dtype == high.dtype == np.uint8
    np.testing.assert_array_equal(columns, before)
