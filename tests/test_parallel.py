"""Work in processes of this machine: in order, each once, and a worker that dies is not the end of it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from comanip.errors import BackendError
from comanip.parallel import each


def squared(x):
    return x * x


def raises_at_three(x):
    if x == 3:
        raise ValueError("three")
    return x


def dies_at(x, where, deadly, times):
    """Kills its own process at the calls in `deadly`, `times` times each, as a system out of memory does."""
    past = Path(where) / str(x)
    lived = len(past.read_text()) if past.exists() else 0
    if x in deadly and lived < times:
        past.write_text("x" * (lived + 1))
        os.kill(os.getpid(), signal.SIGKILL)
    return x


@pytest.mark.parametrize("n_jobs", [1, 2, -1])
def test_results_come_in_order(n_jobs):
    assert list(each(squared, ((i,) for i in range(40)), n_jobs=n_jobs)) == [i * i for i in range(40)]
    assert list(each(squared, [], n_jobs=n_jobs)) == []


def test_what_a_call_raises_is_raised_in_its_turn():
    results = each(raises_at_three, ((i,) for i in range(6)), n_jobs=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(ValueError, match="three"):
        next(results)


@pytest.mark.parametrize(("deadly", "times"), [([0], 1), ([3], 3), ([9], 1), ([1, 4, 8], 1)])
def test_a_call_whose_worker_dies_is_made_again(tmp_path, deadly, times):
    work = ((i, str(tmp_path), deadly, times) for i in range(10))
    assert list(each(dies_at, work, n_jobs=2)) == list(range(10))


def test_a_call_that_kills_every_worker_is_named_and_what_came_before_is_kept(tmp_path):
    results = each(dies_at, ((i, str(tmp_path), [3], 99) for i in range(10)), n_jobs=2)
    assert [next(results) for _ in range(3)] == [0, 1, 2]
    with pytest.raises(
        BackendError, match=r"^workers died 4 times before call 4 had a result; too little memory here\? .*n_jobs=1$"
    ):
        next(results)
    assert list(each(squared, ((i,) for i in range(4)), n_jobs=2)) == [0, 1, 4, 9]  # the next work finds workers again


@pytest.mark.skipif(os.name != "posix", reason="masks of POSIX")
def test_what_is_started_while_control_c_is_blocked_never_hears_it_though_the_trackers_unblock_it():
    """The first pool starts two resource trackers, which open the mask again: its workers died of Control-C with tracebacks."""
    program = (
        "import signal, subprocess, sys\n"
        "from comanip.parallel import deaf, each\n"
        "ask = 'import signal; print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []))'\n"
        "list(each(abs, [(1,)], n_jobs=2))\n"
        "from multiprocessing import resource_tracker\n"
        "from joblib.externals.loky.backend import resource_tracker as loky\n"
        "with deaf():\n"
        "    resource_tracker.ensure_running(); loky.ensure_running()\n"
        "    print(subprocess.run([sys.executable, '-c', ask], capture_output=True, text=True).stdout)\n"
        "print(signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, []), sys.warnoptions)\n"
    )
    fresh = program.replace("list(each(abs, [(1,)], n_jobs=2))\n", "")
    for text in (program, fresh):
        done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True)
        assert done.stdout.split() == ["True", "False", "[]"], done.stderr
