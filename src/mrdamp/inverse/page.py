"""The page of a trial of inverses."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from matplotlib.figure import Figure

from mrdamp.files import write_atomic
from mrdamp.inverse.trial import Trial
from mrdamp.pictures.damper import force_tracking
from mrdamp.report import Page

_KINDS: Mapping[str, str] = {
    "between": "Wanted force between those of the least and the largest command",
    "unrelated": "Random wanted force, independent of the motion, clipped to the damper's range",
}


def write_page(result: Trial, out: Path, command_unit: str) -> Path:
    """Writes index.html, a CSV table by kind of wanted force and network.json into a folder; returns the page."""
    out.mkdir(parents=True, exist_ok=True)
    between = result.tracks["between"]
    best, switching = min(between, key=lambda t: t.error), next(t for t in between if t.name == "on/off switching")
    summary = (
        f"Force tracking in MuJoCo over {between[0].time[-1]:.0f} s of random motion: the least RMS "
        f"error is {100 * best.relative_error:.1f} % of the wanted force ({best.name}), "
        f"that of on/off switching {100 * switching.relative_error:.1f} %."
    )
    page = Page(f"Inverse models of {result.plant.name}", summary, footer="Made by `mrdamp inverse`.")
    for kind, heading in _KINDS.items():
        page.figure(
            heading,
            draw(result, kind, command_unit),
            "Section with the largest wanted force. " + _noise(result),
            "Wanted and true force over time, and the command, for each inverse.",
        )
        page.table("", result.columns, result.rows(kind))
        lines = [",".join(f'"{c}"' for c in result.columns)]
        lines += [",".join([f'"{row[0]}"', *(f"{v:.6g}" for v in row[1:])]) for row in result.rows(kind)]
        write_atomic(out / f"{kind}.csv", "\n".join(lines) + "\n")
    _models(page, result)
    if result.network:
        result.network.write(out / "network.json")
    path = out / "index.html"
    page.write(path)
    return path


def draw(result: Trial, kind: str, command_unit: str) -> Figure:
    """Tracks of one kind of wanted force, without the constant commands."""
    return force_tracking([t for t in result.tracks[kind] if not t.name.startswith("constant")], command_unit)


def _models(page: Page, result: Trial) -> None:
    effects = ", ".join(effect.name for effect in result.plant.effects) or "none"
    said = [f"Controlled damper: {result.plant.name}, law {result.plant.law}, effects: {effects}."]
    if result.fit:
        said.append(
            f"Law inverse: {result.model.law} identified from records, held-out free-run error "
            f"{result.fit.held_out_nrmse:.3f} of the force's standard deviation."
        )
    else:
        own = ", ".join(effect.name for effect in result.model.effects) or "none"
        said.append(f"Law inverse: {result.model.name}, law {result.model.law}, effects: {own}.")
    if result.network:
        said.append(f"Network inverse: {result.network.about}.")
    page.text("Models", said)


def _noise(result: Trial) -> str:
    x, v, f = result.sizes.noise
    return f"Measured with noise of {1e6 * x:.2g} um, {1e3 * v:.2g} mm/s and {f:.2g} N."
