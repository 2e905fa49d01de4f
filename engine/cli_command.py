# SPDX-License-Identifier: GPL-3.0-or-later
"""What the `stipple` command understands: `info`, `apply` and `render` with their options."""

from __future__ import annotations

from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

import click

from .capture_file import LARGE_SPLATS
from .cli_types import background_of, camera_of, size_of
from .orbit import UP_AXES
from .settings import CULLING, METHODS, MULTISAMPLES, RAY_ORDERS, STORAGE, Settings

Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]

DEFAULTS = Settings()
SETTING_NAMES = (
    "method", "samples", "supersampling", "seed", "device", "sh_degree", "antialiased", "dilation_px2",
    "points_per_thread", "ray_order", "multisamples", "culling", "storage",
)  # fmt: skip
AT_LEAST_1 = click.IntRange(min=1)


def option(name: str, help_text: str, **kind: Any) -> Decorator:
    """`click.option` with the help in front and the default shown where there is one."""
    return click.option(name, help=help_text, show_default=kind.get("default") is not None, **kind)


VIEW_OPTIONS = (
    option("--camera", "INRIA cameras.json, nerfstudio transforms.json or the folder of a COLMAP model. Without INDEX: "
           "camera 0, or all of them, numbered from 0, when --out has a place for a number.", callback=camera_of,
           metavar="FILE[:INDEX]"),
    option("--orbit", "N views on a circle around the capture, numbered from 0.", type=AT_LEAST_1, metavar="N"),
    option("--up", "Up axis of the capture, where --camera is not given.", type=click.Choice(tuple(UP_AXES)),
           default="-y"),
    option("--elevation", "Height of the camera above the capture's centre, where --camera is not given.",
           type=float, default=10.0, metavar="DEGREES"),
    option("--fov", "Vertical field of view, where --camera is not given.", type=float, default=45.0,
           metavar="DEGREES"),
    option("--size", "Picture size [px]; the camera file's, or 1280x720. The vertical field of view stays.",
           callback=size_of, metavar="WxH"),
)  # fmt: skip
SETTINGS_OPTIONS = (
    option("--method", "Stochastic points, the noise-free sorted reference, or rays drawn by the graphics hardware.",
           type=click.Choice(METHODS), default=DEFAULTS.method),
    option("--samples", "Frames accumulated by points, and by rays in stochastic order.", type=AT_LEAST_1,
           default=DEFAULTS.samples),
    option("--supersampling", "SxS subpixels per pixel.", type=AT_LEAST_1, default=DEFAULTS.supersampling,
           metavar="S"),
    option("--seed", "Equal seeds give equal pictures on one device.", type=click.IntRange(min=0),
           default=DEFAULTS.seed, metavar="K"),
    option("--device", "Where to render.", default=DEFAULTS.device, metavar="cpu|cuda:N|auto"),
    option("--sh-degree", "Highest spherical-harmonics band; all of the capture's where not given.",
           type=click.IntRange(0, 4), metavar="D"),
    option("--antialiased", "For captures trained with Mip-Splatting's compensation.", is_flag=True),
    option("--dilation-px2", "Variance of the blur on the screen [px²]: 0.3 for 3DGS and gsplat, 0.1 for "
           "Mip-Splatting.", type=click.FloatRange(0, 100), default=DEFAULTS.dilation_px2, metavar="V"),
    option("--points-per-thread", "Above 1: faster on a GPU, slightly biased.", type=AT_LEAST_1,
           default=DEFAULTS.points_per_thread, metavar="K"),
    option("--ray-order", "Of rays: blended by depth, or per pixel and accumulated.", type=click.Choice(RAY_ORDERS),
           default=DEFAULTS.ray_order),
    option("--multisamples", "Of rays in sorted order: rays per pixel (MSAA).",
           type=click.Choice(tuple(map(str, MULTISAMPLES))), callback=lambda _context, _option, value: int(value),
           default=str(DEFAULTS.multisamples)),
    option("--storage", "Captures in full precision, or in 21 to 105 bytes a splat.", type=click.Choice(STORAGE),
           default=DEFAULTS.storage),
    option("--culling", "What points leave out; changes no picture.", type=click.Choice(CULLING),
           default=DEFAULTS.culling),
)  # fmt: skip
OUTPUT_OPTIONS = (
    option("--out", "Picture to write: .png, .exr or .npy. #### or %04d in its name stands for a number.",
           required=True, type=click.Path(path_type=Path), metavar="PATH"),
    option("--background", "sRGB-encoded, each from 0 to 1.", callback=background_of, default="transparent",
           metavar="R,G,B|transparent"),
    option("--stream-above", "Captures of more splats are not read into memory; their splats go to the device chunk by "
           "chunk, quantised.", type=click.IntRange(min=0), default=LARGE_SPLATS, metavar="SPLATS"),
    option("--quiet", "No progress bar and no summary; warnings stay.", is_flag=True),
)  # fmt: skip


def with_options(*options: Decorator) -> Decorator:
    """Decorates with all of them, so that --help lists them in this order."""

    def decorate(function: Callable[..., Any]) -> Callable[..., Any]:
        for add in reversed(options):
            function = add(function)
        return function

    return decorate


def show_version(context: click.Context, parameter: click.Parameter, wanted: bool) -> None:
    """Prints the version of the installed package and ends."""
    if wanted:
        try:
            version = metadata.version("stipple")
        except metadata.PackageNotFoundError:
            version = "(not installed as a package)"
        click.echo(f"stipple {version}")
        context.exit()


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@option("--version", "Show the version and exit.", is_flag=True, is_eager=True, expose_value=False,
        callback=show_version)  # fmt: skip
def command() -> None:
    """Render Gaussian splat captures."""


@command.command()
@click.argument("file", type=click.Path(path_type=Path))
@option("--json", "Print one JSON object instead of text.", is_flag=True)
def info(file: Path, json: bool) -> None:
    """Show what is in a capture FILE."""
    from .cli_info import as_json, as_text, describe
    from .cli_notices import Notices

    notices = Notices(quiet=False)
    with notices.progress:
        facts = describe(file, notices.report)
    for warning in facts["warnings"]:
        click.echo(f"warning: {warning}", err=True)
    click.echo(as_json(facts) if json else as_text(facts))


@command.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.argument("edits", type=click.Path(path_type=Path))
@option("--out", "Capture to write, never FILE itself.", required=True, type=click.Path(path_type=Path), metavar="PATH")
@option("--selected", "Write only what is selected in the edits.", is_flag=True)
@option("--quiet", "No progress bar and no summary; warnings stay.", is_flag=True)
def apply(file: Path, edits: Path, out: Path, selected: bool, quiet: bool) -> None:
    """Write a copy of a capture FILE with the EDITS that Blender keeps beside a .blend (….edits.npz)."""
    from .cli_apply import run

    run(file, edits, out, selected, quiet)


@command.command()
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(path_type=Path))
@with_options(*OUTPUT_OPTIONS, *VIEW_OPTIONS, *SETTINGS_OPTIONS)
def render(**options: Any) -> None:
    """Render capture FILEs together in one scene."""
    from .cli_frames import OrbitOptions
    from .cli_render import RenderJob, run

    run(
        RenderJob(
            files=options["files"],
            out=options["out"],
            camera=options["camera"],
            orbit=OrbitOptions(options["orbit"], options["up"], options["elevation"], options["fov"]),
            size=options["size"],
            background=options["background"],
            settings=Settings(**{name: options[name] for name in SETTING_NAMES}),
            quiet=options["quiet"],
            stream_above=options["stream_above"],
        )
    )
