"""The page in a real browser: Chromium without a window, by Playwright; skipped where there is none.

Servers are processes of their own. No request may leave the machine, and nothing may be said on the console.
"""

import contextlib
import itertools
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager

import pytest

import ksd
from ksd.answers.printing import format_number
from ksd.errors import SceneError
from ksd.scene.toml_file import shipped_scenes
from ksd.units import deg

pytest.importorskip("nicegui", reason="the extra `live` is not installed")
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
if CHROMIUM is None:
    pytest.skip("no Chromium on this machine", allow_module_level=True)

from ksd.interactive.page import check_host, free_port  # noqa: E402

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
MOVES = 15


@contextmanager
def served(*arguments, **where):
    """Address of a page served by a process of its own, which Ctrl-C must end."""
    command = [sys.executable, "-m", "ksd", "live", *map(str, arguments), "--no-browser", "--port", "0"]
    # not a test of its own to nicegui
    given = {k: v for k, v in os.environ.items() if not k.startswith(("PYTEST", "NICEGUI"))}
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=given, **where
    )
    try:
        said = ""
        while "http://" not in said:
            line = process.stdout.readline()
            assert line, f"the page ended: {said}"
            said += line
        yield re.search(r"http://[^; ]+", said)[0]
        process.send_signal(signal.SIGINT)
        assert "Traceback" not in process.communicate(timeout=20)[0]
    finally:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def browser():
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def opened(browser):
    """A function that opens an address in a page that is checked at the end."""
    said, pages = [], []

    def open_page(address, wide=640, tall=480):
        page = browser.new_page(viewport={"width": wide, "height": tall})
        page.on("console", lambda message: said.append(message.text))
        page.on("pageerror", lambda error: said.append(str(error)))
        page.on("request", lambda request: said.append(request.url) if not local(request.url) else None)
        wait_for_page(page, address)
        pages.append(page)
        return page

    yield open_page
    for page in pages:
        page.close()
    assert not said, said


def local(url):
    return url.startswith(("data:", "blob:", "http://127.0.0.1:", "ws://127.0.0.1:"))


def wait_for_page(page, address):
    for tried in range(40):
        try:
            page.goto(address)
            break
        except playwright.Error:
            assert tried < 39
            time.sleep(0.1)
    page.wait_for_function("window.ksdUpdates > 0", timeout=20_000)


def updates(page):
    return page.evaluate("window.ksdUpdates")


def drag_slider(page, moves, *, release=True):
    """Drag the first slider by the mouse, waiting at each move for the picture; updates drawn meanwhile."""
    box = page.locator(".q-slider").first.bounding_box()
    x, y = box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"]
    page.mouse.move(x, y)
    page.mouse.down()
    page.wait_for_timeout(300)
    before = updates(page)
    for k in range(moves):
        page.mouse.move(x - 2 * (k + 1), y)
        page.wait_for_function("n => window.ksdUpdates >= n", arg=before + k + 1, timeout=20_000)
    drawn = updates(page)
    if release:
        page.mouse.up()
    return drawn - before


@pytest.fixture(scope="module")
def gripper(tmp_path_factory):
    file = tmp_path_factory.mktemp("live") / "gripper.toml"
    file.write_text(shipped_scenes()["gripper"].read_text())
    with served(file) as address:
        yield address, file


def test_the_page_follows_the_mouse_and_typed_values_and_saves_that_line_only(opened, gripper):
    address, file = gripper
    page = opened(address)
    force = page.locator("tr", has_text="moment of crank").locator("td").last
    before = force.inner_text()
    assert drag_slider(page, MOVES) >= 0.9 * MOVES
    drawn = updates(page)
    page.wait_for_timeout(1000)
    assert updates(page) - drawn <= 1 and force.inner_text() != before
    typed = page.locator("input.text-right").first
    typed.fill("40 deg")
    typed.press("Enter")
    mechanism, *_ = ksd.load_scene(shipped_scenes()["gripper"])
    expected = format_number(ksd.solve(mechanism, crank=40 * deg).forces["crank"], 6)
    page.get_by_text(f"{expected} Nm").wait_for(timeout=5000)
    page.wait_for_function("!document.querySelector('.ksd-numbers .old')", timeout=20_000)
    assert typed.input_value() == "40"
    page.locator("button:has(i:text-is('save'))").click()
    page.get_by_text("is written").wait_for()
    assert file.read_text() == shipped_scenes()["gripper"].read_text().replace('"15 deg"', '"40 deg"')
    typed.fill("three")
    typed.press("Enter")
    page.get_by_text("crank = 'three'").wait_for()
    assert typed.input_value() == "40"


