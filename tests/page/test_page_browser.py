"""The page in a real browser, with real mouse, touch and key events."""

from __future__ import annotations

import json
import random
import threading
import time
import urllib.error
import urllib.request
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from comanip.formats import read
from comanip.learned import file as skill_file
from comanip.learned.learn import learn
from comanip.learned.skill import LearnedSkill
from comanip.lessons.demonstration import demonstrations
from comanip.page.export import bundle, page, write_page
from comanip.page.serve import server
from comanip.page.study import read_person
from comanip.teaching import teach as simulated
from comanip.web.report import _lift
from page.browser import (  # fmt: skip
    Finger,
    Mouse,
    Swift,
    browser,
    follow,
    handle,
    kept_study,
    lead,
    leads,
    needs_browser,
    now,
    opened,
    settled,
    studied,
    teach,
    until,
    wait,
)

PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}


@pytest.fixture(scope="module")
def one() -> Iterator[Any]:
    with browser() as found:
        yield found


@pytest.fixture(scope="module")
def file(skills: dict[str, LearnedSkill], tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("page") / "lift.html"
    write_page(skills, made)
    return made


REACHABLE = """name => { const wrong = []; for (const one of document.querySelectorAll(`header *, #stage *, #${name} *`)) {
    if (!one.matches('button, input, select, textarea, canvas, summary') || one.type === 'file' || !one.checkVisibility()) continue;
    one.scrollIntoView({ block: 'center', inline: 'nearest' }); const r = one.getBoundingClientRect(), x = r.x + r.width / 2, y = r.y + r.height / 2;
    if (r.width < 8 || r.left < -1 || r.right > innerWidth + 1 || y < 0 || y > innerHeight) wrong.push(one.outerHTML.slice(0, 90));
    else { const seen = document.elementFromPoint(x, y); if (!(seen && (one.contains(seen) || seen.contains(one) || seen.closest('label')?.contains(one) || one.matches('canvas')))) wrong.push('covered: ' + one.outerHTML.slice(0, 90)) } }
  if (document.documentElement.scrollWidth > innerWidth) wrong.push('wider than the screen'); scrollTo(0, 0); return wrong }"""
# whether the browser asks before it leaves the page
LEAVES = "(() => { const leaves = new Event('beforeunload', { cancelable: true }); dispatchEvent(leaves); return leaves.defaultPrevented })()"
# median time between frames, over 30 of them
FRAME_MS = """() => new Promise(done => { const at = []; const next = t => { at.push(t); at.length > 30
    ? done(at.slice(1).map((t, i) => t - at[i]).sort((a, b) => a - b)[15]) : requestAnimationFrame(next) }; requestAnimationFrame(next) })"""


def test_the_page_is_one_small_file_that_opens_and_asks_nobody(one: Any, file: Path) -> None:
    assert file.stat().st_size < 1.5e6
    text = file.read_text()
    assert "import " not in bundle().replace("important", "")
    assert not {"http://", "https://", "<link", " src="} & {
        word for word in ("http://", "https://", "<link", " src=") if word in text
    }
    with opened(one, file) as tab:  # and fails on any request, error or refused policy
        assert tab.title() == "Lift with the robot"


def test_a_mouse_lifts_to_where_it_means_with_a_follower_and_is_judged(one: Any, file: Path) -> None:
    with opened(one, file) as tab:
        found = lead(tab, random.Random(3), duration_s=2.6, onset_s=1.0)
        assert found["verdict"]["success"], found["verdict"]
        assert tab.locator("#verdict").inner_text().startswith("✓")
        assert len(found["take"]["weights"][0]) == 10


def test_the_hand_moves_in_the_next_frames_after_the_pointer(one: Any, file: Path) -> None:
    """Milliseconds are the machine's (8 on one that does nothing else); by itself the page answers within its next frames."""
    with opened(one, file, real_time=True) as tab:
        settled(tab)
        x, y = handle(tab)
        hand, begun = Mouse(tab), now(tab)
        hand.down(x, y)
        while now(tab) - begun < 2.0:
            hand.move(x, y - 40.0 * max(now(tab) - begun - 0.8, 0.0))
            wait(tab, 0.01)
        hand.up()
        latencies = sorted(tab.evaluate("comanip.latencies"))
        assert latencies[len(latencies) // 2] < 4.0 * tab.evaluate(FRAME_MS)


LATER = """(([ms, stamp, x, y]) => { const was = performance.now, before = comanip.session.world.get("time_s"); performance.now = () => was() + ms;
  const made = new PointerEvent("pointermove", { pointerId: 9, clientX: x, clientY: y }); Object.defineProperty(made, "timeStamp", { value: stamp });
  document.getElementById("scene").dispatchEvent(made); performance.now = was;
  return [1000 * (comanip.session.world.get("time_s") - before), comanip.hands.now[1]] })"""


def test_the_world_goes_on_with_an_event_of_the_pointer_before_the_next_frame(one: Any, file: Path) -> None:
    with opened(one, file) as tab:
        settled(tab)
        (x, y), hand = handle(tab), Swift(tab)
        hand.down(x, y)
        hand.move(x, y)
        wait(tab, 1.0)
        passed, at = tab.evaluate(LATER, [20, 1e6, x, y - 5.0])
        assert passed == pytest.approx(20.0, abs=10.0)  # to the robot's tick
        assert at == y - 5.0
        assert tab.evaluate(LATER, [40, 1e6, x, y - 5.0])[0] == 0.0  # the same movement, told again
        assert tab.evaluate(LATER, [60, 1e6 - 1.0, x, y])[1] == y - 5.0  # an older one
        assert tab.evaluate(LATER, [80, 1e6, x, y - 9.0])[1] == y - 9.0  # where stamps are coarse it may be another
        before = tab.evaluate("comanip.session.world.get('time_s')")
        wait(tab, 0.05)  # what has passed does not pass again
        assert tab.evaluate("comanip.session.world.get('time_s')") - before <= 0.05


def test_a_person_who_goes_along_is_led_to_the_end_and_pulls_no_more(one: Any, file: Path) -> None:
    with opened(one, file) as tab:
        tab.click("#roles [data-role=leader]")
        found = follow(tab, random.Random(5), delay_s=0.2)
        assert found["verdict"]["success"], found["verdict"]
        assert found["verdict"]["residual_n"] < 2.0, found["verdict"]


def test_the_handle_is_drawn_where_it_is(one: Any, file: Path) -> None:
    """A tilt drawn larger was answered with a larger pull by whoever followed the handle, who pulled on for ever."""
    with opened(one, file) as tab:
        settled(tab)
        rises, metre = tab.evaluate(
            "(() => { const s = comanip.scene, at = x => { s.draw({ robot: [0.1], person: [0.1 + x], force: [0], tilt: -x, now: 0 }); return s.handle[1] }; return [at(0) - at(0.02), s.scale] })()"
        )
        assert rises == pytest.approx(0.02 * metre, rel=1e-9)


def test_a_finger_lifts_on_a_phone_where_everything_is_reachable(one: Any, file: Path) -> None:
    with opened(one, file, **PHONE) as tab:
        tab.evaluate("(() => { globalThis.shakes = []; navigator.vibrate = ms => { shakes.push(ms); return true } })()")
        found = lead(tab, random.Random(4), duration_s=2.0, onset_s=1.0, hand=Finger(tab))
        assert found["verdict"]["success"], found["verdict"]
        shakes = tab.evaluate("shakes")
        assert shakes
        assert all(11 <= ms <= 38 for ms in shakes), shakes
        until(tab, "document.getElementById('verdict').hidden")
        for name in ("teach", "study", "understand", "about", "lift"):
            tab.tap(f"#tab-{name}")
            wait(tab, 0.1)
            assert tab.evaluate(REACHABLE, name) == [], name


@pytest.mark.parametrize("role", ["leader", "follower"])
def test_keys_alone_lift(role: str, one: Any, file: Path) -> None:
    with opened(one, file, reduced_motion="reduce", color_scheme="dark") as tab:
        assert tab.evaluate("document.documentElement.dataset.theme") == "dark"
        tab.focus("#roles [aria-checked=true]")
        while tab.evaluate("comanip.role") != role:
            tab.keyboard.press("ArrowRight")
        settled(tab)
        tab.focus("#scene")
        tab.keyboard.press("Space")
        wait(tab, 1.0)
        if role == "follower":  # up, until the ring is where the beam is asked for
            tab.keyboard.down("ArrowUp")
            until(tab, "comanip.hands.target[0] > comanip.session.setup.goal[0] - 0.01", step_s=1.0 / 60.0)
            tab.keyboard.up("ArrowUp")
        until(tab, "comanip.takes.length === 1", 20.0)
        verdict = tab.evaluate("comanip.takes[0].verdict")
        assert verdict["success"], verdict


PAD = """(() => { const effects = globalThis.effects = [];
  globalThis.pad = { connected: true, buttons: [{ pressed: false }], axes: [0, 0, 0, 0], vibrationActuator: { playEffect: (kind, about) => { effects.push(about.strongMagnitude); return Promise.resolve() } } };
  navigator.getGamepads = () => [null, globalThis.pad] })()"""


HUM = "(() => { globalThis.loud = []; comanip.sound.loud.gain.setTargetAtTime = value => loud.push(value) })()"


def test_a_gamepad_lifts_rumbles_and_hums_with_the_force(one: Any, file: Path) -> None:
    with opened(one, file) as tab:
        tab.evaluate(PAD)
        tab.click("#sound")
        assert tab.get_attribute("#sound", "aria-pressed") == "true"
        tab.evaluate(HUM)
        settled(tab)
        for pressed in ("true", "false"):
            tab.evaluate(f"pad.buttons[0].pressed = {pressed}")
            wait(tab, 0.1)
        assert tab.evaluate("[comanip.hands.kind, comanip.session.phase]") == ["gamepad", "runs"]
        tab.evaluate("pad.axes = [0, -0.1, 0, 0]")  # a stick that does not come back to its middle
        wait(tab, 0.9)
        assert abs(tab.evaluate("comanip.hands.target[0]")) < 0.01
        tab.evaluate("pad.axes[1] = -0.7")
        until(tab, "comanip.hands.target[0] > comanip.session.setup.goal[0] - 0.01", step_s=1.0 / 60.0)
        tab.evaluate("pad.axes[1] = 0")
        until(tab, "comanip.takes.length === 1", 20.0)
        verdict = tab.evaluate("comanip.takes[0].verdict")
        assert verdict["success"], verdict
        effects = tab.evaluate("effects")
        assert effects
        assert all(0.12 <= strength <= 1.0 for strength in effects)
        loud = tab.evaluate("loud")
        assert max(loud) > 0.005  # 1 N and more
        assert loud[-1] == 0.0


def test_every_control_has_a_name(one: Any, file: Path) -> None:
    with opened(one, file) as tab:
        nameless = tab.evaluate(
            "[...document.querySelectorAll('button, select, input, canvas, [role]')].filter(e => !e.hidden && e.type !== 'file' && !(e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.textContent.trim() || e.closest('label'))).map(e => e.outerHTML.slice(0, 80))"
        )
        assert [e for e in nameless if 'role="status"' not in e and 'role="alert"' not in e and "tabpanel" not in e] == []


def test_three_axes_are_carried_with_the_wheel_for_the_third(one: Any, tmp_path: Path) -> None:
    task = "pick-carry-place"
    lessons = demonstrations(simulated("follower", 5, rng=np.random.default_rng(4), task=task), rate_hz=100.0)
    write_page({"follower": learn(lessons, role="follower")}, tmp_path / "carry.html", task=task)
    with opened(one, tmp_path / "carry.html") as tab:
        assert "along y" in tab.locator("#depth").inner_text()
        hand = Swift(tab)
        hand.dive = Mouse(tab).dive  # type: ignore[method-assign]  # by a real wheel
        settled(tab)
        tab.mouse.move(*handle(tab))
        found = lead(tab, random.Random(6), duration_s=6.0, onset_s=0.8, hand=hand)
        assert found["verdict"]["success"], found["verdict"]
        assert found["take"]["end_position"][-1][1] == pytest.approx(0.2, abs=0.03)
        settled(tab)
        tab.focus("#scene")
        tab.keyboard.press("Space")
        wait(tab, 0.6)
        tab.keyboard.down("e")
        wait(tab, 0.6)
        tab.keyboard.up("e")
        assert tab.evaluate("comanip.hands.target[1]") > 0.08
        assert abs(tab.evaluate("comanip.hands.target[0]")) < 0.03
        tab.keyboard.press("Space")
        settled(tab)
        hand, at = Finger(tab), handle(tab)
        hand.down(*at)
        wait(tab, 0.6)
        hand.dive(0.0, 0.05)  # a second finger, and a third that changes nothing
        hand.points[2] = (at[0] - 100.0, at[1] + 30.0)
        hand._send("touchStart")
        wait(tab, 0.1)
        assert tab.evaluate("comanip.hands.deep") == pytest.approx(0.05, abs=0.005)
        del hand.points[1]
        hand._send("touchMove")
        wait(tab, 0.1)
        assert tab.evaluate("comanip.hands.kind") == "pointer"  # the first still holds
        hand.up()
        wait(tab, 0.1)
        assert tab.evaluate("comanip.hands.target") is None


def test_letting_go_is_noticed_said_and_ended_by_going_on(one: Any, file: Path) -> None:
    with opened(one, file) as tab:
        settled(tab)
        x, y = handle(tab)
        tab.mouse.move(x, y)
        tab.mouse.down()
        wait(tab, 0.7)
        for n in range(25):
            tab.mouse.move(x, y - 2.0 * n)
            wait(tab, 0.02)
        tab.mouse.up()
        until(tab, "comanip.session.world.get('mode') !== 0", 5.0)
        said = tab.locator("#status").inner_text()
        assert "let go" in said or "more hangs" in said, said
        until(tab, "comanip.session.world.get('mode') === 2 || comanip.session.phase !== 'runs'", 5.0)
        if tab.evaluate("comanip.session.phase") == "runs":
            assert tab.locator("#rearm").is_visible()
            tab.mouse.move(*handle(tab))
            tab.mouse.down()
            wait(tab, 0.5)
            tab.keyboard.press("r")
            until(tab, "comanip.session.world.get('mode') === 0 || comanip.session.phase !== 'runs'", 6.0)
            tab.mouse.up()


def test_names_with_markup_are_text_and_a_damaged_skill_is_one_line(
    one: Any, skills: dict[str, LearnedSkill], tmp_path: Path
) -> None:
    nasty = "</script><img src=x onerror=\"document.title='owned'\">{{RUNS}}/*CONFIG*/"
    file = tmp_path / "lift.html"
    file.write_text(page(skills, title=nasty))
    good = tmp_path / "<img src=x onerror=alert(1)>.json"
    skill_file.save(skills["leader"], good)
    bad = tmp_path / "<b>bad.json"
    bad.write_text(good.read_text().replace('"role": "leader"', '"role": "<svg onload=alert(2)>"'))
    with opened(one, file) as tab:
        images = tab.locator("img, svg:not(header svg):not(#roles svg)").count()
        tab.set_input_files("#file", [bad])
        tab.wait_for_selector("#say:not([hidden])")
        assert "sha256" in tab.locator("#say").inner_text()
        tab.set_input_files("#file", [good])
        until(tab, "document.getElementById('say').textContent.includes('lifts with')")
        assert "<img src=x" in tab.locator("#say").inner_text()
        assert tab.title() == "Lift with the robot"
        assert tab.locator("img, svg:not(header svg):not(#roles svg)").count() == images == 0
        assert nasty[:20] in file.read_text() or "\\u003c/script" in file.read_text()


def test_lessons_taught_there_are_learned_from_kept_and_opened_again(one: Any, file: Path, tmp_path: Path) -> None:
    with opened(one, file) as tab:
        hand = Swift(tab)
        teach(tab, "leader", 2, random.Random(7), hand)
        tab.click("#teach button:has-text('Learn from these')")
        assert "learned from 2 lessons" in tab.locator("#say").inner_text()
        assert tab.evaluate("[comanip.mode, comanip.role, comanip.skills.leader.provenance.lessons.length]") == [
            "lift",
            "leader",
            2,
        ]
        found = follow(tab, random.Random(8), delay_s=0.18, hand=hand)
        assert found["verdict"]["success"], found["verdict"]
        tab.click("#tab-teach")
        with tab.expect_download() as kept:
            tab.click("#teach button:has-text('Keep the skill')")
        kept.value.save_as(tmp_path / "leader.json")
        kept_skill = skill_file.load(tmp_path / "leader.json")
        tab.click("#tab-about")
        assert skill_file.to_json(kept_skill)["sha256"][:12] in tab.locator("#about").inner_text()
        tab.click("#tab-teach")
        assert tab.evaluate(LEAVES)  # the lessons themselves are not kept yet
        settled(tab)
        tab.locator("[aria-label='Delete leader-2']").click()
        for suffix in (".csv", ".mcap"):
            with tab.expect_download() as kept:
                tab.click(f"#teach button:has-text('Keep all as {suffix[1:].upper()}')")
            kept.value.save_as(tmp_path / "lessons.zip")
            with zipfile.ZipFile(tmp_path / "lessons.zip") as bundled:
                assert bundled.namelist() == [f"leader-1{suffix}"]
                (tmp_path / f"<img src=x>lesson{suffix}").write_bytes(bundled.read(f"leader-1{suffix}"))
            assert not tab.evaluate(LEAVES)
            (recording,) = read(tmp_path / f"<img src=x>lesson{suffix}")
            assert recording.metadata["role"] == "leader"
            (demonstration,) = demonstrations([recording], rate_hz=100.0)
            assert 0.2 < float(np.ptp(demonstration.position)) < 0.4
        tab.set_input_files("#file", [tmp_path / "<img src=x>lesson.csv", tmp_path / "<img src=x>lesson.mcap"])
        until(tab, "comanip.teach.lessons.length === 3")
        assert tab.locator("#teach .lesson b").all_inner_texts() == ["leader-1", "<img src=x>lesson", "<img src=x>lesson"]
        assert tab.locator("#teach img").count() == 0
        tab.evaluate(
            "(() => { const b = document.querySelectorAll('#teach .trim input')[2]; b.value = 60; b.dispatchEvent(new Event('input')) })()"
        )
        assert tab.evaluate("comanip.teach.kept(comanip.teach.lessons[1]).channels[0].time[0]") == pytest.approx(0.6)
        settled(tab)
        tab.locator("[aria-label='Replay leader-1']").click()
        before = handle(tab)
        wait(tab, 3.0)
        assert handle(tab)[1] < before[1] - 20.0  # the lesson's lift is shown
        tab.locator("[aria-label='Delete leader-1']").click()
        assert tab.evaluate("comanip.teach.lessons.length") == 2


STUDY = """[[conditions]]
name = "ours <img src=x>"
skill = "follower.json"
[[conditions]]
name = "led"
role = "leader"
skill = "leader.json"
[[conditions]]
name = "mass-damper"
mass_kg = 6
damping_ns_per_m = 20
"""


def test_a_study_of_robots_of_ones_own_by_script_is_blind_complete_and_analysed(
    one: Any, skills: dict[str, LearnedSkill], tmp_path: Path
) -> None:
    for role, skill in skills.items():
        skill_file.save(skill, tmp_path / f"{role}.json")
    (tmp_path / "study.toml").write_text(STUDY)
    write_page(skills, tmp_path / "lift.html", study=tmp_path / "study.toml")
    with opened(one, tmp_path / "lift.html") as tab:
        order = studied(tab, 4, trials=1, hand=Swift(tab))
        assert tab.title() == "Lift with the robot"
        assert tab.locator("#study img").count() == 0
        person = read_person(kept_study(tab, "Keep the file", tmp_path / "p.jsonl"))
        with zipfile.ZipFile(kept_study(tab, "as MCAP", tmp_path / "p.zip")) as bundled:
            assert bundled.testzip() is None
            assert bundled.read("study.jsonl") == (tmp_path / "p.jsonl").read_bytes()
            bundled.extractall(tmp_path / "trials")
        trials = {file.name: read(file)[0] for file in (tmp_path / "trials").glob("*.mcap")}
        assert len(trials) == 3
        assert trials["led-1.mcap"].metadata["condition"] == "led"
    assert order == ["mass-damper", "led", "ours <img src=x>"]
    assert person.complete
    assert all(trial["verdict"]["success"] for trial in person.trials), [trial["verdict"]["failures"] for trial in person.trials]
    assert {t["condition"] for t in person.trials} == set(order)
    assert person.about["roles"] == ["follower", "leader", "follower"]
    assert person.about["skills"][0] == [skill_file.to_json(skills["follower"])["sha256"]]
    assert person.prefers == person.about["order"][0] == order[0]
    assert json.loads((tmp_path / "p.jsonl").read_text().splitlines()[1])["channels"]["position"]


def begins(tab: Any, **plan: int) -> None:
    tab.evaluate(f"Object.assign(comanip.study.plan, {json.dumps(plan)})")
    tab.check("#study input[type=checkbox]")
    tab.click("#study button:has-text('Begin')")
    settled(tab)


def test_a_study_that_is_broken_off_anywhere_leaves_what_there_was(one: Any, file: Path, tmp_path: Path) -> None:
    with opened(one, file) as tab:
        hand = Swift(tab)
        tab.click("#tab-study")
        begins(tab, practice=1)
        tab.click("#study button:has-text('Stop here')")  # at practice
        assert not read_person(kept_study(tab, "Keep the file", tmp_path / "at-once.jsonl")).trials
        tab.click("#study button:has-text('Another person')")
        assert tab.locator("#study input[type=text]").input_value() == "p2"
        begins(tab, practice=0, trials=1)
        leads(tab, random.Random(1), duration_s=2.0, onset_s=0.6, hand=hand)
        until(tab, "document.querySelector('#study fieldset') !== null")
        tab.locator("#study input[name=ease][value='3']").check(force=True)
        tab.click("#study button:has-text('Stop here')")  # between two questions
        person = read_person(kept_study(tab, "Keep the file", tmp_path / "asked.jsonl"))
        assert (person.complete, len(person.trials), person.answers) == (False, 1, {})
        tab.click("#study button:has-text('Another person')")
        begins(tab)
        hand.down(*handle(tab))
        wait(tab, 1.0)
        tab.click("#study button:has-text('Stop here')")  # in the middle of a lift
        hand.up()
        assert tab.evaluate(LEAVES)
        tab.click("#study button:has-text('Another person')")
        assert tab.locator("#study h2").inner_text() == "Stopped."  # not before it is kept, or asked for twice
        person = read_person(kept_study(tab, "Keep the file", tmp_path / "later.jsonl"))
        assert (person.complete, len(person.trials)) == (False, 0)
        assert not tab.evaluate(LEAVES)
        wait(tab, 3.0)
        assert tab.evaluate("comanip.study.records.length") == 2  # nothing comes behind the end


def test_it_is_served_here_and_to_nobody_who_calls_it_otherwise(skills: dict[str, LearnedSkill]) -> None:
    needs_browser()
    with server("<p>page</p>") as running:
        threading.Thread(target=running.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        where = f"http://127.0.0.1:{running.server_address[1]}"
        with urllib.request.urlopen(f"{where}/") as answer:
            assert answer.read() == b"<p>page</p>"
            assert answer.headers["X-Content-Type-Options"] == "nosniff"
        asked = urllib.request.Request(f"{where}/", headers={"Host": "evil.example"})
        for other in (asked, f"{where}/etc/passwd"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(other)
        running.shutdown()


def test_the_report_of_a_demo_holds_the_page_in_a_frame_of_its_own(one: Any, file: Path, tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text(f"<!doctype html><title>report</title>{_lift(file.read_text())}")
    tab = one.new_page()
    tab.goto(report.as_uri())
    until(tab, "document.querySelector('iframe') !== null")
    end = time.monotonic() + 15.0
    while tab.frames[1].evaluate("document.documentElement.dataset.ready") != "yes":
        assert time.monotonic() < end
        time.sleep(0.05)
    assert tab.title() == "report"
    tab.close()
