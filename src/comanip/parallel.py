"""Where independent work runs: here, in processes of this machine, or on a cluster. Same work, same bits.

`each` maps a function over work and gives the results in order: through joblib on this machine, and inside

    with comanip.backend("dask", address="tcp://scheduler:8786"):
        select_states(lessons, range(3, 13), channels=names)

on the workers of that cluster: not through joblib's own Dask backend, where in 1.6 an error on a worker, even a file that is
missing there, makes it wait for ever, and what it scatters is lost with the worker that holds it. Any other backend that joblib
knows is joblib's to choose; with Ray

    ray.util.joblib.register_ray()
    with joblib.parallel_config(backend="ray"):
        select_states(lessons, range(3, 13), channels=names, n_jobs=-1)

The bits are equal as long as all machines have one instruction set; COMANIP_KERNELS=avx2 settles that for a mixed cluster.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from . import __version__
from .errors import BackendError, ParameterError

BACKENDS = ("processes", "dask")
PATIENCE_S = 10.0  # for a scheduler to answer, and for its first worker
MOST_DEATHS = 4  # without a result between them: then the call is the cause
ORPHANED_S = 0.25  # after which a worker notices that whoever asked for its work is gone
AHEAD = 4  # calls a thread of the cluster that are handed out before their turn: enough that none waits, too few to fill memory

TIDY = "ignore:resource_tracker:UserWarning"

_cluster: ContextVar[Any] = ContextVar("_cluster", default=None)


@contextmanager
def backend(name: str = "processes", *, address: str | None = None) -> Iterator[None]:
    """While it lasts, `each` and everything built on it run there.

    name     "processes": of this machine, as many as the caller asks for. "dask": a cluster, by its scheduler's `address`
    address  for example tcp://10.0.0.5:8786

    Raises BackendError when dask is not installed, nobody listens within 10 s, or a worker has another comanip; ParameterError
    for a name that is unknown or an address without a cluster.
    """
    if name not in BACKENDS:
        raise ParameterError(f"backend {name!r} is unknown; there are: {', '.join(BACKENDS)}")
    if (name == "dask") != bool(address):
        raise ParameterError(
            "backend 'dask' needs the scheduler's address, for example tcp://10.0.0.5:8786"
            if name == "dask"
            else f"address {address!r} is for backend 'dask'; processes of this machine have none"
        )
    if name == "processes":
        yield
        return
    client = _client(str(address))
    token = _cluster.set(client)
    try:
        yield
    finally:
        _cluster.reset(token)
        client.close()


def each(function: Callable[..., Any], work: Iterable[tuple[Any, ...]], *, n_jobs: int = 1) -> Iterator[Any]:
    """function(*item) of every item, in order; n_jobs processes (−1: one a core), or the whole cluster of `backend`.

    What a call raises is raised here, in its turn. A call whose worker dies is made again by another, here as on a cluster (and
    with it, here, those that were under way); a call that has lost four workers is taken for the cause, and BackendError says so.
    Processes of this machine do not hear Control-C, which is for whoever asked for the work, and end when that one is gone.
    """
    client = _cluster.get()
    if client is not None:
        return _on_cluster(client, function, work)
    if n_jobs == 1:
        return (function(*item) for item in work)
    from joblib import Parallel, delayed
    from joblib.parallel import get_active_backend

    here = get_active_backend()[0]
    if type(here).__name__ == "LokyBackend":
        return _in_processes(function, work, n_jobs)
    comes_in_turn = getattr(here, "supports_return_generator", False)  # Ray's gives all at the end
    parallel = Parallel(n_jobs=n_jobs, return_as="generator" if comes_in_turn else "list")
    return iter(parallel(delayed(function)(*item) for item in work))


@contextmanager
def deaf() -> Iterator[None]:
    """Processes that are started meanwhile never hear Control-C: they inherit the mask. One that comes is delivered after it."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    _begin_trackers()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _begin_trackers() -> None:
    """Whoever starts a process by multiprocessing or loky starts its resource tracker first, which unblocks Control-C once it
    runs, whatever was blocked before: workers that came after it died of Control-C, each with a traceback. What an interrupted
    pool leaves the trackers clean up, and need not say so behind the one line about Control-C.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as of_loky

    sys.warnoptions.append(TIDY)  # is handed on to the processes that are started now
    try:
        resource_tracker.ensure_running()
        of_loky.ensure_running()
    finally:
        sys.warnoptions.remove(TIDY)


def end_with(parent: int) -> None:
    """What a child process begins with: it ends soon after its parent, be it by kill -9, and hears no Control-C."""
    if os.getpid() == parent or sys.platform == "win32":  # Windows tells of no parent that has gone
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_wait_for_end, args=(parent,), daemon=True).start()


def _wait_for_end(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(ORPHANED_S)
    os._exit(1)


def end_workers() -> None:
    """Ends the processes of this machine that `each` started, whatever they are at."""
    loky = sys.modules.get("joblib.externals.loky.reusable_executor")
    executor = getattr(loky, "_executor", None)
    if executor is not None:
        executor.shutdown(wait=True, kill_workers=True)


def _in_processes(function: Callable[..., Any], work: Iterable[tuple[Any, ...]], n_jobs: int) -> Iterator[Any]:
    """Of this machine. joblib ends all with the first worker that dies and does not say whose call it held: what came out before
    is kept, and the rest is begun again, from the first call that has no result."""
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import TerminatedWorkerError

    items, asked, done, deaths, last = iter(work), deque[tuple[Any, ...]](), 0, 0, -1

    def ahead() -> Iterator[tuple[Any, ...]]:
        """What is still without a result, then what was never asked for."""
        yield from list(asked)
        for item in items:
            asked.append(item)
            yield item

    while True:
        parallel = Parallel(n_jobs=n_jobs, return_as="generator", initializer=end_with, initargs=(os.getpid(),))
        with deaf():
            results = parallel(delayed(_outcome)(function, item) for item in ahead())
        try:
            for result, error in results:
                asked.popleft()
                done += 1
                if error is not None:
                    raise error
                yield result
            return
        except TerminatedWorkerError:
            deaths = deaths + 1 if done == last else 1
            last = done
            if deaths >= MOST_DEATHS:
                raise BackendError(
                    f"workers died {deaths} times before call {done + 1} had a result; too little memory here? "
                    f"Fewer at a time need less: n_jobs={max(abs(n_jobs) // 2, 1)}"
                ) from None


def _outcome(function: Callable[..., Any], item: tuple[Any, ...]) -> tuple[Any, Exception | None]:
    """What a call gives, or raises: joblib would end all with an error at once, before calls whose turn comes first."""
    try:
        return function(*item), None
    except Exception as error:
        error.add_note("in a worker: " + "".join(traceback.format_tb(error.__traceback__)))
        return None, error


def _on_cluster(client: Any, function: Callable[..., Any], work: Iterable[tuple[Any, ...]]) -> Iterator[Any]:
    from distributed import KilledWorker

    waiting: deque[Any] = deque()
    items = iter(work)
    more = True
    try:
        while more or waiting:
            room = max(AHEAD * sum(client.nthreads().values()), 1) - len(waiting)  # workers come and go
            while more and room > 0:
                try:
                    item = next(items)
                except StopIteration:
                    more = False
                else:
                    waiting.append(client.submit(function, *item, pure=False))
                    room -= 1
            if waiting:
                yield waiting.popleft().result()
    except KilledWorker as error:
        raise BackendError(f"workers died one after another over the same call: {error}; too little memory there?") from None
    finally:
        if waiting and client.status == "running":  # somebody stopped asking
            client.cancel(list(waiting))


def _client(address: str) -> Any:
    try:
        from distributed import Client
    except ImportError:
        raise BackendError(
            "backend 'dask' needs the package distributed, which is absent: pip install 'comanip[cluster]'"
        ) from None
    try:
        client = Client(address, timeout=PATIENCE_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise BackendError(
            f"no Dask scheduler answers at {address} within {PATIENCE_S:g} s ({type(error).__name__}); start one with "
            "'dask scheduler', workers with 'dask worker tcp://host:8786', and give the address that it prints"
        ) from None
    try:
        _check_workers(client, address)
    except BaseException:
        client.close()
        raise
    return client


def _check_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE_S)
    except TimeoutError:
        raise BackendError(
            f"the Dask scheduler at {address} has no worker after {PATIENCE_S:g} s; start some with 'dask worker {address}'"
        ) from None
    for worker, found in client.run(_version, on_error="return").items():
        if found != __version__:
            what = f"has comanip {found}" if isinstance(found, str) else f"cannot import comanip ({found})"
            raise BackendError(f"Dask worker {worker} {what}; all need {__version__}, as here: install it there")


def _version() -> str:
    return __version__
