import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.exporting import FinishedRun
from meshslam.geometry import Camera, Pose, render
from meshslam.maps import Map, MapObject, Trajectory, TrajectoryEstimate
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry, encode_mask

WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera looks along x
CAMERA = Camera(400, 140, 230.0, 235.0, 198.0, 62.0)
FRAMES = tuple(range(20, 31))
BEGIN_S = 1_317_000_000.125


@pytest.fixture(scope="session")
def run():
    """Three cars along a gentle bend, seen in eleven frames."""
    car, turns = load_category("car"), np.linspace(0.0, 0.2, len(FRAMES))
    poses = tuple(
        Pose(Pose.from_yaw(turn, np.zeros(3)).rotation @ WORLD_FROM_FORWARD, np.array([0.8 * i, 0.1 * i, 1.65]))
        for i, turn in enumerate(turns)
    )
    places = {3: (12.0, 3.0, 0.0), 7: (17.0, -3.0, 3.1), 12: (24.0, 2.5, 0.4)}
    things = tuple(_car(car, number, *place) for number, place in places.items())
    count = len(FRAMES)
    path = Trajectory(BEGIN_S + 0.1 * np.arange(count), poses)
    rng = np.random.default_rng(3)
    roots = rng.normal(0.0, 0.02, (count, 6, 6))
    estimate = TrajectoryEstimate(
        path,
        FRAMES,
        roots @ roots.transpose(0, 2, 1),
        rng.normal(0, 3, (count, 3)),
        rng.normal(0, 0.01, (count, 6)),
        ("images",) * count,
        np.zeros(count, bool),
    )
    found = _detections(poses, things, car.keypoint_names)
    return FinishedRun("a drive", Map(things), path, FRAMES, CAMERA, estimate, found)


def _car(car, number, x, y, yaw):
    return MapObject(
        id=number,
        category="car",
        world_from_object=Pose.from_yaw(yaw, np.array([x, y, car.dimensions[2] / 2])),
        vertices=car.vertices * (1 + 0.02 * number),
        faces=car.faces,
        views=5,
        first_frame=FRAMES[0],
        last_frame=FRAMES[-1],
        mask_iou=0.9,
        pose_covariance=np.diag([0.2, 0.05, 0.04, 0.01, 0.01, 0.02]) ** 2,
        vertex_sigma_m=np.linspace(0.01, 0.4, len(car.vertices)),
        vertex_observed=np.arange(len(car.vertices)) % 3 == 0,
    ).recentred()


def _detections(poses, things, names):
    found = []
    for frame, pose in zip(FRAMES, poses, strict=True):
        for thing in things:
            mask = render(CAMERA, [(pose.inverse() @ thing.world_from_object, thing.vertices, thing.faces)]).mask
            if mask.sum() > 20:
                rows, columns = np.nonzero(mask)
                x, y = float(columns.min()), float(rows.min())
                box = (x, y, float(columns.max() + 1 - x), float(rows.max() + 1 - y))
                number = len(found) + 1
                segments = encode_mask(mask)
                found.append(Detection(number, frame, "car", 0.9, box, segments, mask.shape, track_id=thing.id))
    images = tuple(ImageEntry(frame, f"{frame:010d}.jpg", CAMERA.width, CAMERA.height) for frame in FRAMES)
    return DetectionSet(images, (CategoryEntry(1, "car", names),), tuple(found))
