"""What the network is to minimize."""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from meshslam.perception import ANGLES, CELL_PX, REACH

HEAT_SIGMA_CELLS = 0.8
ANGLE_CONCENTRATION = 1 / 0.15**2  # von Mises, of the soft labels
VISIBLE_WEIGHT, POINT_WEIGHT, SIGMA_WEIGHT, ANGLE_WEIGHT = 0.5, 0.1, 0.1, 0.5
_FAR_PX = 40.0


def total_loss(
    answers: tuple[Tensor, Tensor, Tensor, Tensor], keypoints: Tensor, visible: Tensor, angle: Tensor
) -> Tensor:
    """Sum of the losses of heat maps, visibility, places, sigmas and viewing angle.

    keypoints (N, 12, 2) px of the input, visible (N, 12) 0 or 1, angle (N,) rad. Heat maps: cross entropy against a
    Gaussian about the point. Sigmas: negative log likelihood of a Laplace distribution (the error is taken as given).
    """
    heat, seen, log_sigma, angles = (a.float() for a in answers)
    shown = visible / visible.sum().clamp(min=1)
    cells = (keypoints + 0.5) / CELL_PX - 0.5
    cross = -(_gaussian(cells, heat.shape[2], heat.shape[3]) * torch.log_softmax(heat.flatten(2), 2)).sum(2)
    found = CELL_PX * (local_mean(heat) + 0.5) - 0.5
    off = (found - keypoints).abs().sum(2).clamp(max=_FAR_PX)
    spread = 0.5 * off.detach() * torch.exp(-log_sigma) + log_sigma
    centres = torch.arange(ANGLES, device=angle.device) * (2 * math.pi / ANGLES)
    soft = torch.softmax(ANGLE_CONCENTRATION * torch.cos(angle[:, None] - centres), 1)
    return (
        (shown * cross).sum()
        + POINT_WEIGHT * (shown * off).sum()
        + SIGMA_WEIGHT * (shown * spread).sum()
        + VISIBLE_WEIGHT * functional.binary_cross_entropy_with_logits(seen, visible)
        + ANGLE_WEIGHT * functional.cross_entropy(angles, soft)
    )


def _gaussian(cells: Tensor, height: int, width: int) -> Tensor:
    """Shares (N, K, h w) of the cells under Gaussians about points (N, K, 2)."""
    x = (torch.arange(width, device=cells.device) - cells[..., :1]) ** 2
    y = (torch.arange(height, device=cells.device) - cells[..., 1:]) ** 2
    return torch.softmax(-(y[..., None] + x[:, :, None]).flatten(2) / (2 * HEAT_SIGMA_CELLS**2), 2)


def local_mean(heat: Tensor) -> Tensor:
    """Where heat maps (N, K, h, w) have their points, in cells (N, K, 2): as `decode.points_in_input`."""
    n, k, height, width = heat.shape
    peak = heat.flatten(2).argmax(2)
    rows, columns = (torch.arange(size, device=heat.device) for size in (height, width))
    near_rows = (rows - (peak // width)[..., None]).abs() <= REACH
    near_columns = (columns - (peak % width)[..., None]).abs() <= REACH
    near = near_rows[..., None] & near_columns[:, :, None]
    share = torch.softmax(heat.masked_fill(~near, -1e4).flatten(2), 2).view(n, k, height, width)
    return torch.stack([(share.sum(2) * columns).sum(2), (share.sum(3) * rows).sum(2)], 2)
