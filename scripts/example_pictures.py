"""The pictures of docs/examples.md, from what the programs of examples/ draw and find themselves.

    .venv/bin/python scripts/example_pictures.py [--only NAME …] [--out docs/assets/examples]

Most are small pages of SVG and images, which Chromium (`--chromium`) turns into a JPEG. No recording is needed.
"""

from __future__ import annotations

import argparse
import subprocess
import tempfile
from base64 import b64encode
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import minimize

import meshslam
from examples import fit_a_sphere, localize_in_a_map, mesh_from_masks, own_category, pose_from_a_mask
from meshslam.categories import MeshOptions, category_from_meshes, load_category
from meshslam.geometry import Camera, MaskLoss, Pose, exp_so3, render, right_jacobian, voxel_iou
from meshslam.mapping import object_from_masks
from meshslam.maps import object_colour
from meshslam.perception import read_detections
from meshslam.simulation import EXACT, StreetConfig, driven_again, make_street, procedural_bodies, write_recording
from meshslam.viewing import draw_overlay, footprint
from meshslam.viewing.from_above import round_length_m

WIDTH, SCALE, SAMPLES = 1000, 1.6, 3  # CSS px, device px of each, samples a pixel
CAR = load_category("car")
LOOK = """body{margin:0;background:#fff;color:#263238;font:15px/1.35 system-ui,"DejaVu Sans",sans-serif}
main{width:1000px;box-sizing:border-box;padding:14px 16px}.row{display:flex;gap:12px;margin-bottom:10px}
figure{margin:0;flex:1;min-width:0}img,svg{display:block;width:100%;border-radius:6px}figcaption{margin-top:3px}
b{font-weight:600}small{color:#607d8b;font-size:13px}"""


def uri(image: np.ndarray) -> str:
    """An image (h, w, 3) BGR as the source of a page's picture."""
    return "data:image/png;base64," + b64encode(cv2.imencode(".png", image)[1].tobytes()).decode()


def figure(image: np.ndarray | str, caption: str = "", width: float = 1) -> str:
    """An image, or SVG, with words below."""
    shown = image if isinstance(image, str) else f"<img src='{uri(image)}'>"
    below = f"<figcaption>{caption}</figcaption>" if caption else ""
    return f"<figure style='flex:{width}'>{shown}{below}</figure>"


def row(*figures: str) -> str:
    return f"<div class=row>{''.join(figures)}</div>"


def painted(meshes, camera: Camera, camera_from_world: Pose, ground=(238, 240, 241)) -> np.ndarray:
    """Meshes (vertices in world, faces, colours BGR of vertices or of all) shaded from far to near, (h, w, 3) BGR."""
    image = np.full((camera.height * SAMPLES, camera.width * SAMPLES, 3), ground, np.uint8)
    corners, tones = [], []
    for vertices, faces, colour in meshes:
        seen = camera_from_world.transform(vertices)
        around = seen[faces]
        normal = np.cross(around[:, 1] - around[:, 0], around[:, 2] - around[:, 0])
        normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
        facing = (normal * around.mean(1)).sum(1) < 0
        light = 0.55 + 0.45 * np.clip(normal @ np.array([-0.35, -0.75, -0.55]), 0, 1)
        base = np.broadcast_to(np.asarray(colour, float), vertices.shape)[faces].mean(1)
        corners.append(around[facing])
        tones.append((base * light[:, None])[facing])
    corners, tones = np.concatenate(corners), np.concatenate(tones)
    pixels = SAMPLES * (corners[..., :2] / corners[..., 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy])
    for k in np.argsort(-corners[..., 2].mean(1)):
        if corners[k, :, 2].min() > 0.1:
            cv2.fillConvexPoly(image, np.round(16 * pixels[k]).astype(np.int32), tones[k].tolist(), cv2.LINE_8, 4)
    return cv2.resize(image, (camera.width, camera.height), interpolation=cv2.INTER_AREA)


