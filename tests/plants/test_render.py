"""Pictures show what was recorded, films have the frames they should, and without OpenGL there is one clear line."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from comanip.errors import ParameterError
from comanip.loop import run
from comanip.plants.humanoid.people import CLAY, Shape, joint_between, person
from humanoids import Follows, lift, plant_of

pytest.importorskip("mujoco", reason="the humanoid needs comanip[humanoid]")
pytest.importorskip("PIL", reason="pictures need pillow")

from comanip.plants.humanoid import render

SMALL = {"size": (160, 90)}


@pytest.fixture(scope="module")
def recording():
    return run(plant_of(), Follows(lambda t: lift(t, 0.3, 0.8, 0.1)), duration_s=1.0)


@pytest.fixture
def screen():
    try:
        render.View(size=(16, 16)).close()
    except ParameterError as problem:
        pytest.skip(str(problem))


def test_a_picture_shows_the_moment_that_was_asked_for(recording, screen):
    early, again, late = (render.picture(recording, at_s=s, **SMALL) for s in (0.0, 0.0, 0.95))
    assert early.shape == (90, 160, 3)
    assert (early == again).all()
    assert early.std() > 20.0  # not blank
    changed = (np.abs(early.astype(int) - late).max(axis=2) > 30).mean()
    assert 0.005 < changed < 0.5  # the arm, the beam and the partner moved; the room did not


def test_the_partner_and_the_teacher_are_drawn_when_asked_for(recording, screen):
    joints, base = recording["robot.joints"].values[0], recording["robot.base"].values[0]
    with render.View(**SMALL) as view:
        alone = view.frame(joints, base, partner=False).astype(int)
        together = view.frame(joints, base).astype(int)
        taught = view.frame(joints, base, teacher=True).astype(int)
    right = np.s_[:, 90:]
    assert np.abs(together - alone)[right].max() > 100
    assert np.abs(together - alone)[:, :60].max() < 30
    assert np.abs(taught - together)[:, :60].max() > 60


def test_a_film_has_a_frame_for_every_period(recording, screen, tmp_path):
    image = pytest.importorskip("PIL.Image")
    film = image.open(render.film(recording, tmp_path / "a film.gif", rate_hz=10.0, **SMALL))
    assert film.n_frames == 10
    assert film.info["duration"] == 100
    assert film.size == SMALL["size"]


def test_a_film_can_be_an_mp4_where_the_encoder_is(recording, screen, tmp_path):
    pytest.importorskip("imageio_ffmpeg", reason="an .mp4 needs: pip install imageio imageio-ffmpeg")
    reader = pytest.importorskip("imageio.v2").get_reader(render.film(recording, tmp_path / "a.mp4", rate_hz=10.0, **SMALL))
    assert (reader.get_meta_data()["fps"], reader.get_meta_data()["size"]) == (10.0, SMALL["size"])
    shown = [frame.astype(int) for frame in reader]
    assert len(shown) == 10
    assert np.abs(shown[0] - shown[-1]).max() > 100  # it moves


def test_what_stands_still_in_a_film_costs_nothing(recording, screen, tmp_path):
    """One palette for all frames: with one a frame the same film was three times as large."""
    image = pytest.importorskip("PIL.Image")
    film = render.film(recording, tmp_path / "a.gif", rate_hz=10.0, **SMALL)
    alone = tmp_path / "frame.gif"
    image.open(film).save(alone)
    assert film.stat().st_size < 0.6 * 10 * alone.stat().st_size


def test_films_of_other_kinds_are_refused(recording, tmp_path, monkeypatch):
    with pytest.raises(ParameterError, match=r"cannot be written as \.avi; try \.gif or \.mp4"):
        render.film(recording, tmp_path / "a.avi")
    monkeypatch.setitem(sys.modules, "imageio.v2", None)
    with pytest.raises(ParameterError, match=r"pip install imageio imageio-ffmpeg, or write a \.gif"):
        render.film(recording, tmp_path / "a.mp4")


def test_without_opengl_one_line_says_what_to_install(recording, monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "nonsense")
    with pytest.raises(ParameterError, match=r"no OpenGL to draw with \(nonsense: .*apt-get install libosmesa6"):
        render.picture(recording, at_s=0.0, **SMALL)


def test_a_run_of_another_robot_is_not_drawn_as_this_one(recording):
    pytest.importorskip("jvrc_description", reason="JVRC-1 comes with: pip install jvrc-description")
    with pytest.raises(ParameterError, match="the recording is not of 'JVRC-1': it has no joint 'R_SHOULDER_P'"):
        render.picture(recording, at_s=0.0, robot="jvrc1")


@given(st.floats(0.05, 0.9), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_limbs_keep_their_lengths_and_stretch_no_further(reach, y, z):
    direction = np.array([1.0, y, z]) / np.linalg.norm([1.0, y, z])
    end = reach * direction
    elbow = joint_between(np.zeros(3), end, 0.3, 0.27, np.array([0.0, 0.3, -1.0]))
    assert np.linalg.norm(elbow) == pytest.approx(0.3, abs=1e-6)
    if reach < 0.56:
        assert np.linalg.norm(end - elbow) == pytest.approx(0.27, abs=1e-6)


@pytest.mark.parametrize("height", [0.85, 1.0, 1.23])
def test_a_person_holds_what_he_is_given_and_keeps_his_feet_on_the_ground(height):
    hands = np.array([[1.28, -0.21, height], [1.28, -0.29, height]])
    shapes: list[Shape] = person(hands, at=np.array([1.68, -0.25]), facing=-1.0, shirt=CLAY)
    for hand in hands:
        assert min(np.linalg.norm(s.a - hand) for s in shapes) < 1e-9
    lowest = min(min(s.a[2], s.a[2] if s.b is None else s.b[2]) - s.size[-1] * (s.kind == "capsule") for s in shapes)
    assert lowest == pytest.approx(0.0, abs=0.01)
    reach = [np.linalg.norm(s.b - s.a) for s in shapes if s.kind == "capsule"]
    assert max(reach) < 0.5  # nobody is stretched
