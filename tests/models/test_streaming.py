"""Learning from shards: the model that memory would have given, whoever computes it and however often it is interrupted."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import comanip
from comanip.errors import ChannelError, RecordingError, SkillFileError, TrainingError
from comanip.fitting.hmm import fit_hmm
from comanip.fitting.streaming import fit_stream
from comanip.learned.learn import learn
from comanip.learned.stream import learn_stream
from comanip.lessons.shards import ParquetShards, RecordingShards, files_of
from toys import CHANNELS, Stored, lifts

pytestmark = pytest.mark.filterwarnings("ignore::comanip.errors.ComanipWarning")
FIELDS = ("initial", "transition", "means", "covariances")


READ = Stored()


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    """Twelve lifts in four files; one sequence is too short."""
    folder = tmp_path_factory.mktemp("shards")
    sequences = lifts(12)
    for i in range(4):
        short = [np.ones((3, len(CHANNELS)))] if i == 2 else []
        np.savez(folder / f"{i}.npz", *sequences[3 * i : 3 * i + 3], *short)
    return sequences, sorted(map(str, folder.glob("*.npz")))


def same(a, b, rtol):
    for name in FIELDS:
        np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=rtol, atol=rtol, err_msg=name)


@pytest.mark.parametrize("topology", ["left-right", "cyclic", "free"])
def test_shards_give_the_model_that_memory_gives(shards, topology):
    sequences, paths = shards
    options = {"channels": CHANNELS, "topology": topology, "max_iterations": 12, "tolerance": 0.0}
    there = fit_stream(paths, 4, read=READ, **options)
    here = fit_hmm(sequences, 4, **options)
    same(there.model, here.model, rtol=1e-9)
    np.testing.assert_allclose(there.log_likelihood, here.log_likelihood, rtol=1e-9)
    assert there.bic == pytest.approx(here.bic, rel=1e-9)
    assert there.n_frames == here.n_frames
    assert any("skipped 1 sequences" in note for note in there.notes)


def test_the_number_of_processes_changes_no_bit(shards):
    _, paths = shards
    one, two = (
        fit_stream(paths, 4, channels=CHANNELS, read=READ, stepwise_passes=1, batch=2, max_iterations=3, n_jobs=n).model
        for n in (1, 2)
    )
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))


def test_a_stepwise_pass_starts_em_higher(shards):
    _, paths = shards
    plain, first = (
        fit_stream(paths, 4, channels=CHANNELS, read=READ, stepwise_passes=n, batch=1, max_iterations=1).log_likelihood[0]
        for n in (0, 1)
    )
    assert first > plain


WORKER = """
import sys, time, warnings
warnings.simplefilter("ignore")
sys.path.insert(0, {tests!r})
from comanip.fitting.streaming import fit_stream
from toys import CHANNELS, Stored
fit_stream({paths!r}, 4, channels=CHANNELS, read=Stored(), stepwise_passes=1, batch=2, max_iterations=12, tolerance=0.0,
           checkpoint={checkpoint!r}, checkpoint_every=1, progress=lambda *_: time.sleep(0.03))