def test_a_refused_state_is_a_sentence_and_goes_again(opened, gripper):
    page = opened(gripper[0])
    typed = page.locator("input.text-right").first
    typed.fill("400")
    typed.press("Enter")
    refused = page.locator(".ksd-refused")
    refused.wait_for(state="visible", timeout=20_000)
    page.wait_for_function(
        "[...document.querySelectorAll('.ksd-bar')].some(b => b.style.background.includes('gradient'))"
    )
    typed.fill("2")
    typed.press("Enter")
    refused.wait_for(state="hidden")


def test_a_shape_swings_and_the_stroke_is_drawn_and_played(opened, gripper):
    page = opened(gripper[0], 1000, 640)
    page.locator("tr", has_text="critical load factors").wait_for(timeout=60_000)
    page.get_by_label("swing in").click()
    page.get_by_role("option", name="critical load factor").first.click()
    page.wait_for_function("window.ksdPlayed > 5", timeout=120_000)
    page.get_by_text("over the stroke").click()
    play = page.locator("button:has(i:text-is('play_arrow'))")
    play.click()
    page.get_by_text("solve the stroke first").wait_for()
    page.locator("button:has(i:text-is('show_chart'))").click()
    page.locator("canvas").nth(1).wait_for(timeout=60_000)
    typed, drawn = page.locator("input.text-right").first, updates(page)
    typed.fill("5 deg")
    typed.press("Enter")
    # a new pose ends what is played
    page.wait_for_function("n => window.ksdUpdates > n", arg=drawn)
    before = page.evaluate("window.ksdPlayed")
    play.click()
    page.wait_for_function("n => window.ksdPlayed > n + 5", arg=before, timeout=120_000)
    with page.expect_download() as given:
        page.locator("button:has(i:text-is('table_view'))").click()
    assert given.value.path().read_text().startswith("crank_deg,crank_moment_Nm,")


def test_two_viewers_see_the_same_and_one_may_go_away_in_mid_drag(opened, browser, gripper):
    one = opened(gripper[0])
    other = browser.new_page(viewport={"width": 640, "height": 480})
    wait_for_page(other, gripper[0])
    drag_slider(other, 5, release=False)
    shown = other.locator("input.text-right").first.input_value()
    one.wait_for_function("v => document.querySelector('input.text-right').value === v", arg=shown)
    other.close()
    one.wait_for_timeout(300)
    assert drag_slider(one, 5) >= 4


def test_a_path_in_one_file_is_turned_without_network(browser, tmp_path):
    mechanism, *_ = ksd.load_scene(shipped_scenes()["gripper"])
    file = ksd.view.write_page(
        [ksd.solve(mechanism, crank=a * deg) for a in (0, 10, 20)], tmp_path / "path.html"
    )
    page, said = browser.new_page(viewport={"width": 400, "height": 300}), []
    page.on("console", lambda message: said.append(message.text))
    page.on("pageerror", lambda error: said.append(str(error)))
    page.on(
        "request",
        lambda request: said.append(request.url) if not request.url.startswith(("file:", "blob:")) else 0,
    )
    page.goto(file.as_uri())
    page.wait_for_function("window.ksdPoses === 3")
    shown = page.locator("#name").inner_text()
    page.locator("#at").fill("1")
    assert shown.startswith("crank = 0.349066") and page.locator("#name").inner_text().startswith(
        "crank = 0.174533"
    )
    page.close()
    assert not said, said


def test_hosts_and_ports(capsys):
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert free_port("127.0.0.1", port) > port
    check_host("127.0.0.1", False)
    check_host("0.0.0.0", True)
    with pytest.raises(SceneError, match="add --shared"):
        check_host("0.0.0.0", False)
    with pytest.raises(SceneError, match="is not known"):
        check_host("no.such.host.invalid", True)