def looking(at, distance_m: float, yaw_deg: float, pitch_deg: float) -> Pose:
    """camera_from_world: from a direction (0: from ahead of x, 90: from y) and a height, at a point."""
    yaw, pitch = np.radians([yaw_deg, pitch_deg])
    out = np.array([np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([-np.sin(yaw), np.cos(yaw), 0.0])
    return Pose(np.column_stack([right, np.cross(-out, right), -out]), np.asarray(at) + distance_m * out).inverse()


def portrait(vertices, faces, colour, yaw_deg=40.0, width=480, height=270, fill=0.9) -> np.ndarray:
    """One mesh in its own frame, three quarters from the front."""
    size = float(np.linalg.norm(np.ptp(vertices, axis=0)))
    camera = Camera(width, height, 3.0 * width * fill, 3.0 * width * fill, width / 2 - 0.5, height / 2 - 0.5)
    return painted([(vertices, faces, colour)], camera, looking(np.zeros(3), 3.0 * size, yaw_deg, 16.0))


def colour_of(number: int) -> np.ndarray:
    """BGR."""
    return object_colour(number)[::-1].astype(float)


def heat(values: np.ndarray, low: float, high: float) -> np.ndarray:
    """Colours (n, 3) BGR of values: dark blue is small, yellow is large."""
    level = np.clip((values - low) / (high - low), 0, 1)
    return cv2.applyColorMap((255 * level).astype(np.uint8)[:, None], cv2.COLORMAP_VIRIDIS)[:, 0].astype(float)


def polyline(points, colour: str, width: float = 2, more: str = "") -> str:
    shown = " ".join(f"{x:.2f},{y:.2f}" for x, y in points)
    return f"<polyline points='{shown}' fill=none stroke='{colour}' stroke-width={width} {more}/>"


def chart(lines: dict[str, tuple], x_label: str, y_label: str, size=(480, 250), log=False) -> str:
    """Lines {name: (x, y, colour)} with axes, as SVG."""
    (w, h), (left, top, right, bottom) = size, (64, 14, 12, 40)
    xs, ys = (np.concatenate([np.asarray(line[k], float) for line in lines.values()]) for k in (0, 1))
    lift = np.log10 if log else np.asarray
    low, high = (10.0 ** np.floor(np.log10(ys.min())), 10.0 ** np.ceil(np.log10(ys.max()))) if log else (0, ys.max())
    high = high if log else 1.06 * high

    def at(x, y):
        u = left + (np.asarray(x, float) - xs.min()) / np.ptp(xs) * (w - left - right)
        v = h - bottom - (lift(np.asarray(y, float)) - lift(low)) / (lift(high) - lift(low)) * (h - top - bottom)
        return np.column_stack([u, v])

    steps = 10.0 ** np.arange(np.log10(low), np.log10(high) + 0.5) if log else even_steps(high)
    parts = []
    for tick in steps:
        [(_, v)] = at([xs.min()], [tick])
        parts.append(f"<line x1={left} x2={w - right} y1={v:.1f} y2={v:.1f} stroke='#dfe5e8'/>")
        parts.append(f"<text x={left - 6} y={v + 4:.1f} text-anchor=end>{tick:.3g}</text>")
    step = round_length_m(np.ptp(xs) / 3)
    for tick in np.arange(np.ceil(xs.min() / step), xs.max() / step + 1e-9) * step:
        [(u, _)] = at([tick], [steps[0]])
        parts.append(f"<text x={u:.1f} y={h - bottom + 16} text-anchor=middle>{tick:.3g}</text>")
    parts.append(f"<text x={(w + left) / 2} y={h - 6} text-anchor=middle fill='#607d8b'>{x_label}</text>")
    parts.append(
        f"<text transform='translate(13 {(h - bottom + top) / 2}) rotate(-90)' text-anchor=middle fill='#607d8b'>"
    )
    parts.append(f"{y_label}</text>")
    for k, (name, (x, y, colour)) in enumerate(lines.items()):
        parts.append(polyline(at(x, y), colour, 2.4))
        parts.append(f"<text x={left + 10} y={top + 16 + 18 * k} fill='{colour}' font-weight=600>{name}</text>")
    return f"<svg viewBox='0 0 {w} {h}' style='font-size:13px;fill:#263238'>{''.join(parts)}</svg>"


def even_steps(high: float) -> np.ndarray:
    """Round numbers from 0 on."""
    step = round_length_m(high / 3)
    return np.arange(0, high, step)


def from_above(scene, paths: dict[str, tuple], size=(640, 300)) -> str:
    """Footprints and paths {name: (positions, colour, width)}, as SVG."""
    prints = {n: footprint(thing) for n, thing in scene.items()}
    every = np.vstack([*prints.values(), *(np.asarray(p)[:, :2] for p, *_ in paths.values())])
    low, high = every.min(0) - 1.5, every.max(0) + 1.5
    scale = min(size / (high - low))
    middle = (low + high) / 2

    def at(p):
        return (np.asarray(p)[:, :2] - middle) * [scale, -scale] + np.array(size) / 2

    parts = [f"<rect width={size[0]} height={size[1]} fill='#eef1f2'/>"]
    for n, hull in prints.items():
        b, g, r = colour_of(n)
        shown, tone = " ".join(f"{x:.1f},{y:.1f}" for x, y in at(hull)), f"rgb({r:.0f},{g:.0f},{b:.0f})"
        parts.append(f"<polygon points='{shown}' fill='{tone}' fill-opacity=.35 stroke='{tone}'/>")
        [(x, y)] = at([hull.mean(0)])
        parts.append(f"<text x={x:.1f} y={y + 4:.1f} text-anchor=middle>{n}</text>")
    parts += [polyline(at(p), colour, width, "stroke-linecap=round") for p, colour, width in paths.values()]
    return f"<svg viewBox='0 0 {size[0]} {size[1]}' style='font-size:13px;font-weight:600'>{''.join(parts)}</svg>"


def drive(folder: Path, **changed) -> Path:
    """A street of detailed cars, larger than the programs' own, with exact masks; the key points are the network's."""
    size = {"width_px": 960, "height_px": 300, "focal_px": 570.0}
    config = StreetConfig(**({"frames": 14, "cars_each_side": 2, "moving_cars": 0, **size} | changed))
    street = make_street(procedural_bodies(0, 2 * config.cars_each_side), 1, config)
    write_recording(street, folder / "street", replace(EXACT, keypoints=False))
    return folder / "street"


def map_a_drive(folder: Path) -> str:
    """A frame, the meshes over it, and each mesh with what is known of its surface."""
    street = drive(folder)
    found, recording = meshslam.map_drive(street), meshslam.open_sequence(street)
    index = 3
    image = recording.read_image(index)
    shown = draw_overlay(image, recording.camera, recording.world_from_camera[index], found.map, [])
    top = row(figure(image, "a frame"), figure(shown, "the map drawn over it"))
    tiles = []
    for n, car in found.map.items():
        length, width, height = car.dimensions
        size = f"<b>car {n}</b> {length:.2f} &times; {width:.2f} &times; {height:.2f} m"
        sure = f"<small>position to {100 * np.sqrt(np.diag(car.pose_covariance)[:3]).max():.1f} cm</small>"
        tiles.append(
            figure(portrait(car.vertices, car.faces, heat(car.vertex_sigma_m, 0.02, 0.06)), f"{size}<br>{sure}")
        )
    bar = np.repeat(heat(np.linspace(0, 1, 240), 0, 1)[None], 10, 0).astype(np.uint8)
    style = "display:inline;width:150px;border-radius:3px"
    legend = f"<small>sigma of each vertex: 2 cm <img src='{uri(bar)}' style='{style}'> 6 cm</small>"
    return top + row(*tiles) + legend


def live_slam(folder: Path) -> str:
    """The map after three moments of a drive: meshes, the path so far, the camera."""
    recording = meshslam.open_sequence(drive(folder, frames=26, cars_each_side=5))
    slam = meshslam.Slam(
        recording.camera,
        imu_from_camera=recording.imu_from_camera,
        height_above_ground_m=recording.height_above_ground_m,
        start=recording.initial_state,
    )
    seen, last_s, path, panels = recording.detections_path, -np.inf, [], []
    by_frame = read_detections(seen).by_frame()
    for index, time_s in enumerate(recording.times_s):
        samples, last_s = recording.imu.between(last_s, time_s), time_s
        image = recording.read_image(index)
        state = slam.process(image=image, detections=by_frame.get(index, ()), imu=samples, time_s=time_s)
        path.append(state.world_from_camera.translation)
        if index in (4, 12, len(recording) - 1):
            panels.append((time_s, image, dict(slam.map()), np.array(path)))
    last = panels[-1]
    places = np.array([car.world_from_object.translation for car in last[2].values()])
    middle = 0.5 * (places.mean(0) + last[3].mean(0))
    camera = Camera(640, 420, 760.0, 760.0, 319.5, 209.5)
    view = looking(middle - [0, 0, 1.0], 44.0, 205.0, 36.0)
    tiles = []
    for time_s, image, cars, way in panels:
        meshes = [(car.vertices_in_world, car.faces, colour_of(n)) for n, car in cars.items()]
        picture = painted(meshes, camera, view) if meshes else np.full((420, 640, 3), (238, 240, 241), np.uint8)
        points = view.transform(way - [0, 0, recording.height_above_ground_m])
        pixels = points[:, :2] / points[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        cv2.polylines(picture, [np.round(16 * pixels).astype(np.int32)], False, (16, 96, 214), 4, cv2.LINE_AA, 4)
        cv2.circle(
            picture, tuple(np.round(16 * pixels[-1]).astype(int).tolist()), 16 * 7, (16, 96, 214), -1, cv2.LINE_AA, 4
        )
        driven_m = np.linalg.norm(np.diff(way, axis=0), axis=1).sum()
        words = f"<b>{time_s:.1f} s</b>: {len(cars)} meshes, {driven_m:.1f} m driven"
        tiles.append(f"<figure>{figure(image)}<div style='height:8px'></div>{figure(picture, words)}</figure>")
    return row(*tiles)


def localize(folder: Path) -> str:
    """The second drive's paths from above, and their errors over time."""
    config = StreetConfig(
        **(vars(localize_in_a_map.STREET) | {"frames": 40, "cars_each_side": 6, "mode": "textureless"})
    )
    street = make_street(CAR, 1, config)
    write_recording(street, folder / "first")
    write_recording(driven_again(street, config), folder / "second", known_poses=False)
    meshslam.map_drive(folder / "first").map.save(folder / "map")
    scene, result = meshslam.Map.load(folder / "map"), meshslam.localize(folder / "second", folder / "map")
    truth = meshslam.Trajectory.load(folder / "second" / "groundtruth.tum").positions_in_world
    found = {"by the map": (result.trajectory, "#1565c0"), "by the IMU alone": (result.inertial, "#d84315")}
    lines = {}
    for name, (path, colour) in found.items():
        error = np.linalg.norm(path.positions_in_world - truth, axis=1)
        lines[f"{name}: {error.max():.3f} m at most"] = (path.times_s, np.maximum(error, 1e-4), colour)
    paths = {"found": (result.trajectory.positions_in_world, "#1565c0", 3)}
    plan = from_above(scene, paths, (600, 200))
    errors = chart(lines, "time, s", "position error, m", (400, 215))
    return row(
        figure(plan, "the map of the first drive, and the second drive's path in it", 1.5), figure(errors, "", 1)
    )


def masks_to_mesh(_: Path) -> str:
    """Nine masks; the mean mesh, the mesh that follows from them, the true one."""
    truth = CAR.shape(np.random.default_rng(3).normal(size=len(CAR.modes)))
    camera = Camera(480, 320, 450.0, 450.0, 239.5, 159.5)
    poses = [mesh_from_masks.looking_at_origin(k * 0.7) for k in range(9)]
    masks = [mesh_from_masks.draw(camera, pose, Pose.identity(), truth, CAR.faces) for pose in poses]
    car = object_from_masks(masks, poses, camera, CAR)
    thumbs = [np.where(mask[..., None] > 0, (200, 125, 45), (238, 240, 241)).astype(np.uint8) for mask in masks]
    top = row(*(figure(thumb) for thumb in thumbs))
    mean = voxel_iou(CAR.vertices, CAR.faces, truth, CAR.faces)
    overlap = voxel_iou(car.vertices_in_world, car.faces, truth, CAR.faces)
    named = (
        (CAR.vertices, (190, 170, 150), f"the category's mean<br><small>voxel IoU {mean:.2f}</small>"),
        (
            car.vertices_in_world,
            (200, 125, 45),
            f"<b>the mesh from nine masks</b><br><small>voxel IoU {overlap:.3f}</small>",
        ),
        (truth, (120, 160, 90), "the true mesh<br><small>never seen by the program</small>"),
    )
    return top + row(*(figure(portrait(v, CAR.faces, colour), words) for v, colour, words in named))


def category(folder: Path) -> str:
    """A mesh file, the category that it makes, and an object found with it."""
    own_category.bin_mesh(1.2, 1.0, 1.3).export(folder / "bin.ply")
    made, _ = category_from_meshes("bin", [folder / "bin.ply"], options=MeshOptions())
    first = own_category.bin_mesh(1.2, 1.0, 1.3)
    truth, camera = made.shape(np.array([1.0, -0.7])), Camera(320, 240, 300.0, 300.0, 159.5, 119.5)
    poses = []
    for angle in np.arange(6) * 1.1:
        ahead, right = -np.array([np.cos(angle), np.sin(angle), 0]), np.array([-np.sin(angle), np.cos(angle), 0])
        poses.append(Pose(np.column_stack([right, [0, 0, -1], ahead]), -2.5 * np.ptp(truth, axis=0).max() * ahead))
    masks = [render(camera, [(pose.inverse(), truth, made.faces)]).mask for pose in poses]
    found = object_from_masks(masks, poses, camera, made)
    overlap = voxel_iou(found.vertices_in_world, found.faces, truth, made.faces, step_m=0.02)
    parts = (
        (
            np.asarray(first.vertices) - np.mean(first.bounds, 0),
            np.asarray(first.faces),
            (150, 150, 150),
            f"a mesh file<br><small>{len(first.faces)} faces</small>",
        ),
        (
            made.vertices,
            made.faces,
            (190, 170, 150),
            f"the category's mean<br><small>{len(made.vertices)} vertices, {len(made.modes)} modes</small>",
        ),
        (truth, made.faces, (120, 160, 90), "another bin of this kind<br><small>seen in six masks</small>"),
        (
            found.vertices_in_world,
            found.faces,
            (200, 125, 45),
            f"<b>found from the masks</b><br><small>voxel IoU {overlap:.3f}</small>",
        ),
    )
    return row(*(figure(portrait(v, f, c, 50.0, 380, 330, 0.9), words) for v, f, c, words in parts))


def gradient(_: Path) -> str:
    """The mask, the outline before and after, the gradient over the vertices, and the IoU over evaluations."""
    camera = Camera(640, 240, 500.0, 500.0, 319.5, 119.5)
    forward_left_up = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    truth = Pose(forward_left_up, np.array([0.4, 0.5, 9.0])) @ Pose.from_yaw(0.5, np.zeros(3))
    mask = render(camera, [(truth, CAR.vertices, CAR.faces)]).mask
    start = truth.retract(np.array([0.4, -0.3, 0.1, 0.02, -0.03, 0.14]))
    loss, history = MaskLoss(camera, len(CAR.vertices), CAR.faces, mask), []

    def value_and_gradient(step):  # as `mask_gradient.moved_onto` does it
        found = loss.gradient(start.retract(step), CAR.vertices)
        history.append(-found.loss)
        turned, jacobian = exp_so3(step[3:]), right_jacobian(step[3:])
        return found.loss, np.concatenate([turned @ found.object[:3], jacobian.T @ found.object[3:]])

    best = minimize(value_and_gradient, np.zeros(6), jac=True, method="L-BFGS-B")
    end = start.retract(best.x)
    longest = max(np.hypot(*pulls(camera, loss, pose)[1].T).max() for pose in (start, end))
    tiles = [
        figure(outlined(camera, mask, loss, pose, 30.0 / longest), words, 1.25)
        for pose, words in ((start, f"the start: IoU {history[0]:.3f}"), (end, f"the end: IoU {-best.fun:.3f}"))
    ]
    left = np.maximum(1 - np.maximum.accumulate(history), 1e-4)
    lines = {"what is left": (np.arange(1, len(left) + 1), left, "#1565c0")}
    return row(*tiles, figure(chart(lines, "evaluations", "1 - IoU", (300, 220), log=True), "", 1)) + LEGEND


LEGEND = (
    "<small><b style='color:#90a4ae'>■</b> observed mask &nbsp; <b style='color:#1565c0'>—</b> drawn mesh's outline "
    "&nbsp; <b style='color:#d84315'>→</b> the exact negative gradient of the loss at each vertex, in both pictures to "
    "one scale</small>"
)


def pulls(camera: Camera, loss: MaskLoss, camera_from_object: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Where the vertices are seen (V, 2), px, and the negative gradient over them, projected (V, 2)."""
    pull = -loss.gradient(camera_from_object, CAR.vertices).vertices

    def pixels(vertices):
        seen = camera_from_object.transform(vertices)
        return seen[:, :2] / seen[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]

    tiny = 1e-4 / max(np.abs(pull).max(), 1e-12)
    at = pixels(CAR.vertices)
    return at, (pixels(CAR.vertices + tiny * pull) - at) / tiny


def outlined(camera: Camera, mask, loss: MaskLoss, camera_from_object: Pose, arrow_scale: float) -> str:
    """A mask with a mesh's outline and arrows at its vertices, as SVG."""
    drawn = render(camera, [(camera_from_object, CAR.vertices, CAR.faces)]).mask
    back = np.where(mask[..., None] > 0, (196, 188, 182), (241, 240, 238)).astype(np.uint8)
    parts = [f"<image href='{uri(back)}' width=640 height=240 />"]
    for contour in cv2.findContours(drawn.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]:
        parts.append(polyline([*contour[:, 0] + 0.5, contour[0, 0] + 0.5], "#1565c0", 1.6))
    for (x, y), (dx, dy) in zip(*pulls(camera, loss, camera_from_object), strict=True):
        u, v = x + 0.5 + arrow_scale * dx, y + 0.5 + arrow_scale * dy
        if np.hypot(arrow_scale * dx, arrow_scale * dy) > 1.5:
            ends = f"x1={x + 0.5:.1f} y1={y + 0.5:.1f} x2={u:.1f} y2={v:.1f}"
            parts.append(f"<line {ends} stroke='#d84315' stroke-width=1.3 marker-end='url(#tip)'/>")
    tip = (
        "<marker id=tip viewBox='0 0 6 6' refX=4 refY=3 markerWidth=4 markerHeight=4 orient=auto>"
        "<path d='M0 0L6 3L0 6z' fill='#d84315'/></marker>"
    )
    return f"<svg viewBox='{VIEW_BOX}'><defs>{tip}</defs>{''.join(parts)}</svg>"


VIEW_BOX = "235 70 250 160"


def strip(tiles: list[tuple[np.ndarray, str]], height: int = 300) -> np.ndarray:
    """Images in a row with words below, without a browser."""
    out = []
    for image, words in tiles:
        scale = height / image.shape[0]
        shown = cv2.resize(
            image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
        )
        below = np.full((44, shown.shape[1], 3), 255, np.uint8)
        cv2.putText(below, words, (4, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.62, (56, 50, 38), 1, cv2.LINE_AA)
        out += [np.concatenate([shown, below]), np.full((height + 44, 12, 3), 255, np.uint8)]
    return cv2.copyMakeBorder(np.concatenate(out[:-1], axis=1), 12, 4, 12, 12, cv2.BORDER_CONSTANT, value=(255,) * 3)


def sphere(_: Path) -> np.ndarray:
    """Masks, the mesh as it becomes the car, and the car (extra `torch`)."""
    camera, ahead = Camera(128, 128, 220.0, 220.0, 63.5, 63.5), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    back = [Pose(ahead, np.array([-9.0, 0.0, k % 4 / 2])) for k in range(20)]
    poses = [Pose.from_yaw(0.314 * k, np.zeros(3)) @ pose for k, pose in enumerate(back)]
    masks = [render(camera, [(pose.inverse(), CAR.vertices, CAR.faces)]).mask for pose in poses]
    seen = np.concatenate([np.concatenate([255 - 150 * masks[4 * r + c] for c in (0, 2)], axis=1) for r in (0, 1)])
    tiles = [(cv2.cvtColor(seen, cv2.COLOR_GRAY2BGR), "4 of 20 masks")]
    for steps in (1, 50, 150, 300):
        vertices, faces, overlap = fit_a_sphere.fit(masks, camera, poses, steps=steps)
        shown = portrait(vertices, faces, colour_of(1), fill=0.8)
        tiles.append((shown, f"step {steps}: IoU {overlap:.2f}" if steps > 1 else f"the start: IoU {overlap:.2f}"))
    return strip([*tiles, (portrait(CAR.vertices, CAR.faces, colour_of(0), fill=0.8), "the true mesh")], 200)


def one_mask(_: Path) -> np.ndarray:
    """The mask with three of the starts, and with the pose that is found (extra `jax`)."""
    camera, ahead = Camera(320, 160, 300.0, 300.0, 159.5, 79.5), pose_from_a_mask.AHEAD
    truth = Pose(ahead, np.array([0.8, 0.6, 9.0])) @ Pose.from_yaw(0.6, np.zeros(3))
    mask = render(camera, [(truth, CAR.vertices, CAR.faces)]).mask
    pose, overlap = pose_from_a_mask.found(mask, camera, CAR)
    rows, columns = np.nonzero(mask)
    middle = Pose(ahead, 9.4 * camera.rays(np.array([columns.mean(), rows.mean()])))
    starts = [middle @ Pose.from_yaw(k * np.pi / 6, np.zeros(3)) for k in range(12)]
    return strip(
        [(traced(camera, mask, starts), "twelve starts"), (traced(camera, mask, [pose]), f"found: IoU {overlap:.3f}")]
    )


def traced(camera: Camera, mask, poses: list[Pose]) -> np.ndarray:
    """A mask with the car's outline at some poses."""
    scale = 3
    image = np.where(mask[..., None] > 0, (196, 188, 182), (241, 240, 238)).astype(np.uint8)
    image = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_NEAREST)
    fine = Camera(960, 480, 900.0, 900.0, 479.5, 239.5)
    for pose in poses:
        drawn = render(fine, [(pose, CAR.vertices, CAR.faces)]).mask
        contours = cv2.findContours(drawn.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
        cv2.drawContours(image, contours, -1, (192, 101, 21), 2, cv2.LINE_AA)
    return image[:, 160:]


PICTURES: dict[str, Callable[[Path], str | np.ndarray]] = {
    "map_a_drive": map_a_drive,
    "live_slam": live_slam,
    "localize_in_a_map": localize,
    "mesh_from_masks": masks_to_mesh,
    "own_category": category,
    "mask_gradient": gradient,
    "fit_a_sphere": sphere,
    "pose_from_a_mask": one_mask,
}


def photographed(content: str, chromium: str, folder: Path) -> np.ndarray:
    """A page (h, w, 3) BGR, without the white below it."""
    page, picture = folder / "page.html", folder / "page.png"
    page.write_text(f"<!doctype html><meta charset=utf-8><style>{LOOK}</style><main>{content}</main>", encoding="utf-8")
    flags = ["--headless", "--no-sandbox", "--hide-scrollbars", f"--force-device-scale-factor={SCALE}"]
    size = f"--window-size={WIDTH},1200"
    command = [chromium, *flags, size, f"--screenshot={picture}", page.as_uri()]
    subprocess.run(command, check=True, capture_output=True)
    shown = cv2.imread(str(picture))
    used = np.flatnonzero((shown < 250).any((1, 2)))
    return shown[: used[-1] + round(14 * SCALE)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("docs/assets/examples"))
    parser.add_argument("--only", nargs="*", choices=PICTURES, default=list(PICTURES))
    parser.add_argument("--chromium", default="chromium")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for name in given.only:
        with tempfile.TemporaryDirectory() as folder:
            made = PICTURES[name](Path(folder))
            picture = photographed(made, given.chromium, Path(folder)) if isinstance(made, str) else made
        file = given.out / f"{name}.jpg"
        cv2.imwrite(str(file), picture, [cv2.IMWRITE_JPEG_QUALITY, 88])
        print(f"{file}: {picture.shape[1]} x {picture.shape[0]} px, {file.stat().st_size / 1e3:.0f} kB", flush=True)


if __name__ == "__main__":
    main()
