"""The board of tiles: states follow what happened, and a page that asks again and again ends with the same picture."""

from hypothesis import given, settings
from hypothesis import strategies as st

from orthomill.pipeline.watching import tile_board
from orthomill.pipeline.watching.tile_board import ENDED, Panel, TileBoard, TileState

PANEL = Panel("source", "numbers")


def key(number):
    return ("source", "tile", 0, number)


def board(count):
    made = TileBoard("run", {"source": "Source"})
    for number in range(count):
        made.add(key(number), PANEL, number, 0)
    return made


def states(made):
    answer, found = made.since(0, 0), [TileState.WAITING] * len(made.keys)
    for at in range(0, len(answer["changed"]), 6):
        found[answer["changed"][at]] = TileState(answer["changed"][at + 1])
    return found


def test_a_worker_runs_one_tile_of_those_that_it_got():
    made = board(4)
    for number, worker in enumerate("aabb"):
        made.started(key(number), worker)
    assert states(made) == [TileState.RUNNING, TileState.WAITING, TileState.RUNNING, TileState.WAITING]
    made.ended(key(0), TileState.DONE, 1.5, 300.0)
    assert states(made)[:2] == [TileState.DONE, TileState.RUNNING]


def test_a_tile_that_is_handed_out_again_is_retried_but_one_that_only_waited_is_not():
    made = board(2)
    made.started(key(0), "a")
    made.started(key(1), "a")
    for number in range(2):
        made.came_back(key(number), failed=False)
    for number in range(2):
        made.started(key(number), "b")
    assert states(made) == [TileState.RETRIED, TileState.WAITING]
    assert made.since(0, 0)["changed"][5] == 2, "its second attempt"


def test_a_failed_attempt_counts_wherever_the_tile_stood_in_the_queue():
    made = board(2)
    made.started(key(0), "a")
    made.started(key(1), "a")
    made.came_back(key(1), failed=True)
    made.started(key(1), "a")
    assert states(made) == [TileState.RUNNING, TileState.RETRIED]


def test_what_dask_tells_late_does_not_bring_a_tile_back():
    made = board(1)
    made.ended(key(0), TileState.UNCHANGED)
    made.started(key(0), "a")
    made.started(("source", "unknown", 0, 0), "a")
    assert states(made) == [TileState.UNCHANGED]


def test_an_answer_holds_only_what_is_new():
    made = board(3)
    first = made.since(0, 0)
    assert first["places"] == [0, 0, 0, 0, 1, 0, 0, 2, 0] and first["changed"] == []
    made.ended(key(1), TileState.FAILED, 2.0)
    later = made.since(first["tiles"], first["changes"])
    assert later["places"] == [] and later["changed"][:3] == [1, TileState.FAILED, 2.0]
    assert made.since(later["tiles"], later["changes"])["changed"] == [] and made.counts()[TileState.FAILED] == 1


@settings(deadline=None, max_examples=60)
@given(
    events=st.lists(st.tuples(st.sampled_from("sef"), st.integers(0, 9), st.sampled_from("ab")), max_size=60),
    asked=st.sets(st.integers(0, 60)),
    most=st.integers(1, 7),
)
def test_a_page_that_asks_now_and_then_sees_what_one_sees_that_asks_at_the_end(events, asked, most):
    made, seen, tiles, changes = board(10), [TileState.WAITING] * 10, 0, 0
    before, tile_board.MOST = tile_board.MOST, most
    try:
        for number, (event, tile, worker) in enumerate(events):
            if event == "s":
                made.started(key(tile), worker)
            else:
                made.ended(key(tile), TileState.DONE if event == "e" else TileState.FAILED)
            if number in asked:
                tiles, changes = told(made, seen, tiles, changes)
        while made.since(tiles, changes)["more"]:
            tiles, changes = told(made, seen, tiles, changes)
        told(made, seen, tiles, changes)
    finally:
        tile_board.MOST = before
    assert seen == states(made)
    assert seen.count(TileState.RUNNING) <= 2, "two workers run two tiles at most"
    assert all(state in ENDED for state, number in zip(seen, range(10), strict=True) if ("e", number) in {e[:2] for e in events})


def told(made, seen, tiles, changes):
    answer = made.since(tiles, changes)
    for at in range(0, len(answer["changed"]), 6):
        seen[answer["changed"][at]] = TileState(answer["changed"][at + 1])
    return answer["tiles"], answer["changes"]
