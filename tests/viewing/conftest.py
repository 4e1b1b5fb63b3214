import numpy as np
import pytest

from meshslam.categories import load_category
from meshslam.geometry import Camera, Pose, render
from meshslam.maps import Map, MapObject, MovingObject, MovingPath
from meshslam.perception import CategoryEntry, Detection, DetectionSet, ImageEntry, encode_mask
from meshslam.viewing import ReportContext

WORLD_FROM_FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # camera looks along x
HEIGHT_M = 1.65


@pytest.fixture(scope="session")
def car():
    return load_category("car")


@pytest.fixture
def camera():
    return Camera(400, 140, 230.0, 235.0, 198.0, 62.0, 0.4)


@pytest.fixture
def path():
    return tuple(Pose(WORLD_FROM_FORWARD, np.array([0.8 * i, 0.1 * i, HEIGHT_M])) for i in range(11))


@pytest.fixture
def make_car(car):
    def make(number, x, y, yaw=0.0, **changes):
        fields = {
            "id": number,
            "category": "car",
            "world_from_object": Pose.from_yaw(yaw, np.array([x, y, car.dimensions[2] / 2])),
            "vertices": car.vertices * (1 + 0.02 * number),
            "faces": car.faces,
            "views": 5,
            "first_frame": 0,
            "last_frame": 10,
            "mask_iou": 0.9,
            "pose_covariance": np.diag([0.2, 0.05, 0.04, 0.01, 0.01, 0.02]) ** 2,
            "vertex_sigma_m": np.linspace(0.0, 0.4, len(car.vertices)),
            "vertex_observed": np.arange(len(car.vertices)) % 3 == 0,
        }
        return MapObject(**(fields | changes))

    return make


@pytest.fixture
def make_moving(make_car):
    """A car that drives along x through some frames of a run, from (x, y)."""

    def make(number, x, y, first=2, count=6, speed=5.0):
        body = make_car(number, x, y)
        height = np.array([0.0, 0.0, body.world_from_object.translation[2]])
        places = [np.array([x + 0.1 * speed * i, y, 0.0]) + height for i in range(count)]
        path = MovingPath(
            10.0 + 0.1 * np.arange(first, first + count),
            tuple(range(first, first + count)),
            tuple(Pose.from_yaw(0.0, place) for place in places),
            np.tile(0.01 * np.eye(6), (count, 1, 1)),
            np.tile([speed, 0.0, 0.0], (count, 1)),
            np.full(count, speed),
            np.full(count, 0.3),
            np.zeros(count),
            np.full(count, 0.01),
        )
        return MovingObject(body, float(path.times_s[0]), path)

    return make


@pytest.fixture
def cars(make_car):
    return Map((make_car(3, 12.0, 3.0), make_car(7, 17.0, -3.0, 3.1), make_car(12, 24.0, 2.5, 0.1)))


@pytest.fixture
def detections(camera, path, cars, car):
    """Exact masks, boxes and key points of every car in every frame, and one that is on no track."""
    found = []
    for frame, pose in enumerate(path):
        for thing in cars.objects:
            camera_from_object = pose.inverse() @ thing.world_from_object
            mask = render(camera, [(camera_from_object, thing.vertices, thing.faces)]).mask
            if mask.sum() > 20:
                points = camera.project(camera_from_object.transform(car.keypoints(thing.vertices)))
                scores = (np.arange(len(points)) % 2).astype(float)
                found.append(_detection(len(found) + 1, frame, mask, thing.id, points, scores))
    stray = np.zeros((camera.height, camera.width), np.uint8)
    stray[5:25, 5:45] = 1
    found.append(_detection(len(found) + 1, 0, stray, None, None, None))
    images = tuple(ImageEntry(i, f"{i:06d}.png", camera.width, camera.height) for i in range(len(path)))
    return DetectionSet(images, (CategoryEntry(1, "car", car.keypoint_names),), tuple(found))


def _detection(number, frame, mask, track, points, scores):
    rows, columns = np.nonzero(mask)
    x, y = int(columns.min()), int(rows.min())
    box = (float(x), float(y), float(columns.max() + 1 - x), float(rows.max() + 1 - y))
    return Detection(number, frame, "car", 0.9, box, encode_mask(mask), mask.shape, points, scores, track)


@pytest.fixture
def context(camera, path, cars, detections, car, rng):
    image = rng.integers(0, 255, (camera.height, camera.width, 3), dtype=np.uint8)
    return ReportContext(
        title="a <street> & more",
        camera=camera,
        frame_ids=tuple(range(len(path))),
        world_from_camera=path,
        times_s=10.0 + 0.1 * np.arange(len(path)),
        detections=detections,
        map=cars,
        read_image=lambda index: np.roll(image, index, axis=1),
        left_out=((4, "moves", "its views agree with 3.6 m/s <fast>"),),
        metrics={"mask_iou_shape": 0.875, "seconds_total": 12.5, "ate_rmse_m": float("nan"), "odd_new_figure_m": 1.25},
        stages={thing.id: (thing.world_from_object, car.vertices) for thing in cars.objects},
    )
