"""What reading handles by itself is right, and is said in the notes; what it cannot is an error."""

import io
import json
import zlib

import cv2
import numpy as np
import pytest
from PIL import Image, ImageOps
from scipy.spatial.transform import Rotation

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences import (
    CONVENTIONS,
    ImuSamples,
    RecordingOptions,
    check_sequence,
    in_convention,
    inspect_sequence,
    open_sequence,
    read_extrinsics,
    write_sequence_folder,
)
from meshslam.sequences.images import load_image
from meshslam.sequences.oxts import read_timestamps
from meshslam.sequences.report import Report
from meshslam.sequences.tum import format_tum
from tests.sequences.conftest import CAMERA, FRAMES, random_image, random_pose

TIMES_S = np.arange(FRAMES) * 0.1


def turning_path(times_s):
    """Constant velocity and angular rate."""
    turns = Rotation.from_rotvec(np.outer(times_s, [0.1, -0.2, 0.9])).as_matrix()
    return [Pose(turn, np.array([3.0 * t, 1.0, 0.5 * t])) for turn, t in zip(turns, times_s, strict=True)]


def problems_and_notes(path, **options):
    found = inspect_sequence(path, RecordingOptions(**options))[1]
    return ([str(p) for p in found if p.severity == kind] for kind in ("problem", "note"))


class TestImages:
    def test_names_are_sorted_by_the_numbers_in_them(self, tmp_path, rng):
        images = [random_image(rng) for _ in range(12)]
        write_sequence_folder(tmp_path, CAMERA, np.arange(12) * 0.1, images=images)
        for i, file in enumerate(sorted((tmp_path / "images").iterdir())):
            file.rename(file.with_name(f"frame_{i + 1}.png"))
        drive = open_sequence(tmp_path)
        assert [path.name for path in drive.image_paths] == [f"frame_{i}.png" for i in range(1, 13)]
        assert (drive.read_image(9) == images[9]).all()

    @pytest.mark.parametrize("bits", [10, 12, 14, 16])
    def test_images_of_more_than_eight_bits_are_scaled_alike_and_it_is_said(self, folder, rng, bits):
        deep = rng.integers(0, 2**bits, (FRAMES, *random_image(rng).shape), dtype=np.uint16)
        deep[0] //= 4  # a dark frame is scaled as the others are
        for i, image in enumerate(deep):
            cv2.imwrite(str(folder / "images" / f"{i:06d}.png"), image)
        drive = open_sequence(folder)
        for i, image in enumerate(deep):
            assert np.abs(drive.read_image(i) - image / 2.0 ** (bits - 8)).max() <= 1
        assert [f"values have {bits} bits" in note for note in drive.notes] == [True]

    @pytest.mark.parametrize("orientation", range(1, 9))
    @pytest.mark.parametrize("kind", ["png", "jpg"])
    def test_images_are_turned_as_exif_says(self, tmp_path, rng, orientation, kind):
        exif = Image.Exif()
        exif[0x0112] = orientation
        image = cv2.GaussianBlur(random_image(rng, (16, 24, 3)), (5, 5), 0)
        file = tmp_path / f"000000.{kind}"
        Image.fromarray(image[..., ::-1]).save(file, exif=exif, quality=95)
        expected = np.asarray(ImageOps.exif_transpose(Image.open(file)).convert("RGB"))[..., ::-1]
        assert (load_image(file) == expected).all()
        with pytest.raises(SequenceError, match="EXIF turn" if orientation > 1 else "resolution"):
            load_image(file, (99, 99))

    def test_the_turn_is_said(self, folder, rng):
        exif = Image.Exif()
        exif[0x0112] = 3
        (folder / "images" / "000000.png").unlink()
        Image.fromarray(random_image(rng)).save(folder / "images" / "000000.jpg", exif=exif)
        assert any("EXIF orientation (3)" in note for note in open_sequence(folder).notes)

    @pytest.mark.parametrize("quality", [30, 75, 98])
    @pytest.mark.parametrize("subsampling", [0, 1, 2])
    def test_a_jpeg_is_decoded_as_opencv_does(self, tmp_path, rng, quality, subsampling):
        image = cv2.GaussianBlur(random_image(rng, (45, 61, 3)), (5, 5), 0)
        for mode in ("RGB", "L"):
            Image.fromarray(image).convert(mode).save(tmp_path / "a.jpg", quality=quality, subsampling=subsampling)
            assert (load_image(tmp_path / "a.jpg") == cv2.imread(str(tmp_path / "a.jpg"))).all()

    def test_a_jpeg_is_whole_or_not_by_its_decoders_word(self, tmp_path, rng):
        memory = io.BytesIO()
        Image.fromarray(cv2.GaussianBlur(random_image(rng, (96, 96, 3)), (9, 9), 0)).save(memory, "JPEG")
        whole, file = memory.getvalue(), tmp_path / "000000.jpg"
        file.write_bytes(whole + bytes(2048))  # as phones' motion photos and padding recorders have it
        assert load_image(file).shape == (96, 96, 3)
        middle = len(whole) // 2
        for damaged in (
            whole[:middle] + bytes(len(whole) - middle - 2) + b"\xff\xd9",
            whole[:middle] + b"\xff\xd9",
            whole[:middle] + b"\xff\xd9" + whole[middle:],
        ):
            file.write_bytes(damaged)
            with pytest.raises(SequenceError, match=r"000000\.jpg: JPEG is damaged"):
                load_image(file)

    def test_a_huge_image_is_refused_by_its_header(self, tmp_path):
        file = tmp_path / "000000.png"
        file.write_bytes(cv2.imencode(".png", np.zeros((8, 8), np.uint8))[1].tobytes())
        content = bytearray(file.read_bytes())
        content[16:24] = (100_000).to_bytes(4, "big") * 2
        content[29:33] = zlib.crc32(content[12:29]).to_bytes(4, "big")
        file.write_bytes(bytes(content))
        with pytest.raises(SequenceError, match="100000x100000 pixels: more than"):
            load_image(file)


