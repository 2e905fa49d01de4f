# SPDX-License-Identifier: GPL-3.0-or-later
"""The quality study of Gaussian Point Splatting (doi 10.1145/3811272, Table 1 and Fig. 7) with our own numbers.

Accumulates *points* to 1024 samples and compares with *sorted* on the way, for K = 1 and K = 4; writes the table that
docs/convergence.md shows.

    .venv/bin/python scripts/study.py --out docs/convergence-table.md
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from stipple.engine.camera import Camera
from stipple.engine.renderer import Frame, Renderer
from stipple.engine.scene import Scene
from stipple.engine.settings import Settings
from stipple.scripts.bench_machine import machine
from stipple.scripts.bench_presets import PRESETS

ROOT = Path(__file__).resolve().parent.parent
SAMPLES = (1, 4, 16, 64, 256, 1024)
SIZE = (960, 540)
BACKGROUND = (0.5, 0.5, 0.5)


@dataclass(frozen=True)
class Row:
    """Quality after some samples against sorted at the pixels' centres (the paper's reference) and over their areas.

    `seconds` are wall seconds on CUDA and core seconds on a CPU, which other work on the machine does not lengthen.
    """

    samples: int
    seconds: float
    psnr: float
    ssim: float
    psnr_area: float
    ssim_area: float


def quality(picture: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """(PSNR [dB], SSIM) of sRGB-encoded RGB, clamped to what a screen shows."""
    shown, wanted = (np.clip(image[..., :3], 0.0, 1.0).astype(np.float64) for image in (picture, reference))
    ssim = structural_similarity(wanted, shown, channel_axis=-1, data_range=1.0, gaussian_weights=True, sigma=1.5)
    return peak_signal_noise_ratio(wanted, shown, data_range=1.0), float(ssim)


def study(renderer: Renderer, scene: Scene, camera: Camera, points_per_thread: int) -> list[Row]:
    centre, area = (renderer.render(scene, camera, Settings(method="sorted", supersampling=s)).rgba for s in (1, 4))
    clock = time.perf_counter if renderer.device.is_cuda else time.process_time
    frame = Frame(renderer, scene, camera, Settings(samples=SAMPLES[-1], points_per_thread=points_per_thread))
    rows = []
    seconds = 0.0
    for sample in range(SAMPLES[-1]):
        begin = clock()
        frame.render_sample(sample)
        seconds += clock() - begin
        if sample + 1 in SAMPLES:
            rgba = frame.resolve().rgba
            rows.append(Row(sample + 1, seconds, *quality(rgba, centre), *quality(rgba, area)))
    return rows


def table(name: str, rows: dict[int, list[Row]]) -> str:
    lines = [
        f"### {name}",
        "",
        "| samples | K | PSNR | SSIM | PSNR, area | SSIM, area | seconds |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for index in range(len(SAMPLES)):
        for k, column in rows.items():
            row = column[index]
            lines.append(
                f"| {row.samples} | {k} | {row.psnr:.2f} | {row.ssim:.4f} | {row.psnr_area:.2f} | "
                f"{row.ssim_area:.4f} | {row.seconds:.2f} |"
            )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--device", default="auto")
    parser.add_argument("--preset", choices=PRESETS, action="append", help="may be repeated; default: sample, koala")
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "convergence-table.md")
    options = parser.parse_args()
    renderer = Renderer(options.device)
    parts = [
        ", ".join(f"{key} {value}" for key, value in machine(renderer.device).items()) + f"; {SIZE[0]}×{SIZE[1]}.\n"
    ]
    for name in options.preset or ("sample", "koala"):
        opened = PRESETS[name].open()
        if opened is None:
            print(f"{name}: skipped, its files are not here")
            continue
        scene, camera = replace(opened.scene, background=BACKGROUND), opened.path.camera(0.0, SIZE)
        rows = {k: study(renderer, scene, camera, k) for k in (1, 4)}
        parts.append(table(name, rows))
        print(parts[-1])
    options.out.write_text("\n".join(parts))


if __name__ == "__main__":
    main()
