import pickle
import re
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences import (
    Distortion,
    ImuSamples,
    RecordingOptions,
    camera_yaml,
    check_sequence,
    open_sequence,
    open_with,
    write_sequence_folder,
)
from tests.sequences.bag_writing import (
    BODY,
    IMAGE,
    IMU,
    INFO,
    ODOMETRY,
    RADTAN,
    START_NS,
    Recorded,
    Ros,
    Said,
    foxglove_of,
    png_of,
    said_of,
    write_foxglove,
    write_mcap,
    write_ros1,
    write_ros2,
)
from tests.sequences.conftest import CAMERA, FRAMES, random_image, random_pose

pytest.importorskip("rosbags")
pytest.importorskip("mcap")


@pytest.fixture
def recorded(rng) -> Recorded:
    times_ns = [START_NS + i * 100_000_000 for i in range(FRAMES)]
    imu_times_s = START_NS / 1e9 + np.arange(-2, 45) * 0.01
    return Recorded(
        camera=CAMERA,
        times_ns=times_ns,
        images=[random_image(rng) for _ in times_ns],
        imu=ImuSamples(imu_times_s, rng.normal(size=(47, 3)), rng.normal(size=(47, 3))),
        world_from_body=[
            Pose(Rotation.from_rotvec([0.01 * i, 0, 0.2 * i]).as_matrix(), np.array([1.0 * i, 0, 0]))
            for i in range(FRAMES)
        ],
        camera_from_body=random_pose(rng),
        imu_from_camera=random_pose(rng),
    )


@pytest.fixture
def as_folder(recorded, tmp_path):
    """The same recording as a sequence folder."""
    return open_sequence(
        write_sequence_folder(
            tmp_path / "as_folder",
            CAMERA,
            np.array(recorded.times_ns) / 1e9,
            images=recorded.images,
            world_from_camera=[p @ recorded.camera_from_body.inverse() for p in recorded.world_from_body],
            imu=recorded.imu,
            imu_from_camera=recorded.imu_from_camera,
            distortion=Distortion(CAMERA, CAMERA, np.array(RADTAN)),
        )
    )


def expect_same(bag, folder, *, has_imu=True):
    assert bag.camera == folder.camera
    assert bag.frame_ids == folder.frame_ids
    np.testing.assert_allclose(bag.times_s, folder.times_s, atol=1e-6)
    assert bag.images.names == folder.images.names
    for i in range(len(folder)):
        np.testing.assert_array_equal(bag.read_image(i), folder.read_image(i))
    np.testing.assert_allclose(
        [p.matrix for p in bag.world_from_camera], [p.matrix for p in folder.world_from_camera], atol=1e-6
    )
    np.testing.assert_array_equal(bag.distortion.coefficients, folder.distortion.coefficients)
    if has_imu:
        np.testing.assert_allclose(bag.imu_from_camera.matrix, folder.imu_from_camera.matrix, atol=1e-6)
        np.testing.assert_allclose(bag.imu.times_s, folder.imu.times_s, atol=1e-6)
        np.testing.assert_allclose(bag.imu.angular_rate_rad_s, folder.imu.angular_rate_rad_s, atol=1e-6)
        np.testing.assert_allclose(bag.imu.specific_force_m_s2, folder.imu.specific_force_m_s2, atol=1e-6)


