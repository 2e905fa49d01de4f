# SPDX-License-Identifier: GPL-3.0-or-later
"""How soon the viewport shows a moved view, and Blender answers keys, in the real program's window.

    scripts/bench_viewport CAPTURE.ply [--runs N] [--json FILE]

Keys are real presses on the virtual screen, at random times. *Answered* is when Blender hands the press to an
operator; *shown* is when the window with the first picture of the new view has been drawn and swapped. Both count from
before the press is sent. A window without a graphics card is drawn by the same cores that render: what a redraw costs
then by itself is measured apart (*redrawn, nothing to render*). tests/desktop/program.py says how the program is found.
Everything goes to bench-output/.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
from pathlib import Path
from typing import Any

from stipple.tests.desktop import program

WINDOW = Path(__file__).with_name("bench_viewport_window.py")
BARS = {"answer": 0.050, "shown": 0.300}  # [s]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("capture", type=Path, metavar="CAPTURE.ply")
    parser.add_argument("--runs", type=int, default=1, metavar="N", help="how often to measure; default: 1")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write all times there")
    options = parser.parse_args()
    every = []
    for index in range(options.runs):
        folder = program.ROOT / "bench-output" / f"viewport-{index + 1}"
        folder.mkdir(parents=True, exist_ok=True)
        try:
            results = program.run(WINDOW, "measure", folder, str(options.capture.resolve()), seconds=480)
        except (program.NotHere, program.Failed) as error:
            print(f"bench_viewport: {error}", file=sys.stderr)
            return 1
        every.append(results)
        print(f"\nRun {index + 1} of {options.runs}", *table(dict(results)), sep="\n")
    if options.json:
        options.json.write_text(json.dumps(every, indent=1))
    return 0


def table(results: dict[str, Any]) -> list[str]:
    """The lines to print of one run."""
    width, height = results.pop("region")
    idle = results.pop("idle")
    lines = [
        f"3D view of {width}×{height} px; one redraw of the window at rest takes {results.pop('redraw') * 1e3:.0f} ms",
        f"at the sample limit: {idle['cores'] * 100:.1f} % of a core, {idle['redraws']} redraws",
        "",
        "| while | what | times | median [ms] | 95 % | 99 % | worst | bar | within | redraws/s | samples/s | cores |",
        "|---|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for phase, measured in results.items():
        for name, bar in BARS.items():
            if name in measured:
                times = sorted(1e3 * seconds for seconds in measured[name])
                cells = [phase, {"answer": "key answered", "shown": "moved view shown"}[name], str(len(times))]
                parts = (statistics.median(times), quantile(times, 0.95), quantile(times, 0.99), times[-1])
                cells += [f"{value:.0f}" for value in parts]
                within = sum(seconds <= bar for seconds in measured[name]) / len(times)
                cells += [f"{bar * 1e3:.0f}", f"{within:.1%}", *others(measured)]
                lines.append(f"| {' | '.join(cells)} |")
    return lines


def others(measured: dict[str, Any]) -> list[str]:
    if "cores" not in measured:
        return ["", "", ""]
    return [f"{measured[name]:.1f}" for name in ("redraws_per_second", "samples_per_second", "cores")]


def quantile(ordered: list[float], part: float) -> float:
    return ordered[min(len(ordered) - 1, int(part * len(ordered)))]


if __name__ == "__main__":
    sys.exit(main())
