# SPDX-License-Identifier: GPL-3.0-or-later
"""Loads a method's kernels before they are needed, module by module, so that a host can say what takes so long.

The first load on a machine compiles, which takes seconds to a minute; later ones read Warp's cache in milliseconds.
Loading one module from two threads at once would compile it twice: hosts call `load_kernels` from one thread at a time.
"""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from types import ModuleType

import warp as wp

from . import edit, renderer

PACKAGE = __name__.rpartition(".")[0]
EDITING = "edit"  # stands for what edits need, as the name of a method does for what that needs
CUDA_ONLY = "_cuda"  # how the name of a module ends whose kernels no CPU runs


def load_kernels(
    device: wp.Device,
    method: str,
    progress: Callable[[float, str], None],
    turn: Callable[[], AbstractContextManager[None]] = nullcontext,
) -> None:
    """Compiles what is not in Warp's cache and loads the rest; does nothing for modules that are loaded.

    `progress(fraction, text)` is called before each module and may raise `Cancelled`. Each module is loaded inside
    `turn()`, so that hosts can let others launch between two.
    """
    modules = kernel_modules(method, device.is_cuda)
    for index, module in enumerate(modules):
        progress(index / len(modules), f"preparing kernels {index + 1}/{len(modules)}, slow only the first time")
        with turn():
            wp.load_module(module, device=device)


def kernel_modules(method: str, cuda: bool) -> list[ModuleType]:
    """The engine's modules with kernels that `method`, or `EDITING`, launches on a CPU or on CUDA."""
    own = f"{PACKAGE}."
    if method == EDITING:
        own = f"{edit.__name__}."
        for found in pkgutil.iter_modules(edit.__path__, own):
            importlib.import_module(found.name)
    others = tuple(f"{PACKAGE}.{name}." for name in (*renderer.METHOD_FRAMES, EDITING) if name != method)
    modules = []
    for name, module in sorted(sys.modules.items()):
        if not name.startswith(own) or name.startswith(others) or (name.endswith(CUDA_ONLY) and not cuda):
            continue
        if any(isinstance(value, wp.Kernel) and value.module.name == name for value in vars(module).values()):
            modules.append(module)
    return modules
