"""Every setting: its range, its place, its command, its old name, its page."""

import re
from dataclasses import replace
from functools import reduce
from pathlib import Path

import pytest
import yaml

from meshslam.errors import ConfigError
from meshslam.runs import Config, configured, overlaid, read_config, read_yaml, to_yaml, users, uses
from meshslam.runs.commands import INSTEAD, USED
from meshslam.runs.names import GONE, RENAMED, new_name
from meshslam.settings import paths_of
from meshslam.simulation import SimulationConfig
from scripts.settings_page import PAGE, page

KNOWN, SIMULATED = paths_of(Config), paths_of(SimulationConfig)
OLD = (Path(__file__).parent / "settings_0_1.txt").read_text().split()
RUNS = ("map", "localize", "slam", "merge", "detect")
PACKAGE = Path(__file__).parents[2] / "python" / "meshslam"
BELOW, ABOVE = -(10**12), 10**12


def tree_of(path, value):
    return reduce(lambda tree, key: {key: tree}, reversed(path.split(".")), value)


def given(path, value):
    """A file's content with one setting."""
    return tree_of(f"expert.{path}" if KNOWN[path].about.kind == "expert" else path, value)


def value_of(config, path):
    return reduce(getattr, path.split("."), config)


def another(known, config):
    """A value in range that is not the default."""
    value = known.default
    if known.literals:
        return next(word for word in known.literals if word != value)
    if bool in known.types:
        return not value
    if known.is_list:
        return ("car",) if str in known.types else (1,)
    if str in known.types:
        return "other"
    value = 1 if value is None else value
    for other in (value + 1, value - 1, value * 0.9, 0.5):
        if other != value and known.problem(other, vars(config)) is None:
            return other
    raise AssertionError(known.name)


