"""One run of the simulated project serves all tests that look at a finished one."""

import pytest
from simulated_run import Run, finished_run


@pytest.fixture(scope="session")
def run() -> Run:
    """The project run by two worker processes."""
    return finished_run()
