import subprocess
import sys

import cv2
import numpy as np
import pytest

from meshslam.viewing import Line
from meshslam.viewing.line_picture import HEIGHT_PX, WIDTH_PX, Span, line_picture


def _picture(*lines, **options):
    content = line_picture("title", lines, "x", "y", **options)
    return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)


def _where(picture, bgr):
    return np.argwhere(np.abs(picture.astype(int) - bgr).max(axis=2) < 40)[:, ::-1]


@pytest.mark.parametrize(("low", "high"), [(0, 1), (-63, 64), (1e-3, 2e-3), (5e6, 5e6 + 3), (-1e9, 1e9)])
def test_ticks_are_round_and_few(low, high):
    ticks = Span(low, high).ticks
    assert 3 <= len(ticks) <= 15
    assert low <= ticks[0]
    assert ticks[-1] <= high + 1e-6 * (high - low)
    assert not np.signbit(ticks[ticks == 0]).any()
    step = ticks[1] - ticks[0]
    assert min(abs(step / 10.0 ** np.floor(np.log10(step * 1.0001)) - n) for n in (1, 2, 5)) < 1e-3


def test_values_are_where_the_axes_say():
    square = _picture(Line("", [0, 1, 1, 0, 0], [0, 0, 1, 1, 0]), equal=True)
    found = _where(square, (127, 127, 127))
    found = found[
        (found[:, 0] > 62) & (found[:, 0] < WIDTH_PX - 14) & (found[:, 1] > 32) & (found[:, 1] < HEIGHT_PX - 54)
    ]
    width, height = np.ptp(found, axis=0)
    assert abs(width - height) <= 2
    rising = _where(_picture(Line("a", [0, 1], [0, 1])), (0xB4, 0x77, 0x1F))
    inside = rising[rising[:, 1] > 80]  # below the legend
    assert np.corrcoef(inside.T)[0, 1] < -0.99


def test_the_legend_hides_as_little_as_it_can():
    x = np.linspace(0, 1, 200)
    blue = (0xB4, 0x77, 0x1F)
    for line, corner in ((Line("a", x, x), "left"), (Line("a", x, -x), "right")):
        found = _where(_picture(line), blue)
        key = found[found[:, 1] < 60]
        at_left = (key[:, 0] < WIDTH_PX / 2).mean() if corner == "left" else (key[:, 0] > WIDTH_PX / 2).mean()
        assert at_left > 0.5


@pytest.mark.parametrize("lines", [[], [Line("", [3.0], [4.0])], [Line("a", [2, 2], [5, 5])]])
def test_little_to_draw_is_drawn(lines):
    assert _picture(*lines, equal=True).shape == (HEIGHT_PX, WIDTH_PX, 3)


def test_matplotlib_is_not_needed():
    code = (
        "import sys; from meshslam.viewing import iterations_chart; "
        "assert iterations_chart({'ate_iteration_00_rmse_m': 1.0}); assert 'matplotlib' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
