"""Answers that break off: requests are made again, and nothing else is."""

import pytest

pytest.importorskip("obstore")

from obstore import exceptions

from orthomill.pipeline.storage.depots import repeated_requests
from orthomill.pipeline.storage.depots.repeated_requests import repeated

CUT = "Generic S3 error: Error getting list response body: HTTP error: request or response body error"


def answering(*errors: Exception):
    """A request that fails so often before it answers, and how often it was made."""
    made, waiting = [], list(errors)

    def request() -> str:
        made.append(1)
        if waiting:
            raise waiting.pop(0)
        return "answer"

    return request, made


def test_an_answer_that_breaks_off_is_asked_for_again(monkeypatch):
    pauses = []
    monkeypatch.setattr(repeated_requests.time, "sleep", pauses.append)
    request, made = answering(*[exceptions.GenericError(CUT)] * 3)
    assert repeated(request) == "answer" and len(made) == 4
    assert pauses == [0.3, 0.6, 1.2]


@pytest.mark.parametrize("error", [exceptions.GenericError("the key is wrong"), FileNotFoundError(), exceptions.BaseError(CUT)])
def test_other_errors_are_not(error):
    request, made = answering(error)
    with pytest.raises(type(error)):
        repeated(request)
    assert len(made) == 1


def test_patience_has_an_end(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(repeated_requests.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(repeated_requests.time, "sleep", lambda pause: now.__setitem__(0, now[0] + pause))
    request, made = answering(*[exceptions.GenericError(CUT)] * 1000)
    with pytest.raises(exceptions.GenericError):
        repeated(request)
    assert 20 < len(made) < 40 and now[0] <= 300.0
