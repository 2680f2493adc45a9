"""Jobs of a run on a cluster that does not exist: workers, a scheduler that starts one job after another, a store, and failures.

List scheduling, as the engine does it: jobs are handed over in the order of the plan, as many as the scheduler holds at a time;
those that wait for nothing start in that order. A job asks the store for the objects that it reads several at a time, or one after
the other where it reads a stream; it writes one after the other. A request that fails is repeated after a pause. A worker that is
taken away comes back after a while, and its job begins anew: as often as it takes, or until the run gives the job up.
"""

from heapq import heappop, heappush
from typing import NamedTuple

import numpy as np

from orthomill.kernels.kernel_compilation import njit
from orthomill.pipeline.engine.workers.order_batches import MOST
from orthomill.pipeline.storage.depots.bucket import Bucket


class Jobs(NamedTuple):
    """In the order of the plan. `seconds`, `reads`, `writes` (objects), `bytes`: (N,); the jobs that job n waits for are
    before[first[n] : first[n + 1]]; `streamed` (N,): whether it reads one object after the other."""

    seconds: np.ndarray
    reads: np.ndarray
    writes: np.ndarray
    bytes: np.ndarray
    first: np.ndarray
    before: np.ndarray
    streamed: np.ndarray


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
    at_once: int = Bucket.at_once
    """objects that a job reads at a time"""
    deaths: int = 20
    """workers of a job that may die before it is given up, as the run does where Dask has its own settings"""


class Outcome(NamedTuple):
    """`clock`: s from begin to end; `work`: s of the jobs alone; `busy`: share of `clock` in which the scheduler was; `lost`: s of
    work that was done twice; `longest`: s of the longest job; `given_up`: jobs whose workers died again and again."""

    clock: float
    work: float
    busy: float
    lost: float
    longest: float
    given_up: int

    def efficiency(self, workers: int) -> float:
        """Share of the workers' time that went into jobs."""
        return self.work / (self.clock * workers)


def simulated(jobs: Jobs, cluster: Cluster, seed: int = 0) -> Outcome:
    """What a run of these jobs takes there. The same seed gives the same outcome."""
    random = np.random.default_rng(seed)
    requests, beside = jobs.reads + jobs.writes, np.where(jobs.streamed, 1, cluster.at_once)
    seconds = jobs.seconds + cluster.engine + jobs.bytes / cluster.bandwidth
    seconds += (np.ceil(jobs.reads / beside) + jobs.writes) * cluster.latency
    seconds += random.binomial(requests, cluster.refused) * cluster.pause / np.minimum(beside, np.maximum(requests, 1))
    deaths, lost = _lost(seconds, cluster, random)
    followers, after = _followers(jobs)
    dispatch = cluster.dispatch / np.clip(cluster.together / np.maximum(seconds, 1e-3), 1.0, MOST)
    spent = seconds + lost + deaths * cluster.absence
    clock, busy = _played(spent, np.diff(jobs.first), followers, after, cluster.workers, dispatch, cluster.held)
    given_up = int((deaths > cluster.deaths).sum())
    return Outcome(clock, float(jobs.seconds.sum()), busy / clock, float(lost.sum()), float(jobs.seconds.max()), given_up)


def _lost(seconds: np.ndarray, cluster: Cluster, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """How often the worker of each job (N,) is taken away while it runs, and the s of work (N,) that are lost by that."""
    deaths, lost = np.zeros(len(seconds), int), np.zeros(len(seconds))
    if not np.isfinite(cluster.life):
        return deaths, lost
    running = np.arange(len(seconds))
    while len(running) and deaths.max() <= cluster.deaths:
        until = random.exponential(cluster.life, len(running))
        cut = until < seconds[running]
        running, until = running[cut], until[cut]
        deaths[running] += 1
        lost[running] += until
    return deaths, lost


def _followers(jobs: Jobs) -> tuple[np.ndarray, np.ndarray]:
    """The jobs that wait for job n, as Jobs holds those that it waits for."""
    count = len(jobs.seconds)
    waiting = np.repeat(np.arange(count), np.diff(jobs.first))
    order = np.argsort(jobs.before, kind="stable")
    followers = np.concatenate(([0], np.cumsum(np.bincount(jobs.before, minlength=count))))
    return followers, waiting[order]


@njit(cache=True)
def _played(seconds, missing, followers, after, workers, dispatch, held):  # type: ignore[no-untyped-def]
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
            heappush(ends, (next_start + seconds[job], job))
        now, job = heappop(ends)
        free += 1
        ended += 1
        for place in range(followers[job], followers[job + 1]):
            other = after[place]
            missing[other] -= 1
            if missing[other] == 0 and other < handed:
                heappush(ready, other)
    return now, busy
