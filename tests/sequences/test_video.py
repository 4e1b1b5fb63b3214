"""Videos: times of the frames as they are, frames in any order, turned as the file says; written by PyAV."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import cv2
import numpy as np
import pytest
import yaml

from meshslam.errors import SequenceError
from meshslam.sequences import find_loader, open_sequence

av = pytest.importorskip("av")
WIDTH, HEIGHT, COUNT = 128, 96, 40
STEPS = [3 if i % 7 == 3 else 1 for i in range(COUNT)]  # of 1/30 s: uneven
STAMPS = np.cumsum(STEPS) + 14


def picture(i):
    """A smooth image that tells its number."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    waves = [127 + 100 * np.sin((x + 3 * i) / 17 + k) * np.cos(y / 23 - k) for k in range(3)]
    image = np.stack(waves, -1).astype(np.uint8)
    cv2.rectangle(image, (4, 4), (4 + 2 * i, 14), (255, 255, 255), -1)
    return image


def write(path, codec="mpeg4", gop=10):
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=30, options={"g": str(gop), "q:v": "2"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 30)
        stream.bit_rate = 8_000_000
        for i, stamp in enumerate(STAMPS):
            frame = av.VideoFrame.from_ndarray(picture(i), format="bgr24")
            frame.pts, frame.time_base = int(stamp), Fraction(1, 30)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def camera(folder, size=(WIDTH, HEIGHT)):
    path = folder / "camera.yaml"
    content = {"camera_model": "pinhole", "intrinsics": [100.0, 100.0, 63.5, 47.5], "distortion_model": "none"}
    path.write_text(yaml.safe_dump({"cam0": content | {"distortion_coeffs": [], "resolution": list(size)}}))
    return path


@pytest.fixture(params=["drive.mp4", "drive.mkv"])
def video(request, tmp_path):
    return write(tmp_path / request.param)


def differs(image, i):
    return float(np.abs(image.astype(float) - picture(i)).mean())


def test_frames_and_times_are_those_of_the_video(video):
    found = open_sequence(video, camera=camera(video.parent))
    assert found.layout == find_loader(video).name == "video"
    assert len(found) == COUNT
    assert np.allclose(np.diff(found.times_s), np.diff(STAMPS) / 30, atol=2e-3)
    for i in range(COUNT):
        assert differs(found.read_image(i), i) < 6 < differs(found.read_image(i), (i + 9) % COUNT)


def test_frames_come_in_any_order_and_from_copies(video):
    found = open_sequence(video, camera=camera(video.parent))
    first = {i: found.read_image(i) for i in range(COUNT)}
    for i in np.random.default_rng(0).permutation(COUNT):
        assert (found.read_image(i) == first[i]).all()
    for other in (copy.deepcopy(found.images), pickle.loads(pickle.dumps(found.images))):
        assert (other.read(7, None) == first[7]).all()
    part = open_sequence(video, camera=camera(video.parent), frames="5:20:5")
    assert (part.read_image(2) == first[15]).all()
    assert len(set(found.images.digests())) == COUNT


def turned(path, folder):
    """The same video whose header says that it is to be turned by 90 degrees, as telephones write it."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 44
    quarter = [0, 65536, 0, -65536, 0, 0, 0, 0, 1 << 30]
    data[at : at + 36] = b"".join(int(v).to_bytes(4, "big", signed=True) for v in quarter)
    out = folder / "turned.mp4"
    out.write_bytes(bytes(data))
    return out


def test_a_turned_video_is_upright_and_needs_a_camera_of_that_size(tmp_path):
    plain = write(tmp_path / "drive.mp4")
    path = turned(plain, tmp_path)
    with pytest.raises(SequenceError, match="do not scale to 96x128"):
        open_sequence(path, camera=camera(tmp_path))
    found = open_sequence(path, camera=camera(tmp_path, (HEIGHT, WIDTH)))
    assert differs(np.rot90(found.read_image(5), 1), 5) < 6  # it was turned clockwise
    assert any("turned by" in note for note in found.notes)


def test_wrong_uses_are_one_line(tmp_path):
    path = write(tmp_path / "drive.mp4")
    given = camera(tmp_path)
    with pytest.raises(SequenceError, match="give --camera FILE"):
        open_sequence(path)
    whole = path.read_bytes()
    for cut in (b"", whole[:40], whole[: len(whole) // 2]):
        path.write_bytes(cut)
        with pytest.raises(SequenceError) as caught:
            open_sequence(path, camera=given, layout="video")
        assert "\n" not in str(caught.value)
    path.write_bytes(b"no video at all")
    with pytest.raises(SequenceError, match="no known layout"):
        open_sequence(path, camera=given)


def test_a_cut_video_gives_the_frames_that_are_whole(tmp_path):
    path = write(tmp_path / "drive.mkv")
    whole = open_sequence(path, camera=camera(tmp_path)).read_image(3)
    path.write_bytes(path.read_bytes()[: int(0.6 * path.stat().st_size)])
    found = open_sequence(path, camera=camera(tmp_path))
    assert 10 < len(found) < COUNT
    assert (found.read_image(3) == whole).all()


def test_threads_share_one_decoder(video):
    found = open_sequence(video, camera=camera(video.parent))
    first = [found.read_image(i) for i in range(COUNT)]
    with ThreadPoolExecutor(4) as pool:
        again = list(pool.map(found.read_image, [*range(COUNT), *range(COUNT)[::-1]]))
    assert all((one == other).all() for one, other in zip(again, [*first, *first[::-1]], strict=True))
