"""Times of frames from a file of their own: for videos, folders and COLMAP projects, with an IMU on the same clock."""

import cv2
import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences import open_sequence
from tests.sequences.conftest import random_image
from tests.sequences.test_layouts import camera_file

COUNT = 6
TIMES_S = 1000.0 + np.cumsum([0.0, 0.1, 0.1, 0.25, 0.1, 0.1])
STAMPS = [round(1e9 * t) + 1_600_000_000_000_000_000 for t in TIMES_S]


def folder(tmp_path, rng):
    path = tmp_path / "cam"
    path.mkdir()
    for i in range(COUNT):
        cv2.imwrite(str(path / f"shot_{i}.png"), random_image(rng))
    return path


def video(tmp_path, rng):
    av = pytest.importorskip("av")
    path = tmp_path / "drive.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for _ in range(COUNT):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(random_image(rng), format="bgr24")))
        container.mux(stream.encode())
    return path


MADE = {"frames": folder, "video": video}


@pytest.fixture(params=MADE)
def recording(request, tmp_path, rng):
    path = MADE[request.param](tmp_path, rng)
    return path, camera_file(path)


def written(recording, text):
    path = recording[0].parent / "frame_times.csv"
    path.write_text(text)
    return path


def lines(rows):
    return "\n".join(map(str, rows)) + "\n"


KINDS = {
    "seconds": (lines(TIMES_S), None),
    "comments": ("# made by hand\n" + lines(TIMES_S), None),
    "CSV in seconds": ("timestamp,exposure\n" + lines(f"{t:.6f},12" for t in TIMES_S), None),
    "TUM's list": ("# color images\n# timestamp filename\n" + lines(f"{t:.6f} rgb/{t:.6f}.png" for t in TIMES_S), None),
    "EuRoC's list": ("#timestamp [ns],filename\n" + lines(f"{s},{s}.png" for s in STAMPS), "ns: the header says so"),
    "nanoseconds": ("stamp\n" + lines(STAMPS), "ns: by their steps"),
    "nanoseconds from 0": (lines(s - STAMPS[0] for s in STAMPS), "ns: by their steps"),
    "microseconds": ("t_us;frame\n" + lines(f"{s // 1000};{i}" for i, s in enumerate(STAMPS)), "us: the header says"),
    "a byte order mark": ("\ufefftime\r\n" + "\r\n".join(map(str, TIMES_S)), None),
}


@pytest.mark.parametrize("kind", KINDS)
def test_times_are_the_files(recording, kind):
    text, said = KINDS[kind]
    found = open_sequence(recording[0], camera=recording[1], times=written(recording, text))
    assert len(found) == COUNT
    assert np.allclose(np.diff(found.times_s), np.diff(TIMES_S), atol=1e-6)
    notes = [note for note in found.notes if "times" in note and "taken" in note]
    assert len(notes) == (said is not None)
    assert said is None or said in notes[0]


WRONG = {
    "too few": (lines(TIMES_S[:-1]), "holds 5 times, but {name} has 6 frames"),
    "too many": (lines([*TIMES_S, 2000.0]), "holds 7 times, but {name} has 6 frames"),
    "empty": ("", "holds 0 times, but {name} has 6 frames"),
    "a header alone": ("timestamp\n", "holds 0 times"),
    "not rising": (lines(TIMES_S[[0, 1, 3, 2, 4, 5]]), "line 4: time 1000.2 s is not after 1000.45 s of line 3"),
    "twice": ("t\n" + lines(TIMES_S[[0, 1, 1, 2, 3, 4]]), "line 4: time 1000.1 s is not after"),
    "a word": (lines([*TIMES_S[:3], "later", *TIMES_S[4:]]), "line 4: expected a time, found 'later'"),
    "no number": (lines([*TIMES_S[:3], "nan", *TIMES_S[4:]]), "line 4: expected a time, found 'nan'"),
    "another first column": ("frame,timestamp\n" + lines(f"{i},{t}" for i, t in enumerate(TIMES_S)), "put 'timestamp'"),
    "an unknown unit": (lines(s // 1000 for s in STAMPS), "neither seconds nor nanoseconds: write seconds, or a"),
    "milliseconds": (lines(s // 1_000_000 for s in STAMPS), "neither seconds nor nanoseconds"),
    "text": ("these are\nno times\n", "line 2: expected a time"),
}


@pytest.mark.parametrize("case", WRONG)
def test_a_wrong_file_is_one_line(recording, case):
    text, said = WRONG[case]
    with pytest.raises(SequenceError) as caught:
        open_sequence(recording[0], camera=recording[1], times=written(recording, text))
    assert said.format(name=recording[0].name) in str(caught.value)
    assert "frame_times.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_file_and_a_rate_beside_it_are_errors(recording):
    path, camera = recording
    with pytest.raises(SequenceError, match=r"none\.txt: no such file"):
        open_sequence(path, camera=camera, times=path.parent / "none.txt")
    if path.is_dir():
        with pytest.raises(SequenceError, match="give one of them"):
            open_sequence(path, camera=camera, times=written(recording, lines(TIMES_S)), rate_hz=10.0)


def test_layouts_with_times_of_their_own_refuse_it(raw, tmp_path):
    times = tmp_path / "times.txt"
    times.write_text(lines(TIMES_S))
    with pytest.raises(SequenceError, match="--times FILE is not for recordings of the layout kitti-raw: leave it out"):
        open_sequence(raw, times=times)


def test_it_outranks_times_beside_the_folder(tmp_path, rng):
    path = folder(tmp_path, rng)
    (path / "times.txt").write_text(lines(range(COUNT)))
    given = tmp_path / "given.txt"
    given.write_text(lines(TIMES_S))
    found = open_sequence(path, camera=camera_file(path), times=given)
    assert np.allclose(found.times_s, TIMES_S)


def test_an_imu_in_a_file_goes_with_it(recording):
    path, camera = recording
    imu = path.parent / "imu.csv"
    rows = [f"{999.9 + 0.01 * k:.2f},0,0,0,0,0,9.81" for k in range(90)]
    imu.write_text("timestamp,wx,wy,wz,ax,ay,az\n" + lines(rows))
    mounted = path.parent / "imu_from_camera.yaml"
    mounted.write_text("imu_from_camera: [[0,0,1,0.1],[-1,0,0,0.2],[0,-1,0,0.3],[0,0,0,1]]\n")
    found = open_sequence(
        path, camera=camera, times=written(recording, lines(TIMES_S)), imu=imu, imu_from_camera=mounted
    )
    assert found.imu.rate_hz == pytest.approx(100.0)
    assert np.allclose(found.imu_from_camera.translation, [0.1, 0.2, 0.3])
    assert found.imu.times_s[0] < found.times_s[0] < found.times_s[-1] < found.imu.times_s[-1]
    part = open_sequence(
        path,
        camera=camera,
        times=written(recording, lines(TIMES_S)),
        imu=imu,
        imu_from_camera=mounted,
        frames="1:6:2",
    )
    assert np.allclose(part.times_s, TIMES_S[1:6:2])