class TestPoses:
    def test_poses_between_frames_are_interpolated_and_it_is_said(self, folder):
        dense_s = np.arange(-3, 24) * 0.02 + 0.007
        (folder / "poses.tum").write_text(format_tum(dense_s, turning_path(dense_s)))
        drive = open_sequence(folder)
        for pose, true in zip(drive.world_from_camera, turning_path(TIMES_S), strict=True):
            assert np.allclose(pose.matrix, true.matrix, atol=1e-7)
        assert any("5 frames have no pose of their time" in note for note in drive.notes)

    def test_no_pose_is_made_up_across_a_gap(self, folder):
        times_s = np.array([-1.0, 0.0, 0.1, 0.4])
        (folder / "poses.tum").write_text(format_tum(times_s, turning_path(times_s)))
        drive = open_sequence(folder)
        assert drive.world_from_camera is None
        assert sorted(drive.partial_poses) == [0, 1, 4]
        assert any("2 of 5 frames have no pose" in note and "frame 2" in note for note in drive.notes)
        part = drive.with_poses_only()
        assert part.frame_ids == (0, 1, 4)
        assert part.left_out_frames == {2, 3}
        assert (part.read_image(2) == drive.read_image(4)).all()

    def test_poses_of_another_clock_are_a_problem(self, folder):
        (folder / "poses.tum").write_text(format_tum(TIMES_S + 1.4e9, turning_path(TIMES_S)))
        with pytest.raises(SequenceError, match="another clock"):
            open_sequence(folder)

    @pytest.mark.parametrize("convention", CONVENTIONS[1:])
    def test_a_convention_that_is_named_is_taken(self, folder, convention):
        as_read = open_sequence(folder).world_from_camera
        drive = open_sequence(folder, poses_convention=convention)
        for pose, expected in zip(drive.world_from_camera, in_convention(as_read, convention), strict=True):
            assert np.allclose(pose.matrix, expected.matrix, atol=1e-12)

    def test_poses_of_a_body_with_its_camera(self, folder, rng, tmp_path):
        camera_from_body, file = random_pose(rng), tmp_path / "mounting.json"
        path = turning_path(TIMES_S)
        (folder / "poses.tum").write_text(format_tum(TIMES_S, [pose @ camera_from_body for pose in path]))
        for content in (
            camera_from_body.matrix.tolist(),
            {"camera_from_body": camera_from_body.matrix.tolist()},
            {"body_from_camera": camera_from_body.inverse().matrix.tolist()},
        ):
            file.write_text(json.dumps(content))
            drive = open_sequence(folder, camera_from_body=file)
            for pose, true in zip(drive.world_from_camera, path, strict=True):
                assert np.allclose(pose.matrix, true.matrix, atol=1e-7)

    def test_what_does_not_go_together_is_refused(self, folder, odometry, tmp_path):
        with pytest.raises(SequenceError, match="known are camera, quaternion-first"):
            open_sequence(folder, poses_convention="wxyz")
        with pytest.raises(SequenceError, match="sequence folder, or --poses FILE, only"):
            open_sequence(odometry, poses_convention="body")
        (tmp_path / "m.json").write_text(json.dumps(np.eye(4).tolist()))
        with pytest.raises(SequenceError, match="not of the convention"):
            open_sequence(folder, poses_convention="camera-from-world", camera_from_body=tmp_path / "m.json")

    def test_a_blank_line_moves_no_pose(self, odometry):
        file = odometry.parent / "poses" / "07.txt"
        lines = file.read_text().splitlines()
        file.write_text("\n".join([*lines[:2], "", *lines[2:]]))
        with pytest.raises(SequenceError, match="line 3: is blank"):
            open_sequence(odometry)


def test_blank_time_stamps_keep_their_place(tmp_path):
    file, report = tmp_path / "timestamps.txt", Report()
    lines = [f"2011-09-26 14:14:10.{100 * i:03d}000000" for i in range(7)]
    expected = read_timestamps_of(file, lines)
    for blank in ([2], [3, 4], [0], [1, 5]):
        file.write_text("\n".join("" if i in blank else line for i, line in enumerate(lines)) + "\n\n")
        assert (read_timestamps(file, report) == expected).all()
    assert any("2 blank lines" in note for note in report.notes)