ADDED = (  # since 0.1
    "lengths.enabled",
    "lengths.points",
    "lengths.steps",
    "lengths.min_step_m",
    "lengths.given_share",
    "lengths.given_sigma_m",
    "lengths.point_inflation",
    "lengths.min_sigmas",
    "lengths.min_share",
    "lengths.road_share",
    "lengths.road_baseline_m",
    "lengths.cars",
    "slam.max_shape_error",
    "mapping.moving.enabled",
    "mapping.moving.doubt_gain",
    "mapping.moving.doubt_mask_iou",
    "mapping.moving.standing_gain",
    "mapping.moving.standing_mask_iou",
    "mapping.moving.standing_mask_iou_step",
    "mapping.moving.min_gain",
    "mapping.moving.min_views",
    "mapping.moving.max_views",
    "mapping.moving.acceleration",
    "mapping.moving.steering",
    "mapping.moving.slip",
    "mapping.moving.turning",
    "mapping.moving.speed_sigma_m_s",
    "mapping.moving.curvature_sigma",
    "mapping.moving.road_correlation_m",
    "mapping.moving.min_speed_m_s",
    "mapping.moving.min_speed_sigmas",
    "mapping.moving.min_way_m",
    "objects.max_way_m",
    "input.category_names",
    "input.adapter",
    "input.allow_outside",
    "input.camera_file",
    "input.size",
    "input.rate_hz",
    "input.times",
    "input.scene",
    "input.topics",
    "input.frames",
    "input.from_s",
    "input.to_s",
    "input.imu_time_offset_s",
    "input.poses",
    "input.poses_time_offset_s",
    "input.poses_scale",
    "live.enabled",
    "live.rate",
    "live.deadline_s",
    "live.pending_frames",
    "live.busy_step_s",
    "live.max_pending_frames",
    "live.start_s",
    "live.start_step_s",
    "live.imu_wait_s",
    "live.zoom",
    "live.network_threads",
    "live.pending_poses",
    "merging.poses",
    "merging.use_views",
    "merging.max_views",
    "merging.min_views",
    "merging.tilt_sigma_deg",
    "merging.global_sigma_m",
    "merging.global_sigma_deg",
    "merging.place_sigma_m",
    "merging.heading_sigma_deg",
    "merging.unknown_place_sigma_m",
    "merging.unknown_heading_sigma_deg",
    "merging.max_joined_m",
    "merging.moved_sigmas",
    "merging.min_moved_m",
    "merging.max_moved_m",
    "merging.size_ratio",
    "merging.max_misfit",
    "merging.bent_share",
    "mapping.common_shape_sigma",
    "merging.constellations.pair_radius_m",
    "merging.constellations.place_sigma_m",
    "merging.constellations.drift_share",
    "merging.constellations.height_sigma_m",
    "merging.constellations.heading_sigma_deg",
    "merging.constellations.size_sigma",
    "merging.constellations.size_spread",
    "merging.constellations.cars_per_m2",
    "merging.constellations.unshared_cost",
    "merging.constellations.candidates",
    "merging.constellations.min_objects",
    "merging.constellations.min_evidence",
    "merging.constellations.min_agreement",
    "merging.constellations.max_ambiguity",
    "merging.visits.max_distance_m",
    "merging.visits.min_box_px",
    "merging.visits.min_inside_share",
    "merging.visits.min_free_share",
    "merging.visits.min_frames",
    "merging.visits.step_m",
    "merging.visits.step_deg",
    "merging.constellations.scale_sigma",
    "localization.relocalization.search_every_s",
    "localization.relocalization.give_up_s",
    "localization.relocalization.constellations.pair_radius_m",
    "localization.relocalization.constellations.place_sigma_m",
    "localization.relocalization.constellations.drift_share",
    "localization.relocalization.constellations.scale_sigma",
    "localization.relocalization.constellations.height_sigma_m",
    "localization.relocalization.constellations.heading_sigma_deg",
    "localization.relocalization.constellations.size_sigma",
    "localization.relocalization.constellations.size_spread",
    "localization.relocalization.constellations.cars_per_m2",
    "localization.relocalization.constellations.unshared_cost",
    "localization.relocalization.constellations.candidates",
    "localization.relocalization.constellations.min_objects",
    "localization.relocalization.constellations.min_evidence",
    "localization.relocalization.constellations.min_agreement",
    "localization.relocalization.constellations.max_ambiguity",
)


def test_every_setting_says_what_it_is():
    assert len(KNOWN) == len(OLD) + 1 + len(ADDED)
    for path, known in {**KNOWN, **SIMULATED}.items():
        bounds = known.about.bounds
        assert known.types or known.literals, path
        assert path in SIMULATED or known.about.kind in ("public", "expert"), path
        assert known.about.kind != "public" or known.about.doc, path
        is_number = known.types in ((int,), (float,))
        assert not is_number or bounds.text or path in SIMULATED, f"{path} has no range"
        assert (
            known.problem(
                known.default,
                {name.rpartition(".")[2]: s.default for name, s in KNOWN.items()}
                | {name.rpartition(".")[2]: s.default for name, s in SIMULATED.items()},
            )
            is None
        ), path


def test_some_thirty_are_public_beside_the_input():
    public = [path for path, known in KNOWN.items() if known.about.kind == "public"]
    assert len([path for path in public if not path.startswith("input.")]) <= 38


def test_names_are_of_one_dialect():
    wrong = re.compile(r"(^|[._])(least|largest|minimum|maximum|smallest|longest|shortest|nearest|farthest)([._]|$)")
    assert not [path for path in (*KNOWN, *SIMULATED) if wrong.search(path)]
    assert not [path for path in KNOWN if re.search(r"\.\w+_(min|max)_", path)]  # min_box_px, not box_min_px


def test_no_setting_is_without_effect():
    code = "\n".join(path.read_text() for path in PACKAGE.rglob("*.py"))
    assert not [path for path in KNOWN if not re.search(rf"\.{path.rpartition('.')[2]}\b", code)]


