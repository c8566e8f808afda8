"""The moving picture of README and site: a Franka Panda wipes a table, on the page that ``record`` writes.

    python docs/moving_picture.py [PATH] [--frames N]     # docs/wiping.webp

Needs Chromium, and playwright of the extra 'test'. The page is opened without a window, played frame by frame and kept
as an animated WebP.
"""

# ruff: noqa: RUF005

from __future__ import annotations

import argparse
import io
import shutil
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import phcontrol as ph

LASTS = 8.0  # [s]
SIZE = {"width": 960, "height": 540}
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]  # WebGL without a graphics card
NEARER = "phcontrol.viewer.camera.position.lerp(phcontrol.viewer.controls.target, 0.2)"
SHOWN = """async () => {
  await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
}"""


def wiping(page: Path) -> None:
    """Write the page of a run: the hand presses with 10 N and wipes to and fro, its law certified."""
    system = ph.MechanicalSystem(ph.load_robot("panda", locked_joints=["panda_finger_joint1", "panda_finger_joint2"]))
    frame, start = system.hand_frame, np.array([-0.3, 0.35, 0.0, -2.0, 0.0, 2.35, 0.5])
    hand = system.at(start).placement(frame)
    way = [(0.0, 0.0), (0.0, 0.36), (-0.06, 0.36), (-0.06, 0.0), (-0.12, 0.0), (-0.12, 0.36), (0.0, 0.0)]  # [m]
    law = ph.CartesianTracking(
        system,
        path=ph.FrameSpline(frame, [ph.Pose(hand.translation + [*step, 0.0], hand.rotation) for step in way], LASTS),
        translational_stiffness=1500.0,
        rotational_stiffness=60.0,
        free_direction=(0.0, 0.0, 1.0),
        wrench=(0.0, 0.0, -10.0, 0.0, 0.0, 0.0),
    )
    middle = hand.translation + [-0.06, 0.18, -0.0105]
    place = ph.SphereContact(frame, 0.01, "plane", position=middle)
    table = ph.RigidBody(place, stiffness=2e4, damping=200.0, friction=0.4)
    log = ph.simulate(system, law, duration=LASTS, q0=start, bodies=[table])
    ph.record(log, page, certificate=ph.certify(law))


def filmed(page: Path, frames: int) -> list[Image.Image]:
    """Return pictures of a page at even times."""
    from playwright.sync_api import sync_playwright

    chromium = next((path for name in ("chromium", "chromium-browser") if (path := shutil.which(name))), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        shown = browser.new_page(viewport=SIZE)
        shown.goto(page.as_uri())
        shown.wait_for_function("window.phcontrol && phcontrol.frames > 0")
        shown.evaluate("phcontrol.pause(); phcontrol.charts.show(['contact', 'velocity', 'torque'])")
        shown.evaluate(NEARER)
        pictures = []
        for moment in np.linspace(0.0, LASTS, frames, endpoint=False):
            shown.evaluate(f"phcontrol.seek({moment})")
            shown.evaluate(SHOWN)
            pictures.append(Image.open(io.BytesIO(shown.screenshot())).convert("RGB"))
        browser.close()
    return pictures


def main() -> None:
    """Make the picture and say how large it is."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("path", nargs="?", type=Path, default=Path(__file__).parent / "wiping.webp")
    options.add_argument("--frames", type=int, default=100, help="how many pictures the 8 s become (100)")
    given = options.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        wiping(Path(folder) / "wiping.html")
        first, *others = filmed(Path(folder) / "wiping.html", given.frames)
    kept = {"format": "WEBP", "quality": 60, "method": 6, "loop": 0}
    first.save(given.path, save_all=True, append_images=others, duration=round(1000 * LASTS / given.frames), **kept)
    print(f"{given.path}: {given.frames} frames, {given.path.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
