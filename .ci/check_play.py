#!/usr/bin/env python3
"""Opens the page of `sidehill play` in headless Chromium: `.ci/check_play.py PROGRAM FOLDER`.

PROGRAM serves the page. Its figures are compared with those of `PROGRAM simulate` on three scenarios, one of them with a
path that the mouse draws. Screenshots are left in FOLDER.
"""

import base64
import json
import pathlib
import subprocess
import sys

from browser import Browser

REPOSITORY = pathlib.Path(__file__).parent.parent
SIZE_MAX = 2_000_000
# What depends on the machine.
TIMES = ("solve_us", "cycle_us", "deadline_misses")
# The browser's sine and cosine differ from those of the C library in the last bit: 0.01 %, or 0.01 mm, mm/s and mrad.
# The scenarios are such that the program's own figures stay within that, too, where the start moves by 1e-12 m.
RELATIVE, ABSOLUTE = 1e-4, 1e-5


class Page:
    """The page in a browser."""

    def __init__(self, browser, address):
        self.browser, self.address = browser, address

    def open(self, choices="", width=1280, height=900, scheme="light"):
        self.browser.show(self.address + choices, width, height, scheme)
        self.browser.wait("typeof showTime === 'function' && !/Loading/.test($('state').textContent)", 60)
        self.text("state") != "Cannot be driven" or sys.exit(f"{choices}: {self.text('reason')}")

    def text(self, name):
        return self.browser.evaluate(f"$('{name}').textContent")

    def mouse(self, kind, place):
        x, y = self.browser.evaluate(
            f"(([x, y]) => {{ const box = map.getBoundingClientRect(); return ["
            f"box.left + box.width / 2 + (x - view.x) * view.scale, box.top + box.height / 2 - (y - view.y) * view.scale]; }})"
            f"({json.dumps(place)})")
        self.browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1)

    def drag(self, places):
        self.mouse("mousePressed", places[0])
        for place in places[1:]:
            self.mouse("mouseMoved", place)
        self.mouse("mouseReleased", places[-1])

    def figures(self):
        """Drives to the end and returns the figures of all controllers."""
        self.browser.evaluate("$('pace').value = '100'")
        rows = "[...document.querySelectorAll('#figures tbody tr')]"
        self.browser.wait(f"{rows}.length > 0 && {rows}.every(row => row.dataset.figures)")
        return json.loads(self.browser.evaluate(f"JSON.stringify({rows}.map(row => JSON.parse(row.dataset.figures)))"))


def difference(path, one, other):
    """Returns where two values differ by more than is allowed; nothing where they do not."""
    if isinstance(one, dict) and isinstance(other, dict):
        names = [name for name in {**one, **other} if name not in TIMES]
        found = (difference(f"{path}.{name}", one.get(name), other.get(name)) for name in names)
        return next((text for text in found if text), None)
    if isinstance(one, float) and isinstance(other, (int, float)):
        return None if abs(one - other) <= RELATIVE * abs(other) + ABSOLUTE else f"{path}: {one}, not {other}"
    return None if one == other else f"{path}: {one}, not {other}"


def compare(program, page, name, folder):
    """Compares the figures of what the page drives with those of the program."""
    scenario = folder / f"{name}.yaml"
    scenario.write_text(page.browser.evaluate("scenario"))
    found = page.figures()
    command = [program, "simulate", scenario, "--format", "json"]
    for run in found:
        command += ["--controller", run["controller"]]
    done = subprocess.run(command, capture_output=True, text=True)
    if not done.stdout:
        sys.exit(f"{name}: {done.stderr}")
    expected = json.loads(done.stdout)["runs"]
    if len(found) != len(expected):
        sys.exit(f"{name}: {len(found)} runs, not {len(expected)}")
    largest = 0.0
    for one, other in zip(found, expected):
        if wrong := difference(f"{name}: {one['controller']}", one, other):
            sys.exit(wrong)
        rms, other_rms = one["cross_track_rms_m"], other["cross_track_rms_m"]
        largest = max(largest, abs(rms - other_rms) / other_rms)
        print(f"{name}: {one['controller']} {100 * rms:.3f} cm RMS, as `simulate`")
    print(f"{name}: largest relative difference of an RMS {largest:.1e}")


