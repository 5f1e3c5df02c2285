#!/usr/bin/env python3
"""Opens reports in headless Chromium and compares their figures: `.ci/check_reports.py FOLDER`.

FOLDER holds NAME.html for each subcommand and what it printed beside it, as `.ci/reports` leaves them. Each page is opened
as on a phone and on a desk, light and dark; a picture of each is written there, too.
"""

import base64
import json
import math
import pathlib
import re
import sys

import axe_playwright_python
from browser import Browser
from make_map import COLOURS, tile_of

WINDOWS = [(390, 844), (1280, 900)]
SCHEMES = ["light", "dark"]
AXE = (pathlib.Path(axe_playwright_python.__path__[0]) / "axe.min.js").read_text()
SERIOUS = ("serious", "critical")
TAPS_MAX = 3

failed = []


def compare(page, name, found, expected):
    if found != expected:
        failed.append(f"{page}: {name} is {found}, the program printed {expected}")


def significant(value):
    """Writes a number as reports do: with two significant digits, as far as three decimals show them."""
    if value is None or not math.isfinite(value):
        return "\u2013"
    decimals = min(max(1 - math.floor(math.log10(max(abs(value), 1e-3))), 0), 3)
    return f"{value:.{decimals}f}"


def shows(found, value):
    """Whether a text is a number, rounded to the digits that it has, two or more that count unless it is exact."""
    decimals = len(found.partition(".")[2])
    count = len(found.lstrip("-0.").replace(".", ""))
    return found == f"{value:.{decimals}f}" and (count >= 2 or float(found) == value)


# A minus before nothing but zeros.
NO_ZERO = r"(?<![\d.])[-\u2212]0(\.0+)?(?![\d.])"


def inspect(browser, name):
    """Looks for what no page may have."""
    if zeros := re.findall(NO_ZERO, browser.evaluate("document.body.innerText")):
        failed.append(f"{name}: zeros have a sign, {len(zeros)} times")
    if not browser.evaluate("document.querySelector('#words summary').checkVisibility()"):
        failed.append(f"{name}: the words are not explained")
    cut = browser.evaluate("JSON.stringify([...document.querySelectorAll('table')].filter(table => table.scrollWidth > "
                           "table.parentElement.clientWidth && !table.closest('.scroll[tabindex]')).map(table => table.innerText))")
    if json.loads(cut):
        failed.append(f"{name}: tables are cut: {cut[:200]}")
    if browser.complaints:
        failed.append(f"{name}: the browser's console says {browser.complaints}")
        browser.complaints.clear()
    wide = browser.evaluate("document.documentElement.scrollWidth - innerWidth")
    if wide > 0:
        failed.append(f"{name}: it is {wide} pixels too wide")
    browser.evaluate(f"{AXE}; 0")
    found = json.loads(browser.evaluate("axe.run().then(found => JSON.stringify(found.violations))"))
    for violation in found:
        if violation["impact"] in SERIOUS:
            nodes = [node["html"][:120] for node in violation["nodes"][:3]]
            failed.append(f"{name}: {violation['impact']}: {violation['help']}: {nodes}")


def shown(browser, folder, name, ready):
    """Opens a page in all windows, leaves pictures, and ends on a desk."""
    for width, height in WINDOWS:
        for scheme in SCHEMES:
            browser.show((folder / f"{name}.html").as_uri(), width, height, scheme)
            browser.wait(f"document.readyState === 'complete' && {ready}")
            # The picture is of the whole page, also of what is out of sight.
            browser.evaluate("whole = true; renew()")
            browser.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
            inspect(browser, f"{name}, {width} px, {scheme}")
            picture = folder / f"{name}_{width}_{scheme}.png"
            picture.write_bytes(base64.b64decode(browser.picture(whole=True)))


def rows(browser, table):
    """Returns the cells of a table by the first of each row."""
    texts = browser.evaluate(f"JSON.stringify([...document.querySelectorAll('#{table} tr')].map(row => "
                             "[...row.cells].map(cell => cell.textContent)))")
    return {row[0]: row[1:] for row in json.loads(texts)}


def opened(browser, folder, name):
    """Opens a page of plots."""
    shown(browser, folder, name, "document.body.dataset.plots")
    plots, drawn, canvases, findings = browser.evaluate(
        "[document.querySelectorAll('.plot').length, Number(document.body.dataset.plots), "
        "document.querySelectorAll('.plot canvas').length, document.querySelectorAll('.finding').length]")
    if plots == 0 or drawn != plots or canvases != plots:
        failed.append(f"{name}: {plots} plots, {drawn} drawn, {canvases} canvases")
    if not findings:
        failed.append(f"{name}: it concludes nothing")
    print(f"{name}: {drawn} plots")


