"""EuRoC's ASL layout: mav0 with cam0, imu0 and state_groundtruth_estimate0, each with data.csv and sensor.yaml."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from meshslam.errors import SequenceError
from meshslam.geometry import Pose
from meshslam.sequences.cameras.read import read_camera
from meshslam.sequences.image_source import ImageFiles
from meshslam.sequences.images import image_bits, note_turn
from meshslam.sequences.layouts.timed_images import timed_images
from meshslam.sequences.loader import LoadOptions
from meshslam.sequences.pose_files import read_euroc
from meshslam.sequences.pose_matching import all_or_some, poses_at
from meshslam.sequences.report import IncompleteError, Report, fail
from meshslam.sequences.sequence import ImuSamples, Sequence
from meshslam.sequences.text import check_increasing, parse_table, pose_of, read_text, read_yaml

GROUND_TRUTH = "state_groundtruth_estimate0"
_IMU_COLUMNS = 7  # time, angular rate, specific force


@dataclass(frozen=True)
class Euroc:
    """Poses are the ground truth's, of the body, where it is there; times are seconds of the clock of the recording."""

    name: str = "euroc"
    looks_for: str = "a folder that holds mav0 or cam0/data.csv"
    accepts: frozenset[str] = frozenset()

    def recognizes(self, path: Path) -> bool:
        """By its parts."""
        return (_root(path) / "cam0" / "data.csv").is_file()

    def image_files(self, path: Path, options: LoadOptions) -> list[Path]:
        """Those that data.csv names; see Loader."""
        camera = _camera_folder(path, options)
        return timed_images(camera / "data.csv", camera / "data", ",", Report())[1]

    def load(self, path: Path, options: LoadOptions, report: Report) -> Sequence:
        """Read all but the images; see Loader."""
        root, folder = _root(path), _camera_folder(path, options)
        found = report.attempt(lambda: read_camera(folder / "sensor.yaml", report=report))
        images = report.attempt(lambda: timed_images(folder / "data.csv", folder / "data", ",", report))
        has_imu = options.has_own_imu and (root / "imu0" / "data.csv").exists()
        imu = report.attempt(lambda: _imu(root / "imu0" / "data.csv", report)) if has_imu else None
        if found is None or images is None:
            raise IncompleteError(f"{path}: nothing to load")
        times_s, files = images[0] / 1e9, images[1]
        body_from_camera = found.imu_from_camera
        if body_from_camera is None:
            raise fail(folder / "sensor.yaml", "T_BS", "key is missing, expected body from sensor, a 4x4 matrix")
        body_from_imu = _body_from_sensor(root / "imu0" / "sensor.yaml", report)
        poses = {}
        truth = root / GROUND_TRUTH / "data.csv"
        if options.has_own_poses and truth.exists():
            body_from_truth = _body_from_sensor(truth.parent / "sensor.yaml", report)
            pose_times_s, bodies = read_euroc(truth, report)
            cameras = tuple(p @ body_from_truth.inverse() @ body_from_camera for p in bodies)
            poses = poses_at(times_s, pose_times_s, cameras, truth, report)
        note_turn(files, report)
        every, some = all_or_some(poses, len(files))
        return Sequence(
            name=path.name,
            layout=self.name,
            root=path,
            camera=found.camera,
            frame_ids=tuple(range(len(files))),
            times_s=times_s,
            images=ImageFiles(tuple(files), image_bits(files, report)),
            world_from_camera=every,
            detections_path=options.detections_path,
            imu=imu,
            imu_from_camera=body_from_imu.inverse() @ body_from_camera,
            distortion=found.distortion,
            partial_poses=some,
        )


def _root(path: Path) -> Path:
    return path / "mav0" if (path / "mav0").is_dir() else path


def _camera_folder(path: Path, options: LoadOptions) -> Path:
    root, number = _root(path), options.camera_number or 0
    folder = root / f"cam{number}"
    if not (folder / "data.csv").is_file():
        there = ", ".join(p.name for p in sorted(root.glob("cam[0-9]"))) or "none"
        raise SequenceError(f"{folder}: holds no data.csv; cameras that are there: {there}: choose one by --camera N")
    return folder


def _body_from_sensor(path: Path, report: Report) -> Pose:
    """T_BS of a sensor.yaml; the body itself where there is none."""
    content = read_yaml(path) if path.exists() else {}
    return pose_of(path, "T_BS", content["T_BS"], report) if content.get("T_BS") is not None else Pose.identity()


def _imu(path: Path, report: Report) -> ImuSamples:
    words = [(n, line.split(",")) for n, line in enumerate(read_text(path).splitlines(), 1)]
    rows = [(n, row) for n, row in words if row[0].strip() and not row[0].lstrip().startswith("#")]
    table = parse_table(path, rows, _IMU_COLUMNS, report)
    if not len(table.rows):
        raise fail(path, "", "holds no samples")
    times_s = table.rows[:, 0] / 1e9
    check_increasing(path, times_s, table.lines, report)
    return ImuSamples(times_s, table.rows[:, 1:4], table.rows[:, 4:7])