ROS1, ROS2 = (pytest.param(v, id=f"ros{v}") for v in (1, 2))
WRITERS = {
    "ros1": lambda path, said: write_ros1(path / "drive.bag", Ros(1), said(Ros(1))),
    "ros1-lz4": lambda path, said: write_ros1(path / "drive.bag", Ros(1), said(Ros(1)), "LZ4"),
    "ros1-bz2": lambda path, said: write_ros1(path / "drive.bag", Ros(1), said(Ros(1)), "BZ2"),
    "ros2-sqlite": lambda path, said: write_ros2(path / "drive", Ros(2), said(Ros(2))),
    "ros2-sqlite-zstd": lambda path, said: write_ros2(path / "drive", Ros(2), said(Ros(2)), mode="MESSAGE"),
    "ros2-mcap": lambda path, said: write_ros2(path / "drive", Ros(2), said(Ros(2)), "MCAP"),
    "ros2-mcap-zstd": lambda path, said: write_ros2(path / "drive", Ros(2), said(Ros(2)), "MCAP", "STORAGE"),
    "ros2-mcap-message": lambda path, said: write_ros2(path / "drive", Ros(2), said(Ros(2)), "MCAP", "MESSAGE"),
    "mcap-ros1": lambda path, said: write_mcap(path / "drive.mcap", Ros(1), said(Ros(1))),
    "mcap-ros2": lambda path, said: write_mcap(path / "drive.mcap", Ros(2), said(Ros(2))),
    "mcap-bare": lambda path, said: write_mcap(path / "drive.mcap", Ros(2), said(Ros(2)), use_chunking=False),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("is_compressed", [False, True], ids=["raw", "png"])
def test_a_bag_is_the_sequence_folder_of_the_same_data(name, is_compressed, recorded, as_folder, tmp_path):
    path = WRITERS[name](tmp_path, lambda ros: said_of(ros, recorded, png_of(ros) if is_compressed else None))
    bag = open_sequence(path)
    assert bag.layout == ("mcap" if name.startswith("mcap") else "ros-bag")
    expect_same(bag, as_folder)
    assert check_sequence(path) == [] or all(p.severity == "note" for p in check_sequence(path))
    assert any(f"{IMAGE}: the only topic with images" in note for note in bag.notes)


@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_foxglove_schemas_are_read(encoding, recorded, as_folder, tmp_path):
    if encoding == "protobuf":
        pytest.importorskip("foxglove_schemas_protobuf")
        pytest.importorskip("mcap_protobuf")
    bag = open_sequence(write_foxglove(tmp_path / "drive.mcap", foxglove_of(recorded), encoding))
    expect_same(bag, as_folder, has_imu=False)
    assert bag.imu is None
    assert any("poses are those of camera_optical in odom" in note for note in bag.notes)


def write2(tmp_path, said, name="drive"):
    return write_ros2(tmp_path / name, Ros(2), said)


def without(said, *topics):
    return [s for s in said if s.topic not in topics]


@pytest.fixture
def ros():
    return Ros(2)


@pytest.fixture
def said(ros, recorded):
    return said_of(ros, recorded)


def test_copies_hold_no_handle_and_digests_follow_the_content(recorded, said, ros, tmp_path):
    path = write2(tmp_path, said)
    images = open_sequence(path).images
    copy = pickle.loads(pickle.dumps(images))
    np.testing.assert_array_equal(copy.read(3, None), recorded.images[3])
    assert copy.digests() == images.digests()
    assert len(set(images.digests())) == FRAMES
    assert images.part([3]).digests() == images.digests()[3:4]
    recorded.images[0] = recorded.images[0] + np.uint8(1)
    other = open_sequence(write2(tmp_path / "other", said_of(ros, recorded))).images
    assert set(other.digests()).isdisjoint(images.digests())


def test_images_are_ordered_by_their_stamps_not_by_when_they_were_written(recorded, said, as_folder, tmp_path):
    images = [s for s in said if s.topic == IMAGE]
    logs = [s.log_ns for s in images]
    for s, log_ns in zip(images, [logs[1], logs[0], *logs[2:]], strict=True):
        s.log_ns = log_ns
    bag = open_sequence(write2(tmp_path, sorted(said, key=lambda s: s.log_ns)))
    expect_same(bag, as_folder)
    assert any("put in order" in note for note in bag.notes)


def test_stamps_of_zero_give_way_to_the_times_of_writing(ros, said, recorded, tmp_path):
    for s in said:
        if s.topic == IMAGE:
            s.message.header.stamp = ros.time(0)
    bag = open_sequence(write2(tmp_path, said))
    np.testing.assert_allclose(bag.times_s, np.array(recorded.times_ns) / 1e9 + 0.005, atol=1e-6)
    assert any("header stamps are all zero" in note for note in bag.notes)


def test_of_images_with_one_stamp_the_first_is_kept(ros, said, recorded, tmp_path):
    images = [s for s in said if s.topic == IMAGE]
    images[2].message.header.stamp = images[1].message.header.stamp
    bag = open_sequence(write2(tmp_path, said))
    assert len(bag) == FRAMES - 1
    assert any("1 messages have another's stamp" in note for note in bag.notes)


def test_a_second_camera_must_be_chosen(ros, said, recorded, as_folder, tmp_path):
    right = [Said("/right/image_raw", s.log_ns, s.message) for s in said if s.topic == IMAGE]
    path = write2(tmp_path, said + right)
    with pytest.raises(SequenceError, match=r"2 topics hold images, /camera/image_raw, /right/image_raw: choose by "):
        open_sequence(path)
    expect_same(open_sequence(path, topics={"image": IMAGE}), as_folder)
    with pytest.raises(SequenceError, match=r"--topic image=/nothing: no such topic; topics with images are /camera"):
        open_sequence(path, topics={"image": "/nothing"})
    with pytest.raises(SequenceError, match=r"its type is sensor_msgs/msg/Imu; topics with images are"):
        open_sequence(path, topics={"image": IMU})
    with pytest.raises(SequenceError, match=r"by --topic image=/…"):
        open_sequence(path, camera_number=1)


@pytest.mark.parametrize(("height_m", "expected"), [(1.4, 1.4), (-0.2, None)])
def test_the_height_is_that_over_base_footprint(height_m, expected, ros, said, recorded, tmp_path):
    body_from_camera = recorded.camera_from_body.inverse()
    lifted = Pose(np.eye(3), np.array([0.0, 0.0, height_m - body_from_camera.translation[2]]))
    footprint = Said("/tf_static", START_NS, ros.transforms(0, [("base_footprint", BODY, lifted)]))
    found = open_sequence(write_ros2(tmp_path / "bag", ros, [footprint, *said]))
    assert found.height_above_ground_m == (None if expected is None else pytest.approx(expected, abs=1e-9))


def test_of_two_topics_with_poses_none_is_guessed(ros, said, recorded, as_folder, tmp_path):
    other = [Said("/gps", s.log_ns, s.message) for s in said if s.topic == ODOMETRY]
    path = write2(tmp_path, said + other)
    bag = open_sequence(path)
    assert bag.world_from_camera is None
    assert any("2 topics hold poses, /gps, /odom: none is taken" in note for note in bag.notes)
    expect_same(open_sequence(path, topics={"poses": ODOMETRY}), as_folder)


def test_without_an_image_topic_the_topics_are_listed(said, tmp_path):
    with pytest.raises(SequenceError, match=r"no topic holds images; it has .*/tf_static \(tf2_msgs/msg/TFMessage\)"):
        open_sequence(write2(tmp_path, without(said, IMAGE)))


def test_without_calibration_a_camera_file_is_asked_for_and_taken(said, recorded, as_folder, tmp_path):
    path = write2(tmp_path, without(said, INFO))
    with pytest.raises(SequenceError, match=r"/camera/image_raw: its camera is not known, .*: give --camera FILE"):
        open_sequence(path)
    expect_same(open_sequence(path, camera=as_folder.root / "camera.yaml"), as_folder)
    half = open_sequence(write2(tmp_path / "half", without(said, INFO)), camera=as_folder.root / "camera.yaml")
    assert half.raw_camera == CAMERA


def test_a_camera_file_is_scaled_to_the_size_that_is_given(ros, said, as_folder, tmp_path):
    for s in said:
        if s.topic == IMAGE:
            pixels = s.message.data.reshape(48, 64, 3)[::2, ::2]
            s.message = ros.image(s.log_ns, pixels)
    path = write2(tmp_path, without(said, INFO))
    file = as_folder.root / "camera.yaml"
    with pytest.raises(SequenceError, match=r"which do not scale to 32x32"):
        open_sequence(path, camera=file, size=(32, 32))
    for size in (None, (32, 24)):
        found = open_sequence(path, camera=file, size=size).raw_camera
        assert (found.width, found.fx, found.cx, found.cy) == (32, CAMERA.fx / 2, 15.5, 11.5)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"k": np.zeros(9)}, "not calibrated: K is zero"),
        ({"model": "mei", "d": (0.1, 0, 0, 0)}, "the lens model 'mei' is not read"),
        ({"d": (0.1,) * 7, "model": "rational_polynomial"}, "found 7 numbers"),
        ({"d": (0.0,) * 8, "model": "rational_polynomial"}, None),
        ({"d": (), "model": ""}, None),
    ],
)
def test_calibrations_that_cannot_be_used_are_refused(given, message, ros, said, tmp_path):
    for s in said:
        if s.topic == INFO:
            s.message = ros.info(s.log_ns, CAMERA, **given)
    path = write2(tmp_path, said)
    if message is None:
        assert open_sequence(path).distortion is None
    else:
        with pytest.raises(SequenceError, match=re.escape(message)):
            open_sequence(path)