def check(program, address, folder):
    with Browser() as browser:
        page = Page(browser, address)

        def look(name):
            path = folder / f"{name}.png"
            path.write_bytes(base64.b64decode(browser.picture()))
            wide = browser.evaluate("document.documentElement.scrollWidth - innerWidth")
            if wide > 0:
                sys.exit(f"{name}: the page is {wide} pixels too wide")
            if browser.complaints:
                sys.exit(f"{name}: the browser's console says {browser.complaints}")

        for width, height in [(390, 844), (1280, 900)]:
            for scheme in ["light", "dark"]:
                page.open("", width, height, scheme)
                browser.wait("newest()[0] > 3")
                look(f"{width}_{scheme}")
                # Each strip is in sight once.
                browser.evaluate("document.querySelector('#strips').scrollIntoView()")
                browser.evaluate("new Promise(shown => requestAnimationFrame(() => requestAnimationFrame(shown)))")
                look(f"{width}_{scheme}_strips")

        # A shipped scenario, as a file that is opened.
        shipped = (REPOSITORY / "config/scenarios/figure_eight_10deg.yaml").read_text()
        shipped = shipped.replace("../vehicles/", f"{REPOSITORY}/config/vehicles/")
        page.open()
        opened = shipped.replace(f"{REPOSITORY}/config/vehicles/", "../vehicles/")
        browser.evaluate(f"opened = {json.dumps(opened)}; driveScenario(() => opened)")
        browser.evaluate(f"scenario = {json.dumps(shipped)}")
        compare(program, page, "figure_eight_10deg", folder)

        # A link.
        page.open("#terrain=hummocks&slope_deg=10&uphill_deg=60&drives=late&patches=1&controllers=contact-mpc,icrik-mpc")
        compare(program, page, "link", folder)
        look("link")

        # A path that is drawn, by a vehicle of another size with perfect sensors; the link holds it.
        page.open("#vehicle=four_small&sensors=perfect&slope_deg=8&controllers=contact-mpc,icrhk-mpc,pure-pursuit")
        browser.evaluate("$('draw').click()")
        page.drag([[0.25 * i - 1, 0.2 * (i % 8 - 4) ** 2 / 16 + 0.2 * i] for i in range(13)])
        link = browser.evaluate("location.hash")
        if "course=drawn" not in link:
            sys.exit(f"the path that was drawn is not in the link: {link}")
        drawn = browser.evaluate("scenario")
        compare(program, page, "drawn", folder)
        look("drawn")
        page.open(link)
        if browser.evaluate("scenario") != drawn:
            sys.exit("the link of the drawn path makes another scenario")

        # A rover that is dragged aside comes back, and the page says that it was moved.
        page.open("#controllers=contact-mpc&course=straight")
        browser.wait("newest()[0] > 6")
        browser.evaluate("playing = false")
        x, y = browser.evaluate("[get(newest(), 'x'), get(newest(), 'y')]")
        page.drag([[x, y], [x + 0.3, y], [x + 0.6, y]])
        aside = browser.evaluate("get(newest(), 'x')")
        if not 0.4 < aside - x < 0.7:
            sys.exit(f"the rover was dragged from {x} m by 0.6 m and is at {aside} m")
        browser.evaluate("playing = true")
        [run] = page.figures()
        if not run["completed"] or "moved by hand" not in page.text("note"):
            sys.exit(f"a rover that was dragged aside: {run}, {page.text('note')}")
        look("dragged")

        # What cannot be driven is said.
        browser.evaluate("opened = 'name: x'; driveScenario(() => opened)")
        browser.wait("$('state').textContent === 'Cannot be driven'")
        if "scenario.yaml" not in page.text("reason"):
            sys.exit(f"a wrong scenario: {page.text('reason')}")


def main(program, folder):
    folder.mkdir(parents=True, exist_ok=True)
    size = (REPOSITORY / "target/play/index.html").stat().st_size
    if size > SIZE_MAX:
        sys.exit(f"the page has {size} bytes, more than {SIZE_MAX}")
    server = subprocess.Popen([program, "play"], stdout=subprocess.PIPE, text=True)
    try:
        address = server.stdout.readline().split()[0]
        check(program, address, folder)
    finally:
        # A shell starts what runs in the background without SIGINT.
        server.terminate()
        server.wait(timeout=10)
    print(f"the page has {size / 1e6:.2f} MB; its figures are those of `simulate`")


if __name__ == "__main__":
    main(pathlib.Path(sys.argv[1]).resolve(), pathlib.Path(sys.argv[2]).resolve())
