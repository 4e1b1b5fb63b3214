"""Drives are laid into one world by the cars that they share."""

import numpy as np
import pytest

from meshslam.errors import MapError
from meshslam.geometry import Pose
from meshslam.merging import MergingConfig, drive_names, in_order, merge_drives
from tests.merging.conftest import camera_path

NO_VIEWS = MergingConfig(use_views=False)


def drift(merged, index, anchor_from_street, drive_from_street):
    """RMSE of a drive's path, m, and its rotation, degrees."""
    laid = next(laid for laid in merged.worlds[0].drives if laid.index == index)
    true = anchor_from_street @ drive_from_street.inverse()
    path = merged.drives[index].trajectory.positions_in_world
    away = np.linalg.norm(laid.world_from_drive.transform(path) - true.transform(path), axis=1)
    return float(np.sqrt((away**2).mean())), float(np.degrees(np.linalg.norm(true.local(laid.world_from_drive)[3:])))


@pytest.mark.parametrize("seed", range(4))
def test_maps_moved_by_any_transform_are_laid_back(street, drive_by, seed):
    cars = street(seed)
    (one, a), (two, b), (three, c) = (drive_by(f"d{k}", cars, 10 * seed + k, numbers_from=100 * k) for k in range(3))
    merged = merge_drives((one, two, three), NO_VIEWS)
    assert len(merged.worlds) == 1
    assert len(merged.map) == len(cars)
    for index, world in ((1, b), (2, c)):
        metres, degrees = drift(merged, index, a, world)
        assert metres < 0.10
        assert degrees < 0.5
    for thing in merged.map.objects:
        gaps = [
            np.linalg.norm((a @ pose).translation - thing.world_from_object.translation) for pose, _ in cars.values()
        ]
        assert min(gaps) < 0.15


def test_how_well_drives_lie_is_known_honestly(street, drive_by):
    """Squared errors of a drive's world, by its covariance, have the mean of chi-square."""
    errors = []
    exact = MergingConfig(use_views=False, place_sigma_m=0.0, heading_sigma_deg=0.0)
    for seed in range(10):
        cars = street(seed)
        one, a = drive_by("one", cars, 2 * seed)
        two, b = drive_by("two", cars, 2 * seed + 1)
        merged = merge_drives((one, two), exact)
        laid = merged.worlds[0].drives[1]
        gap = laid.world_from_drive.local(a @ b.inverse())
        errors.append(gap @ np.linalg.solve(laid.covariance, gap))
    assert 2.5 < np.mean(errors) < 9.0  # 6 are expected


def test_what_two_drives_saw_is_known_better_than_what_one_saw(street, drive_by):
    cars = street(1)
    one, _ = drive_by("one", cars, 1)
    two, _ = drive_by("two", {k: v for k, v in cars.items() if k > 3}, 2)
    merged = merge_drives((one, two), NO_VIEWS)
    sigma = {car.thing.id: np.sqrt(np.trace(car.thing.covariance[:3, :3])) for car in merged.worlds[0].cars}
    alone = [sigma[car.thing.id] for car in merged.worlds[0].cars if len(car.seen_in) == 1]
    both = [sigma[car.thing.id] for car in merged.worlds[0].cars if len(car.seen_in) == 2]
    assert len(alone) == 3
    assert len(both) == len(cars) - 3
    assert max(both) < min(alone)


def test_drives_hang_together_through_a_third(street, drive_by):
    cars = street(2, 20)
    parts = [{k: v for k, v in cars.items() if low < k <= low + 10} for low in (0, 5, 10)]
    drives, worlds = zip(*(drive_by(f"d{k}", part, 20 + k) for k, part in enumerate(parts)), strict=True)
    merged = merge_drives(drives, NO_VIEWS)
    assert len(merged.worlds) == 1
    assert len(merged.map) == 20
    assert drift(merged, 2, worlds[0], worlds[2])[0] < 0.6  # the path is far from the cars that are shared