def test_a_changing_calibration_is_noted(ros, said, recorded, as_folder, tmp_path):
    last = [s for s in said if s.topic == INFO][-1]
    last.message = ros.info(last.log_ns, replace(CAMERA, fx=70.0), RADTAN)
    bag = open_sequence(write2(tmp_path, said))
    expect_same(bag, as_folder)
    assert any("the calibration changes 1 times: the first is taken" in note for note in bag.notes)


def test_rectified_images_have_the_projection_and_no_distortion(ros, said, tmp_path):
    projection = [50.0, 0, 30, 0, 0, 51, 20, 0, 0, 0, 1, 0]
    for s in said:
        s.topic = s.topic.replace("image_raw", "image_rect_color")
        if s.topic == INFO:
            s.message = ros.info(s.log_ns, CAMERA, RADTAN, p=projection)
    bag = open_sequence(write2(tmp_path, said))
    assert (bag.camera.fx, bag.camera.fy, bag.camera.cx, bag.camera.cy) == (50, 51, 30, 20)
    assert bag.distortion is None
    assert any("rectified by its name" in note for note in bag.notes)


def test_without_transforms_it_is_said_what_is_missing(said, as_folder, recorded, tmp_path):
    path = write2(tmp_path, without(said, "/tf_static"))
    bag = open_sequence(path)
    assert bag.imu is not None
    assert bag.imu_from_camera is None
    assert bag.world_from_camera is None
    assert any("localize and slam need --imu-from-camera FILE" in note for note in bag.notes)
    assert any("not used, give --camera-from-body FILE" in note for note in bag.notes)
    mounting = tmp_path / "camera_from_body.yaml"
    mounting.write_text(f"camera_from_body: {recorded.camera_from_body.matrix.tolist()}\n")
    given = open_sequence(path, camera_from_body=mounting, imu_from_camera=as_folder.root / "camera.yaml")
    expect_same(given, as_folder)


