"""Pictures of the page "Draw a gripper": what it says is done by the mouse of a real browser.

    python docs/draw_a_gripper.py

Needs Chromium and Playwright; run it when the page of `ksd live` has changed.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent / "tests"), str(DOCS.parent / "tests" / "interactive")]

from playwright.sync_api import sync_playwright  # noqa: E402
from test_page import CHROMIUM, FLAGS, Plane, served, wait_for_page  # noqa: E402


def main() -> None:
    """Draw, and write `how_to/gripper_1.png` to `gripper_6.png`."""
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        browser, file = (
            started.chromium.launch(executable_path=CHROMIUM, args=FLAGS),
            Path(folder) / "gripper.toml",
        )
        with served(file) as address:
            page = browser.new_page(viewport={"width": 1200, "height": 700})
            wait_for_page(page, address)
            plane, taken = Plane(page), iter(range(1, 7))

            def picture() -> None:
                page.wait_for_timeout(2500)
                page.wait_for_function("!document.querySelector('.ksd-numbers .old')", timeout=300_000)
                page.wait_for_timeout(500)
                page.screenshot(path=DOCS / "how_to" / f"gripper_{next(taken)}.png")

            plane.choose("leaf")
            plane.drag((20, 0), (20, 50))
            picture()
            page.get_by_label("to", exact=True).click()
            page.get_by_role("option", name="link", exact=True).click()
            plane.drag((40, 0), (40, 50))
            plane.choose("drive")
            plane.drag((20, 50), (0, 50))
            page.locator("tr", has_text="checked by exact rods").wait_for(timeout=300_000)
            picture()
            plane.choose("move")
            plane.drag((30, 50), (26, 50), follows=True)
            picture()
            plane.drag((40, 25), (44, 25))
            picture()
            thickness = page.get_by_label("thickness", exact=True)
            thickness.fill("0.3 mm")
            thickness.press("Enter")
            picture()
            page.keyboard.press("Escape")
            page.get_by_text("3D", exact=True).first.click()
            page.wait_for_timeout(1000)
            page.get_by_text("3D", exact=True).last.click()
            picture()
            page.keyboard.press("Control+s")
            page.get_by_text("is written").wait_for()
            page.close()
            print(
                subprocess.run(
                    [sys.executable, "-m", "ksd", "solve", file], capture_output=True, text=True
                ).stdout
            )
        browser.close()


if __name__ == "__main__":
    main()
