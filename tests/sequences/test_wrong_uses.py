"""Wrong uses of videos, nuScenes and COLMAP: cut, mixed up and half-empty files: one line each, of what to do."""

import json
import struct
import subprocess
import sys

import cv2
import numpy as np
import pytest

from meshslam.errors import SequenceError
from meshslam.sequences import RecordingOptions, check_sequence, inspect_sequence, open_sequence
from tests.sequences.conftest import FRAMES, random_image
from tests.sequences.test_layouts import POSES, colmap, nuscenes
from tests.sequences.test_video import HEIGHT, WIDTH, camera, write


def said_of(path, **options):
    """What opening says, in one short line, and `check` too."""
    with pytest.raises(SequenceError) as caught:
        open_sequence(path, **options)
    said = str(caught.value)
    assert "\n" not in said
    assert len(said.replace(str(path), "")) < 330, said
    given = {"camera": "camera_file", "times": "times_file"}
    known = {given.get(key, key): value for key, value in options.items() if key not in ("frames", "from_s", "to_s")}
    if known.keys() == options.keys() | set():
        problems = [str(p) for p in inspect_sequence(path, RecordingOptions(**known))[1] if p.severity == "problem"]
        assert problems, "check finds nothing"
        assert not any("\n" in problem for problem in problems)
    return said


# nuScenes -------------------------------------------------------------------------------------------------------------


@pytest.fixture
def drive(tmp_path, rng):
    nuscenes(tmp_path / "nuscenes", rng)
    return tmp_path / "nuscenes"


def table(folder, name, change):
    """Rewrite a table."""
    file = folder / "v1.0-mini" / f"{name}.json"
    rows = json.loads(file.read_text())
    changed = change(rows)
    file.write_text(json.dumps(rows if changed is None else changed))


def cut(folder, name, share=0.6):
    file = folder / "v1.0-mini" / f"{name}.json"
    file.write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])


def put(folder, name, row, key, value):
    table(folder, name, lambda rows: rows[row].__setitem__(key, value))


NUSCENES = {
    "a scene that is not there": (lambda f: {"scene": "scene-9"}, "has no scene 'scene-9'; there are scene-0001, sc"),
    "no scene of two": (lambda f: {"scene": None}, "holds 2 scenes: choose one by --scene NAME"),
    "camera 9": (lambda f: {"camera_number": 9}, "has no camera 9, only 0 CAM_FRONT, 1 CAM_FRONT_LEFT"),
    "another camera": (lambda f: {"camera_number": 3}, "has no frame of CAM_BACK"),
    "a missing table": (lambda f: (f / "v1.0-mini/sample.json").unlink(), "sample.json: no such table: unpack"),
    "a cut table": (lambda f: cut(f, "sample_data"), "sample_data.json: cannot be read as a table, it is cut or"),
    "half of the poses": (lambda f: table(f, "ego_pose", lambda r: r[::2]), "2 rows that sample_data.json names are"),
    "no list": (lambda f: table(f, "sensor", lambda r: {"rows": r}), "sensor.json: expected a list of rows"),
    "a row that is none": (lambda f: table(f, "sample", lambda r: [*r, 7]), "sample.json: row 2: token: found 7"),
    "a row without a token": (
        lambda f: table(f, "scene", lambda r: [{"name": "x"}]),
        "scene.json: row 0: token: found",
    ),
    "no rows": (lambda f: table(f, "sample_data", lambda r: []), "has no frame of CAM_FRONT: are the tables of one"),
    "no scenes": (lambda f: table(f, "scene", lambda r: []), "scene.json: holds no scenes"),
    "a token that is a list": (lambda f: put(f, "sample", 0, "token", ["a"]), "sample.json: row 0: token: found ['a']"),
    "a time that is text": (lambda f: put(f, "sample_data", 0, "timestamp", "1e9"), "timestamp: found '1e9'"),
    "two images of one time": (
        lambda f: put(f, "sample_data", 0, "timestamp", 100_300_000),
        "a second image of the ti",
    ),
    "a name outside": (lambda f: put(f, "sample_data", 0, "filename", "../../x.png"), "filename: found '../../x.png'"),
    "no images": (
        lambda f: [p.unlink() for p in (f / "samples/CAM_FRONT").iterdir()] and None,
        "none of the 5 images of CAM_FRONT is there, such as samples/CAM_FRONT/0.png: unpack samples and sweeps",
    ),
    "a camera of the lidar": (lambda f: put(f, "calibrated_sensor", 0, "camera_intrinsic", []), "token c1: is damaged"),
    "a rotation of zeros": (
        lambda f: put(f, "ego_pose", 1, "rotation", [0, 0, 0, 0]),
        "ego_pose.json: token e1: is da",
    ),
    "a position of two": (lambda f: put(f, "ego_pose", 1, "translation", [0, 1]), "ego_pose.json: token e1: is damag"),
    "a position that is none": (
        lambda f: put(f, "ego_pose", 1, "translation", [0, 1, float("nan")]),
        "ego_pose.json: token e1: is damaged",
    ),
    "no width": (lambda f: put(f, "sample_data", 4, "width", None), "token c1: is damaged"),
    "an IMU that is cut": (
        lambda f: (f / "can_bus/scene-0001_ms_imu.json").write_text('[{"utime": 1'),
        "scene-0001_ms_imu.json: is cut or damaged",
    ),
    "an IMU without samples": (lambda f: (f / "can_bus/scene-0001_ms_imu.json").write_text("[]"), "holds no samples"),
    "a rate": (lambda f: {"rate_hz": 10.0}, "--rate is not for recordings of the layout nuscenes: leave it out"),
    "a camera's file": (lambda f: {"camera": camera(f)}, "--camera FILE is not for recordings of the layout nuscenes"),
}