def test_poses_without_a_body_are_the_cameras(ros, said, recorded, as_folder, tmp_path):
    poses = iter(as_folder.world_from_camera)
    for s in said:
        if s.topic == ODOMETRY:
            ns = s.message.header.stamp
            s.message = ros.pose_stamped(ns.sec * 10**9 + ns.nanosec, next(poses))
            s.kind = "geometry_msgs/msg/PoseStamped"
    bag = open_sequence(write2(tmp_path, said))
    expect_same(bag, as_folder)
    assert any("poses that name no body are taken as the camera's" in note for note in bag.notes)


def test_poses_are_taken_from_moving_transforms(ros, said, recorded, as_folder, tmp_path):
    moving = [
        Said("/tf", ns, ros.transforms(ns, [("odom", "base_link", pose)]))
        for ns, pose in zip(recorded.times_ns, recorded.world_from_body, strict=True)
    ]
    path = write2(tmp_path, without(said, ODOMETRY) + moving)
    expect_same(open_sequence(path), as_folder)
    both = write2(tmp_path / "both", said + moving)
    expect_same(open_sequence(both, topics={"poses": "/tf"}), as_folder)
    with pytest.raises(SequenceError, match="transforms do not tell how camera_optical"):
        open_sequence(write2(tmp_path / "none", said), topics={"poses": "/tf_static"})