class Plane:
    """The plane view of a page: the mouse in millimetres."""

    def __init__(self, page):
        self.page = page

    def choose(self, tool):
        icons = {
            "leaf": "horizontal_rule",
            "pin": "radio_button_unchecked",
            "drive": "arrow_right_alt",
            "move": "near_me",
        }
        self.page.locator(f"button:has(i:text-is('{icons[tool]}'))").first.click()
        self.page.wait_for_function("document.querySelector('.ksd-view svg')?.hasAttribute('viewBox')")

    def at(self, x, y):
        script = """([x, y]) => { const svg = document.querySelector('.ksd-view svg');
            const p = new DOMPoint(x, -y).matrixTransform(svg.getScreenCTM()); return [p.x, p.y]; }"""
        return self.page.evaluate(script, [x, y])

    def drag(self, *points, moves=3, follows=False):
        """Drag through points, waiting at each for the picture where it `follows`; updates drawn meanwhile, and moves."""
        self.page.mouse.move(*self.at(*points[0]))
        self.page.mouse.down()
        self.page.wait_for_timeout(100)
        before, seen = updates(self.page), []
        for (x0, y0), (x1, y1) in itertools.pairwise(points):
            for k in range(1, moves + 1):
                self.page.mouse.move(*self.at(x0 + (x1 - x0) * k / moves, y0 + (y1 - y0) * k / moves))
                if follows:
                    script = "n => window.ksdUpdates >= n"
                    with contextlib.suppress(playwright.TimeoutError):
                        self.page.wait_for_function(script, arg=before + len(seen) + 1, timeout=1000)
                    seen.append(updates(self.page))
                else:
                    self.page.wait_for_timeout(30)
        drawn = updates(self.page)
        self.page.mouse.up()
        self.page.wait_for_timeout(150)
        return drawn - before, moves * (len(points) - 1)


def test_a_fourbar_is_drawn_by_the_mouse_alone_and_its_file_solves_to_the_drawn_numbers(opened, tmp_path):
    file = tmp_path / "drawn.toml"
    with served(file) as address:
        page = opened(address, 1000, 640)
        plane = Plane(page)
        plane.choose("leaf")
        plane.drag((-30, 0), (-30, 20))
        plane.drag((30, 0), (30, 20))
        plane.choose("pin")
        plane.drag((-30, 20), (-30, 60))
        page.get_by_label("to", exact=True).click()
        page.get_by_role("option", name="link.3").click()
        plane.drag((30, 20), (30, 60))
        plane.choose("drive")
        plane.drag((-30, 60), (0, 60))
        page.locator(".q-slider").wait_for()
        # its first answers may compile, all others wait meanwhile
        page.locator("tr", has_text="checked by exact rods").wait_for(timeout=300_000)
        plane.choose("move")
        drawn, moves = plane.drag((30, 0), (30, -40), moves=8, follows=True)
        assert drawn >= 0.9 * moves
        plane.drag((-30, 10), (-36, 10))
        page.wait_for_function("document.querySelector('textarea').value.includes('[leaf.curve]')")
        page.keyboard.press("Control+z")
        page.wait_for_function("!document.querySelector('textarea').value.includes('curve')")
        page.locator("circle[data-name='leaf/0/middle'][cx='-30']").wait_for()
        plane.drag((-30, 10), (-34, 10))
        # the driven link itself
        plane.drag((0, 60), (4, 60))
        page.wait_for_function("document.querySelector('textarea').value.includes('[leaf.curve]')")
        force = page.locator("tr", has_text="force of drive").locator("td").last
        page.wait_for_function("!document.querySelector('.ksd-numbers .old')", timeout=20_000)
        shown = force.inner_text()
        page.keyboard.press("Control+s")
        page.get_by_text("is written").wait_for()
        said = subprocess.run(
            [sys.executable, "-m", "ksd", "solve", file], capture_output=True, text=True, check=True
        ).stdout
        line = next(one for one in said.splitlines() if re.match(r" *drive  .* mm ", one))
        assert shown.split()[0] in line and "4 mm" in file.read_text()
        # before its server ends
        page.close()
