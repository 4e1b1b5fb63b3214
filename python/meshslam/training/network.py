"""The key point network: an hourglass of bottlenecks (Newell et al. 2016) that looks before it points."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from meshslam.perception import ANGLES, CELL_PX, KEYPOINTS

_WIDTHS = (24, 40, 80, 176)  # channels at 1/2, 1/4, 1/8 and 1/16 of the input
_HEAD = 24
_LOOK = 112


class KeypointNetwork(nn.Module):
    """Crops (N, 4, 96, 128) to heat map logits, visibility logits, log sigmas and logits of the viewing angle.

    Heat maps (N, 12, 24, 32): one cell is `CELL_PX` px of the input wide. Visibility (N, 12). Log of sigma in input px
    (N, 12): the mean under the heat map of a map of its own. Angle (N, `ANGLES`): bins around the car.
    """

    def __init__(self, height: int = 96, width: int = 128) -> None:
        super().__init__()
        a, b, c, d = _WIDTHS
        self.stem = nn.Sequential(_conv(4, a, 2), _conv(a, b, 2), _Bottleneck(b))
        self.middle = nn.Sequential(_conv(b, c, 2), _Bottleneck(c), _Bottleneck(c))
        self.deep = nn.Sequential(_conv(c, d, 2), _Bottleneck(d), _Bottleneck(d), _Bottleneck(d))
        self.deep_to_middle, self.middle_up = _point(d, c), _Bottleneck(c)
        self.middle_to_stem, self.stem_up = _point(c, b), nn.Sequential(_Bottleneck(b), _Bottleneck(b))
        self.maps = nn.Conv2d(b, 2 * KEYPOINTS, 1)
        cells = height // (4 * CELL_PX) * (width // (4 * CELL_PX))
        self.look = nn.Sequential(_point(d, _HEAD), nn.Flatten(), nn.Linear(cells * _HEAD, _LOOK), nn.ReLU())
        self.answers = nn.Linear(_LOOK, KEYPOINTS + ANGLES)
        self.look_to_deep = nn.Linear(_LOOK, d)

    def forward(self, crops: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Heat maps, visibility, log sigma, angle."""
        fine = self.stem(crops)
        half = self.middle(fine)
        deep = self.deep(half)
        look = self.look(deep)
        deep = deep + self.look_to_deep(look)[..., None, None]
        half = self.middle_up(half + _doubled(self.deep_to_middle(deep)))
        fine = self.stem_up(fine + _doubled(self.middle_to_stem(half)))
        heat, spread = self.maps(fine).split(KEYPOINTS, 1)
        share = torch.softmax(heat.flatten(2), 2)
        log_sigma = (share * spread.flatten(2)).sum(2)
        visible, angle = self.answers(look).split([KEYPOINTS, ANGLES], 1)
        return heat, visible, log_sigma, angle


def _conv(inputs: int, outputs: int, stride: int = 1) -> nn.Sequential:
    layer = nn.Conv2d(inputs, outputs, 3, stride, 1, bias=False)
    return nn.Sequential(layer, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


def _point(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.Conv2d(inputs, outputs, 1, bias=False), nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class _Bottleneck(nn.Module):
    """x + 1x1, 3x3, 1x1 with half as many channels in between (He et al. 2016)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        last = nn.Conv2d(channels // 2, channels, 1, bias=False)
        norm = nn.BatchNorm2d(channels)
        nn.init.zeros_(norm.weight)
        self.body = nn.Sequential(_point(channels, channels // 2), _conv(channels // 2, channels // 2), last, norm)

    def forward(self, x: Tensor) -> Tensor:
        return torch.relu(x + self.body(x))


def _doubled(x: Tensor) -> Tensor:
    return nn.functional.interpolate(x, scale_factor=2.0, mode="nearest")