@pytest.mark.parametrize("case", NUSCENES)
def test_wrong_nuscenes_is_one_line(drive, case):
    change, expected = NUSCENES[case]
    options = change(drive)
    options = options if isinstance(options, dict) else {}
    assert expected in said_of(drive, **{"scene": "scene-0001", **options})


def test_the_folder_of_tables_names_the_one_above_it(drive):
    assert f"holds the tables alone: give the folder above it, {drive}" in said_of(drive / "v1.0-mini")
    (drive / "v1.0-mini" / "sample_data.json").unlink()
    assert "holds no tables" in said_of(drive, layout="nuscenes")


def test_rows_in_another_order_are_the_same_recording(drive, rng):
    whole = open_sequence(drive, scene="scene-0001")
    for name in ("sample", "sensor", "calibrated_sensor", "ego_pose", "sample_data", "scene"):
        table(drive, name, lambda rows: [rows[i] for i in rng.permutation(len(rows))])
    mixed = open_sequence(drive, scene="scene-0001")
    assert (mixed.times_s == whole.times_s).all()
    assert mixed.images.names == whole.images.names
    assert all(
        (a.matrix == b.matrix).all() for a, b in zip(mixed.world_from_camera, whole.world_from_camera, strict=True)
    )


def test_a_scene_is_found_in_whichever_tables_hold_it(drive):
    other = drive / "v1.0-trainval"
    other.mkdir()
    for file in (drive / "v1.0-mini").iterdir():
        other.joinpath(file.name).write_text("[]" if file.name != "scene.json" else '[{"token": "z", "name": "late"}]')
    assert len(open_sequence(drive, scene="scene-0001")) == FRAMES
    assert "has no frame of CAM_FRONT" in said_of(drive, scene="late")


# COLMAP ---------------------------------------------------------------------------------------------------------------


def rows_of(folder, change):
    """Rewrite the lines of images.txt."""
    file = folder / "sparse" / "0" / "images.txt"
    file.write_text("\n".join(change(file.read_text().split("\n"))))


def camera_row(row):
    return lambda f: (f / "sparse/0/cameras.txt").write_text(row)