@pytest.mark.parametrize("path", KNOWN)
def test_out_of_range_is_refused_with_the_name(path):
    known, bounds = KNOWN[path], KNOWN[path].about.bounds
    wrong = [{"a": 1}, *([] if known.takes_none else [None])]
    wrong += [] if known.types == (bool,) else [True]
    wrong += ["seven"] if not (known.types == (str,) and not known.is_list) else [3]
    wrong += [] if known.is_list else [[1, 2]]
    if known.types in ((int,), (float,)):
        wrong += [float("nan"), float("inf"), 10**400]
        wrong += [BELOW] if (bounds.low, bounds.above) != (None, None) else []
        wrong += [ABOVE] if (bounds.high, bounds.below) != (None, None) else []
        wrong += [2.5] if known.types == (int,) else []
        wrong += [bound for bound in (bounds.above, bounds.below) if isinstance(bound, int | float)]
    for value in wrong:
        with pytest.raises(ConfigError, match=rf"^here: {re.escape(path)}: expected "):
            configured(given(path, value), "here")
        group, _, name = path.rpartition(".")
        with pytest.raises(ConfigError, match=rf"Config\.{name}: |NoiseModel\.{name}: "):
            replace(value_of(Config(), group), **{name: value})


@pytest.mark.parametrize("path", SIMULATED)
def test_settings_of_simulation_are_checked_too(path):
    for value in ({"a": 1}, float("nan"), [1, 2]):
        with pytest.raises(ConfigError, match=rf"^here: {re.escape(path)}: expected "):
            overlaid(SimulationConfig(), tree_of(path, value), "here")


def test_bounds_that_are_other_settings_hold():
    with pytest.raises(ConfigError, match="max_distance_m: expected a number above min_distance_m"):
        configured(given("slam.road.min_distance_m", 30), "here")
    both = given("slam.road.min_distance_m", 30)
    both["expert"]["slam"]["road"]["max_distance_m"] = 40
    assert configured(both, "here").slam.road.max_distance_m == 40


@pytest.mark.parametrize("path", KNOWN)
def test_a_setting_has_one_place(path):
    known = KNOWN[path]
    value = another(known, value_of(Config(), path.rpartition(".")[0]))
    found = configured(given(path, list(value) if isinstance(value, tuple) else value), "here")
    assert value_of(found, path) == value
    is_expert = known.about.kind == "expert"
    wrong = tree_of(path if is_expert else f"expert.{path}", value)
    with pytest.raises(ConfigError, match=f"{known.about.kind} setting") as error:
        configured(wrong, "here")
    text = str(error.value).partition("write ")[2]
    assert value_of(configured(yaml.safe_load("{" + text + "}"), "here"), path) == value if not known.is_list else text


@pytest.mark.parametrize("command", USED)
def test_what_a_command_does_not_use_is_refused(command):
    for path, known in KNOWN.items():
        value = another(known, value_of(Config(), path.rpartition(".")[0]))
        value = list(value) if isinstance(value, tuple) else value
        if uses(command, path):
            assert configured(given(path, value), "here", command) != Config()
        else:
            with pytest.raises(ConfigError, match=f"^here: {command} does not use {re.escape(path)} ") as error:
                configured(given(path, value), "here", command)
            assert users(path)
            instead = INSTEAD.get(command, {}).get(path)
            assert f"but {instead}: give that one" in str(error.value) or instead is None
    assert all(uses(command, path) for path in INSTEAD.get(command, {}).values())


@pytest.mark.parametrize("command", RUNS)
def test_a_saved_configuration_makes_the_same_run(command, tmp_path):
    config = Config()
    for path, known in KNOWN.items():
        if uses(command, path):
            value = another(known, value_of(config, path.rpartition(".")[0]))
            config = overlaid(config, tree_of(path, list(value) if isinstance(value, tuple) else value), "here")
    saved = tmp_path / "config.yaml"
    saved.write_text(to_yaml(config, command))
    assert read_config(saved, command) == config
    tree = yaml.safe_load(saved.read_text())
    assert list(tree)[-1] == "expert"
    assert set(flat(tree)) == {
        f"expert.{path}" if known.about.kind == "expert" else path
        for path, known in KNOWN.items()
        if uses(command, path)
    }


