"""One run of the simulated project serves all tests that look at a finished one."""

import pytest
from simulated_run import Run, run_in


@pytest.fixture(scope="session")
def run(tmp_path_factory) -> Run:
    """The project run by two worker processes."""
    return run_in(tmp_path_factory.mktemp("simulated"), "--workers", "2")
