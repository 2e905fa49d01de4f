# SPDX-License-Identifier: GPL-3.0-or-later
"""Check that the arrows between the folders point the way design/architecture.md says, and that files stay small.

    check_layers.py [ROOT]

Prints one `path:line: what is wrong` per finding and exits with 1 if there is any. Reads the source with `ast` and
imports nothing, so it sees an import wherever it stands (at the top, in a function, under TYPE_CHECKING). It does not
follow imports made by name at run time.

A file or function that is better left long says why in a comment `# long: reason` (a file in its first ten lines, a
function between its `def` and its first statement).
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

BLENDER = ("bpy", "bpy_extras", "bl_ext", "bl_ui", "gpu", "gpu_extras", "mathutils", "imbuf")
SOURCE_FOLDERS = ("addon", "engine", "scripts", "tests")
SPDX = "# SPDX-License-Identifier: GPL-3.0-or-later"
VAGUE_NAMES = ("common", "helper", "helpers", "manager", "misc", "util", "utils")
MAX_FILE, MAX_FUNCTION, MAX_KERNEL = 300, 40, 80

# Folder (a prefix of the path), the modules it never imports, and why.
FORBIDDEN: tuple[tuple[str, tuple[str, ...], str], ...] = (
    ("engine/", (*BLENDER, "stipple.addon"), "the engine runs without Blender"),
    ("engine/formats/", ("warp",), "files are read without a device"),
    ("tests/oracle/", ("stipple", "warp"), "the oracle shares no code with the engine"),
    ("__init__.py", BLENDER, "only addon/ imports Blender"),
)
MODERNGL_HOME = "engine/rays/"
SHIPPED = ("engine/", "addon/", "__init__.py")

Finding = tuple[int, str]
FunctionNode = ast.FunctionDef | ast.AsyncFunctionDef


def absolute_name(path: str, node: ast.ImportFrom) -> str:
    """The imported module's full name; a relative import counts from the folder of `path`."""
    if not node.level:
        return node.module or ""
    package = ("stipple", *Path(path).parts[:-1]) if path.startswith(SHIPPED) else Path(path).parts[:-1]
    base = package[: len(package) - node.level + 1]
    return ".".join((*base, *([node.module] if node.module else [])))


def imported(path: str, tree: ast.Module) -> Iterator[tuple[int, str, bool]]:
    """(line, full module name, is relative) of every import; `from a import b` yields a.b, for b may be a module."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield node.lineno, alias.name, False
        elif isinstance(node, ast.ImportFrom):
            for alias in node.names:
                yield node.lineno, f"{absolute_name(path, node)}.{alias.name}", node.level > 0


def is_inside(module: str, package: str) -> bool:
    return module == package or module.startswith(package + ".")


def check_imports(path: str, tree: ast.Module) -> Iterator[Finding]:
    for line, module, relative in imported(path, tree):
        for prefix, forbidden, why in FORBIDDEN:
            if path.startswith(prefix) and any(is_inside(module, name) for name in forbidden):
                yield line, f"imports {module}: {why}"
        if is_inside(module, "moderngl") and path.startswith(SHIPPED) and not path.startswith(MODERNGL_HOME):
            yield line, f"imports moderngl: only {MODERNGL_HOME} does"
        if is_inside(module, "stipple") and path.startswith(SHIPPED) and not relative:
            yield line, f"imports {module} absolutely: Blender installs the package under another name"


def functions(node: ast.AST) -> Iterator[FunctionNode]:
    for child in ast.walk(node):
        if isinstance(child, FunctionNode):
            yield child


def span(node: FunctionNode) -> int:
    return (node.end_lineno or node.lineno) - node.lineno + 1


def own_lines(node: FunctionNode) -> int:
    """Lines from `def` to the end, without the docstring and without functions inside, which count for themselves."""
    count = span(node)
    if ast.get_docstring(node) is not None:
        count -= (node.body[0].end_lineno or 0) - node.body[0].lineno + 1
    nested = [inner for statement in node.body for inner in functions(statement)]
    outermost = [f for f in nested if not any(g is not f and f in set(functions(g)) for g in nested)]
    return count - sum(map(span, outermost))


def is_kernel(node: FunctionNode) -> bool:
    """True for what Warp compiles: decorated with wp.kernel, wp.func or a call of one."""
    names = [ast.unparse(d.func if isinstance(d, ast.Call) else d) for d in node.decorator_list]
    return any(name.split(".")[-1] in ("kernel", "func") for name in names)


def check_lengths(tree: ast.Module, lines: list[str]) -> Iterator[Finding]:
    if len(lines) > MAX_FILE and not any("# long: " in line for line in lines[:10]):
        yield MAX_FILE + 1, f"the file has {len(lines)} lines: split it below {MAX_FILE}, or say `# long: reason`"
    for node in functions(tree):
        limit = MAX_KERNEL if is_kernel(node) else MAX_FUNCTION
        body = node.body[1] if ast.get_docstring(node) is not None and len(node.body) > 1 else node.body[0]
        excused = any("# long: " in line for line in lines[node.lineno - 1 : body.lineno])
        count = own_lines(node)
        if count > limit and not excused:
            yield node.lineno, f"{node.name} has {count} lines: split it below {limit}, or say `# long: reason`"


def check_head(path: str, tree: ast.Module, lines: list[str]) -> Iterator[Finding]:
    first = lines[1:2] if lines and lines[0].startswith("#!") else lines[:1]
    if first != [SPDX]:
        yield 1, f"does not begin with `{SPDX}`"
    if ast.get_docstring(tree) is None:
        yield 1, "has no module docstring"
    if Path(path).stem in VAGUE_NAMES or Path(path).parent.name in VAGUE_NAMES:
        yield 1, "has a name that says nothing: name the one concept it holds"


def check_file(path: str, text: str) -> list[Finding]:
    """What is wrong with one source file; `path` is relative to the root, with forward slashes."""
    lines = text.splitlines()
    if not lines and path.endswith("__init__.py"):
        return []
    try:
        tree = ast.parse(text)
    except SyntaxError as error:
        return [(error.lineno or 1, f"is not Python: {error.msg}")]
    return [*check_head(path, tree, lines), *check_imports(path, tree), *check_lengths(tree, lines)]


def main(root: Path) -> int:
    files = [root / "__init__.py", *(f for folder in SOURCE_FOLDERS for f in sorted((root / folder).rglob("*.py")))]
    count = 0
    for file in files:
        path = file.relative_to(root).as_posix()
        for line, message in check_file(path, file.read_text(encoding="utf-8")):
            print(f"{path}:{line}: {message}")
            count += 1
    if not files[1:]:
        print(f"{root}: no source files found; give the root of the repository.")
    return 1 if count or not files[1:] else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parent.parent))
