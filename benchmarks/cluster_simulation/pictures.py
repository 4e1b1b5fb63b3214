"""Pictures of docs/scale.md from docs/scale.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

HOUR_S = 3600.0
DAYS = {  # of the figures' days, by what their names hold
    "a usual day": "a usual day",
    "a bad day": "a bad day",
    "live two hours": "spot nodes, 2 h each",
    "of 1 GB/s": "a storage of 1 GB/s",
}
COLOURS = ("#1b6ca8", "#c0392b", "#d08c00", "#5b7a3a")
Rows = Sequence[Mapping[str, Any]]


def draw(days: Rows, sweep: Rows, folder: Path) -> None:
    """Both pictures, as SVG, to the same bytes for the same figures."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "scale", "font.size": 9, "axes.spines.top": False})
    matplotlib.rcParams["axes.spines.right"] = False
    _draw_sweep(sweep, folder / "scale_sweep.svg")
    _draw_days(days, folder / "scale_days.svg")


def _draw_sweep(rows: Rows, file: Path) -> None:
    from matplotlib import pyplot

    figure, (times, busy) = pyplot.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for colour, drives in zip(COLOURS, sorted({row["drives"] for row in rows}), strict=False):
        own = sorted((row for row in rows if row["drives"] == drives), key=_cpus)
        cpus = [_cpus(row) for row in own]
        first = own[0]
        times.plot(cpus, [row["makespan_s"] / HOUR_S for row in own], "o-", color=colour, label=f"{drives:,} drives")
        work_h = first["makespan_s"] * first["utilization"] * _cpus(first) / HOUR_S
        times.plot(cpus, [work_h / count for count in cpus], ":", color=colour, linewidth=1)
        busy.plot(cpus, [100 * row["driver_busy"] for row in own], "o-", color=colour, label=f"{drives:,} drives")
    times.set(xscale="log", yscale="log", xlabel="CPUs", ylabel="hours until the last drive ends")
    times.set_title("dotted: every CPU busy all the time", fontsize=9, loc="left")
    busy.set(xscale="log", xlabel="CPUs", ylabel="driver busy, %", ylim=(0, None))
    times.legend(frameon=False)
    _save(figure, file)


def _cpus(row: Mapping[str, Any]) -> float:
    return float(row["nodes"] * row["cpus"])


def _draw_days(rows: Rows, file: Path) -> None:
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(9, 3.0), layout="constrained")
    for colour, (held, label) in zip(COLOURS, DAYS.items(), strict=True):
        row = next(row for row in rows if held in row["name"])
        counts, length_h = row["at_work"], row["makespan_s"] / HOUR_S
        edges_h = [length_h * k / len(counts) for k in range(len(counts) + 1)]
        axes.stairs(counts, edges_h, color=colour, linewidth=1.4, label=label)
    axes.set(xlabel="hours", ylabel="tasks at work", ylim=(0, None), xlim=(0, None))
    axes.legend(frameon=False, loc="upper right")
    _save(figure, file)


def _save(figure: Any, file: Path) -> None:  # matplotlib's
    figure.savefig(file, metadata={"Date": None, "Creator": None})
