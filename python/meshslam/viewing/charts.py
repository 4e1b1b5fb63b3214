"""Line charts by Matplotlib (extra `plots`): the same figures give the same bytes."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from meshslam.errors import MeshslamError


@dataclass(frozen=True)
class Line:
    """A line through points; those without a name are thin and grey, and not in the legend."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    style: Literal["-", "--", ":", "none"] = "-"  # none: points alone
    colour: int | None = None  # number in the cycle of colours; None: the next one
    wide: bool = False  # a pale band: lines over it stay visible


def line_charts(
    charts: Mapping[str, Sequence[Line]],
    x_label: str,
    y_label: str,
    kind: Literal["svg", "png"],
    *,
    logarithmic: bool = False,
    equal: bool = False,
) -> bytes:
    """Charts side by side under their titles, as one SVG or PNG file; `equal`: one scale for both axes."""
    try:
        import matplotlib
        from matplotlib.figure import Figure
    except ImportError:
        raise MeshslamError("charts need Matplotlib: pip install 'meshslam[plots]'") from None
    with matplotlib.rc_context({"svg.hashsalt": "meshslam", "font.size": 9}):
        figure = Figure(figsize=(5.2 * len(charts), 4.0), layout="constrained")
        for axes, (title, lines) in zip(figure.subplots(1, len(charts), squeeze=False)[0], charts.items(), strict=True):
            for line in lines:
                if not line.name:
                    axes.plot(line.x, line.y, line.style, color="0.5", linewidth=0.8)
                    continue
                marker = "o" if len(line.x) < 30 else None
                colour = None if line.colour is None else f"C{line.colour}"
                band = {"linewidth": 5, "alpha": 0.45} if line.wide else {}
                axes.plot(
                    line.x, line.y, line.style, label=line.name, marker=marker, markersize=3, color=colour, **band
                )
            axes.set(title=title, xlabel=x_label, ylabel=y_label)
            axes.grid(alpha=0.3)
            axes.legend(fontsize=7)
            if logarithmic:
                axes.set_yscale("log")
            if equal:
                axes.set_aspect("equal", adjustable="datalim")
        content = io.BytesIO()
        metadata = {"Date": None} if kind == "svg" else {"Software": None}
        figure.savefig(content, format=kind, dpi=120, metadata=metadata)
    return content.getvalue()