def read_timestamps_of(file, lines):
    file.write_text("\n".join(lines) + "\n")
    return read_timestamps(file, Report())


class TestExtrinsics:
    def test_three_decimals_are_made_a_rotation_and_it_is_said(self, tmp_path, rng):
        for _ in range(20):
            pose, report = random_pose(rng), Report()
            (tmp_path / "t.json").write_text(json.dumps(np.round(pose.matrix, 3).tolist()))
            read = read_extrinsics(tmp_path / "t.json", report=report)[0]
            assert np.abs(read.rotation - pose.rotation).max() < 2e-3
            assert np.allclose(read.rotation.T @ read.rotation, np.eye(3), atol=1e-12)
        assert "nearest" in report.notes[0]

    def test_of_several_cameras_the_one_with_these_intrinsics_is_taken(self, folder, tmp_path, rng):
        mounted = [random_pose(rng) for _ in range(3)]
        own = {"resolution": [64, 48], "intrinsics": [60.0, 61.0, 31.5, 23.5]}
        others = [{"resolution": [64, 48], "intrinsics": [90.0, 90.0, 31.5, 23.5]}, own, {"resolution": [99, 48]}]
        rig = {
            f"cam{i}": {**about, "T_cam_imu": pose.inverse().matrix.tolist()}
            for i, (about, pose) in enumerate(zip(others, mounted, strict=True))
        }
        file = tmp_path / "rig.yaml"
        file.write_text(json.dumps(rig))
        drive = open_sequence(folder, imu_from_camera=file)
        assert np.allclose(drive.imu_from_camera.matrix, mounted[1].matrix)
        assert any("cam1" in note for note in drive.notes)
        assert np.allclose(
            open_sequence(folder, None, 2, imu_from_camera=file).imu_from_camera.matrix, mounted[2].matrix
        )
        rig["cam0"] |= own
        file.write_text(json.dumps(rig))
        with pytest.raises(SequenceError, match="cam0, cam1 have this recording's intrinsics: give --camera N"):
            open_sequence(folder, imu_from_camera=file)
        with pytest.raises(SequenceError, match="holds cam0, cam1, cam2, and none has"):
            read_extrinsics(_without_intrinsics(file, rig), camera=CAMERA)

    def test_files_that_are_given_outrank_the_folders_own(self, folder, tmp_path, rng):
        times_s = np.arange(-2, 45) * 0.01
        values = rng.normal(size=(47, 6))
        rows = ["timestamp,wx,wy,wz,ax,ay,az"]
        rows += [",".join(map(str, (t, *row))) for t, row in zip(times_s, values, strict=True)]
        (tmp_path / "other.csv").write_text("\n".join(rows))
        (folder / "imu.csv").write_text("what another program left here")
        with pytest.raises(SequenceError, match=r"imu\.csv"):
            open_sequence(folder)
        drive = open_sequence(folder, imu=tmp_path / "other.csv")
        assert np.allclose(drive.imu.angular_rate_rad_s, values[:, :3])
        assert open_sequence(folder, use_imu=False).imu is None  # `map` needs none


def _without_intrinsics(file, rig):
    for entry in rig.values():
        entry.pop("intrinsics", None)
    file.write_text(json.dumps(rig))
    return file


class TestCheck:
    def test_unknown_keys_of_the_camera_are_errors_that_name_the_likely_one(self, folder):
        file = folder / "camera.yaml"
        file.write_text(file.read_text() + "intrinsic: [1, 2, 3, 4]\n")
        with pytest.raises(SequenceError, match="intrinsic: unknown key; did you mean intrinsics"):
            open_sequence(folder)

    def test_what_can_be_handled_is_a_note(self, folder):
        (folder / "poses.tum").write_text(format_tum(TIMES_S[:3], turning_path(TIMES_S[:3])))
        problems, notes = problems_and_notes(folder)
        assert problems == []
        assert "map leaves them out" in notes[0]

    def test_sound_folders_have_neither(self, folder, odometry):
        assert check_sequence(folder) == check_sequence(odometry) == []
        assert open_sequence(folder).notes == open_sequence(odometry).notes == ()


def test_samples_of_the_imu_need_no_mounting_to_be_read(tmp_path, rng):
    imu = ImuSamples(np.arange(50) * 0.01, rng.normal(size=(50, 3)), rng.normal(size=(50, 3)))
    images = [random_image(rng) for _ in TIMES_S]
    write_sequence_folder(tmp_path / "s", CAMERA, TIMES_S, images=images, imu=imu, imu_from_camera=random_pose(rng))
    file = tmp_path / "s" / "camera.yaml"
    text = file.read_text()
    file.write_text(text[: text.index("imu_from_camera")])
    drive = open_sequence(tmp_path / "s")
    assert drive.imu is not None
    assert drive.imu_from_camera is None
    assert "imu_from_camera" in drive.notes[0]
