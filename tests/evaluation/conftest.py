import importlib.util
import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from meshslam.categories import load_category
from meshslam.geometry import Camera, Pose, render
from meshslam.maps import Map, MapObject, Trajectory
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry, encode_mask, write_detections
from meshslam.sequences import camera_yaml

WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # camera looks along x


@pytest.fixture
def score_run(data_folder):
    """The independent tool that scores run directories."""
    path = data_folder.parent / "tools" / "score_run.py"
    if not path.is_file():
        pytest.skip(f"no {path}")
    spec = importlib.util.spec_from_file_location("score_run", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def car():
    return load_category("car")


@pytest.fixture
def make_car(car, rng):
    def make(number, position, yaw=0.0, z=None):
        vertices = car.shape(rng.normal(size=len(car.modes)) if z is None else z)
        vertices = vertices - (vertices.max(axis=0) + vertices.min(axis=0)) / 2
        return MapObject(number, "car", Pose.from_yaw(yaw, np.asarray(position, float)), vertices, car.faces, views=5)

    return make


@pytest.fixture
def true_cars(make_car, rng):
    return [make_car(10 + i, [9.0 + 6 * i, (-1) ** i * 3.0, 0.8], rng.uniform(-3, 3)) for i in range(6)]


def moved(thing, number, shift=(0, 0, 0), yaw=0.0, scale=1.0):
    """The same object as an estimate that is a little off."""
    pose = Pose(np.eye(3), np.asarray(shift, float)) @ thing.world_from_object @ Pose.from_yaw(yaw, np.zeros(3))
    return MapObject(number, "car", pose, scale * thing.vertices, thing.faces, views=5)


@pytest.fixture
def write_truth(tmp_path):
    """Write a sequence folder's truth; `shown` says how many detections show each object."""

    def write(objects=(), shown=None, path=None):
        folder = tmp_path / "case"
        (folder / "meshes").mkdir(parents=True, exist_ok=True)
        entries = []
        for thing in objects:
            trimesh.Trimesh(thing.vertices, thing.faces, process=False).export(folder / "meshes" / f"{thing.id}.ply")
            pose = thing.world_from_object.matrix.tolist()
            entries.append(
                {"id": thing.id, "category": "car", "world_from_object": pose, "mesh": f"meshes/{thing.id}.ply"}
            )
        if entries:
            (folder / "objects.json").write_text(json.dumps({"objects": entries}))
        if shown is not None:
            ids = [number for number, count in shown.items() for _ in range(count)]
            (folder / "association.json").write_text(json.dumps({str(i + 1): n for i, n in enumerate(ids)}))
        if path is not None:
            path.save(folder / "groundtruth.tum")
        return folder

    return write


@pytest.fixture
def write_run(tmp_path):
    def write(objects=None, path=None):
        folder = tmp_path / "run"
        folder.mkdir(exist_ok=True)
        if objects is not None:
            Map(tuple(objects)).save(folder)
        if path is not None:
            path.save(folder / "trajectory.tum")
        return folder

    return write


@pytest.fixture
def random_path(rng):
    def make(count=12):
        steps = rng.normal([0.8, 0.1, 0.0], 0.1, (count, 3))
        rotations = Rotation.from_rotvec(np.cumsum(rng.normal(0, 0.02, (count, 3)), axis=0)).as_matrix()
        poses = [Pose(r @ WORLD_FROM_FORWARD, p) for r, p in zip(rotations, np.cumsum(steps, axis=0), strict=True)]
        return Trajectory(0.1 * np.arange(count), tuple(poses))

    return make


@pytest.fixture
def write_masks(write_run):
    """A run whose masks are drawn from `shown` and whose map holds `objects`, seen along a straight path."""

    def write(shown, objects, frames=3, fray=0):
        camera = Camera(320, 110, 190.0, 192.0, 158.0, 50.0)
        poses = tuple(Pose(WORLD_FROM_FORWARD, np.array([0.7 * i, 0.0, 1.65])) for i in range(frames))
        found = []
        for frame, pose in enumerate(poses):
            meshes = [(pose.inverse() @ o.world_from_object, o.vertices, o.faces) for o in shown]
            drawn = render(camera, meshes).object_index
            for i, thing in enumerate(shown):
                mask = (drawn == i).astype(np.uint8)
                mask[:, : (mask.any(axis=0).argmax() + fray)] = 0
                if mask.any():
                    found.append(_detection(len(found) + 1, frame, mask, thing.id))
        folder = write_run(objects, Trajectory(0.1 * np.arange(frames), poses))
        images = tuple(ImageEntry(i, f"{i:06d}.png", camera.width, camera.height) for i in range(frames))
        detections = DetectionSet(images, (CategoryEntry(1, "car"),), tuple(found))
        (folder / "detections.json").write_bytes(write_detections(detections))
        (folder / "camera.yaml").write_text(camera_yaml(camera))
        return folder

    return write


def _detection(number, frame, mask, track):
    rows, columns = np.nonzero(mask)
    x, y = float(columns.min()), float(rows.min())
    box = (x, y, float(columns.max()) + 1 - x, float(rows.max()) + 1 - y)
    return Detection(number, frame, "car", 0.9, box, encode_mask(mask), mask.shape, track_id=track)
