"""Lens distortion, taken out once at the door: everything behind a Sequence is pinhole."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np

from meshslam.errors import GeometryError
from meshslam.geometry import Bytes, Camera, Floats
from meshslam.sequences.images import MAX_PIXELS
from meshslam.sequences.lenses import LENSES, Lens, LensModel, angles_of, fold_angle_rad, slope_brown, straighten

WIDEST_DEG = 105.0  # of a pinhole view: its pixels grow with the tangent
LEAST_SHARE = 0.6  # of the raw image's pixels that a lens model must give a ray
_LEAST_ANGLE_RAD = np.radians(45.0)  # that a fisheye's model must reach at least, where it does not fill the image
_OUTSIDE_PX = -1e6  # where pixels that show nothing are looked for


@dataclass(frozen=True, eq=False)
class Distortion:
    """A lens from a raw camera to a pinhole one; the models and their coefficients' order are OpenCV's (see lenses).

    GeometryError for a model that folds over within the raw image; with `partial` only for one that gives fewer than
    60% of its pixels a ray. Pixels of the pinhole view beyond the fold, or outside the raw image, are black.
    """

    raw_camera: Camera
    camera: Camera  # the undistorted one
    coefficients: Floats  # radtan (4,) or (5,), rational (8,), equidistant (4,), fov (1,)
    model: LensModel = "radtan"
    partial: bool = False
    _maps: tuple[Floats, ...] = field(init=False, repr=False, default=())

    def __post_init__(self) -> None:
        with np.errstate(all="ignore"):  # of values that no camera has
            self._prepare()

    def _prepare(self) -> None:
        size = max(camera.width * camera.height for camera in (self.raw_camera, self.camera))
        if size > MAX_PIXELS:
            raise GeometryError(f"an image of {size} pixels: more than {MAX_PIXELS} are not undistorted")
        problem = coefficients_problem(self.model, self.coefficients)
        if problem:
            raise GeometryError(problem)
        pixels = _pixel_grid(self.camera)
        if not self._is_usable():
            names = self.lens.names.replace("[, k3]", ", k3")
            raise GeometryError(f"the distortion folds over within the image: check the coefficients' order {names}")
        angles = np.arctan(np.linalg.norm(self.camera.rays(pixels)[..., :2], axis=-1))
        beyond = angles >= fold_angle_rad(self.lens, self.coefficients)
        with np.errstate(all="ignore"):
            maps = np.where(beyond[..., None], _OUTSIDE_PX, np.nan_to_num(self.distort(pixels), nan=_OUTSIDE_PX))
        maps = np.clip(maps, _OUTSIDE_PX, -_OUTSIDE_PX)
        object.__setattr__(self, "_maps", tuple(np.moveaxis(maps, -1, 0).astype(np.float32)))

    @property
    def lens(self) -> Lens:
        """The model's functions."""
        return LENSES[self.model]

    def distort(self, pixels: Floats) -> Floats:
        """Take pixels (..., 2) of the undistorted camera to the raw camera."""
        return _pixels(self.raw_camera, self.lens.bend(self.camera.rays(pixels)[..., :2], self.coefficients))

    def undistort(self, pixels: Floats) -> Floats:
        """Take pixels (..., 2) of the raw camera to the undistorted one, by Newton's method.

        NaN where the lens gives a pixel no ray before 90 degrees off its axis: never for a lens that is invertible
        within its image.
        """
        target = self.raw_camera.rays(pixels)[..., :2]
        if self.model != "radtan" or self.partial:
            return _pixels(self.camera, straighten(self.lens, self.coefficients, target))
        straight = target.copy()
        for _ in range(20):
            slope = slope_brown(straight, self.coefficients)
            error = target - self.lens.bend(straight, self.coefficients)
            straight = straight + np.linalg.solve(slope, error[..., None])[..., 0]
        return _pixels(self.camera, straight)

    def undistort_image(self, image: Bytes) -> Bytes:
        """Resample a raw image (h, w[, 3]), bilinear."""
        return np.asarray(cv2.remap(image, self._maps[0], self._maps[1], cv2.INTER_LINEAR), np.uint8)

    def undistort_mask(self, mask: Bytes) -> Bytes:
        """Resample a raw mask (h, w), nearest pixel."""
        return np.asarray(cv2.remap(mask, self._maps[0], self._maps[1], cv2.INTER_NEAREST), np.uint8)

    def raw_rays(self, pixels: Floats) -> Floats:
        """Unit directions (..., 3) of raw pixels (..., 2), those behind the camera too; NaN where there is none."""
        bent = self.raw_camera.rays(pixels)[..., :2]
        if self.lens.slope is not None:
            straight = straighten(self.lens, self.coefficients, bent)
            rays = np.concatenate([straight, np.ones_like(straight[..., :1])], axis=-1)
            unit: Floats = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
            return unit
        radii = np.linalg.norm(bent, axis=-1)
        angles = angles_of(self.lens, self.coefficients, radii)
        across = bent * (np.sin(angles) / np.maximum(radii, 1e-12))[..., None]
        return np.concatenate([across, np.cos(angles)[..., None]], axis=-1)

    def project_raw(self, points_in_camera: Floats) -> Floats:
        """Project points (..., 3), metres, to raw pixels (..., 2), also behind a wide lens; NaN beyond the fold."""
        x, y, z = np.moveaxis(np.asarray(points_in_camera, float), -1, 0)
        aside = np.hypot(x, y)
        angles = np.arctan2(aside, z)
        seen = angles < fold_angle_rad(self.lens, self.coefficients)
        if self.lens.slope is not None:
            depth = np.where(seen & (z > 0), z, np.nan)
            return _pixels(self.raw_camera, self.lens.bend(np.stack([x, y], -1) / depth[..., None], self.coefficients))
        grown = self.lens.radius(np.where(seen, angles, np.nan), self.coefficients) / np.maximum(aside, 1e-12)
        return _pixels(self.raw_camera, np.stack([x, y], axis=-1) * grown[..., None])

    def black_share(self) -> float:
        """The share of the pinhole view's pixels that show nothing, 0 to 1."""
        u, v = self._maps
        inside = (u >= 0) & (u <= self.raw_camera.width - 1) & (v >= 0) & (v <= self.raw_camera.height - 1)
        return float(1.0 - inside.mean())

    def _is_usable(self) -> bool:
        """Whether enough of the raw image's pixels have a ray: all of them, unless `partial` or the lens is wide."""
        if not self.lens.is_wide and not self.partial:
            return self._invertible()
        radii = np.linalg.norm(self.raw_camera.rays(_pixel_grid(self.raw_camera, 33))[..., :2], axis=-1)
        share = np.isfinite(angles_of(self.lens, self.coefficients, radii)).mean()
        wide = self.lens.is_wide and fold_angle_rad(self.lens, self.coefficients) >= _LEAST_ANGLE_RAD
        return bool(wide or share >= LEAST_SHARE)

    def _invertible(self) -> bool:
        raw = _pixel_grid(self.raw_camera, 33)
        with np.errstate(all="ignore"):
            try:
                back = self.undistort(raw)
                error = np.abs(self.distort(back) - raw).max()
            except np.linalg.LinAlgError:
                return False
            slopes = np.linalg.det(slope_brown(self.camera.rays(back)[..., :2], self.coefficients))
        return bool(np.isfinite(error) and error < 0.01 and (slopes > 0).all())


