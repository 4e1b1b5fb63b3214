"""What a user of the front door meets first, and meets when something is wrong."""

import numpy as np
import pytest

import meshslam
from meshslam.categories import load_category
from meshslam.errors import DetectionError, GeometryError, MapError, SequenceError
from meshslam.geometry import Camera, Pose, render
from meshslam.mapping import object_from_masks
from meshslam.perception import Detection
from meshslam.sequences import camera_yaml, read_camera_file
from meshslam.simulation import EXACT, StreetConfig, make_street, observe, write_recording

CAMERA = Camera(160, 120, 150.0, 150.0, 79.5, 59.5)
AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # the camera looks along x
POSE = Pose(AHEAD, np.array([-10.0, 0.0, 0.0]))


@pytest.fixture(scope="module")
def drive(tmp_path_factory):
    small = StreetConfig(frames=4, width_px=160, height_px=60, focal_px=95.0, cars_each_side=1, mode="contrast")
    return write_recording(make_street(load_category("car"), 1, small), tmp_path_factory.mktemp("drive") / "drive")


def test_an_imu_of_other_files_takes_the_place_of_the_recordings_own(drive, tmp_path):
    own = meshslam.open_sequence(drive)
    rows = (drive / "imu.csv").read_text().splitlines()
    (tmp_path / "imu.csv").write_text("\n".join(rows[:21]) + "\n")
    (tmp_path / "mounted.yaml").write_text(f"imu_from_camera: {np.eye(4).tolist()}\n")
    other = meshslam.open_sequence(drive, imu=str(tmp_path / "imu.csv"), imu_from_camera=tmp_path / "mounted.yaml")
    assert len(other.imu.times_s) == 20
    assert np.array_equal(other.imu.times_s, own.imu.times_s[:20])
    assert np.array_equal(other.imu_from_camera.matrix, np.eye(4))


def test_samples_between_frames_are_each_handed_over_once(drive):
    recording, last_s, seen = meshslam.open_sequence(drive), -np.inf, []
    for time_s in recording.times_s:
        seen += recording.imu.between(last_s, time_s).times_s.tolist()
        last_s = time_s
    until = recording.imu.times_s <= recording.times_s[-1]
    assert seen == recording.imu.times_s[until].tolist()


def test_frame_by_frame_reads_the_colours_of_a_simulated_world(drive):
    recording = meshslam.open_sequence(drive)
    slam = meshslam.Slam(
        recording.camera,
        imu_from_camera=recording.imu_from_camera,
        start=recording.initial_state,
        segmenter="colour",
    )
    for index, time_s in enumerate(recording.times_s):
        state = slam.process(image=recording.read_image(index), imu=recording.imu, time_s=time_s)
        assert state.is_started
    assert len(slam.finish().detections.detections) > 4


def test_a_detection_from_a_mask_has_its_box_and_its_mask():
    mask = np.zeros((20, 30), bool)
    mask[5:10, 8:20] = True
    found = Detection.from_mask(mask, id=3, frame=7)
    assert found.bbox == (8.0, 5.0, 12.0, 5.0)
    assert np.array_equal(found.mask() > 0, mask)
    assert (found.id, found.frame, found.area_px) == (3, 7, 60)


@pytest.mark.parametrize("mask", [np.zeros((4, 5), np.uint8), np.ones(4, np.uint8)], ids=["empty", "one axis"])
def test_a_mask_that_shows_nothing_is_an_error_in_words(mask):
    with pytest.raises(DetectionError, match="at least one pixel set"):
        Detection.from_mask(mask, id=1, frame=0)


def test_an_object_from_one_mask_covers_it():
    car = load_category("car")
    mask = render(CAMERA, [(POSE.inverse() @ Pose.from_yaw(0.6, np.zeros(3)), car.vertices, car.faces)]).mask
    found = object_from_masks([mask, np.zeros_like(mask)], [POSE, POSE], CAMERA)
    assert found.category == "car"
    assert found.mask_iou > 0.95
    assert found.views == 1


@pytest.mark.parametrize(
    ("masks", "poses", "words"),
    [
        ([np.zeros((120, 160), np.uint8)], [POSE], "every mask is empty"),
        ([np.zeros((120, 160), np.uint8)], [POSE, POSE], "found 1 masks and 2 poses"),
        ([np.zeros((120, 100), np.uint8)], [POSE], r"mask 0 has shape \(120, 100\), expected the camera's"),
        ([np.eye(120, 160, dtype=np.uint8)], [POSE], "no car fits the masks: "),
    ],
    ids=["empty", "numbers", "size", "no car"],
)
def test_masks_without_an_object_say_why(masks, poses, words):
    with pytest.raises(MapError, match=words):
        object_from_masks(masks, poses, CAMERA)


def test_evaluate_says_which_folder_is_missing(drive, tmp_path):
    with pytest.raises(MapError, match="no run: expected a folder with"):
        meshslam.evaluate(tmp_path / "nowhere", drive)
    meshslam.Trajectory(np.zeros(1), (POSE,)).save(str(tmp_path / "trajectory.tum"))
    with pytest.raises(SequenceError, match="no such folder"):
        meshslam.evaluate(tmp_path, tmp_path / "nowhere")


def test_a_camera_file_is_read_without_a_report(tmp_path):
    (tmp_path / "camera.yaml").write_text(camera_yaml(CAMERA, None, None, 1.5))
    assert read_camera_file(tmp_path / "camera.yaml").camera == CAMERA


def test_ids_of_a_frame_s_objects_are_those_of_the_map():
    config = StreetConfig(frames=12, width_px=480, height_px=150, focal_px=285.0, cars_each_side=2, moving_cars=0)
    street = make_street(load_category("car"), 1, config)
    seen, truth = observe(street, EXACT)
    by_frame = seen.with_tracks({detection: 40 + car for detection, car in truth.items()}).by_frame()
    slam, shown = meshslam.Slam(street.camera, by_odometry=True), set()
    for frame, pose in enumerate(street.world_from_camera):
        time_s = float(street.times_s[frame])
        state = slam.process(time_s=time_s, detections=by_frame[frame], odometry=pose, frame=frame)
        scene = slam.map()
        assert set(state.objects) <= set(scene)
        shown |= set(state.objects)
    assert shown == {41, 42, 43, 44}
    for number, mark in ((mark.track, mark) for mark in slam.landmarks()):
        alone = slam._estimator.landmark_covariance(mark.number)
        assert np.allclose(scene[number].pose_covariance, alone, rtol=0, atol=1e-3 * np.abs(alone).max())


@pytest.mark.parametrize(
    "image",
    [np.zeros((60, 160), np.uint8), np.zeros((60, 100, 3), np.uint8), np.zeros((60, 160, 3)), "000000.png"],
    ids=["grey", "size", "floats", "name"],
)
def test_an_image_of_another_kind_is_an_error_in_words(drive, image):
    slam = meshslam.Slam(meshslam.open_sequence(drive).camera, segmenter="colour")
    with pytest.raises(GeometryError, match=r"frame 0: an image is uint8 BGR \(60, 160, 3\), found"):
        slam.process(image=image, time_s=0.0)
