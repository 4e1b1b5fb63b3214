"""A simulated street with exact truth, seen as masks and key points."""

import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import Camera, Pose, render
from meshslam.mapping import Frames
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry, encode_mask
from meshslam.simulation import ObserverConfig, StreetConfig, make_street, observe

WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera looks along x


@pytest.fixture(scope="session")
def car():
    return load_category("car")


@pytest.fixture(scope="session")
def camera():
    return Camera(640, 200, 400.0, 400.0, 319.5, 84.0)


@pytest.fixture(scope="session")
def street(car):
    small = StreetConfig(frames=14, width_px=560, height_px=180, focal_px=330.0, cars_each_side=2)
    return make_street(car, 4, small)


@pytest.fixture(scope="session")
def frames(street):
    count = len(street.times_s)
    return Frames(street.camera, tuple(range(count)), street.times_s, street.world_from_camera, street.camera_height_m)


@pytest.fixture(scope="session")
def tracked(street):
    """What is seen of the street, on the tracks of its cars."""
    found, truth = observe(street, ObserverConfig())
    return found.with_tracks(truth)


@pytest.fixture(scope="session")
def only():
    """Take a detection set to its detections on some tracks."""

    def keep(detections, *tracks):
        kept = tuple(d for d in detections.detections if d.track_id in tracks)
        return DetectionSet(detections.images, detections.categories, kept)

    return keep


@pytest.fixture(scope="session")
def box_detection(camera):
    """Make a detection whose mask is its box."""

    def make(number, frame, box, track=None, category="car"):
        mask = np.zeros((camera.height, camera.width), np.uint8)
        x, y, w, h = (int(value) for value in box)
        mask[y : y + h, x : x + w] = 1
        return Detection(
            number, frame, category, 0.9, tuple(map(float, box)), encode_mask(mask), mask.shape, track_id=track
        )

    return make


@pytest.fixture(scope="session")
def car_detection(camera, car):
    """Make the detection of a car that stands somewhere, with exact mask and key points."""

    def make(number, frame, world_from_camera, world_from_object, vertices, hidden_by=(), track=1):
        camera_from_world = world_from_camera.inverse()
        camera_from_object = camera_from_world @ world_from_object
        meshes = [(camera_from_object, vertices, car.faces)]
        meshes += [(camera_from_world @ pose, other, car.faces) for pose, other in hidden_by]
        mask = (render(camera, meshes).object_index == 0).astype(np.uint8)
        rows, columns = np.nonzero(mask)
        box = (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)
        points = camera.project(camera_from_object.transform(car.keypoints(vertices)))
        scores = np.full(len(points), 0.9)
        code = encode_mask(mask)
        return Detection(
            number, frame, "car", 0.9, tuple(map(float, box)), code, mask.shape, points, scores, track_id=track
        )

    return make


@pytest.fixture(scope="session")
def as_set(camera, car):
    """Make a detection set of detections in frames 0 to count - 1."""

    def make(count, detections):
        images = tuple(ImageEntry(i, f"{i:06d}.png", camera.width, camera.height) for i in range(count))
        return DetectionSet(images, (CategoryEntry(1, "car", car.keypoint_names),), tuple(detections))

    return make


@pytest.fixture(scope="session")
def drive():
    """Make camera poses `step` metres apart along x, at 1.65 m."""

    def make(count, step=1.0, y=0.0):
        return tuple(Pose(WORLD_FROM_FORWARD, np.array([step * i, y, 1.65])) for i in range(count))

    return make
