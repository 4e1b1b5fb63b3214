"""A USD stage: an Xform with a Mesh for each object, the path as curves, a Camera with a time sample a frame."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from meshslam.exporting.finished_run import FinishedRun, positions_of
from meshslam.exporting.formats import Notes
from meshslam.geometry import Floats, Pose
from meshslam.maps import MapObject, linear, vertex_colours

PATH_WIDTH_M = 0.12
APERTURE_MM = 36.0
LOOKS_ALONG_MINUS_Z = Pose(np.diag([1.0, -1.0, -1.0]), np.zeros(3))  # USD's camera; ours looks along z, y down


def write(run: FinishedRun, target: Path) -> Notes:
    """Z up, metres; time codes are the frames' indices. Properties of objects are attributes `meshslam:...`."""
    from pxr import Usd, UsdGeom

    named = target.with_suffix(".usdc")  # the writer goes by the name
    stage = Usd.Stage.CreateNew(str(named))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    world = UsdGeom.Xform.Define(stage, "/world")
    stage.SetDefaultPrim(world.GetPrim())
    for thing in run.scene.objects:
        _add_object(stage, thing)
    _add_path(stage, positions_of(run))
    _add_camera(stage, run)
    stage.GetRootLayer().Save()
    named.replace(target)
    return ()


def _add_object(stage: Any, thing: MapObject) -> None:  # noqa: ANN401 # a Usd.Stage
    from pxr import Sdf, UsdGeom, Vt

    place = f"/world/{thing.category}_{thing.id}"
    frame = UsdGeom.Xform.Define(stage, place)
    frame.AddTransformOp().Set(_matrix(thing.world_from_object))
    mesh = UsdGeom.Mesh.Define(stage, f"{place}/mesh")
    points = np.asarray(thing.vertices, np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(thing.faces), 3, np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(np.asarray(thing.faces, np.int32).ravel()))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    colours = mesh.CreateDisplayColorPrimvar(UsdGeom.Tokens.vertex)
    shades = linear(vertex_colours(thing))[:, :3].astype(np.float32) / 255.0
    colours.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(shades)))
    kinds = Sdf.ValueTypeNames
    properties = (
        ("id", kinds.Int, thing.id),
        ("category", kinds.String, thing.category),
        ("views", kinds.Int, thing.views),
    )
    for name, kind, value in properties:
        frame.GetPrim().CreateAttribute(f"meshslam:{name}", kind).Set(value)
    if thing.mask_iou is not None:
        frame.GetPrim().CreateAttribute("meshslam:mask_iou", kinds.Double).Set(thing.mask_iou)


def _add_path(stage: Any, points: Floats) -> None:  # noqa: ANN401 # a Usd.Stage
    from pxr import UsdGeom, Vt

    if len(points) < 2:
        return
    curve = UsdGeom.BasisCurves.Define(stage, "/world/path")
    curve.CreateTypeAttr(UsdGeom.Tokens.linear)
    curve.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points.astype(np.float32)))
    curve.CreateCurveVertexCountsAttr([len(points)])
    curve.CreateWidthsAttr([PATH_WIDTH_M])
    curve.SetWidthsInterpolation(UsdGeom.Tokens.constant)


def _add_camera(stage: Any, run: FinishedRun) -> None:  # noqa: ANN401 # a Usd.Stage
    from pxr import Gf, UsdGeom

    lens = run.camera
    camera = UsdGeom.Camera.Define(stage, "/world/camera")
    camera.CreateHorizontalApertureAttr(APERTURE_MM)
    camera.CreateVerticalApertureAttr(APERTURE_MM * lens.height / lens.width * lens.fx / lens.fy)
    camera.CreateFocalLengthAttr(APERTURE_MM * lens.fx / lens.width)
    off = (lens.width / 2 - 0.5 - lens.cx) / lens.width, (lens.cy - lens.height / 2 + 0.5) / lens.height
    camera.CreateHorizontalApertureOffsetAttr(APERTURE_MM * off[0])
    camera.CreateVerticalApertureOffsetAttr(camera.GetVerticalApertureAttr().Get() * off[1])
    camera.CreateClippingRangeAttr(Gf.Vec2f(0.1, 1000.0))
    moves = camera.AddTransformOp()
    for index, pose in enumerate(run.path.world_from_camera):
        moves.Set(_matrix(pose @ LOOKS_ALONG_MINUS_Z), index)
    if len(run.path):
        stage.SetStartTimeCode(0)
        stage.SetEndTimeCode(len(run.path) - 1)


def _matrix(pose: Pose) -> Any:  # noqa: ANN401 # a Gf.Matrix4d
    from pxr import Gf

    return Gf.Matrix4d(pose.matrix.T.tolist())  # USD multiplies rows