COLMAP = {
    "an unknown model": (camera_row("1 EUCM 64 48 60 60 32 24 0.5 1"), "EUCM is not read (make the project pinhole by"),
    "no model at all": (camera_row("1 PINHOL 64 48 60 60 32 24"), "the model PINHOL is not read"),
    "a parameter too few": (camera_row("1 PINHOLE 64 48 60 60 32"), "line 1: PINHOLE has 4 finite parameters, found 3"),
    "no cameras": (camera_row("# Camera list with one line of data per camera:\n"), "cameras.txt"),
    "a camera that is not there": (
        lambda f: {"camera_number": 7},
        "holds no camera 7, only 1 (PINHOLE)",
    ),
    "a row of another camera": (
        camera_row("2 PINHOLE 64 48 60 60 32 24"),
        "holds no camera 1, only 2 (PINHOLE)",
    ),
    "lines of points left out": (
        lambda f: rows_of(f, lambda lines: [line for line in lines if line]),
        "line 3: an image stands where the points of the one before it should: each image has two lines",
    ),
    "half a line": (lambda f: rows_of(f, lambda lines: [*lines[:3], lines[3][:20]]), "line 4: expected IMAGE_ID QW QX"),
    "an image twice": (lambda f: rows_of(f, lambda lines: [*lines, lines[1], ""]), "a second pose of 000000.png"),
    "no rows": (lambda f: rows_of(f, lambda lines: lines[:1]), "images.txt: holds no images"),
    "a rotation of zeros": (
        lambda f: rows_of(f, lambda lines: [lines[0], "1 0 0 0 0 0 0 0 1 000000.png", *lines[2:]]),
        "line 2: expected a quaternion and a translation",
    ),
    "a position that is none": (
        lambda f: rows_of(f, lambda lines: [lines[0], "1 1 0 0 0 nan 0 0 1 000000.png", *lines[2:]]),
        "line 2: expected a quaternion and a translation",
    ),
    "other images": (
        lambda f: [p.rename(p.with_name(f"other_{p.name}")) for p in (f / "images").iterdir()] and None,
        "none of its 5 images, such as 000000.png, is in",
    ),
    "no images": (lambda f: [p.unlink() for p in (f / "images").iterdir()] and None, "none of its 5 images"),
    "one camera file of two": (lambda f: (f / "sparse/0/cameras.txt").unlink(), "no known layout"),
    "a name outside": (
        lambda f: rows_of(f, lambda lines: [line.replace(" 0000", " ../images/0000") for line in lines]),
        "none of its 5 images, such as ../images/000000.png",
    ),
    "topics": (lambda f: {"topics": {"image": "/a"}}, "--topic is not for recordings of the layout colmap"),
    "times of other frames": (lambda f: {"times": numbered(f, 4)}, "holds 4 times, but images has 5 frames"),
    "a rate beside times": (lambda f: {"times": numbered(f, 5), "rate_hz": 5.0}, "give one of them"),
}


def numbered(folder, count):
    path = folder.parent / "t.txt"
    path.write_text("".join(f"{0.1 * i}\n" for i in range(count)))
    return path


@pytest.mark.parametrize("case", COLMAP)
def test_wrong_colmap_is_one_line(tmp_path, rng, case):
    folder = tmp_path / "project"
    colmap(folder, rng, binary=False)
    change, expected = COLMAP[case]
    options = change(folder)
    assert expected in said_of(folder, **(options if isinstance(options, dict) else {}))


def binary_cases():
    whole = struct.pack("<QiiQQ4d", 1, 1, 1, 64, 48, 60.0, 60.0, 32.0, 24.0)
    yield "cameras", whole[:-1], "cameras.bin: is cut: not all of its cameras are whole: copy it anew"
    yield "cameras", whole[:3], "cameras.bin: is cut"
    yield "cameras", b"", "cameras.bin: is cut"
    yield "cameras", whole + b"\0", "1 bytes stand behind its 1 cameras"
    yield "cameras", struct.pack("<Q", 0), "cameras.bin: holds no cameras"
    yield "cameras", struct.pack("<QiiQQ4d", 1, 1, 99, 64, 48, 0, 0, 0, 0), "a model of the number 99 is not known"
    yield "images", struct.pack("<Q", 0), "images.bin: holds no images"
    yield "images", struct.pack("<Q", 1 << 60), "images.bin: is cut: 0 of 1152921504606846976 images are whole"
    yield "images", b"abc", "images.bin: is no images.bin of COLMAP, or is cut"


@pytest.mark.parametrize(("name", "content", "expected"), list(binary_cases()))
def test_wrong_binary_colmap_is_one_line(tmp_path, rng, name, content, expected):
    folder = tmp_path / "project"
    colmap(folder, rng, binary=True)
    (folder / "sparse" / "0" / f"{name}.bin").write_bytes(content)
    assert expected in said_of(folder)