def coefficients_problem(model: LensModel, coefficients: Floats) -> str | None:
    """What is wrong with a model's coefficients, in words; None if nothing is."""
    lens = LENSES[model]
    if len(coefficients) not in lens.counts:
        return f"{model} has {lens.names.replace('[, k3]', ' and perhaps k3')}, found {len(coefficients)} numbers"
    if model == "fov" and not 1e-3 < coefficients[0] < 3.1:
        return f"omega of the fov lens is an angle in radians from 0.001 to 3.1, found {coefficients[0]:g}"
    return None


def undistorted(raw_camera: Camera, coefficients: Floats, model: LensModel = "radtan") -> tuple[Distortion, str]:
    """The lens with the pinhole view that suits it, and what should be said of the view; empty if nothing should.

    radtan and rational keep the raw camera's intrinsics; where the model folds over within the image, pixels beyond
    the fold are black. equidistant and fov get a view of the same size, centred, of the raw centre's resolution, but of
    105 degrees at most. GeometryError for a model that gives too little of the image a ray.
    """
    if LENSES[model].is_wide:
        found = Distortion(raw_camera, _view_of_wide(raw_camera, coefficients, model), coefficients, model)
        return _worth_it(found), view_note(found)
    try:
        whole = Distortion(raw_camera, raw_camera, coefficients, model)
    except GeometryError:
        part = _worth_it(Distortion(raw_camera, raw_camera, coefficients, model, partial=True))
        limit = np.degrees(fold_angle_rad(part.lens, part.coefficients))
        return part, f"the distortion folds over {limit:.0f} degrees off the axis: {view_note(part)}"
    return (whole, "") if model == "radtan" else (_worth_it(whole), view_note(whole))