def flat(tree, before=""):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from flat(value, f"{before}{key}.")
        else:
            yield f"{before}{key}"


@pytest.mark.parametrize("path", OLD)
def test_every_name_of_0_1_is_known_or_leads_to_its_new_one(path):
    if path in KNOWN:
        return
    with pytest.raises(ConfigError, match=re.escape(path)) as error:
        configured(tree_of(path, 1), "here")
    if path in GONE:
        assert "no setting any more" in str(error.value)
        return
    new = new_name(path, KNOWN)
    assert f"{path} is called {new} now: write " in str(error.value)
    assert ("write expert: {" in str(error.value)) == (KNOWN[new].about.kind == "expert")


def test_an_old_name_of_another_command_is_to_be_removed():
    with pytest.raises(ConfigError, match=r"is called rotations.enabled now, and slam does not use .*: remove it"):
        configured(tree_of("mapping.rotations.enabled", False), "here", "slam")
    with pytest.raises(ConfigError, match=r"estimation.smoother.lag_s but slam.lag_s: give that one"):
        configured(tree_of("localization.smoother.lag_s", 3), "here", "slam")


def test_no_old_name_is_in_vain():
    assert set(RENAMED.values()) <= KNOWN.keys()
    assert not RENAMED.keys() & KNOWN.keys()
    assert not GONE.keys() & KNOWN.keys()


@pytest.mark.parametrize(
    ("path", "near"),
    [
        ("mapping.min_view", "mapping.min_views"),
        ("maping.min_views", "mapping.min_views"),
        ("slam.max_views", "objects.max_views"),
        ("slam.loop_closures.enabled", "slam.loop_closure.enabled"),
        ("corners", "slam.points.corners"),
        ("segmentation.banana", "score_threshold"),
        ("banana", "tracking"),
    ],
)
def test_typing_errors_are_answered_with_near_names(path, near):
    with pytest.raises(ConfigError, match=f"here: unknown setting {re.escape(path)}.*{re.escape(near)}"):
        configured(tree_of(path, 3), "here", "slam")


@pytest.mark.parametrize(
    "text", ["? [1, 2]\n: 3", "{1: 2}", "slam: {lag_s: 2001-01-01}", "? {a: 1}\n: 3", "!!python/x 3"]
)
def test_odd_yaml_is_refused_in_one_line(tmp_path, text):
    file = tmp_path / "settings.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"settings\.yaml: [^\n]+$"):
        read_config(file, "slam")


@pytest.mark.parametrize("document", [[1], 3, "text", {"slam": 3}, {"expert": [1]}, {"slam": {"points": [1]}}])
def test_what_is_no_tree_is_refused(document):
    with pytest.raises(ConfigError, match="expected settings with values"):
        configured(document, "here")


def test_numbers_are_written_as_people_write_them(tmp_path):
    file = tmp_path / "settings.yaml"
    file.write_text("estimation: {imu: {gyroscope_noise: 1e-4, gravity_m_s2: 10}}\nslam:\nexpert:\n")
    found = read_config(file)
    assert (found.estimation.imu.gyroscope_noise, found.estimation.imu.gravity_m_s2) == (1e-4, 10.0)
    assert isinstance(found.estimation.imu.gravity_m_s2, float)


def test_a_setting_that_stands_twice_is_refused(tmp_path):
    file = tmp_path / "settings.yaml"
    file.write_text("slam: {lag_s: 3}\nmapping: {min_views: 3}\nslam: {lag_s: 4}\n")
    with pytest.raises(ConfigError, match=r"line 3.*slam stands twice"):
        read_yaml(file)


def test_the_page_is_as_the_code_declares():
    assert PAGE.read_text(encoding="utf-8") == page(), "run scripts/settings_page.py"
