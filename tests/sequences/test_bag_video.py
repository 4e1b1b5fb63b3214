"""Bags of compressed video, depth images beside a camera's, and files that are compressed as a whole."""

import bz2
import copy
import gzip
import pickle
from fractions import Fraction

import numpy as np
import pytest
import yaml

from meshslam.errors import SequenceError
from meshslam.sequences import RecordingOptions, find_loader, open_sequence, open_with
from meshslam.sequences.bags.unpacking import COMMANDS
from tests.sequences.bag_writing import Ros, foxglove_of, said_of, write_foxglove, write_ros1, write_ros2
from tests.sequences.test_bags import recorded  # noqa: F401 # a fixture
from tests.sequences.test_video import HEIGHT, WIDTH, camera, differs, picture

av = pytest.importorskip("av")
pytest.importorskip("rosbags")
pytest.importorskip("mcap")
COUNT = 30
ENCODERS = {"h264": "libx264", "h265": "libx265"}


def packets(form, gop=8):
    """One a frame, without pictures that need later ones."""
    encoder = av.CodecContext.create(ENCODERS[form], "w")
    encoder.width, encoder.height, encoder.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    encoder.time_base, encoder.framerate, encoder.gop_size, encoder.max_b_frames = Fraction(1, 30), 30, gop, 0
    encoder.options = {"tune": "zerolatency", "crf": "12", "x265-params": f"log-level=none:bframes=0:keyint={gop}"}
    found = []
    for i in range(COUNT):
        frame = av.VideoFrame.from_ndarray(picture(i), format="bgr24")
        frame.pts = i
        found += [bytes(packet) for packet in encoder.encode(frame)]
    return found + [bytes(packet) for packet in encoder.encode(None)]


def messages(form, data, topic="/camera/video"):
    return [
        (topic, "CompressedVideo", 10**18 + 33_000_000 * i, {"frame_id": "cam", "data": content, "format": form})
        for i, content in enumerate(data)
    ]


def opened(path, **options):
    return open_sequence(path, camera=camera(path.parent), **options)


@pytest.mark.parametrize("form", ENCODERS)
@pytest.mark.parametrize("encoding", ["protobuf", "json"])
def test_video_of_foxglove_is_decoded_in_any_order(tmp_path, form, encoding):
    found = opened(write_foxglove(tmp_path / "drive.mcap", messages(form, packets(form)), encoding))
    assert len(found) == COUNT
    assert np.allclose(np.diff(found.times_s), 0.033, atol=1e-6)
    first = [found.read_image(i) for i in range(COUNT)]
    assert all(differs(image, i) < 6 < differs(image, (i + 9) % COUNT) for i, image in enumerate(first))
    for i in np.random.default_rng(0).permutation(COUNT):
        assert (found.read_image(i) == first[i]).all()
    part = opened(tmp_path / "drive.mcap", frames="5:20:5")
    for other in (part, copy.deepcopy(part), pickle.loads(pickle.dumps(part))):
        assert (other.read_image(2) == first[15]).all()
    assert len(set(found.images.digests())) == COUNT


def test_pictures_before_the_first_key_frame_are_left_out_and_said(tmp_path):
    data = packets("h264")
    found = opened(write_foxglove(tmp_path / "drive.mcap", messages("h264", data[3:]), "protobuf"))
    assert len(found) == COUNT - 8
    assert any("5 pictures before the first key frame cannot be decoded" in note for note in found.notes)
    assert differs(found.read_image(0), 8) < 6
    assert found.times_s[0] == pytest.approx(1e9 + 5 * 0.033)
    found.index.save(tmp_path / "kept.npz")
    given = RecordingOptions(camera_file=camera(tmp_path), kept_index=tmp_path / "kept.npz")
    again = open_with(tmp_path / "drive.mcap", given)
    assert again.notes == found.notes
    assert (again.read_image(4) == found.read_image(4)).all()
    path = write_foxglove(tmp_path / "none.mcap", messages("h264", data[1:7]), "protobuf")
    with pytest.raises(SequenceError, match="its video has no key frame"):
        opened(path)


def test_a_damaged_picture_is_an_error_of_its_frame_and_those_that_need_it(tmp_path):
    data = packets("h264")
    data[10] = data[10][:4] + b"\xff" * 20
    found = opened(write_foxglove(tmp_path / "drive.mcap", messages("h264", data), "protobuf"))
    with pytest.raises(SequenceError, match=r"/camera/video, frame 10: a picture of h264 is damaged"):
        found.read_image(10)
    assert differs(found.read_image(9), 9) < 6
    assert differs(found.read_image(16), 16) < 6


