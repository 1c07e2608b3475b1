"""LeRobot, Parquet, HDF5, .mat of version 7.3, folders of one CSV a topic: what people have, opened with at most one flag a
channel."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest

from comanip.errors import ChannelError, ComanipWarning, ParameterError, RecordingError
from comanip.formats import Columns, read, write, write_all
from comanip.formats.events import events
from comanip.formats.mapping_file import mapping_file
from comanip.learned.stream import learn_stream
from comanip.lessons.demonstration import demonstrations
from comanip.lessons.shards import ParquetShards, RecordingShards, files_of, rate_of
from lifts import lift, minimum_jerk

arrow = pytest.importorskip("pyarrow")
parquet = pytest.importorskip("pyarrow.parquet")

STATE = ["x", "y", "z", "vx", "vy", "vz", "Fx", "Fy", "Fz"]


def frames_of(episodes=3, rate=100.0):
    """(episode, frame, stamp, state of nine, task) of each frame of a set, as lists."""
    rows = []
    for e in range(episodes):
        r = lift(e, duration_s=4.0 + 0.1 * e)
        x, v, f = (r[f"hand.{n}"].values[:, 0] for n in ("position", "velocity", "force"))
        for i in range(len(x)):
            rows.append([e, i, np.float32(i / rate), [0.5, 0.0, x[i], 0.0, 0.0, v[i], 0.0, 0.0, f[i]], e % 2])
    return rows


def write_set(folder, rows, fps=100, version="v3.0", names=True, **info):
    columns = dict(
        zip(
            ("episode_index", "frame_index", "timestamp", "observation.state", "task_index"), zip(*rows, strict=True), strict=True
        )
    )
    arrays = {
        "episode_index": arrow.array(columns["episode_index"]),
        "frame_index": arrow.array(columns["frame_index"]),
        "timestamp": arrow.array(np.array(columns["timestamp"], dtype=np.float32)),
        "observation.state": arrow.FixedSizeListArray.from_arrays(arrow.array(np.concatenate(columns["observation.state"])), 9),
        "task_index": arrow.array(columns["task_index"]),
    }
    table = arrow.table(arrays)
    (folder / "data/chunk-000").mkdir(parents=True)
    (folder / "meta").mkdir()
    feature = {"dtype": "float32", "shape": [9], "names": STATE if names else None}
    about = {"codebase_version": version, "fps": fps, "features": {"observation.state": feature}, **info}
    (folder / "meta/info.json").write_text(json.dumps(about))
    if version == "v3.0":
        parquet.write_table(table, folder / "data/chunk-000/file-000.parquet")
        words = arrow.table({"task_index": [0, 1], "__index_level_0__": ["lift", "lower"]})
        parquet.write_table(words, folder / "meta/tasks.parquet")
    else:
        for e in sorted(set(columns["episode_index"])):
            part = table.filter(arrow.compute.equal(table.column("episode_index"), e))
            parquet.write_table(part, folder / f"data/chunk-000/episode_{e:06d}.parquet")
        (folder / "meta/tasks.jsonl").write_text('{"task_index": 0, "task": "lift"}\n{"task_index": 1, "task": "lower"}\n')
        lengths = [sum(1 for v in columns["episode_index"] if v == e) for e in sorted(set(columns["episode_index"]))]
        text = "".join(json.dumps({"episode_index": e, "length": n, "tasks": []}) + "\n" for e, n in enumerate(lengths))
        (folder / "meta/episodes.jsonl").write_text(text)
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
def test_a_lerobot_set_opens_by_its_names_with_its_tasks_at_its_rate(tmp_path, version):
    import pyarrow.compute  # noqa: F401

    recordings = read(write_set(tmp_path / "a", frames_of(), version=version))
    assert [len(r["hand.position"].time) for r in recordings] == [401, 411, 421]
    assert np.array_equal(recordings[1]["hand.force"].values, lift(1, duration_s=4.1)["hand.force"].values)
    assert np.array_equal(recordings[1]["hand.position"].time, np.arange(411) / 100)  # not the float32 of its stamps
    assert recordings[0]["hand.position"].axes == ("z",)
    assert [r.metadata["task"] for r in recordings] == ["lift", "lower", "lift"]
    assert "axis x, y left out" in "\n".join(recordings[0].metadata["notes"])
    assert {lesson.dt for lesson in demonstrations(recordings)} == {0.01}


def test_what_a_set_says_of_itself_is_held_against_its_frames(tmp_path):
    write_set(tmp_path / "a", frames_of(), total_frames=2000)
    with pytest.raises(RecordingError, match=r"meta/info.json says 2000 frames, the files hold 1233"):
        read(tmp_path / "a")
    write_set(tmp_path / "b", frames_of(), total_episodes=4)
    with pytest.raises(RecordingError, match="says 4 episodes, the files hold 3"):
        read(tmp_path / "b")
    write_set(tmp_path / "c", frames_of(), version="v2.1")
    (tmp_path / "c/meta/episodes.jsonl").write_text('{"episode_index": 1, "length": 500}\n')
    with pytest.raises(RecordingError, match="episode 1 has 411 frames, meta/episodes says 500"):
        read(tmp_path / "c")
    write_set(tmp_path / "e", frames_of(), fps=float("nan"))
    with pytest.raises(RecordingError, match=r"fps is nan; allowed: 1 to 50000"):
        read(tmp_path / "e")


def with_state(change):
    """Rows whose state is changed: change(row, k, value) -> value."""
    return lambda rows: [[*r[:3], [change(r, k, v) for k, v in enumerate(r[3])], r[4]] for r in rows]


SPOILT = {  # what was done -> (rows changed, fps, what is said)
    "rate": (lambda rows: rows, 30, r"fps is 30, the column 'timestamp' steps by 0.01 s \(100 Hz\)"),
    "backwards fps": (lambda rows: rows, -30, "fps is -30; allowed"),
    "lost": (
        lambda rows: [r for r in rows if not (r[0] == 1 and 50 <= r[1] < 120)],
        100,
        "episode 1: frame_index goes from 49 to 120 at row .*: 70 frames are missing",
    ),
    "reversed": (lambda rows: sorted(rows, key=lambda r: (r[0], -r[1])), 100, "episode 0: frame_index goes from 400 to 399"),
    "merged": (lambda rows: [[0, *r[1:]] for r in rows], 100, "several episodes under one number"),
    "torn": (lambda rows: rows[:200] + rows[401:] + rows[200:401], 100, "rows of episode 0 stand apart|frame_index goes from"),
    "swapped": (
        lambda rows: [*rows[:10], rows[11], rows[10], *rows[12:]],
        100,
        "frame_index goes from 9 to 11 at row 10: the frames are not in order",
    ),
    "millimetres": (with_state(lambda r, k, v: 1000 * v if k < 3 else v), 100, "millimetres"),
    "velocity": (with_state(lambda r, k, v: -v if 3 <= k < 6 else v), 100, "sign is flipped"),
    "nan": (with_state(lambda r, k, v: np.nan if (r[0], r[1], k) == (2, 7, 8) else v), 100, "frame 7"),
}
MAP = {"position.z": "observation.state[2]", "force.z": "observation.state[8]", "velocity.z": "observation.state[5]"}


def learned_in_pieces(folder):
    dt = 1.0 / rate_of(folder)
    return learn_stream(files_of([folder]), read=ParquetShards(MAP), channels=list(MAP), dt=dt, role="follower", n_states=3)


@pytest.mark.parametrize("how", SPOILT)
@pytest.mark.parametrize("streamed", [False, True])
def test_d29_a_spoilt_set_is_refused_in_memory_and_streamed(tmp_path, how, streamed):
    change, fps, said = SPOILT[how]
    folder = write_set(tmp_path / "a", change(frames_of()), fps=fps)
    with pytest.raises((RecordingError, ChannelError), match=said):
        learned_in_pieces(folder) if streamed else demonstrations(read(folder))


def test_d29_suspicions_are_said_once_and_kept_with_the_skill(tmp_path):
    rows = [[*r[:3], [-v if k >= 6 else v for k, v in enumerate(r[3])], r[4]] for r in frames_of()]
    folder = write_set(tmp_path / "a", rows)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        skill = learn_stream(
            files_of([folder]), read=ParquetShards(MAP), channels=list(MAP), dt=0.01, role="follower", n_states=4
        )
    flipped = [str(w.message) for w in said if "is the force's sign flipped" in str(w.message)]
    assert len(flipped) == 3  # one an episode, whatever the number of passes
    assert "episode 2" in flipped[2]
    assert set(flipped) <= set(skill.notes)


def test_the_stream_and_memory_learn_one_model_with_the_same_notes_of_stability(tmp_path):
    from comanip.learned.learn import learn, stability_notes

    folder = write_set(tmp_path / "a", frames_of(8))
    streamed = learn_stream(
        files_of([folder]), read=ParquetShards(MAP), channels=list(MAP), dt=0.01, role="leader", n_states=4, law="paper"
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        memory = learn(demonstrations(read(folder, Columns(role="leader"))), n_states=4)
    assert np.allclose(streamed.model.means, memory.model.means, atol=1e-6)
    told = stability_notes(streamed.model, "paper", "leader", {})
    assert told
    assert set(told) <= set(streamed.notes)


def test_a_stream_with_jitter_is_prepared_as_in_memory(tmp_path):
    rng = np.random.default_rng(1)
    rows = [[r[0], r[1], r[1] / 100 + 0.002 * rng.uniform(-1, 1), *r[3:]] for r in frames_of(2)]
    folder = write_set(tmp_path / "a", rows)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ComanipWarning)
        lessons = demonstrations(read(folder), rate_hz=100.0)
        reader = ParquetShards(MAP)
        (path,) = files_of([folder])
        found = reader.check(path, 0.01, "")
        assert not found.untouched
        pieces = [a for piece in reader.prepared([path], 0.01, "")(path) for a in piece]
    for piece, lesson in zip(pieces, lessons, strict=True):
        assert np.allclose(piece, lesson.array(tuple(MAP)), atol=1e-9)


def test_files_of_any_format_are_checked_once_before_they_are_streamed(tmp_path):
    from comanip.lessons.demonstration import Preparation

    for seed in range(3):
        write(lift(seed, role="leader" if seed == 1 else "follower"), tmp_path / f"{seed}.mcap")
    reader = RecordingShards(("position.z", "force.z", "velocity.z"), Columns(), Preparation(role="follower", rate_hz=100.0))
    with pytest.raises(RecordingError, match="its role is 'leader', 'follower' was asked for"):
        learn_stream(
            sorted(map(str, tmp_path.glob("*.mcap"))), read=reader, channels=reader.channels, dt=0.01, role="follower", n_states=3
        )


def test_a_plain_table_is_data_for_every_command(tmp_path):
    r = lift()
    columns = {"t": r["hand.force"].time, "z": r["hand.position"].values[:, 0], "vz": r["hand.velocity"].values[:, 0]}
    table = arrow.table({**columns, "Fz": r["hand.force"].values[:, 0], "who": ["me"] * 401, "when": arrow.array([None] * 401)})
    parquet.write_table(table, tmp_path / "a.parquet")
    (found,) = read(tmp_path / "a.parquet")
    assert np.array_equal(found["hand.force"].values, r["hand.force"].values)
    assert "column 'who' left out: string is not numbers" in found.metadata["notes"]
    with pytest.raises(ChannelError, match="no column 'zz'"):
        read(tmp_path / "a.parquet", Columns(position="zz"))


def test_a_set_that_we_wrote_is_read_by_lerobot(tmp_path):
    pytest.importorskip("lerobot", reason="lerobot is not installed")
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    write_all([lift(0), lift(1)], tmp_path / "a.lerobot")
    found = LeRobotDataset("somebody/lifts", root=tmp_path / "a.lerobot")
    assert (found.num_episodes, found.num_frames, found.fps) == (2, 802, 100)
    state = np.array(found[405]["observation.state"])
    assert np.allclose(state, [lift(1)[f"hand.{n}"].values[4, 0] for n in ("position", "velocity", "force")])


def test_a_set_that_we_wrote_has_the_layout_of_version_3(tmp_path):
    write_all([lift(0), lift(1, duration_s=3.0)], tmp_path / "a.lerobot")
    info = json.loads((tmp_path / "a.lerobot/meta/info.json").read_text())
    assert (info["codebase_version"], info["fps"], info["total_episodes"], info["total_frames"]) == ("v3.0", 100, 2, 702)
    assert info["features"]["observation.state"]["names"] == ["hand.position.z", "hand.velocity.z", "hand.force.z"]
    episodes = parquet.read_table(tmp_path / "a.lerobot/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(e["dataset_from_index"], e["dataset_to_index"], e["length"]) for e in episodes] == [(0, 401, 401), (401, 702, 301)]
    stats = json.loads((tmp_path / "a.lerobot/meta/stats.json").read_text())
    both = np.concatenate([lift(0)["hand.force"].values, lift(1, duration_s=3.0)["hand.force"].values])
    assert stats["observation.state"]["max"][2] == both.max()
    assert stats["observation.state"]["std"][2] == pytest.approx(both.std())
    assert stats["observation.state"]["count"] == [702]
    (tmp_path / "a.lerobot/meta/comanip.json").unlink()  # as anybody's set
    found = read(tmp_path / "a.lerobot")
    assert np.array_equal(found[1]["hand.force"].values, lift(1, duration_s=3.0)["hand.force"].values)


# HDF5 ---------------------------------------------------------------------------------------------------------------------


def robomimic(path, rate=True, demos=11):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": "Lift", "env_kwargs": {"control_freq": 100} if rate else {}})
        for i in range(demos):
            r = lift(i, duration_s=3.0 + 0.1 * i)
            group = data.create_group(f"demo_{i}")
            group.attrs["num_samples"] = len(r["hand.force"].time)
            for name, channel in (("eef_pos", "position"), ("eef_vel_lin", "velocity"), ("ee_force", "force")):
                values = np.zeros((len(r["hand.force"].time), 3))
                values[:, 2] = r[f"hand.{channel}"].values[:, 0]
                group[f"obs/robot0_{name}"] = values
            group["actions"] = np.zeros((len(values), 7))


def test_robomimics_demonstrations_open_in_their_order_at_the_rate_of_their_environment(tmp_path):
    robomimic(tmp_path / "a.hdf5")
    found = read(tmp_path / "a.hdf5")
    assert [len(r["hand.force"].time) for r in found] == [301 + 10 * i for i in range(11)]  # demo_10 after demo_9
    assert np.array_equal(found[10]["hand.force"].values[:, 0], lift(10, duration_s=4.0)["hand.force"].values[:, 0])
    assert len(demonstrations(found)) == 11
    (mapped, *_) = read(tmp_path / "a.hdf5", Columns(position="robot0_eef_pos[2]", force="-obs/robot0_ee_force[:,2]"))
    assert np.array_equal(mapped["hand.force"].values, -found[0]["hand.force"].values)
    with pytest.raises(ChannelError, match="did you mean 'obs/robot0_eef_pos'"):
        read(tmp_path / "a.hdf5", Columns(position="obs/robot0_eef_po"))


def test_a_robomimic_file_without_a_rate_asks_for_it_and_one_that_was_cut_says_so(tmp_path):
    h5py = pytest.importorskip("h5py")
    robomimic(tmp_path / "a.hdf5", rate=False)
    with pytest.raises(RecordingError, match="state the rate"):
        read(tmp_path / "a.hdf5")
    assert len(read(tmp_path / "a.hdf5", Columns(rate_hz=100))) == 11
    with h5py.File(tmp_path / "a.hdf5", "r+") as file:
        file["data/demo_3"].attrs["num_samples"] = 500
    with pytest.raises(RecordingError, match="demo_3 says 500 samples and holds 331"):
        read(tmp_path / "a.hdf5", Columns(rate_hz=100))


def test_matlabs_7_3_is_read_with_its_structs_and_cells(tmp_path):
    h5py = pytest.importorskip("h5py")
    r = lift()
    with h5py.File(tmp_path / "a.mat", "w", userblock_size=512) as file:
        for name, values in (("t", r["hand.force"].time), ("z", r["hand.position"].values), ("Fz", r["hand.force"].values)):
            file[name] = values.reshape(1, -1)
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
        store = file.create_group("#refs#")
        pieces = [store.create_dataset(str(i), data=np.arange(3.0 * (4 + i)).reshape(4 + i, 3)) for i in range(2)]
        file["runs/pos"] = np.array([[p.ref for p in pieces]], dtype=h5py.ref_dtype)
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + data[512:])
    (found,) = read(tmp_path / "a.mat")
    assert np.array_equal(found["hand.force"].values, r["hand.force"].values)
    runs = read(tmp_path / "a.mat", Columns(position="runs.pos[0,:]", rate_hz=10, time="none"))
    assert [len(run["hand.position"].time) for run in runs] == [4, 5]
    assert runs[1]["hand.position"].values[:, 0].tolist() == [0.0, 3.0, 6.0, 9.0, 12.0]


def test_a_file_on_which_the_library_dies_is_an_error_and_the_next_one_is_read(tmp_path, monkeypatch):
    pytest.importorskip("h5py")
    from comanip.formats import outside

    write(lift(), tmp_path / "a.hdf5")
    read(tmp_path / "a.hdf5")
    outside._server.kill()
    read(tmp_path / "a.hdf5")
    monkeypatch.setattr(outside, "PATIENCE_S", 0.2)
    import os
    import signal

    os.kill(outside._server.pid, signal.SIGSTOP)
    with pytest.raises(RecordingError, match=r"its library took longer than 0.2 s"):
        read(tmp_path / "a.hdf5")
    monkeypatch.undo()
    assert len(read(tmp_path / "a.hdf5")) == 1


def test_links_and_numbers_elsewhere_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    write(lift(), tmp_path / "secret.hdf5")
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["z"] = np.arange(20.0)
        file["link"] = h5py.ExternalLink("secret.hdf5", "data")
        file.create_dataset("raw", (100,), "f8", external=[(str(tmp_path / "secret.hdf5"), 0, 800)])
    (found,) = read(tmp_path / "a.hdf5", Columns(position="z", rate_hz=10))
    assert "raw left out: float64 is not numbers" in "\n".join(found.metadata["notes"])
    with pytest.raises(ChannelError, match="there are: z"):
        read(tmp_path / "a.hdf5", Columns(position="raw", rate_hz=10))


# Folders of topics --------------------------------------------------------------------------------------------------------


def topic_folder(folder, how, frames=("base", "base")):
    """A lift as bagpy or rostopic writes it: pose at 100 Hz, wrench at 500 Hz, each with its own stamps."""
    folder.mkdir()
    tick, fast = np.arange(401) / 100, np.arange(2001) / 500
    x, _, _ = minimum_jerk(tick)
    _, dx, _ = minimum_jerk(fast)
    if how == "bagpy":
        head = "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,"
        dot, stamp = "", lambda i, t, f: f"{1e9 + t + 0.25:.6f},{i},{10**9 + int(t)},{round(t % 1 * 1e9)},{f}"
    else:
        head = "%time,field.header.seq,field.header.stamp,field.header.frame_id,"
        dot, stamp = "field.", lambda i, t, f: f"{10**18 + round((t + 0.25) * 1e9)},{i},{10**18 + round(t * 1e9)},{f}"
    names = [f"{dot}pose.position.{a}" for a in "xyz"] + [f"{dot}pose.orientation.{a}" for a in "xyzw"]
    rows = [
        f"{stamp(i, t, frames[0])},0.5,0.0,{0.8 + v},0,0,0,1"
        for i, (t, v) in enumerate(zip(tick.tolist(), x.tolist(), strict=True))
    ]
    (folder / "ee_pose.csv").write_text(head + ",".join(names) + "\n" + "\n".join(rows) + "\n")
    names = [f"{dot}wrench.{k}.{a}" for k in ("force", "torque") for a in "xyz"]
    rows = [
        f"{stamp(i, t, frames[1])},0.1,0,{25 * v},0,0,{v}"
        for i, (t, v) in enumerate(zip(fast.tolist(), dx.tolist(), strict=True))
    ]
    (folder / "ft-wrench.csv").write_text(head + ",".join(names) + "\n" + "\n".join(rows) + "\n")
    (folder / "marks.csv").write_text("t,event,details\n1000000001.0,start,\n1000000003.0,stop,x\n")
    (folder / "._ee_pose.csv").write_bytes(b"\0\5\x16\x07")
    return folder


@pytest.mark.parametrize("how", ["bagpy", "rostopic"])
def test_a_folder_of_one_csv_a_topic_opens_without_a_flag(tmp_path, how):
    (found,) = read(topic_folder(tmp_path / "a", how))
    x, _, _ = minimum_jerk(np.arange(401) / 100)
    assert np.array_equal(found["hand.position"].values[:, 0], 0.8 + x)
    assert len(found["hand.force"].time) == 2001
    assert np.abs(found["hand.force"].time - 1e9 - np.arange(2001) / 500).max() < 1e-6
    assert found["hand.orientation"].values[0].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert np.allclose(found["hand.torque"].values[:, 2] * 25, found["hand.force"].values[:, 0])
    assert found["hand.force"].frame == "base"
    assert [(round(e.time_s - 1e9, 6), e.label) for e in events(found)] == [(1.0, "start"), (3.0, "stop")]
    (lesson,) = demonstrations([found])
    assert lesson.channels == ("position.z", "force.z", "velocity.z")
    (log,) = read(tmp_path / "a", Columns(time="log"))
    assert np.abs(log["hand.position"].time - 1e9 - 0.25 - np.arange(401) / 100).max() < 1e-6


def test_frames_of_topics_in_csv_are_held_like_a_bags(tmp_path):
    with pytest.raises(ChannelError, match="is in frame 'ft', the position in 'base'"):
        demonstrations(read(topic_folder(tmp_path / "a", "bagpy", ("base", "ft"))))
    (found,) = read(tmp_path / "a", Columns(frames={"ft": "same"}))
    assert found["hand.force"].frame == "base"


def test_tables_of_one_layout_are_takes_and_not_topics(tmp_path):
    for seed in range(2):
        r = lift(seed, duration_s=4.0 + seed)
        rows = zip(
            r["hand.force"].time.tolist(),
            r["hand.position"].values[:, 0].tolist(),
            r["hand.force"].values[:, 0].tolist(),
            strict=True,
        )
        (tmp_path / f"{seed}.csv").write_text("t,z,Fz\n" + "".join(f"{a},{b},{c}\n" for a, b, c in rows))
    assert [len(r["hand.force"].time) for r in read(tmp_path)] == [401, 501]


# A mapping in TOML --------------------------------------------------------------------------------------------------------


def test_a_mapping_is_kept_in_a_file(tmp_path):
    path = tmp_path / "map.toml"
    path.write_text(
        'position = ["ee_pose.pose.position.z"]\nforce = "-wrench.force.z"\nrole = "leader"\n'
        '[frames]\nft = "same"\n[extra]\nq = "pose.orientation"\n'
    )
    (found,) = read(topic_folder(tmp_path / "a", "bagpy", ("base", "ft")), mapping_file(path))
    _, dx, _ = minimum_jerk(np.arange(2001) / 500)
    assert np.allclose(found["hand.force"].values[:, 0], -25 * dx)
    assert found.metadata["role"] == "leader"
    assert found["q"].axes == ("w", "x", "y", "z")
    path.write_text("postion = 'z'\n")
    with pytest.raises(ParameterError, match="'postion' is no part of a mapping; allowed: position, "):
        mapping_file(path)
    path.write_text("position = 3\n")
    with pytest.raises(ParameterError, match="position is 3; allowed: a column, or a list of columns"):
        mapping_file(path)
    path.write_text("position = \n")
    with pytest.raises(RecordingError, match="not TOML"):
        mapping_file(path)


def test_text_that_is_no_utf8_is_refused_in_one_line(tmp_path):
    """Parquet's text is not looked at when it is read; it ended in a UnicodeDecodeError later."""
    import pyarrow

    bytes_ = pyarrow.array([b"lift \xe8 it", b"lower it"])
    words = pyarrow.StringArray.from_buffers(2, *bytes_.buffers()[1:])
    parquet.write_table(pyarrow.table({"task": words, "task_index": [0, 1]}), tmp_path / "tasks.parquet")
    with pytest.raises(RecordingError, match=r"tasks.parquet: not a Parquet file that can be read: .*UTF8") as told:
        read(tmp_path / "tasks.parquet")
    assert "\n" not in str(told.value)


def test_a_stray_quote_in_a_folder_of_tables_is_told_by_file_and_line(tmp_path):
    """A field of more than 131,072 characters ended in csv's own error."""
    folder = topic_folder(tmp_path / "a", "bagpy")
    file = max(folder.rglob("*.csv"), key=lambda f: f.stat().st_size)
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:2], '"' + lines[2], *lines[3:], *lines[3:], *lines[3:]]))
    with pytest.raises(RecordingError, match=r"line 3 opens a quote that is never closed") as told:
        read(folder)
    assert file.name in str(told.value)
