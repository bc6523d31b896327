"""The C library for the tests here: on this machine under the sanitizers, and on emulated Cortex-M boards."""

import pytest

from tests.c_library.build import CORES, Driver, MissingToolError, host_driver, target_driver

HOST = "host"


def driver_of(where: str) -> Driver:
    try:
        return host_driver() if where == HOST else target_driver(where)
    except MissingToolError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="session")
def c_driver() -> Driver:
    """The library on this machine."""
    return driver_of(HOST)


@pytest.fixture(scope="session", params=[HOST, *CORES])
def any_driver(request: pytest.FixtureRequest) -> Driver:
    """The library everywhere it can run."""
    return driver_of(request.param)