def test_every_cut_of_a_binary_model_is_one_line(tmp_path, rng):
    folder = tmp_path / "project"
    colmap(folder, rng, binary=True)
    for name in ("cameras.bin", "images.bin"):
        file = folder / "sparse" / "0" / name
        whole = file.read_bytes()
        for length in range(len(whole)):
            file.write_bytes(whole[:length])
            with pytest.raises(SequenceError) as caught:
                open_sequence(folder)
            assert name in str(caught.value)
        file.write_bytes(whole)


def test_images_in_folders_are_told_apart_by_their_camera(tmp_path, rng):
    folder = tmp_path / "project"
    colmap(folder, rng, binary=False)
    model = folder / "sparse" / "0"
    model.joinpath("cameras.txt").write_text("1 PINHOLE 64 48 60 60 32 24\n2 PINHOLE 64 48 70 70 32 24\n")
    lines = [line for line in (model / "images.txt").read_text().split("\n")[1:] if line]
    rows = [f"{line.rsplit(' ', 2)[0]} {k} cam{k}/{line.split()[-1]}\n\n" for k in (1, 2) for line in lines]
    model.joinpath("images.txt").write_text("".join(rows))
    for k in (1, 2):
        (folder / "images" / f"cam{k}").mkdir()
        for i in range(FRAMES):
            cv2.imwrite(str(folder / "images" / f"cam{k}" / f"{i:06d}.png"), random_image(rng))
    for file in (folder / "images").glob("*.png"):
        file.unlink()
    assert "the images are of the cameras 1, 2: choose one by --camera N" in said_of(folder)
    found = open_sequence(folder, camera_number=2)
    assert found.camera.fx == 70
    assert {path.parent.name for path in found.image_paths} == {"cam2"}
    assert len(found) == len(found.world_from_camera) == FRAMES
    assert all(p.severity == "note" for p in check_sequence(folder, camera_number=2))


def test_a_second_model_is_said(tmp_path, rng):
    folder = tmp_path / "project"
    colmap(folder, rng, binary=False)
    (folder / "sparse" / "1").mkdir()
    for file in (folder / "sparse" / "0").iterdir():
        (folder / "sparse" / "1" / file.name).write_bytes(file.read_bytes())
    assert any("made 2 models (0, 1), 0 is read" in note for note in open_sequence(folder).notes)


PYCOLMAP = """
import sys
import numpy as np, pycolmap
model, folder, binary, poses = sys.argv[1], sys.argv[2], sys.argv[3] == "binary", np.load(sys.argv[4])
made = pycolmap.Reconstruction()
camera = pycolmap.Camera(camera_id=1, model=model, width=64, height=48, params=[60, 61, 32, 24])
made.add_camera_with_trivial_rig(camera)
for i, row in enumerate(poses):
    image = pycolmap.Image(name=f"{i:06d}.png", camera_id=1, image_id=len(poses) - i)
    image.points2D = pycolmap.Point2DList([pycolmap.Point2D(np.array([3.0, 4.0]))])
    made.add_image_with_trivial_frame(image, pycolmap.Rigid3d(row.reshape(3, 4)))
(made.write_binary if binary else made.write_text)(folder)
"""


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_a_model_of_pycolmap_is_read(tmp_path, rng, kind):
    """In a process of its own: its libraries and OpenCV's do not go together."""
    folder = tmp_path / "project"
    colmap(folder, rng, binary=False)
    for file in (folder / "sparse" / "0").iterdir():
        file.unlink()
    back = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    rows = [np.column_stack([p.rotation.T @ back, -p.rotation.T @ p.translation]) for p in POSES]
    np.save(tmp_path / "poses.npy", np.array(rows).reshape(FRAMES, 12))
    code = [sys.executable, "-c", PYCOLMAP, "PINHOLE", str(folder / "sparse" / "0"), kind, str(tmp_path / "poses.npy")]
    subprocess.run(code, check=True, capture_output=True)
    found = open_sequence(folder)
    assert (found.camera.fx, found.camera.fy, found.camera.cx, found.camera.cy) == (60, 61, 31.5, 23.5)
    for one, other in zip(found.world_from_camera, POSES, strict=True):
        assert np.allclose(one.matrix, other.matrix, atol=1e-6)