def test_formats_that_are_not_decoded_are_named(tmp_path):
    path = write_foxglove(tmp_path / "drive.mcap", messages("av1", [b"\x12\x00"] * 3), "protobuf")
    with pytest.raises(SequenceError, match="its video is 'av1': only h264 and h265 are read, convert it"):
        opened(path)


def test_without_the_extra_the_error_names_it(tmp_path, monkeypatch):
    path = write_foxglove(tmp_path / "drive.mcap", messages("h264", packets("h264")), "protobuf")
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(SequenceError, match=r"/camera/video: video needs PyAV: pip install \"meshslam\[video\]\""):
        opened(path)


# depth ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_depth_images_beside_a_cameras_are_not_taken_for_it(recorded, tmp_path, encoding):  # noqa: F811
    """As depth cameras record them: two topics of images, of which one is a camera's."""
    rows = [row for row in foxglove_of(recorded) if row[1] != "FrameTransform"]
    bytes_of = 2 if encoding == "16UC1" else 4
    for ns in recorded.times_ns:
        width, height = recorded.camera.width, recorded.camera.height
        fields = {"frame_id": "depth", "width": width, "height": height, "encoding": encoding}
        fields |= {"step": width * bytes_of, "data": bytes(width * height * bytes_of)}
        rows.append(("/depth/image", "RawImage", ns, fields))
    path = write_foxglove(tmp_path / "drive.mcap", rows, "protobuf")
    found = open_sequence(path)
    assert (found.read_image(2) == open_sequence(path, topics={"image": "/camera/image"}).read_image(2)).all()
    with pytest.raises(SequenceError, match=f"its images are {encoding}: depth, not what a camera sees; topics with"):
        open_sequence(path, topics={"image": "/depth/image"})


# compressed as a whole ------------------------------------------------------------------------------------------------

PACKERS = {".gz": gzip.compress, ".bz2": bz2.compress, ".zst": bytes, ".zstd": bytes, ".xz": bytes, ".lz4": bytes}


@pytest.mark.parametrize("suffix", PACKERS)
@pytest.mark.parametrize("kind", [".bag", ".mcap", ".db3"])
def test_a_file_compressed_as_a_whole_names_the_command_that_unpacks_it(tmp_path, suffix, kind):
    path = tmp_path / f"drive{kind}{suffix}"
    path.write_bytes(PACKERS[suffix](b"anything"))
    assert find_loader(path).name == ("mcap" if kind == ".mcap" else "ros-bag")
    command = f"unpack it first: {COMMANDS[suffix]} {path.name}"
    with pytest.raises(SequenceError) as caught:
        open_sequence(path)
    assert command in str(caught.value)


def test_a_rosbag2_whose_files_were_compressed_is_read_once_they_are_unpacked(recorded, tmp_path):  # noqa: F811
    ros = Ros(2)
    folder = write_ros2(tmp_path / "drive", ros, said_of(ros, recorded), mode="FILE")
    packed = next(p for p in folder.iterdir() if p.suffix.startswith(".zst"))
    with pytest.raises(SequenceError, match=rf"unpack each such file in its folder: zstd -d {packed.name}"):
        open_sequence(folder)
    metadata = (folder / "metadata.yaml").read_text()
    (folder / "metadata.yaml").unlink()
    with pytest.raises(SequenceError, match="unpack each such file in its folder: zstd -d"):
        open_sequence(folder)
    (folder / "metadata.yaml").write_text(metadata)
    assert yaml.safe_load(metadata)["rosbag2_bagfile_information"]["compression_mode"].lower() == "file"
    zstandard = pytest.importorskip("zstandard")
    with packed.open("rb") as source, packed.with_suffix("").open("wb") as target:
        zstandard.ZstdDecompressor().copy_stream(source, target)
    assert len(open_sequence(folder)) == len(recorded.images)


def test_a_bag_that_was_unpacked_is_read(recorded, tmp_path):  # noqa: F811
    ros = Ros(1)
    path = write_ros1(tmp_path / "drive.bag", ros, said_of(ros, recorded))
    packed = tmp_path / "drive.bag.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    whole = path.read_bytes()
    path.unlink()
    with pytest.raises(SequenceError, match=r"gunzip -k drive\.bag\.gz"):
        open_sequence(packed)
    path.write_bytes(gzip.decompress(packed.read_bytes()))
    assert path.read_bytes() == whole
    assert len(open_sequence(path)) == len(recorded.images)
