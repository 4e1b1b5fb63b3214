"""The table of used settings against tiny runs whose reads are noted."""

import json
import shutil

import pytest

from meshslam.categories import load_category
from meshslam.runs import (
    Config,
    InputConfig,
    Outlet,
    open_input,
    overlaid,
    read_config,
    run_localize,
    run_map,
    run_slam,
    segment_frames,
    uses,
    with_keypoints,
)
from meshslam.settings import paths_of
from meshslam.simulation import ObserverConfig, StreetConfig, make_street, write_recording
from tests.perception.networks import colour_network
from tests.runs.reads import recorded

KNOWN = paths_of(Config)
SMALL = StreetConfig(frames=24, width_px=480, height_px=150, focal_px=280.0, cars_each_side=3)
QUICK = {  # a short drive: each step is reached
    "slam": {
        "min_baseline_m": 1.0,
        "lag_s": 0.8,
        "full_trajectory_iterations": 2,
        "gradient_iterations": 1,
        "road": {"min_distance_m": 3.0, "max_distance_m": 8.0, "chord_m": 6.0},
        "loop_closure": {"min_views": 2},
    },
    "estimation": {"unknown_start": {"settling_s": 1.0, "alignment": {"seconds": 1.0}}},
    "objects": {"gradient": {"pose_iterations": 3, "shape_iterations": 3}},
}
READ_IN_VAIN = {  # by steps that several commands have in common
    ("detect", "input.detections"): "opens the recording; what it names is not used",
    ("localize", "tracking.categories"): "whether all detections have tracks is asked, but not by localize",
    ("slam", "estimation.imu.gyroscope_noise"): "the rough start integrates samples, without their covariance",
}
SELDOM = {  # read where tiny runs do not come
    "segmentation.min_area_px": "a network found something",
    "segmentation.max_side_px": "a network leaves its input's size open",
    "colour.max_gap": "a body is seen in two parts",
    "localization.gate.moved_views": "an object was moved",
    **dict.fromkeys(
        (path for path in KNOWN if path.startswith("localization.relocalization.")), "a large map, no start"
    ),
    "lengths.cars": "points or road contradict the given poses",
    "slam.retry_views": "an object's start failed",
    "slam.road.sigma_share": "the road's texture is clear",
    **{
        f"slam.loop_closure.{name}": "a place is seen twice"
        for name in (
            "heading_deg",
            "size_ratio",
            "place_sigma_m",
            "turn_sigma_rad",
            "min_separation_m",
            "min_objects",
            "single_object_radius_m",
        )
    },
}
SELDOM_BY_DETECT = ("min_box_px", "edge_margin_px", "batch", "sigma_factor")  # of keypoints: a network found something


@pytest.fixture(scope="module")
def places(tmp_path_factory):
    """Recordings: all there is; neither start nor poses; no IMU either; no key points; coded colours; a network."""
    root, category = tmp_path_factory.mktemp("used"), load_category("car")
    full = write_recording(make_street(category, 4, SMALL), root / "full", ObserverConfig())
    coded = StreetConfig(**{**vars(SMALL), "frames": 4, "mode": "contrast"})
    write_recording(make_street(category, 4, coded), root / "colour", ObserverConfig())
    shutil.copytree(full, root / "start")
    for name in ("initial_state.yaml", "poses.tum"):
        (root / "start" / name).unlink()
    shutil.copytree(root / "start", root / "images")
    (root / "images" / "imu.csv").unlink()
    shutil.copytree(full, root / "masks")
    document = json.loads((full / "detections.json").read_text())
    for annotation in document["annotations"]:
        annotation.pop("keypoints", None)
    (root / "masks" / "detections.json").write_text(json.dumps(document))
    colour_network(root / "net.onnx")
    run_map(Config(InputConfig(sequence=str(full))), root / "map", Outlet(), overwrite=False)
    return root