def mosaic(pattern: str, colour: dict[str, int]) -> np.ndarray:
    image = np.zeros((48, 64), np.uint8)
    for k, letter in enumerate(pattern):
        image[k // 2 :: 2, k % 2 :: 2] = colour[letter]
    return image


GREY = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64)
COLOUR = {"b": 40, "g": 90, "r": 200}
YUV = np.round(
    [16, 128, 128]
    + np.array(  # ITU-R BT.601, of video's range
        [[65.738, 129.057, 25.064], [-37.945, -74.494, 112.439], [112.439, -94.154, -18.285]]
    )
    @ [200, 90, 40]
    / 256
)


def yuv422(order: str) -> np.ndarray:
    values = {"y": YUV[0], "u": YUV[1], "v": YUV[2]}
    return np.tile(np.array([values[c] for c in order], np.uint8), (48, 32))


@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", np.full((48, 64, 3), (200, 90, 40), np.uint8)),
        ("rgba8", np.full((48, 64, 4), (200, 90, 40, 7), np.uint8)),
        ("bgra8", np.full((48, 64, 4), (40, 90, 200, 7), np.uint8)),
        *((f"bayer_{p}8", mosaic(p, COLOUR)) for p in ("rggb", "bggr", "gbrg", "grbg")),
        ("yuv422", yuv422("uyvy")),
        ("uyvy", yuv422("uyvy")),
        ("yuyv", yuv422("yuyv")),
        ("yuv422_yuy2", yuv422("yuyv")),
    ],
)
def test_every_encoding_gives_the_same_colour(encoding, pixels, ros, said, tmp_path):
    for s in said:
        if s.topic == IMAGE:
            s.message = ros.image(s.log_ns, pixels, encoding, size=(48, 64))
    image = open_sequence(write2(tmp_path, said)).images.read(0, (64, 48))
    assert image.shape == (48, 64, 3)
    np.testing.assert_allclose(image[4:-4, 4:-4].reshape(-1, 3), np.tile([40, 90, 200], (40 * 56, 1)), atol=3)


@pytest.mark.parametrize("big", [0, 1])
def test_16_bits_are_scaled_by_what_the_recording_has(big, ros, said, tmp_path):
    pixels = GREY.astype(">u2" if big else "<u2")
    for s in said:
        if s.topic == IMAGE:
            s.message = ros.image(s.log_ns, pixels, "mono16", big=big)
    bag = open_sequence(write2(tmp_path, said))
    np.testing.assert_array_equal(bag.images.read(0, None)[..., 1], GREY // 16)
    assert any("values have 12 bits" in note for note in bag.notes)


def test_padded_rows_do_not_slant(ros, said, recorded, as_folder, tmp_path):
    images = iter(recorded.images)
    for s in said:
        if s.topic == IMAGE:
            time = s.message.header.stamp
            padded = np.pad(next(images).reshape(48, -1), ((0, 0), (0, 8)), constant_values=255)
            s.message = ros.image(time.sec * 10**9 + time.nanosec, padded, step=64 * 3 + 8, size=(48, 64))
    expect_same(open_sequence(write2(tmp_path, said)), as_folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"encoding": "32FC1"}, "only depth images are there, /camera/image_raw (32FC1): a camera's images are needed"),
        ({"encoding": "16UC1"}, "only depth images are there, /camera/image_raw (16UC1)"),
        ({"encoding": "8UC9"}, "unknown encoding '8UC9': known are mono8"),
        ({"step": 10}, "bytes for an image bgr8 of 64x48: expected 48 rows of 192 bytes every 10"),
        ({"size": (490, 64)}, "9216 bytes for an image bgr8 of 64x490"),
        ({"size": (2**16, 2**16)}, "image of 65536x65536 pixels"),
        ({"size": (0, 64)}, "image of 64x0 pixels"),
    ],
)
def test_images_that_cannot_be_are_one_line(change, message, ros, said, tmp_path):
    pixels = np.zeros((48, 64, 3), np.uint8)
    for s in said:
        if s.topic == IMAGE:
            s.message = ros.image(s.log_ns, pixels, **{"step": 192, "size": (48, 64)} | change)
    with pytest.raises(SequenceError) as caught:
        open_sequence(write2(tmp_path, said))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_damaged_compressed_image_is_named_by_its_frame(ros, recorded, tmp_path):
    content = cv2.imencode(".png", recorded.images[0])[1].tobytes()
    damaged = iter([content, content, content[:-30], content, content])
    said = said_of(ros, recorded, lambda ns, _: ros.compressed(ns, next(damaged), "png"))
    bag = open_sequence(write2(tmp_path, said))
    with pytest.raises(SequenceError, match=r"image_raw, frame 2: PNG is truncated.*\(format 'png'\)"):
        bag.read_image(2)
    assert any("frame 2" in str(p) for p in check_sequence(bag.root) if p.severity == "problem")


