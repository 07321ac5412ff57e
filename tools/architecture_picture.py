"""Draws docs/pictures/packages.svg from the tree's imports: `python tools/architecture_picture.py`.

Boxes are groups of packages and modules with what each holds. Thin arrows are imports between groups that no longer
path of imports implies. The way of a record and the way of a command are drawn over them. Fails where a module has no
group, and where modules or groups import each other in a circle.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

ROOT = Path(__file__).resolve().parents[1]
FILE = ROOT / "docs" / "pictures" / "packages.svg"

#: Group -> its packages and modules right below `mrdamp`.
GROUPS: Mapping[str, tuple[str, ...]] = {
    "command line": ("__main__", "api", "cli", "commands", "demo"),
    "diagnosis": ("diagnosis", "gap"),
    "learning, comparison": ("envs", "train", "compare"),
    "control": ("control", "inverse"),
    "identification": ("identify", "narx"),
    "reporting": ("report", "pictures"),
    "simulation": ("simulation", "models_xml", "motions", "warp"),
    "model": ("model", "sets", "structures", "gpu"),
    "records": ("records", "datasets"),
    "shared": ("errors", "files", "interrupts", "outside", "parallel", "library", "registration", "shown"),
}
#: Centre and size of each box, in units of the drawing.
BOXES: Mapping[str, tuple[float, float, float, float]] = {
    "command line": (5.0, 12.3, 6.0, 0.75),
    "diagnosis": (1.9, 10.75, 3.2, 0.75),
    "learning, comparison": (7.6, 10.75, 3.2, 0.75),
    "control": (7.6, 9.1, 3.2, 0.75),
    "identification": (1.9, 8.4, 3.2, 1.25),
    "reporting": (4.75, 3.4, 1.9, 0.75),
    "simulation": (7.6, 6.8, 3.2, 1.5),
    "model": (7.6, 4.1, 3.2, 1.75),
    "records": (1.9, 4.8, 3.2, 1.5),
    "shared": (1.9, 1.35, 3.2, 1.05),
}
#: Packages with a list of their modules.
LISTED = ("identify", "simulation", "model", "structures", "records")
CHAIN = ("command", "driver", "magnetics", "fluid", "mechanics", "mount", "sensor")
#: Each step is an import in one direction or the other.
RECORD = ("records", "identification", "model", "simulation", "diagnosis", "command line")
COMMAND = ("learning, comparison", "control", "simulation", "model")
_BLUE, _ORANGE, _GREY = "#0a5fa5", "#c25700", "#a8b0b9"


def modules() -> dict[str, Path]:
    """Every module of the package by its name; the linked folders envs and train with them."""
    package = ROOT / "src" / "mrdamp"
    folders = [package, *(f for f in package.iterdir() if f.is_symlink() and f.is_dir())]
    found = {}
    for folder in folders:
        for path in folder.rglob("*.py"):
            parts = path.relative_to(package.parent).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(path: Path, known: Mapping[str, Path], *, later: bool = False) -> Iterator[str]:
    """Modules of the package that a file imports at its top, those for types left out; later: within functions too."""
    waiting: list[ast.AST] = [ast.parse(path.read_text(encoding="utf-8"))]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            for alias in node.names:
                whole = f"{node.module}.{alias.name}"
                if whole in known or node.module in known:
                    yield whole if whole in known else node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif _for_types(node) or (not later and isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)):
            continue
        waiting += ast.iter_child_nodes(node)


def _for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def graph(*, later: bool = False) -> dict[str, set[str]]:
    """Module -> modules that it imports. Raises CycleError where those at the top of modules go in a circle."""
    known = modules()
    found = {name: set(imports(path, known, later=later)) - {name} for name, path in known.items()}
    if not later:
        tuple(TopologicalSorter(found).static_order())
    return found


def group_of(module: str) -> str | None:
    """The group of a module; None for the package itself. Raises KeyError where it has none."""
    parts = module.split(".")
    if len(parts) == 1:
        return None
    for group, names in GROUPS.items():
        if parts[1] in names:
            return group
    raise KeyError(f"{module}: no group; add {parts[1]} to GROUPS in {Path(__file__).name}")


def group_imports(*, later: bool = False) -> dict[str, set[str]]:
    """Group -> groups that its modules import. Raises CycleError as `graph`."""
    found: dict[str, set[str]] = {group: set() for group in GROUPS}
    for module, used in graph(later=later).items():
        group = group_of(module)
        for other in map(group_of, used):
            if group and other and other != group:
                found[group].add(other)
    if not later:
        tuple(TopologicalSorter(found).static_order())
    return found


def reduced(edges: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """The imports between groups without those that follow from two others."""

    def reach(start: str, banned: str) -> set[str]:
        seen, waiting = set(), [g for g in edges[start] if g != banned]
        while waiting:
            group = waiting.pop()
            if group not in seen:
                seen.add(group)
                waiting += edges[group] - {start}
        return seen

    return [(a, b) for a in edges for b in sorted(edges[a]) if b not in reach(a, b)]


def _edge(group: str, towards: str) -> tuple[float, float]:
    """Where a line from the middle of one box to that of another leaves the first."""
    x, y, w, h = BOXES[group]
    dx, dy = BOXES[towards][0] - x, BOXES[towards][1] - y
    share = min(0.5 * w / abs(dx) if dx else 9.0, 0.5 * h / abs(dy) if dy else 9.0)
    return x + share * dx, y + share * dy


def _arrow(ax: Axes, a: str, b: str, colour: str, width: float, bend: float) -> None:
    ax.add_patch(
        FancyArrowPatch(
            _edge(a, b), _edge(b, a), arrowstyle="-|>", mutation_scale=8 + 3 * width, color=colour, linewidth=width,
            connectionstyle=f"arc3,rad={bend}", zorder=1 if colour == _GREY else 3,
        )
    )  # fmt: skip


def _wrapped(names: Iterable[str], width: int) -> str:
    lines = [""]
    for name in names:
        if len(lines[-1]) + len(name) > width:
            lines.append("")
        lines[-1] += f"{name}  "
    return "\n".join(line.strip() for line in lines)


def contents(group: str, known: Iterable[str], width: int) -> str:
    """The packages of a group in lines of so many letters, some with their modules."""
    lines = []
    plain = [name for name in GROUPS[group] if name not in LISTED]
    for package in (name for name in GROUPS[group] if name in LISTED):
        inside = sorted(
            name.split(".")[2]
            for name in known
            if name.startswith(f"mrdamp.{package}.") and name.count(".") == 2
        )
        lines.append(_wrapped([f"{package}:", *inside], width))
    return "\n".join([*lines, *([_wrapped(plain, width)] if plain else [])])


def draw() -> None:
    """Writes the picture."""
    known = list(graph())
    edges = group_imports()
    with matplotlib.rc_context(
        {"svg.hashsalt": "mrdamp", "svg.fonttype": "none", "font.family": "sans-serif"}
    ):
        fig, ax = plt.subplots(figsize=(7.6, 10.2), layout="constrained")
        ax.set(xlim=(0.1, 10.1), ylim=(-0.75, 12.8), aspect="equal")
        ax.axis("off")
        for a, b in reduced(edges):
            _arrow(ax, a, b, _GREY, 0.9, 0.0)
        for way, colour, bend in ((RECORD, _BLUE, 0.16), (COMMAND, _ORANGE, 0.16)):
            for a, b in pairwise(way):
                _arrow(ax, a, b, colour, 2.2, bend)
        for group, (x, y, w, h) in BOXES.items():
            box = FancyBboxPatch(
                (x - w / 2, y - h / 2), w, h, boxstyle="round,pad=0,rounding_size=0.12", facecolor="#f5f7f9",
                edgecolor="#57606a", zorder=2,
            )  # fmt: skip
            ax.add_patch(box)
            ax.text(x, y + h / 2 - 0.1, group, ha="center", va="top", weight="bold", fontsize=10, zorder=4)
            text = contents(group, known, round(w * 10.5))
            ax.text(x, y - 0.16, text, ha="center", va="center", fontsize=6.8, family="monospace", zorder=4)
        _chain(ax)
        for y, colour, text in ((-0.1, _BLUE, "way of a record"), (-0.5, _ORANGE, "way of a command")):
            ax.plot([0.3, 0.9], [y, y], color=colour, linewidth=2.2)
            ax.text(1.05, y, text, va="center", fontsize=9)
        ax.plot([3.6, 4.2], [-0.1, -0.1], color=_GREY, linewidth=0.9)
        ax.text(4.35, -0.1, "imports (those implied by others are left out)", va="center", fontsize=9)
        FILE.parent.mkdir(parents=True, exist_ok=True)
        fig.savefig(FILE, metadata={"Date": None}, facecolor="white")


def _chain(ax: Axes) -> None:
    """The C++ chain below the model, which calls it."""
    left, right, y, h = 3.9, 10.0, 1.2, 0.9
    width = (right - left) / len(CHAIN)
    ax.text(0.5 * (left + right), y + h / 2 + 0.32, "plugin_cpp: the chain, stepped by MuJoCo or by the C entry",
            ha="center", va="center", fontsize=9, weight="bold")  # fmt: skip
    for k, stage in enumerate(CHAIN):
        x = left + k * width
        ax.add_patch(
            FancyBboxPatch(
                (x + 0.04, y - h / 4), width - 0.08, h / 2, boxstyle="round,pad=0,rounding_size=0.08",
                facecolor="#fdf1e7", edgecolor=_ORANGE, zorder=2,
            )
        )  # fmt: skip
        ax.text(x + width / 2, y, stage, ha="center", va="center", fontsize=7.6, zorder=4)
    x, low = BOXES["model"][0], BOXES["model"][1] - BOXES["model"][3] / 2
    ax.add_patch(FancyArrowPatch((x, low), (x, y + h / 2 + 0.45), arrowstyle="-|>", mutation_scale=14, color=_ORANGE,
                                 linewidth=2.2, zorder=3))  # fmt: skip


def main() -> int:
    try:
        draw()
    except (CycleError, KeyError) as error:
        print(f"architecture_picture: {error.args}", file=sys.stderr)
        return 1
    print(FILE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
