"""Jobs of a run on a cluster that does not exist: workers, a scheduler that starts one job after another, a store, and failures.

List scheduling, as the engine does it: jobs are handed over in the order of the plan, as many as the scheduler holds at a time;
those that wait for nothing start in that order. A job asks the store for each object that it reads and writes, one after the other;
a request that fails is repeated after a pause. A worker that is taken away comes back after a while, and its job begins anew.
"""

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.pipeline.engine.workers.order_batches import MOST


class Jobs(NamedTuple):
    """In the order of the plan. `seconds`, `reads`, `writes` (objects), `bytes`: (N,); the jobs that job n waits for are
    before[first[n] : first[n + 1]]."""

    seconds: np.ndarray
    reads: np.ndarray
    writes: np.ndarray
    bytes: np.ndarray
    first: np.ndarray
    before: np.ndarray


class Cluster(NamedTuple):
    """`dispatch`: s for which a task keeps the scheduler busy, which is a job or several that take `together` s; `engine`: s of a
    worker for a job beside its work; `held`: jobs that the scheduler holds; `latency`: s a request; `bandwidth`: bytes a second of
    a worker; `refused`: share of requests that fail, repeated after `pause` s; `life`: mean s until a worker is taken away,
    `absence`: s until it is back."""

    workers: int
    dispatch: float
    engine: float
    held: int = 2000
    latency: float = 0.03
    bandwidth: float = 1e8
    refused: float = 0.0
    pause: float = 1.0
    life: float = np.inf
    absence: float = 120.0
    together: float = 0.0


class Outcome(NamedTuple):
    """`clock`: s from begin to end; `work`: s of the jobs alone; `busy`: share of `clock` in which the scheduler was; `lost`: s of
    work that was done twice; `longest`: s of the longest job."""

    clock: float
    work: float
    busy: float
    lost: float
    longest: float

    def efficiency(self, workers: int) -> float:
        """Share of the workers' time that went into jobs."""
        return self.work / (self.clock * workers)


def simulated(jobs: Jobs, cluster: Cluster, seed: int = 0) -> Outcome:
    """What a run of these jobs takes there. The same seed gives the same outcome."""
    random = np.random.default_rng(seed)
    requests = jobs.reads + jobs.writes
    seconds = jobs.seconds + cluster.engine + requests * cluster.latency + jobs.bytes / cluster.bandwidth
    seconds += random.binomial(requests, cluster.refused) * cluster.pause
    # Whether its worker is taken away while it runs, and when: at most once a job, for jobs are short beside a worker's life.
    until = random.exponential(cluster.life, len(seconds)) if np.isfinite(cluster.life) else np.full(len(seconds), np.inf)
    followers, after = _followers(jobs)
    dispatch = cluster.dispatch / np.clip(cluster.together / np.maximum(seconds, 1e-3), 1.0, MOST)
    clock, busy = _played(
        seconds, until, np.diff(jobs.first), followers, after, cluster.workers, dispatch, cluster.held, cluster.absence
    )
    lost = float(until[until < seconds].sum())
    return Outcome(clock, float(jobs.seconds.sum()), busy / clock, lost, float(jobs.seconds.max()))


def _followers(jobs: Jobs) -> tuple[np.ndarray, np.ndarray]:
    """The jobs that wait for job n, as Jobs holds those that it waits for."""
    count = len(jobs.seconds)
    waiting = np.repeat(np.arange(count), np.diff(jobs.first))
    order = np.argsort(jobs.before, kind="stable")
    followers = np.concatenate(([0], np.cumsum(np.bincount(jobs.before, minlength=count))))
    return followers, waiting[order]


@njit(cache=True)
def _played(seconds, until, missing, followers, after, workers, dispatch, held, absence):  # type: ignore[no-untyped-def]
    """(clock, seconds for which the scheduler was busy). `missing`: of how many jobs each one waits."""
    count = len(seconds)
    missing = missing.copy()
    ready, ends = [np.int64(0) for _ in range(0)], [(0.0, np.int64(0)) for _ in range(0)]
    free, handed, ended = workers, 0, 0
    now, next_start, busy = 0.0, 0.0, 0.0
    while ended < count:
        while handed < count and handed - ended < held:
            if missing[handed] == 0:
                heappush(ready, np.int64(handed))
            handed += 1
        while ready and free > 0:
            job = heappop(ready)
            next_start = max(now, next_start) + dispatch[job]
            busy += dispatch[job]
            free -= 1
            spent = seconds[job] if until[job] >= seconds[job] else until[job] + absence + seconds[job]
            heappush(ends, (next_start + spent, job))
        now, job = heappop(ends)
        free += 1
        ended += 1
        for place in range(followers[job], followers[job + 1]):
            other = after[place]
            missing[other] -= 1
            if missing[other] == 0 and other < handed:
                heappush(ready, other)
    return now, busy