def test_a_drive_of_another_street_keeps_its_world_and_the_reason_is_told(street, drive_by):
    one, _ = drive_by("here", street(3), 1)
    two, _ = drive_by("here again", street(3), 2)
    other, _ = drive_by("elsewhere", street(77, 10, 8.1), 3)
    merged = merge_drives((other, one, two), NO_VIEWS)
    assert [[merged.drives[d.index].name for d in world.drives] for world in merged.worlds] == [
        ["here", "here again"],
        ["elsewhere"],
    ]
    assert len(merged.worlds[1].standing) == len(other.map)
    [said] = [note for note in merged.notes if note.startswith("elsewhere")]
    assert "world-2" in said
    assert "objects" in said


def test_cars_taken_the_wrong_way_round_are_one_and_most_views_decide(street, drive_by):
    cars = street(4)
    drives, worlds = zip(*(drive_by(f"d{k}", cars, k, turned=(2, 5) if k == 1 else ()) for k in range(3)), strict=True)
    merged = merge_drives(drives, NO_VIEWS)
    assert len(merged.map) == len(cars)
    for number, (pose, _) in cars.items():
        true = worlds[0] @ pose
        thing = min(
            merged.map.objects, key=lambda o: np.linalg.norm(o.world_from_object.translation - true.translation)
        )
        assert float(thing.world_from_object.rotation[:, 0] @ true.rotation[:, 0]) > 0.9, number


def test_worlds_that_are_one_already_are_corrected_only(street, drive_by):
    given = MergingConfig(use_views=False, poses="global")
    off = Pose.from_yaw(0.003, np.array([0.4, -0.3, 0.1]))
    cars = street(5)
    one, a = drive_by("one", cars, 1, world=Pose.identity())
    two, b = drive_by("two", cars, 2, world=off)
    far, _ = drive_by(
        "far",
        {k: (Pose.from_yaw(0.0, np.array([500.0, 0, 0])) @ p, v) for k, (p, v) in cars.items()},
        3,
        world=Pose.identity(),
    )
    merged = merge_drives((one, two, far), given)
    assert len(merged.worlds) == 1
    assert drift(merged, 1, a, b)[0] < 0.1
    assert merged.worlds[0].drives[2].how == "given"
    assert np.abs(merged.worlds[0].drives[2].world_from_drive.matrix - np.eye(4)).max() < 1e-6
    assert len(merged.map) == 2 * len(cars)


def test_a_bent_drive_is_said(street, drive_by):
    cars = street(6, 16)
    one, _ = drive_by("straight", cars, 1)
    bent = {
        k: (Pose.from_yaw(0.0, np.array([0.0, 0.00035 * (p.translation[0] - 40) ** 2, 0.0])) @ p, v)
        for k, (p, v) in cars.items()
    }
    two, _ = drive_by("bent", bent, 2)
    merged = merge_drives((one, two), NO_VIEWS)
    assert any("its path is bent" in note for note in merged.notes)
    straight, _ = drive_by("other", cars, 3)
    assert not any("bent" in note for note in merge_drives((one, straight), NO_VIEWS).notes)


def test_drives_are_in_the_order_of_their_times_where_these_tell(street, drive_by):
    cars = street(7)
    early, late = drive_by("early", cars, 1)[0], drive_by("late", cars, 2)[0]
    assert [d.name for d in in_order((late, early))] == ["early", "late"]
    same = drive_by("same", cars, 2, path=camera_path(30))[0]
    assert [d.name for d in in_order((late, same))] == ["late", "same"]
    assert [d.name for d in in_order((same, late))] == ["same", "late"]


def test_one_drive_is_no_merge_and_no_run_counts_twice(street, drive_by, tmp_path):
    with pytest.raises(MapError, match="two runs or more"):
        merge_drives((drive_by("one", street(8), 1)[0],))
    with pytest.raises(MapError, match="given twice"):
        drive_names([tmp_path / "run", tmp_path / "run"])
    assert drive_names([tmp_path / "a" / "run", tmp_path / "b" / "run"]) == ["a/run", "b/run"]


@pytest.mark.parametrize("seed", [2, 6, 16, 17])
def test_streets_whose_cars_stand_in_even_steps_are_not_taken_for_each_other(street, drive_by, seed):
    """Their constellations agree roughly, by chance: the cars' own sigmas tell."""
    one, other = (drive_by(f"d{k}", street(seed + 500 * k, 9), seed + 50 * k)[0] for k in range(2))
    merged = merge_drives((one, other), NO_VIEWS)
    assert len(merged.worlds) == 2
    assert any("agree roughly only" in note for note in merged.notes)