@pytest.mark.parametrize("form", ["jpeg", "bgr8; jpeg compressed bgr8", "rgb8; jpeg compressed bgr8", ""])
def test_formats_dialects_are_told_by_the_content(form, ros, recorded, tmp_path):
    pixels = np.full((48, 64, 3), (40, 90, 200), np.uint8)
    content = cv2.imencode(".jpg", pixels)[1].tobytes()
    said = said_of(ros, recorded, lambda ns, _: ros.compressed(ns, content, form))
    np.testing.assert_allclose(open_sequence(write2(tmp_path, said)).images.read(0, (64, 48)), pixels, atol=3)


def test_a_compressed_mosaic_becomes_colour(ros, recorded, tmp_path):
    content = cv2.imencode(".png", mosaic("rggb", COLOUR))[1].tobytes()
    form = "bayer_rggb8; png compressed bayer_rggb8"
    said = said_of(ros, recorded, lambda ns, _: ros.compressed(ns, content, form))
    image = open_sequence(write2(tmp_path, said)).images.read(0, (64, 48))
    np.testing.assert_allclose(image[10, 10], [40, 90, 200], atol=3)


@pytest.mark.parametrize("name", ["ros1", "ros1-lz4", "mcap-ros2", "mcap-bare", "ros2-sqlite", "ros2-mcap-zstd"])
def test_of_a_cut_file_what_is_whole_is_read(name, recorded, tmp_path):
    recorded.images = [np.random.default_rng(i).integers(0, 256, (480, 640, 3), np.uint8) for i in range(FRAMES)]
    recorded.camera = replace(CAMERA, width=640, height=480)
    recorded.distortion = ()
    path = WRITERS[name](tmp_path, lambda ros: said_of(ros, recorded))
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix in (".db3", ".mcap"))
    file.write_bytes(file.read_bytes()[: file.stat().st_size * 7 // 10])
    bag = open_sequence(path)
    assert 1 <= len(bag) < FRAMES
    np.testing.assert_array_equal(bag.images.read(0, None), recorded.images[0])
    assert any("cut" in note and "read" in note for note in bag.notes)
    assert any(re.search(r"\d+ messages could be read of a bag that is cut", note) for note in bag.notes)


def test_a_folder_without_metadata_is_read_and_noted(said, as_folder, tmp_path):
    path = write2(tmp_path, said)
    (path / "metadata.yaml").unlink()
    bag = open_sequence(path)
    expect_same(bag, as_folder)
    assert any("metadata.yaml is missing" in note for note in bag.notes)


def test_a_folder_of_several_recordings_is_none(said, tmp_path):
    for path in (write2(tmp_path / "a", said), write2(tmp_path / "b", said)):
        (found,) = path.glob("*.db3")
        found.rename(tmp_path / f"{path.parent.name}.db3")
    with pytest.raises(SequenceError, match=r"holds 2 recordings \(a\.db3, b\.db3\): name one of the files"):
        open_sequence(tmp_path)


@pytest.mark.parametrize("name", ["ros1", "mcap-ros2", "ros2-mcap", "ros2-sqlite"])
def test_an_empty_bag_is_one_line(name, tmp_path):
    with pytest.raises(SequenceError, match="the bag holds no messages"):
        open_sequence(WRITERS[name](tmp_path, lambda ros: []))


@pytest.mark.parametrize("name", ["ros1", "mcap-ros2", "ros2-mcap", "ros2-sqlite"])
@pytest.mark.parametrize("seed", range(6))
def test_damaged_bytes_raise_nothing_but_our_own_error(name, seed, recorded, tmp_path):
    path = WRITERS[name](tmp_path, lambda ros: said_of(ros, recorded))
    file = path if path.is_file() else next(p for p in path.iterdir() if p.suffix in (".db3", ".mcap"))
    content, rng = bytearray(file.read_bytes()), np.random.default_rng(seed)
    for at in rng.integers(20, len(content), 40):
        content[at] = rng.integers(256)
    file.write_bytes(content)
    said = ""
    try:
        bag = open_sequence(path)
        for i in range(len(bag)):
            bag.images.read(i, None)
    except SequenceError as error:
        said = str(error)
    assert "\n" not in said
    assert len(said) < 300 + len(str(path))


def test_a_chunk_that_unpacks_beyond_measure_is_left_out(said, ros, tmp_path, monkeypatch):
    monkeypatch.setattr("meshslam.sequences.bags.unpacking.LARGEST_CHUNK", 1000)
    with pytest.raises(SequenceError, match="the bag holds no messages"):
        open_sequence(write_mcap(tmp_path / "drive.mcap", ros, said))


def test_samples_that_are_no_numbers_are_left_out(ros, said, tmp_path):
    first = next(s for s in said if s.topic == IMU)
    first.message.angular_velocity.x = float("nan")
    bag = open_sequence(write2(tmp_path, said))
    assert len(bag.imu.times_s) == 46
    assert any("/imu/data: 1 of 47 messages left out" in note for note in bag.notes)


def test_messages_of_an_interrupted_chunk_lie_bare(recorded, as_folder, tmp_path):
    path = write_ros1(tmp_path / "drive.bag", Ros(1), said_of(Ros(1), recorded))
    content = bytearray(path.read_bytes())
    at = content.index(b"op=\x05") + 4  # the chunk's header; its data's length follows
    end = content.index(b"size=", at) + 9
    assert int.from_bytes(content[end : end + 4], "little") > 10_000
    content[end : end + 4] = bytes(4)
    path.write_bytes(content)
    expect_same(open_sequence(path), as_folder)


def test_the_rest_of_a_damaged_chunk_is_noted(ros, said, tmp_path):
    from mcap.writer import CompressionType

    plain = {"chunk_size": 10**6, "enable_crcs": False, "compression": CompressionType.NONE}
    path = write_mcap(tmp_path / "drive.mcap", ros, said, **plain)
    content = bytearray(path.read_bytes())
    third = [s for s in said if s.topic == IMAGE][2]
    at = content.index(bytes(ros.types.serialize_cdr(third.message, third.kind))) - 31  # record's and message's heads
    content[at + 1 : at + 9] = b"\xff" * 8
    path.write_bytes(content)
    bag = open_sequence(path)
    assert len(bag) == 2
    assert any("the rest of a damaged chunk: left out" in note for note in bag.notes)


def test_an_imu_of_another_clock_is_left_out(ros, said, tmp_path):
    for s in said:
        if s.topic == IMU:
            s.message.header.stamp = ros.time(s.log_ns - START_NS + 10**10)
    bag = open_sequence(write2(tmp_path, said))
    assert bag.imu is None
    assert any("another clock? The IMU is left out" in note for note in bag.notes)


def test_transforms_within_a_robot_are_no_poses(ros, said, recorded, tmp_path):
    moving = [
        Said("/tf", ns, ros.transforms(ns, [("turret", "base_link", pose)]))
        for ns, pose in zip(recorded.times_ns, recorded.world_from_body, strict=True)
    ]
    path = write2(tmp_path, without(said, ODOMETRY) + moving)
    bag = open_sequence(path)
    assert bag.world_from_camera is None
    assert any("move camera_optical in turret: not taken as poses" in note for note in bag.notes)
    assert open_sequence(path, topics={"poses": "/tf"}).world_from_camera is not None


def test_the_calibration_of_a_compressed_topic_stands_two_names_up(ros, said, tmp_path):
    for s in said:
        s.topic = s.topic.replace("image_raw", "image_raw/compressed")
    other = [
        Said("/right/camera_info", s.log_ns, ros.info(0, replace(CAMERA, fx=1.0))) for s in said if s.topic == INFO
    ]
    assert open_sequence(write2(tmp_path, other + said)).raw_camera == CAMERA


def test_a_type_without_a_proper_name_is_not_compiled(said, ros, tmp_path):
    path = write_mcap(tmp_path / "drive.mcap", ros, said, use_chunking=False)
    path.write_bytes(path.read_bytes().replace(b"sensor_msgs/msg/Image", b'sensor_msgs/m"g/Image'))
    with pytest.raises(SequenceError, match="no topic holds images"):
        open_sequence(path)


def test_the_extra_is_named_where_it_is_missing(said, tmp_path, monkeypatch):
    path = write2(tmp_path, said)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(SequenceError, match=r'pip install "meshslam\[bags\]"'):
        open_sequence(path)


def test_lens_models_of_ros_are_read(ros, said, tmp_path):
    bent = (-0.1, 0.01, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0)
    for s in said:
        if s.topic == INFO:
            s.message = ros.info(s.log_ns, CAMERA, bent, model="rational_polynomial")
    found = open_sequence(write2(tmp_path, said)).distortion
    assert (found.model, found.raw_camera.fx) == ("rational", CAMERA.fx)
    assert np.allclose(found.coefficients, bent)


def no_reading(*_):
    raise AssertionError("the bag is read through again")


@pytest.mark.parametrize("name", WRITERS)
def test_with_its_kept_index_a_bag_is_the_same_and_not_read_through(name, recorded, as_folder, tmp_path, monkeypatch):
    path = WRITERS[name](tmp_path, lambda ros: said_of(ros, recorded))
    first = open_sequence(path)
    first.index.save(tmp_path / "kept.npz")
    monkeypatch.setattr("meshslam.sequences.bags.index_file.build_index", no_reading)
    found = open_with(path, RecordingOptions(kept_index=tmp_path / "kept.npz"))
    expect_same(found, as_folder)
    assert found.notes == first.notes
    assert found.images.digests() == first.images.digests()


def test_notes_and_refusals_of_a_kept_index_are_those_of_the_bag(ros, said, tmp_path):
    path = write2(tmp_path, [s for s in said if s.topic != INFO])
    with pytest.raises(SequenceError) as refused:
        open_sequence(path)
    camera = tmp_path / "camera.yaml"
    camera.write_text(camera_yaml(CAMERA))
    open_with(path, RecordingOptions(camera_file=camera)).index.save(tmp_path / "kept.npz")
    with pytest.raises(SequenceError, match=re.escape(str(refused.value))):
        open_with(path, RecordingOptions(kept_index=tmp_path / "kept.npz"))


def test_an_index_of_other_files_or_a_damaged_one_is_made_anew(ros, said, recorded, as_folder, tmp_path):
    path, kept = write2(tmp_path, said), tmp_path / "kept.npz"
    open_sequence(path).index.save(kept)
    content = kept.read_bytes()
    for damaged in (b"", content[:200], content[: len(content) // 2], b"PK\x03\x04" + content[4:-30] + bytes(30)):
        kept.write_bytes(damaged)
        expect_same(open_with(path, RecordingOptions(kept_index=kept)), as_folder)
    kept.write_bytes(content)
    shutil.rmtree(path)
    write2(tmp_path, [s for s in said if s.topic != IMU])
    assert open_with(path, RecordingOptions(kept_index=kept)).imu is None


@pytest.mark.parametrize("name", ["ros2-sqlite", "mcap-ros2", "mcap-bare"])
def test_progress_of_reading_a_bag_rises_to_its_end(name, recorded, tmp_path, monkeypatch):
    monkeypatch.setattr("meshslam.sequences.report._QUICK_S", 0.0)
    monkeypatch.setattr("meshslam.sequences.bags.index._COUNTED", 1)
    path, told = WRITERS[name](tmp_path, lambda ros: said_of(ros, recorded)), []
    open_with(path, RecordingOptions(progress=lambda *said: told.append(said)))
    done = [share for _, share, _ in told]
    assert done == sorted(done)
    assert {(step, total) for step, _, total in told} == {("bag's index", 100)}
    assert done[0] <= 20
    assert 80 <= done[-1] <= 100


def test_what_is_quick_shows_no_progress(said, tmp_path):
    told = []
    open_with(write2(tmp_path, said), RecordingOptions(progress=lambda *said: told.append(said)))
    assert told == []
