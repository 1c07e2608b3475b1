"""A real Dask cluster on loopback, one scheduler and two workers in processes of their own: same bits as one process here."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import joblib
import numpy as np
import pytest
from joblib.parallel import ThreadingBackend

import comanip
from comanip import parallel as engine
from comanip.errors import BackendError, ParameterError
from comanip.fitting.selection import select_states
from comanip.parallel import each
from comanip.trials import draw_case, run_cases
from toys import CHANNELS, lifts

pytest.importorskip("distributed", reason="needs comanip[cluster]")
ENVIRONMENT = {"OPENBLAS_NUM_THREADS": "1", "PYTHONPATH": str(Path(__file__).parent)}
LOOPBACK = ("--host", "127.0.0.1")


class Cluster:
    """Scheduler and workers; `workers` are processes, so that one can be killed as a machine dies: without a word."""

    def __init__(self, folder):
        self.address = f"tcp://127.0.0.1:{_free_port()}"
        self.folder, self.processes = folder, []
        port = self.address.rsplit(":", 1)[1]
        self._start("scheduler", *LOOPBACK, "--port", port, "--no-dashboard")
        self.workers = []

    def _worker(self):
        return self._start("worker", self.address, *LOOPBACK, "--no-nanny", "--nthreads", "1", "--no-dashboard",
                           "--local-directory", str(self.folder))  # fmt: skip

    def _start(self, what, *words):
        log = open(self.folder / f"{what}_{len(self.processes)}.log", "w")  # noqa: SIM115
        command = [sys.executable, "-m", f"distributed.cli.dask_{what}", *words]
        process = subprocess.Popen(command, stdout=log, stderr=log, env={**os.environ, **ENVIRONMENT})
        self.processes.append(process)
        return process

    def ready(self):
        """Two workers alive and registered, whatever an earlier test did."""
        from distributed import Client

        self.workers = [w for w in self.workers if w.poll() is None]
        self.workers += [self._worker() for _ in range(2 - len(self.workers))]
        with Client(self.address, timeout=30, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=30)
        return self

    def stop(self):
        for process in reversed(self.processes):
            process.terminate()
        for process in self.processes:
            try:
                process.wait(timeout=5)
            except subprocess.TimeoutExpired:
                process.kill()


def _free_port():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


@pytest.fixture(scope="module")
def _started(tmp_path_factory):
    made = Cluster(tmp_path_factory.mktemp("cluster"))
    yield made
    made.stop()


@pytest.fixture
def cluster(_started):
    return _started.ready()


def where(seconds):
    time.sleep(seconds)
    return os.getpid()


def test_a_cluster_gives_the_bits_of_one_process_even_when_a_worker_is_killed(cluster, skills):
    rng = np.random.default_rng(3)
    cases = [draw_case("follower", rng, misbehaving=0.3) for _ in range(12)]
    here = run_cases(cases, skills, "default")

    def kill_one(done, total):
        if done == 4:
            cluster.workers[0].send_signal(signal.SIGKILL)

    with comanip.backend("dask", address=cluster.address):
        pids = set(each(where, [(0.3,)] * 8))
        assert pids == {w.pid for w in cluster.workers}
        there = run_cases(cases, skills, "default")
        after = run_cases(cases, skills, "default", progress=kill_one)
        assert cluster.workers[0].wait(timeout=5) == -signal.SIGKILL
        scores = select_states(lifts(3), (2, 3), channels=CHANNELS, criterion="cross-validation").scores
    assert repr(there) == repr(here)  # repr: floats to the last bit, and NaN equal to NaN
    assert repr(after) == repr(here)
    np.testing.assert_array_equal(scores, select_states(lifts(3), (2, 3), channels=CHANNELS, criterion="cross-validation").scores)


def stumble(i):
    if i == 3:
        raise ValueError(f"no {i} here")
    return i


class Patient(ThreadingBackend):
    """As Ray's: it gives all results at the end, or none."""

    supports_return_generator = False
    used = 0

    def submit(self, *arguments, **keywords):
        Patient.used += 1
        return super().submit(*arguments, **keywords)

    apply_async = submit


def test_any_backend_of_joblib_does_the_work():
    joblib.register_parallel_backend("patient", Patient)
    with joblib.parallel_config(backend="patient"):
        assert list(each(divmod, [(7, 2), (9, 4), (5, 5)], n_jobs=2)) == [(3, 1), (2, 1), (1, 0)]
    assert Patient.used


def test_what_a_worker_raises_is_raised_here_in_its_turn(cluster):
    with comanip.backend("dask", address=cluster.address):
        results = each(stumble, [(i,) for i in range(100)])
        assert [next(results) for _ in range(3)] == [0, 1, 2]
        with pytest.raises(ValueError, match="no 3 here"):
            next(results)
        assert list(each(stumble, [])) == []


def test_an_address_where_nobody_listens_is_named_within_its_patience(monkeypatch):
    import distributed

    monkeypatch.setattr(engine, "PATIENCE_S", 1.0)
    address, asked, real = f"tcp://127.0.0.1:{_free_port()}", [], distributed.Client
    monkeypatch.setattr(distributed, "Client", lambda *given, **how: asked.append(how["timeout"]) or real(*given, **how))
    with pytest.raises(BackendError, match=rf"{address} within 1 s.*dask scheduler"), comanip.backend("dask", address=address):
        pass
    assert asked == [1.0]


def test_a_scheduler_without_workers_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "PATIENCE_S", 5.0)
    lonely = Cluster(tmp_path)
    try:
        with pytest.raises(BackendError, match="has no worker after"), comanip.backend("dask", address=lonely.address):
            pass
    finally:
        lonely.stop()


def test_workers_of_another_version_are_refused(cluster, monkeypatch):
    monkeypatch.setattr(engine, "__version__", "99.0")
    with pytest.raises(BackendError, match=r"has comanip .*all need 99\.0"), comanip.backend("dask", address=cluster.address):
        pass


def test_names_and_addresses_that_make_no_sense():
    with pytest.raises(ParameterError, match="processes, dask"), comanip.backend("ray"):
        pass
    with pytest.raises(ParameterError, match="tcp://"), comanip.backend("dask"):
        pass
    with pytest.raises(ParameterError, match="have none"), comanip.backend(address="tcp://127.0.0.1:1"):
        pass


def test_without_distributed_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    message = r"pip install 'comanip\[cluster\]'"
    with pytest.raises(BackendError, match=message), comanip.backend("dask", address="tcp://127.0.0.1:1"):
        pass