# video ----------------------------------------------------------------------------------------------------------------


def sound(folder):
    """A file with sound alone."""
    av = pytest.importorskip("av")
    path = folder / "sound.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(np.zeros((1, 1024), np.float32), format="fltp", layout="mono")
        frame.sample_rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def bytes_of(name, content):
    def make(folder):
        path = folder / name
        path.write_bytes(content)
        return path

    return make


def video_part(share):
    def make(folder):
        path = write(folder / "drive.mp4")
        path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        return path

    return make


def mixed_up(folder):
    """The middle of the file twice, its end not at all: the packets are damaged."""
    path = write(folder / "drive.mkv")
    data = path.read_bytes()
    third = len(data) // 3
    path.write_bytes(data[: 2 * third] + data[third : 2 * third])
    return path


def written(name="drive.mp4"):
    return lambda folder: write(folder / name)


VIDEO = {
    "no camera": (written(), {"camera": None}, "a video says nothing of its camera: give --camera FILE"),
    "a camera of another aspect": (written(), {"camera": lambda f: camera(f, (640, 300))}, "do not scale to 128x96"),
    "a camera that is not there": (written(), {"camera": lambda f: f / "none.yaml"}, "none.yaml: no such file"),
    "the video as its camera": (written(), {"camera": lambda f: f / "drive.mp4"}, "drive.mp4"),
    "another size": (written(), {"size": (640, 300)}, "do not scale to 640x300"),
    "sound alone": (sound, {}, "sound.mp4: holds no video"),
    "an empty file": (bytes_of("drive.mp4", b""), {"layout": "video"}, "drive.mp4: cannot be read as a video"),
    "an image called a video": (
        bytes_of("drive.mp4", cv2.imencode(".png", np.zeros((9, 9, 3), np.uint8))[1].tobytes()),
        {},
        "no known layout",
    ),
    "text called a video": (bytes_of("drive.mp4", b"no video"), {"layout": "video"}, "cannot be read as a video"),
    "half a file": (video_part(0.5), {}, "cannot be read as a video"),
    "the head of a file": (video_part(0.01), {}, "cannot be read as a video"),
    "a rate": (
        written(),
        {"rate_hz": 30.0},
        "--rate is not for recordings of the layout video: leave it out, or give --t",
    ),
    "topics": (written(), {"topics": {"image": "/a"}}, "--topic is not for recordings of the layout video"),
    "a scene": (written(), {"scene": "x"}, "--scene is not for recordings of the layout video"),
    "no frame chosen": (written(), {"frames": "100:"}, "it has the frames 0 to 39"),
    "seconds beyond its end": (written(), {"from_s": 100.0}, "no frame is chosen"),
    "poses of another clock": (written(), {"poses": lambda f: poses(f, 5000.0)}, "another clock"),
    "no poses": (written(), {"poses": lambda f: f / "none.tum"}, "none.tum: no such file"),
    "a video in another layout": (written(), {"layout": "folder"}, "drive.mp4"),
    "a folder as a video": (lambda f: f, {"layout": "video"}, "is a folder, expected a video's file"),
}


def poses(folder, begin_s):
    path = folder / "poses.tum"
    path.write_text("".join(f"{begin_s + 0.1 * i} 0 0 {i} 0 0 0 1\n" for i in range(20)))
    return path


@pytest.mark.parametrize("case", VIDEO)
def test_a_wrong_video_is_one_line(tmp_path, case):
    pytest.importorskip("av")
    make, options, expected = VIDEO[case]
    path = make(tmp_path)
    given = {"camera": camera(tmp_path)} | {k: v(tmp_path) if callable(v) else v for k, v in options.items()}
    assert expected in said_of(path, **{key: value for key, value in given.items() if value is not None})


def test_a_video_of_mixed_up_packets_gives_frames_or_says_which_cannot_be_read(tmp_path):
    pytest.importorskip("av")
    found = open_sequence(mixed_up(tmp_path), camera=camera(tmp_path))
    said = [error for i in range(len(found)) if (error := unread(found, i)) is not None]
    assert all("cannot be decoded" in error and "\n" not in error for error in said)


def unread(found, index):
    try:
        assert found.read_image(index).shape == (HEIGHT, WIDTH, 3)
    except SequenceError as error:
        return str(error)
    return None
