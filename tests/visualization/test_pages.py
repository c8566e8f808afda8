"""Pages in a real browser: what is asserted is where the stage has its objects, beside what is seen."""

from __future__ import annotations

import os
import signal
import socket
from pathlib import Path

import numpy as np
import pytest

from phcontrol import (
    InvalidArgumentError,
    LiveView,
    MechanicalSystem,
    MinimumJerk,
    PHControlError,
    certify,
    load_robot,
    make_controller,
    record,
    simulate,
)
from phcontrol.visualization import recording
from phcontrol.visualization.server import PageServer, announce_page

pytestmark = [pytest.mark.browser, pytest.mark.xdist_group("browser")]


def where(page, node):
    return np.array(page.evaluate(f"phcontrol.where('{node}')"))


def looks_drawn(png):
    """Return whether a picture has the variety of a drawn stage rather than an empty pane."""
    import io

    from PIL import Image

    pixels = np.asarray(Image.open(io.BytesIO(png)).convert("RGB"))[60:600, 320:1000].reshape(-1, 3)
    return len(np.unique(pixels // 16, axis=0)) > 40


def test_a_recording_plays_offline(browser, log, tmp_path):
    path = record(log, tmp_path / "run.html")
    robot = load_robot("pera")
    with browser.open(path.as_uri()) as page:
        page.context.set_offline(True)
        places = []
        for part in (0.0, 0.5, 1.0):
            page.evaluate(f"phcontrol.seek({part} * phcontrol.duration)")
            row = int(np.searchsorted(log.time, part * log.time[-1] - 1e-9))
            places.append(where(page, "robot/hand"))
            expected = robot.placement("hand", log.position[row]).translation
            np.testing.assert_allclose(places[-1], expected, atol=1e-5)
        goal = robot.placement("hand", log.goal[0]).translation
        np.testing.assert_allclose(where(page, "goal/hand"), goal, atol=1e-5)
        assert np.linalg.norm(places[1] - places[0]) > 0.01  # it has moved
        assert np.linalg.norm(places[2] - places[1]) > 0.001
        assert looks_drawn(page.screenshot())
        page.evaluate("phcontrol.charts.show(['storage function', 'energy of the arm', 'power', 'contact'])")
        panel = page.inner_text("#panel")
        for words in ("storage function H_d", "energy H", "contact force", "dissipated", "arrows: 1 N"):
            assert words in panel
        assert f"{log.contact_force[-1]:.4g}"[:4] in panel
        assert page.problems == []
        assert page.requests == [path.as_uri()]


def test_play_pause_scrub_and_speed(browser, log, tmp_path):
    path = record(log, tmp_path / "run.html")
    with browser.open(path.as_uri()) as page:
        page.evaluate("phcontrol.seek(0)")
        page.select_option("#speed", "0.1")
        page.click("#play")
        page.wait_for_function("phcontrol.time > 0.02")
        page.click("#play")
        stopped = page.evaluate("phcontrol.time")
        assert 0.0 < stopped < log.time[-1]
        page.wait_for_timeout(100)
        assert page.evaluate("phcontrol.time") == stopped
        page.locator("#scrub").fill(str(log.time[-1] / 2))
        assert abs(page.evaluate("phcontrol.time") - log.time[-1] / 2) < 1e-3
        page.select_option("#speed", "10")
        page.click("#play")
        page.wait_for_function(f"phcontrol.time >= {log.time[-1] - 1e-3}")
        page.wait_for_function("document.getElementById('play').textContent === '▶'")  # and stops at the end
        assert page.problems == []


@pytest.mark.filterwarnings("ignore::phcontrol.RobotDescriptionWarning")
def test_a_missing_mesh_is_said_on_the_page(browser, tmp_path):
    from tests.visualization.test_stage import ARM

    mesh = '<visual><geometry><mesh filename="package://parts/arm.stl"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(ARM.format(mesh))
    system = MechanicalSystem(load_robot(tmp_path / "arm.urdf"))
    log = simulate(system, make_controller("energy_shaping", system, goal=[0.5]), duration=0.5)
    with browser.open(record(log, tmp_path / "run.html").as_uri()) as page:
        page.click("#notes summary")
        assert "mesh package://parts/arm.stl is missing" in page.inner_text("#notes")
        assert page.problems == []


def test_a_live_view_follows_the_run_and_can_be_played_again(browser):
    system = MechanicalSystem(load_robot("pera"))
    controller = make_controller("force_feedback", system, goal=[-0.3, 1.0, -0.3, -0.9, 0.3, -1.2, 0.2])
    with LiveView(port=0, real_time=False, rate=1e6, announce=lambda server: None) as view:
        log = simulate(system, controller, duration=0.3, dt=1e-2, watch=view)
        with browser.open(view.server.address) as page:
            page.wait_for_function(f"phcontrol.frames >= {view.shown}")
            assert not page.evaluate("phcontrol.ended")
            page.wait_for_function(f"Math.abs(phcontrol.time - {log.time[-1]}) < 1e-5")
            now = where(page, "robot/hand")
            np.testing.assert_allclose(now, system.robot.placement("hand", log.position[-1]).translation, atol=1e-5)
            view.finish(log)
            page.wait_for_function("phcontrol.ended")
            page.evaluate("phcontrol.seek(0)")
            np.testing.assert_allclose(
                where(page, "robot/hand"), system.robot.placement("hand", log.position[0]).translation, atol=1e-5
            )
            assert looks_drawn(page.screenshot())
            assert page.problems == []
            assert set(page.requests) == {view.server.address}


def test_watching_changes_nothing_and_never_waits():
    """A browser that stands still costs frames, not time: the server is stopped, and the run goes to its end."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    controller = make_controller("force_feedback", system, goal=[1.0, 0.5])
    alone = simulate(system, controller, duration=0.4)
    servers = []

    def stop(server):
        servers.append(server)
        os.kill(server._process.pid, signal.SIGSTOP)

    with LiveView(port=0, real_time=False, rate=1e6, announce=stop) as view:
        watched = simulate(system, controller, duration=0.4, watch=view)
        os.kill(servers[0]._process.pid, signal.SIGCONT)
    assert view.shown + view.dropped == len(watched)
    assert view.dropped > 0
    np.testing.assert_array_equal(watched.position, alone.position)


class Clock:
    """A clock that passes a tenth of a millisecond whenever it is looked at, and sleeps as told."""

    def __init__(self):
        self.now = 0.0

    def perf_counter(self):
        self.now += 1e-4
        return self.now

    def sleep(self, seconds):
        assert seconds > 0.0
        self.now += seconds


@pytest.mark.parametrize(("real_time", "passed", "frames"), [(True, 0.5, 10), (False, 0.05, 1)])
def test_frames_and_pace_go_by_the_clock(monkeypatch, real_time, passed, frames):
    """500 steps of 1 ms at 20 frames a second: in real time, or as fast as they go."""
    from phcontrol.visualization import live

    clock = Clock()
    monkeypatch.setattr(live, "time", clock)
    system = MechanicalSystem(load_robot("pera_shoulder"))
    controller = make_controller("energy_shaping", system, goal=[1.0, 0.5])
    with LiveView(port=0, rate=20.0, real_time=real_time, announce=lambda server: None) as view:
        simulate(system, controller, duration=0.5, watch=view)
    assert abs(clock.now - passed) < 0.01
    assert abs(view.shown - frames) <= 1


def test_a_taken_port_is_a_clear_message():
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(PHControlError, match=f"port {port} cannot be used .*give another, or 0 for any free one"):
            PageServer(port)


def test_without_a_browser_the_address_is_printed(monkeypatch, capsys):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"):
        monkeypatch.delenv(name, raising=False)
    with PageServer(0) as server:
        server.publish("<p>hello</p>")
        announce_page(server)
        text = capsys.readouterr().out
        assert server.address in text
        assert "--record FILE.html" in text


def box_of(page, selector):
    box = page.locator(selector).bounding_box()
    return np.array([box["x"], box["y"], box["x"] + box["width"], box["y"] + box["height"]])


@pytest.mark.parametrize("size", [(1280, 760), (800, 600), (400, 700)], ids=str)
def test_charts_never_cover_the_arm_and_fold_away(browser, log, tmp_path, size):
    with browser.open(record(log, tmp_path / "run.html").as_uri()) as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        width = "document.querySelector('#meshcat-pane{}').clientWidth"
        page.wait_for_function(f"Math.abs({width.format(' canvas')} - {width.format('')}) < 2")
        pane, panel, timeline = (box_of(page, selector) for selector in ("#meshcat-pane", "#panel", "#timeline"))
        for first, second in ((pane, panel), (pane, timeline), (panel, timeline)):
            overlap = np.minimum(first[2:], second[2:]) - np.maximum(first[:2], second[:2])
            assert overlap.min() <= 0.5
        canvas = box_of(page, "#meshcat-pane canvas")
        np.testing.assert_allclose(canvas, pane, atol=1.0)  # the picture fills its pane, no more
        page.keyboard.press("c")
        assert not page.is_visible("#panel")
        folded = box_of(page, "#meshcat-pane")
        assert np.prod(folded[2:] - folded[:2]) > 1.3 * np.prod(pane[2:] - pane[:2])
        page.keyboard.press("c")
        assert page.is_visible("#panel")
        assert page.problems == []


def test_signals_are_picked_hidden_pointed_at_and_zoomed(browser, log, tmp_path):
    with browser.open(record(log, tmp_path / "run.html").as_uri()) as page:
        page.evaluate("phcontrol.charts.show(['velocity']); phcontrol.seek(0)")
        names = load_robot("pera").joint_names
        rows = page.locator(".value")
        assert [row.split("\n")[0] for row in rows.all_inner_texts()] == list(names)
        canvas = box_of(page, ".chart canvas")
        middle = (0.5 * (canvas[0] + 46 + canvas[2] - 8), 0.5 * (canvas[1] + canvas[3]))
        page.mouse.move(*middle)  # values are those where the pointer is, not of the frame that is shown
        k = int(np.searchsorted(log.time, 0.5 * log.time[-1]))
        shown = float(rows.nth(1).inner_text().split("\n")[1])
        assert shown == pytest.approx(log.velocity[k, 1], rel=0.02, abs=2e-3)
        page.mouse.down()  # and a press goes there
        page.mouse.up()
        assert page.evaluate("phcontrol.time") == pytest.approx(0.5 * log.time[-1], abs=0.02 * log.time[-1])
        rows.nth(1).click()
        assert rows.nth(1).get_attribute("aria-pressed") == "false"
        before = page.locator(".chart canvas").screenshot()
        page.mouse.move(*middle)
        page.mouse.wheel(0, -500)
        page.wait_for_timeout(200)
        assert page.locator(".chart canvas").screenshot() != before
        page.locator(".chart select").select_option("power")
        assert page.locator(".value").count() == 3
        page.click("#add")
        assert page.locator(".chart").count() == 2
        page.locator(".chart-head button").first.click()
        assert page.locator(".chart").count() == 1
        assert page.problems == []


def test_keys_certificate_and_dark_scheme(browser, log, tmp_path):
    system = MechanicalSystem(load_robot("pera"))
    certificate = certify(make_controller("energy_shaping", system), system, samples=8)
    path = record(log, tmp_path / "run.html", certificate=certificate)
    with browser.open(path.as_uri()) as page:
        assert page.inner_text("#badge summary") == f"certificate: {certificate.verdict}"
        page.click("#badge summary")
        assert "matching residual" in page.inner_text("#badge pre")
        page.evaluate("document.activeElement.blur()")
        page.keyboard.press("End")
        assert page.evaluate("phcontrol.time") == pytest.approx(log.time[-1])
        page.keyboard.press("Home")
        page.keyboard.press("ArrowRight")
        assert page.evaluate("phcontrol.time") == pytest.approx(0.1)
        page.keyboard.press("f")
        assert page.get_attribute("#axes", "aria-pressed") == "false"
        paper = "getComputedStyle(document.body).backgroundColor"
        assert page.evaluate(paper) == "rgb(255, 255, 255)"
        page.emulate_media(color_scheme="dark")
        page.wait_for_timeout(300)
        assert page.evaluate(paper) == "rgb(27, 30, 36)"
        assert looks_drawn(page.screenshot())
        assert page.problems == []


def test_a_page_is_small(tmp_path):
    """Ten seconds of an arm with fine meshes; the 3-D library is in it."""
    system = MechanicalSystem(load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))
    way = MinimumJerk.within_limits(system.robot, system.robot.home, system.robot.near_home(), fraction=0.05)
    log = simulate(system, make_controller("energy_shaping", system, reference=way), duration=10.0, dt=0.01)
    assert record(log, tmp_path / "run.html").stat().st_size < 1.5e6


def test_an_axis_of_a_chart_has_three_ticks_at_least(browser, log, tmp_path):
    """The functions that choose them, at ranges of every size."""
    text = (Path(recording.__file__).parent / "assets" / "charts.js").read_text()
    functions = text[text.index("function ticksOf") : text.index("function tickText")]
    program = """
        const bad = [];
        for (let k = 0; k < 2000; k++) {
          const low = (((k * 7919) % 1000) / 500 - 1) * Math.pow(10, (k % 9) - 4);
          const high = low + (1 + (k % 17)) * Math.pow(10, (k % 11) - 6);
          const off = 1e-8 * (high - low) + 1e-12 * Math.abs(high);
          for (const wanted of [2, 3, 4, 8]) {
            const found = ticksOf(low, high, wanted).ticks;
            if (found.length < 3 || found.length > 30 || found.some((t) => t < low - off || t > high + off))
              bad.push([low, high, wanted, found.length]);
          }
        }
        return bad;
    """
    with browser.open(record(log, tmp_path / "run.html").as_uri()) as page:
        assert page.evaluate(f"(() => {{ {functions} {program} }})()") == []


@pytest.fixture(scope="module")
def beside():
    """Two runs of the same arm from the same place, of different length: with and without a push."""
    system = MechanicalSystem(load_robot("pera_shoulder"))
    law = make_controller("energy_shaping", system, goal=[0.5, 0.3])
    calm = simulate(system, law, duration=1.0, dt=1e-2)
    pushed = simulate(system, law, duration=0.6, dt=1e-2, disturbance=[3.0, 0.0])
    return {"calm": calm, "pushed <b>": pushed}


def test_runs_stand_side_by_side_under_one_time(browser, beside, tmp_path):
    robot = load_robot("pera_shoulder")
    with browser.open(record(beside, tmp_path / "runs.html").as_uri()) as page:
        assert page.evaluate("phcontrol.duration") == pytest.approx(1.0)
        for moment in (0.0, 0.3, 0.9):
            page.locator("#scrub").fill(str(moment))
            for number, log in enumerate(beside.values()):
                k = int(np.searchsorted(log.time, min(moment, log.time[-1]) - 1e-9))  # an ended run stays at its end
                seen = np.array(page.evaluate(f"phcontrol.where('robot/arm', {number})"))
                np.testing.assert_allclose(seen, robot.placement("arm", log.position[k]).translation, atol=1e-4)
        assert page.locator(".pane canvas").count() == 2
        assert page.locator(".pane .name").all_inner_texts() == list(beside)
        page.evaluate("phcontrol.charts.show(['position']); phcontrol.seek(0.3)")
        rows = page.locator(".value:not(.head)")
        k = int(np.searchsorted(beside["calm"].time, 0.3 - 1e-9))
        for joint in range(2):
            values = [float(text) for text in rows.nth(joint).inner_text().split("\n")[1:]]
            np.testing.assert_allclose(
                values, [log.position[k, joint] for log in beside.values()], rtol=6e-3, atol=6e-4
            )
        both = page.locator(".chart canvas").screenshot()
        page.locator("#runs button").nth(1).click()  # its lines go, its arm stays
        assert page.locator("#runs button").nth(1).get_attribute("aria-pressed") == "false"
        assert page.locator(".chart canvas").screenshot() != both
        assert page.locator(".pane canvas").count() == 2
        assert page.problems == []


def test_scenes_side_by_side_are_looked_at_from_one_place(browser, beside, tmp_path):
    with browser.open(record(beside, tmp_path / "runs.html").as_uri()) as page:
        before = page.evaluate("phcontrol.cameras")
        assert np.allclose(before[0], before[1])
        pane = box_of(page, "#meshcat-pane > .pane:first-child")
        page.mouse.move(0.5 * (pane[0] + pane[2]), 0.5 * (pane[1] + pane[3]))
        page.mouse.down()
        page.mouse.move(0.5 * (pane[0] + pane[2]) + 80, 0.5 * (pane[1] + pane[3]) + 30, steps=4)
        page.mouse.up()
        page.wait_for_function(f"Math.abs(phcontrol.cameras[0][0] - {before[0][0]}) > 1e-2")
        after = page.evaluate("phcontrol.cameras")
        assert not np.allclose(after[0], before[0], atol=1e-2)
        assert np.allclose(after[0], after[1], atol=1e-6)


@pytest.mark.parametrize("size", [(1200, 800), (800, 900), (400, 800)], ids=str)
def test_panes_side_by_side_share_the_width(browser, beside, tmp_path, size):
    with browser.open(record(beside, tmp_path / "runs.html").as_uri()) as page:
        page.set_viewport_size({"width": size[0], "height": size[1]})
        panes = "[...document.querySelectorAll('.pane')]"
        page.wait_for_function(f"{panes}.every((pane) => Math.abs(pane.clientWidth - pane.firstChild.clientWidth) < 2)")
        panes = [page.locator(".pane").nth(k).bounding_box() for k in range(2)]
        canvases = [page.locator(".pane canvas").nth(k).bounding_box() for k in range(2)]
        for pane, canvas in zip(panes, canvases, strict=True):
            for side in ("x", "y", "width", "height"):
                assert canvas[side] == pytest.approx(pane[side], abs=1.5)
        assert panes[0]["width"] == pytest.approx(panes[1]["width"], abs=1.5)
        assert panes[0]["x"] + panes[0]["width"] <= panes[1]["x"] + 0.5
        assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
        panel = page.locator("#panel")
        assert panel.evaluate("(box) => box.scrollWidth <= box.clientWidth")
        assert page.problems == []


def test_more_runs_than_can_be_told_apart_are_refused(beside, tmp_path):
    log = beside["calm"]
    with pytest.raises(InvalidArgumentError, match="must be 1 to 4 runs for a page, but are 5"):
        record({str(k): log for k in range(5)}, tmp_path / "runs.html")
    with pytest.raises(InvalidArgumentError, match="must be 1 to 4 runs for a page, but are 0"):
        record({}, tmp_path / "runs.html")
    with pytest.raises(InvalidArgumentError, match=r"log\['two'\]: must be a Log"):
        record({"one": log, "two": 3}, tmp_path / "runs.html")