def reads_of(command, places, run, name, segmenter=None, **changes):
    """What one run of a command reads."""
    chosen = {"sequence": str(places / name)}
    if segmenter is not None:
        chosen["segmenter"] = str(places / segmenter) if segmenter.endswith(".onnx") else segmenter
    if command == "localize":
        chosen["map"] = str(places / "map")
    config = overlaid(overlaid(Config(), QUICK, "test"), {**changes, "input": chosen}, "test")
    with pytest.MonkeyPatch.context() as patch, recorded(config, patch) as reads:
        if command == "detect":
            recording = open_input(config.input)
            with_keypoints(recording, segment_frames(recording, config, Outlet()), config, Outlet())
        else:
            {"map": run_map, "localize": run_localize, "slam": run_slam}[command](config, run, Outlet(), overwrite=True)
    return reads.paths


GRADIENT = {"solver": "gradient"}
RUNS = {
    "map": (
        {"name": "masks"},
        {"name": "full", "objects": GRADIENT, "tracking": {"tracker": "paper"}},
        {"name": "colour", "segmenter": "colour"},
        {"name": "colour", "segmenter": "net.onnx"},
    ),
    "localize": (
        {"name": "start"},
        {"name": "masks", "localization": GRADIENT},
        {"name": "colour", "segmenter": "colour"},
        {"name": "colour", "segmenter": "net.onnx"},
    ),
    "slam": (
        {"name": "start"},
        {"name": "images"},
        {"name": "masks", "slam": {"poses": "odometry"}},
        {"name": "full", "slam": GRADIENT, "tracking": {"tracker": "paper"}},
        {"name": "colour", "segmenter": "colour"},
        {"name": "colour", "segmenter": "net.onnx"},
        {"name": "full", "live": {"enabled": True, "rate": 4.0}},
        {"name": "colour", "segmenter": "net.onnx", "live": {"enabled": True}},
    ),
    "detect": ({"name": "colour", "segmenter": "colour"}, {"name": "colour", "segmenter": "net.onnx"}),
}


@pytest.mark.parametrize("command", RUNS)
def test_a_command_reads_what_the_table_says_and_nothing_else(command, places, tmp_path):
    read = set()
    for number, told in enumerate(RUNS[command]):
        read |= reads_of(command, places, tmp_path / str(number), **told)
    unmarked = {path for path in read if not uses(command, path) and (command, path) not in READ_IN_VAIN}
    assert unmarked == set()
    seldom = {*SELDOM, *(f"keypoints.{name}" for name in SELDOM_BY_DETECT if command == "detect")}
    unread = {path for path in KNOWN if uses(command, path)} - read - seldom
    assert unread == set()


@pytest.mark.parametrize("command", ["map", "localize", "slam"])
def test_a_runs_configuration_repeats_it(command, places, tmp_path):
    told = InputConfig(sequence=str(places / "masks"), map=str(places / "map") if command == "localize" else None)
    changes = {
        "objects": {"max_views": 5},
        "estimation": {"smoother": {"iterations": 1}},
        "keypoints": {"enabled": False},
    }
    config = overlaid(overlaid(Config(told), QUICK, "test"), changes, "test")
    run = {"map": run_map, "localize": run_localize, "slam": run_slam}[command]
    run(config, tmp_path / "first", Outlet(), overwrite=False)
    run(read_config(tmp_path / "first" / "config.yaml", command), tmp_path / "again", Outlet(), overwrite=False)
    for name in ("config.yaml", "trajectory.tum", *(["map.json"] if command != "localize" else [])):
        assert (tmp_path / "first" / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_reads_follow_what_is_derived():
    config = Config()
    with pytest.MonkeyPatch.context() as patch, recorded(config, patch) as reads:
        changed = overlaid(config.slam.points, {"corners": 3}, "test")
        assert not reads.paths  # making one reads nothing
        assert changed.corners == 3
        assert changed.rows == 2
        assert Config().slam.lag_s == 4.0  # one's own
    assert reads.paths == {"slam.points.rows"}