def tap(browser, selector):
    """Taps the middle of an element, which must be in sight."""
    x, y = browser.evaluate(
        f"(() => {{ const box = document.querySelector('{selector}').getBoundingClientRect(); "
        "return [box.left + box.width / 2, box.top + box.height / 2]; })()")
    if not (0 <= x <= 390 and 0 <= y <= 844):
        sys.exit(f"{selector} is not in sight: {x}, {y}")
    for kind in ("mousePressed", "mouseReleased"):
        browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)


def check_drive(browser, folder):
    """The report of a drive that was stopped."""
    facts = json.loads((folder / "drive.json").read_text())
    shown(browser, folder, "drive", "typeof showVerdict === 'function' && !!document.querySelector('#state').textContent")
    held = json.loads(browser.evaluate("document.querySelector('#facts').textContent"))
    compare("drive", "what it holds", held, facts)
    figures = json.loads(browser.evaluate(
        "JSON.stringify([...document.querySelectorAll('#driven dt')].map(name => [name.textContent, name.nextSibling.textContent]))"))
    error = facts["cross_track"]
    for name, key in (("RMS", "rms_m"), ("p95", "p95_m"), ("largest", "max_m")):
        compare("drive", name, dict(figures)[f"cross-track error, {name}"], f"{significant(100 * error[key])} cm")
    weather = rows(browser, "weather")
    for sensor in facts["sensors"]:
        keys = ("rate_hz", "age_p50_s", "age_p95_s", "age_max_s", "gap_max_s")
        expected = ["0" if abs(sensor[key]) < 5e-4 else significant(sensor[key]) for key in keys]
        compare("drive", sensor["name"], weather[sensor["name"]][:5], expected)

    # On a phone: why did it stop? The cause is in sight; a tap shows the moment on the map and in plots.
    [stop] = [stop for stop in facts["stops"] if stop["kind"] == "fault"]
    browser.show((folder / "drive.html").as_uri(), *WINDOWS[0], "light")
    browser.wait("typeof showVerdict === 'function' && !!document.querySelector('#state').textContent")
    cause = browser.evaluate("document.querySelector('#stops b').closest('button').textContent")
    if stop["cause"] not in cause or f"{stop['latitude_deg']:.7f}" not in cause:
        failed.append(f"drive: the stop says {cause!r}, not {stop['cause']!r} and its place")
    taps = 1
    tap(browser, "#stops button")
    browser.wait("cursor !== null")
    compare("drive", "the moment", browser.evaluate("cursor"), stop["time_s"])
    browser.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
    top, bottom = browser.evaluate("(box => [box.top, box.bottom])(document.querySelector('#map').getBoundingClientRect())")
    strip = browser.evaluate("document.querySelector('.strip canvas').getBoundingClientRect().bottom")
    if taps > TAPS_MAX or top < 0 or bottom > 844 or strip > 844:
        failed.append(f"drive: after {taps} taps the map ends at {bottom} and the first plot at {strip}")
    (folder / "drive_stop.png").write_bytes(base64.b64decode(browser.picture()))

    # A touch on the map, where it was at the begin, shows that moment.
    browser.evaluate("(() => { const frame = drive.frames.find(frame => is(get(frame, 'x'))); const box = map.getBoundingClientRect(); "
                     "window.aim = [box.left + map.clientWidth / 2 + (get(frame, 'x') - view.x) * view.scale, "
                     "box.top + map.clientHeight / 2 - (get(frame, 'y') - view.y) * view.scale, frame[0]]; })()")
    x, y, _ = browser.evaluate("aim")
    for kind in ("mousePressed", "mouseReleased"):
        browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
    if browser.evaluate("Math.abs(cursor - aim[2])") > 1.0:
        failed.append("drive: a touch on the map does not show the moment at which the vehicle was there")
    print(f"drive: {browser.evaluate('document.title')}; the cause of the stop is told without a tap, its moment after {taps}")