"""


@pytest.mark.parametrize("passes", [0, 1, 4])
def test_killed_and_resumed_ends_at_the_same_bits(shards, tmp_path, passes):
    """Killed in the stepwise pass, in the first EM passes, and later; SIGKILL leaves no chance to tidy up."""
    _, paths = shards
    file = tmp_path / "checkpoint.json"
    code = WORKER.format(tests=str(Path(__file__).parents[1]), paths=paths, checkpoint=str(file))
    process = subprocess.Popen([sys.executable, "-c", code])
    try:
        deadline = time.monotonic() + 60
        while time.monotonic() < deadline and process.poll() is None:
            found = json.loads(file.read_text()) if file.exists() else {"at": 0}
            if found["at"] == 1 and found["steps"] >= 1 and len(found["trace"]) >= passes:  # in the middle of a pass
                break
            time.sleep(0.002)
        assert process.poll() is None, "it ended before it could be killed"
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    seen = []
    options = {"channels": CHANNELS, "read": READ, "stepwise_passes": 1, "batch": 2, "max_iterations": 12, "tolerance": 0.0}
    resumed = fit_stream(paths, 4, checkpoint=file, progress=lambda stage, *_: seen.append(stage), **options)
    assert "survey" not in seen
    whole = fit_stream(paths, 4, **options)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(resumed.model, name), getattr(whole.model, name))
    np.testing.assert_array_equal(resumed.log_likelihood, whole.log_likelihood)


def test_a_checkpoint_that_is_damaged_or_of_other_work_is_refused(shards, tmp_path):
    _, paths = shards
    file = tmp_path / "c.json"
    fit_stream(paths, 4, channels=CHANNELS, read=READ, max_iterations=2, checkpoint=file)
    with pytest.raises(SkillFileError, match="other shards, channels or settings"):
        fit_stream(paths[:3], 4, channels=CHANNELS, read=READ, max_iterations=2, checkpoint=file)
    text = file.read_text()
    file.write_text(text.replace('"steps": 0', '"steps": 1'))
    with pytest.raises(SkillFileError, match="sha256"):
        fit_stream(paths, 4, channels=CHANNELS, read=READ, max_iterations=2, checkpoint=file)
    file.write_text(text[: len(text) // 2])
    with pytest.raises(SkillFileError, match=r"c\.json: not a checkpoint"):
        fit_stream(paths, 4, channels=CHANNELS, read=READ, max_iterations=2, checkpoint=file)


def test_a_bad_frame_names_its_shard(tmp_path):
    sequences = lifts(2)
    sequences[1][7, 0] = np.nan
    np.savez(tmp_path / "bad.npz", *sequences)
    with pytest.raises(TrainingError, match=r"bad\.npz: demonstration 1, frame 7"):
        fit_stream([tmp_path / "bad.npz"], 3, channels=CHANNELS, read=READ)
    np.savez(tmp_path / "short.npz", *lifts(2))
    with pytest.raises(TrainingError, match=">= 1001 frames"):
        fit_stream([tmp_path / "short.npz"], 1000, channels=CHANNELS, read=READ)


# --------------------------------------------------------------------------------------------------- Parquet, LeRobot


def lerobot(folder, sequences, *, per_file):
    """A data set as LeRobot v3 lays it out: several episodes a file, numbers in list columns."""
    pa = pytest.importorskip("pyarrow", reason="needs comanip[parquet]")
    import pyarrow.parquet as parquet

    for f, begin in enumerate(range(0, len(sequences), per_file)):
        chosen = sequences[begin : begin + per_file]
        frames = np.concatenate(chosen)
        table = pa.table({
            "observation.state": pa.FixedSizeListArray.from_arrays(pa.array(frames[:, :2].ravel()), 2),
            "action": pa.array(frames[:, 2:].tolist()),
            "episode_index": np.repeat(np.arange(begin, begin + len(chosen)), [len(x) for x in chosen]),
            "frame_index": np.concatenate([np.arange(len(x)) for x in chosen]),
        })  # fmt: skip
        path = folder / "data" / "chunk-000" / f"file-{f:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, path, row_group_size=100)
    return folder


LEROBOT = dict(zip(CHANNELS, ("observation.state[0]", "observation.state[1]", "action[0]"), strict=True))


@pytest.mark.parametrize("piece", [64, 100, 65_536])
def test_parquet_gives_back_every_sequence_however_it_is_cut(tmp_path, monkeypatch, piece):
    monkeypatch.setattr("comanip.lessons.shards.PIECE", piece)
    sequences = lifts(5)
    lerobot(tmp_path, sequences, per_file=2)
    paths = files_of([tmp_path])
    assert len(paths) == 3
    found = [x for path in paths for whole in ParquetShards(LEROBOT)(path) for x in whole]
    assert len(found) == 5
    for x, y in zip(found, sequences, strict=True):
        np.testing.assert_array_equal(x, y)


def test_parquet_that_does_not_fit_says_why(tmp_path):
    path = files_of([lerobot(tmp_path, lifts(2), per_file=2)])[0]
    with pytest.raises(ChannelError, match=r"no column 'force'; it has: action, episode_index"):
        list(ParquetShards({"force.z": "force"})(path))
    with pytest.raises(ChannelError, match=r"holds 2 numbers a frame"):
        list(ParquetShards({"force.z": "observation.state[2]"})(path))
    with pytest.raises(ChannelError, match=r"say which number, for example action\[0\]"):
        list(ParquetShards({"force.z": "action"})(path))
    with pytest.raises(RecordingError, match="no such file"):
        files_of([tmp_path / "nothing"])
    (tmp_path / "x.parquet").write_bytes(b"not parquet at all")
    with pytest.raises(RecordingError, match=r"x\.parquet: not a Parquet file"):
        list(ParquetShards(LEROBOT)(str(tmp_path / "x.parquet")))


def test_a_skill_from_shards_is_the_skill_from_memory(tmp_path, lessons):
    chosen = lessons["follower"][:5]
    names = ("position.z", "force.z", "velocity.z")
    lerobot(tmp_path, [x.array(names) for x in chosen], per_file=2)
    channels = dict(zip(names, LEROBOT.values(), strict=True))
    here = learn(chosen, role="follower", n_states=5)
    there = learn_stream(
        files_of([tmp_path]), read=ParquetShards(channels), channels=names, dt=chosen[0].dt, role="follower", n_states=5
    )
    same(there.model, here.model, rtol=1e-8)
    np.testing.assert_allclose(there.clock.means, here.clock.means, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(there.clock.covariances, here.clock.covariances, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(there.clock.weights, here.clock.weights, rtol=1e-7)
    np.testing.assert_allclose(there.workspace, here.workspace, rtol=1e-12)
    np.testing.assert_array_equal(there.ends, here.ends)
    assert len(there.paths) == len(here.paths) == 1
    for one, other in zip(there.paths, here.paths, strict=True):
        assert one.step_s == other.step_s
        for name in ("position", "force", "spread", "ends"):
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-9, atol=1e-12, err_msg=name)


def test_recordings_are_shards_too(tmp_path, lessons):
    from comanip.formats import Columns
    from comanip.lessons.demonstration import Preparation

    names = ("position.z", "force.z", "velocity.z")
    for i, lesson in enumerate(lessons["leader"][:3]):
        np.savetxt(tmp_path / f"{i}.csv", lesson.array(names), delimiter=",", header="z,Fz,vz", comments="")
    columns = Columns(position="z", force="Fz", velocity="vz", rate_hz=100.0)
    read = RecordingShards(names, columns, Preparation(role="leader"))
    found = fit_stream(sorted(tmp_path.glob("*.csv")), 4, channels=names, read=read, max_iterations=5, tolerance=0.0)
    here = fit_hmm([x.array(names) for x in lessons["leader"][:3]], 4, channels=names, max_iterations=5, tolerance=0.0)
    np.testing.assert_allclose(found.model.means, here.model.means, rtol=1e-5, atol=1e-5)


def test_a_cluster_gives_the_same_bits(shards, tmp_path):
    pytest.importorskip("distributed", reason="needs comanip[cluster]")
    from test_cluster import Cluster

    _, paths = shards
    options = {"channels": CHANNELS, "read": READ, "max_iterations": 3, "tolerance": 0.0}
    here = fit_stream(paths, 4, **options).model
    cluster = Cluster(tmp_path)
    try:
        with comanip.backend("dask", address=cluster.ready().address):
            there = fit_stream(paths, 4, **options).model
    finally:
        cluster.stop()
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(there, name), getattr(here, name))


MEMORY = """
import resource, sys, warnings
warnings.simplefilter("ignore")
from comanip.fitting.streaming import fit_stream
from comanip.lessons.shards import ParquetShards
names = [f"c.{{i}}" for i in range(7)]
read = ParquetShards({{n: n for n in names}})
next(iter(read({paths!r}[0])))
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
fit_stream({paths!r}, 5, channels=names, read=read, max_iterations=2, topology="free")
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""


def test_memory_does_not_grow_with_the_data(tmp_path):
    """6e5 frames are 34 MB; 24 MB are some pieces of 65,536 frames and the E-step's workspace."""
    pa = pytest.importorskip("pyarrow", reason="needs comanip[parquet]")
    import pyarrow.parquet as parquet

    rng = np.random.default_rng(0)
    for f in range(6):
        columns = {f"c.{i}": rng.normal(size=100_000) for i in range(7)}
        table = pa.table({**columns, "episode_index": np.arange(100_000) // 500})
        parquet.write_table(table, tmp_path / f"{f}.parquet", row_group_size=50_000)

    def extra_mb(n):
        paths = [str(tmp_path / f"{f}.parquet") for f in range(n)]
        done = subprocess.run([sys.executable, "-c", MEMORY.format(paths=paths)], capture_output=True, text=True,
                              env={**os.environ, "OPENBLAS_NUM_THREADS": "1"})  # fmt: skip
        assert done.returncode == 0, done.stderr
        return float(done.stdout) / 1024

    one, six = extra_mb(1), extra_mb(6)
    assert six < one + 20.0, (one, six)  # all data at once would be 28 MB more, and its transformed copy again
