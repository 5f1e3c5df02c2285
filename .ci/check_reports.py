#!/usr/bin/env python3
"""Opens reports in headless Chromium and compares their figures: `.ci/check_reports.py FOLDER`.

FOLDER holds NAME.html for each subcommand and what it printed beside it, as `.ci/reports` leaves them. A screenshot of
each page is written there, too.
"""

import html.parser
import json
import pathlib
import subprocess
import sys
import tempfile

# A new profile for each page, and nothing that looks for a network.
CHROMIUM = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
            "--disable-background-networking", "--disable-component-update", "--disable-sync",
            "--enable-logging=stderr", "--v=0", "--virtual-time-budget=10000", "--window-size=1000,2600"]


class Page(html.parser.HTMLParser):
    """What a page shows once its scripts have run."""

    def __init__(self, text):
        super().__init__()
        self.drawn, self.plots, self.canvases = None, 0, 0
        # Rows of cells by the table's id.
        self.tables, self.table, self.in_cell = {}, None, False
        self.findings, self.in_finding = [], False
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        if tag == "body":
            self.drawn = int(attrs.get("data-plots", -1))
        self.plots += tag == "div" and attrs.get("class") == "plot"
        self.canvases += tag == "canvas"
        if tag == "table":
            self.table = self.tables.setdefault(attrs.get("id"), [])
        if tag == "tr" and self.table is not None:
            self.table.append([])
        self.in_cell = tag in ("td", "th") or (self.in_cell and tag == "span")
        if self.in_cell and tag in ("td", "th") and self.table:
            self.table[-1].append("")
        if tag == "p" and attrs.get("class") == "finding":
            self.findings.append("")
            self.in_finding = True

    def handle_endtag(self, tag):
        if tag == "table":
            self.table = None
        if tag in ("td", "th"):
            self.in_cell = False
        if tag == "p":
            self.in_finding = False

    def handle_data(self, data):
        if self.in_cell and self.table:
            self.table[-1][-1] += data
        if self.in_finding:
            self.findings[-1] += data


def opened(path, failed):
    """Returns the page of a file, having taken a screenshot of it."""
    with tempfile.TemporaryDirectory() as profile:
        command = [*CHROMIUM, f"--user-data-dir={profile}", "--dump-dom", path.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    with tempfile.TemporaryDirectory() as profile:
        picture = path.with_suffix(".png")
        command = [*CHROMIUM, f"--user-data-dir={profile}", f"--screenshot={picture}", path.as_uri()]
        subprocess.run(command, capture_output=True, timeout=300, check=True)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    if console:
        failed.append(f"{path.name}: the browser's console says {console}")
    page = Page(done.stdout)
    if page.plots == 0 or page.drawn != page.plots or page.canvases != page.plots:
        failed.append(f"{path.name}: {page.plots} plots, {page.drawn} drawn, {page.canvases} canvases")
    if not page.findings:
        failed.append(f"{path.name}: it concludes nothing")
    print(f"{path.name}: {page.drawn} plots; {' '.join(page.findings)}")
    return page


def main(folder):
    failed = []

    def compare(page, name, found, expected):
        if found != expected:
            failed.append(f"{page}: {name} is {found}, the program printed {expected}")

    def rows(page, table):
        return {row[0]: row[1:] for row in page.tables[table]}

    runs = json.loads((folder / "simulate.json").read_text())["runs"]
    table = rows(opened(folder / "simulate.html", failed), "figures")
    for run in runs:
        keys = ("cross_track_rms_m", "cross_track_p95_m", "cross_track_max_m")
        expected = [f"{100 * run[key]:.2f}" for key in keys] + [f"{run['steer_total_variation_m_s']:.2f}"]
        compare("simulate", run["controller"], table[run["controller"]][:4], expected)

    figures = json.loads((folder / "odometry.json").read_text())
    table = rows(opened(folder / "odometry.html", failed), "figures")
    for model in ("icrhk", "icrik", "extended", "diff_drive"):
        expected = [f"{figures[model][key]:.4f}" for key in ("mse_x", "mse_y", "mse_z", "mse_yaw", "j_over_n")]
        compare("odometry", model, table[model], expected)

    table = rows(opened(folder / "identify.html", failed), "level-parameters")
    vehicle = (folder / "identified.yaml").read_text().split("\nextension:")[0]
    vehicle = dict(line.split(": ", 1) for line in vehicle.splitlines() if ": " in line and line[0] != "#")
    # What the logs do not determine is not in the table.
    names = [name for name in table if name in vehicle]
    compare("identify", "the number of parameters", len(names) >= 3, True)
    for name in names:
        compare("identify", name, table[name][0], f"{float(vehicle[name]):.4f}")

    controllers = json.loads((folder / "campaign.json").read_text())["controllers"]
    table = rows(opened(folder / "campaign.html", failed), "figures")
    for own in controllers:
        cm = ["-" if own[key] is None else f"{100 * own[key]:.2f}" for key in ("median_m", "p95_m", "worst_m")]
        expected = [str(own["runs"]), str(own["completed"]), *cm]
        compare("campaign", own["controller"], table[own["controller"]][:5], expected)

    print("\n".join(failed) or "all figures are those of the program")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]).resolve()))