def check_map(browser, folder):
    """Tiles below the drive: each place has the colour that the file has there."""
    shown(browser, folder, "drive_map", "typeof pictures === 'object' && pictures.every(({ image }) => image.complete)")
    compare("drive_map", "the source", browser.evaluate("$('source').textContent"), "\u00a9 Field Survey")
    latitude_deg, longitude_deg = 36.717, -4.489
    places = [(x + 0.3, y + 0.3) for x in range(-8, 16) for y in range(-8, 24)]
    colours = json.loads(browser.evaluate(
        "(() => { const { data } = map.getContext('2d').getImageData(0, 0, map.width, map.height), ratio = devicePixelRatio; "
        f"return JSON.stringify({json.dumps(places)}.map(([x, y]) => {{ "
        "const right = Math.floor(ratio * (map.clientWidth / 2 + (x - view.x) * view.scale)); "
        "const down = Math.floor(ratio * (map.clientHeight / 2 - (y - view.y) * view.scale)); "
        "const at = right >= 0 && right < map.width ? 4 * (down * map.width + right) : -9; "
        "return [0, 1, 2, 3].map(i => data[at + i] ?? 0); })); })()"))
    # The ground of a dark page covers part of it.
    drawn = {parity: [0.55 * value + 0.45 * ground for value, ground in zip(colour, (0x17, 0x1b, 0x1e))]
             for parity, colour in COLOURS.items()}
    # Metres of a degree on WGS 84, a few metres from the datum.
    flat = 0.00669438
    sine, cosine = math.sin(math.radians(latitude_deg)), math.cos(math.radians(latitude_deg))
    across = 6378137 / math.sqrt(1 - flat * sine ** 2)
    meridian = across * (1 - flat) / (1 - flat * sine ** 2)
    right = {parity: [] for parity in COLOURS}
    for (x, y), (*found, opaque) in zip(places, colours):
        if opaque:
            place = (latitude_deg + math.degrees(y / meridian), longitude_deg + math.degrees(x / (across * cosine)))
            parity = tuple(math.floor(at) % 2 for at in tile_of(*place))
            right[parity].append(min(drawn, key=lambda other: math.dist(found, drawn[other])) == parity)
    # Lines of path, drive and vehicle, and what is on them, are drawn above it.
    if any(len(places) < 4 or sum(places) < 0.75 * len(places) for places in right.values()):
        failed.append("drive_map: too few places have the colour of their tile")
    print("drive_map: places with the colour of their tile:", ", ".join(f"{sum(all)} of {len(all)}" for all in right.values()))


def main(folder):
    with Browser() as browser:
        check_drive(browser, folder)
        check_map(browser, folder)

        opened(browser, folder, "simulate")
        table = rows(browser, "figures")
        for run in json.loads((folder / "simulate.json").read_text())["runs"]:
            keys = ("cross_track_rms_m", "cross_track_p95_m", "cross_track_max_m")
            expected = [significant(100 * run[key]) for key in keys] + [significant(run["steer_total_variation_m_s"])]
            compare("simulate", run["controller"], table[run["controller"]][:4], expected)
        if "Perfect sensors" not in browser.evaluate("document.querySelector('.finding').textContent"):
            failed.append("simulate: it does not say that its sensors are perfect")

        # A place on the map shows its moment in the plots, which are zoomed to it.
        x, y, time_s = browser.evaluate(
            "(() => { map.scrollIntoView({ block: 'center' }); const { frames } = runs[0], frame = frames[Math.floor(frames.length / 2)], "
            "box = map.getBoundingClientRect(); return [box.left + map.clientWidth / 2 + (get(frame, 'x') - view.x) * view.scale, "
            "box.top + map.clientHeight / 2 - (get(frame, 'y') - view.y) * view.scale, frame[0]]; })()")
        for kind in ("mousePressed", "mouseReleased"):
            browser.ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        if abs(browser.evaluate("cursor ?? -100") - time_s) > 30:
            failed.append(f"simulate: a click on the map at {time_s} s shows {browser.evaluate('cursor')}")
        low, high = browser.evaluate("(({ min, max }) => [min, max])(groups.time[0].chart.scales.x)")
        if high - low > 21:
            failed.append(f"simulate: after a click on the map the plots show {high - low} s")
        # A box hides a run in plots and map.
        browser.evaluate("document.querySelector('input[data-run]').click()")
        if not browser.evaluate("runs[0].hidden && groups.time[0].chart.series[1].show === false"):
            failed.append("simulate: a run that is hidden is shown")

        figures = json.loads((folder / "odometry.json").read_text())
        opened(browser, folder, "odometry")
        table = rows(browser, "figures")
        for model in ("icrhk", "icrik", "extended", "diff_drive"):
            for key, found in zip(("mse_x", "mse_y", "mse_z", "mse_yaw", "j_over_n"), table[model]):
                if not shows(found, figures[model][key]):
                    failed.append(f"odometry: {model} {key} is {found}, the program printed {figures[model][key]}")

        opened(browser, folder, "identify")
        table = rows(browser, "level-parameters")
        vehicle = (folder / "identified.yaml").read_text().split("\nextension:")[0]
        vehicle = dict(line.split(": ", 1) for line in vehicle.splitlines() if ": " in line and line[0] != "#")
        # What the logs do not determine is not in the table.
        names = [name for name in table if name in vehicle]
        compare("identify", "the number of parameters", len(names) >= 3, True)
        for name in names:
            value = table[name][0]
            compare("identify", name, value, f"{float(vehicle[name]):.{len(value.partition('.')[2])}f}")

        opened(browser, folder, "campaign")
        table = rows(browser, "figures")
        for own in json.loads((folder / "campaign.json").read_text())["controllers"]:
            keys = ("median_m", "p95_m", "worst_m")
            cm = ["-" if own[key] is None else significant(100 * own[key]) for key in keys]
            expected = [str(own["runs"]), str(own["completed"]), *cm]
            compare("campaign", own["controller"], table[own["controller"]][:5], expected)

        opened(browser, folder, "replay")
        opened(browser, folder, "tune")

    print("\n".join(failed) or "all figures are those of the program")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]).resolve()))