def _worth_it(found: Distortion) -> Distortion:
    """The lens; GeometryError if most of its view shows nothing, as with coefficients in a wrong order."""
    shown = 1.0 - found.black_share()
    if shown < LEAST_SHARE:
        seen = f"the lens shows {100 * shown:.0f}% of its pinhole view"
        raise GeometryError(f"{seen}: check the coefficients' order {found.lens.names}")
    return found


def view_note(found: Distortion) -> str:
    """Say which view a lens was undistorted into."""
    camera, black = found.camera, found.black_share()
    across, down = 2 * np.degrees(np.arctan([camera.width / 2 / camera.fx, camera.height / 2 / camera.fy]))
    view = f"undistorted into a pinhole view of {across:.0f} x {down:.0f} degrees, focal length {camera.fx:.0f} px"
    return view if black < 5e-4 else f"{view}; {100 * black:.1f}% of it are black: the lens shows nothing there"


def _view_of_wide(raw: Camera, coefficients: Floats, model: LensModel) -> Camera:
    """A pinhole camera for a fisheye: a little narrower where a part would show nothing otherwise."""
    problem = coefficients_problem(model, coefficients)
    if problem:
        raise GeometryError(problem)
    lens = LENSES[model]
    centre = float(2 * np.tan(coefficients[0] / 2) / coefficients[0]) if model == "fov" else 1.0  # px per raw px
    least_px = max(raw.width, raw.height) / 2 / np.tan(np.radians(WIDEST_DEG / 2))
    first_px = max(centre * float(np.sqrt(raw.fx * raw.fy)), least_px)
    for focal_px in first_px * np.linspace(1.0, 1.5, 26):
        if _shows_all(view := _centred(raw, float(focal_px)), raw, coefficients, lens):
            return view
    return _centred(raw, float(first_px))


def _centred(raw: Camera, focal_px: float) -> Camera:
    return Camera(raw.width, raw.height, focal_px, focal_px, (raw.width - 1) / 2, (raw.height - 1) / 2)


def _shows_all(view: Camera, raw: Camera, coefficients: Floats, lens: Lens) -> bool:
    """Whether every pixel of the view lies in the raw image: its border does."""
    grid = _pixel_grid(view, 33)
    border = np.concatenate([grid[0], grid[-1], grid[:, 0], grid[:, -1]])
    directions = view.rays(border)[:, :2]
    if np.arctan(np.linalg.norm(directions, axis=1)).max() >= fold_angle_rad(lens, coefficients):
        return False
    u, v = _pixels(raw, lens.bend(directions, coefficients)).T
    return bool(min(u.min(), v.min()) >= 0 and u.max() <= raw.width - 1 and v.max() <= raw.height - 1)


def _pixel_grid(camera: Camera, steps: int = 0) -> Floats:
    u = np.linspace(0, camera.width - 1, steps or camera.width)
    v = np.linspace(0, camera.height - 1, steps or camera.height)
    return np.stack(np.meshgrid(u, v), axis=-1)


def _pixels(camera: Camera, directions: Floats) -> Floats:
    return camera.project(np.concatenate([directions, np.ones_like(directions[..., :1])], axis=-1))
