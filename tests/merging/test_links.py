"""Links between drives: the most evident ones decide, and one that contradicts them is said."""

import numpy as np

from meshslam.geometry import Pose
from meshslam.merging.links import Link, _joined


def test_a_link_that_contradicts_more_evident_ones_is_a_conflict(street, drive_by):
    drives = [drive_by(f"d{k}", street(1), k)[0] for k in range(3)]
    ahead = Pose.from_yaw(0.0, np.array([10.0, 0.0, 0.0]))
    pairs = ((1, 1), (2, 2), (3, 3))
    links = [
        Link(0, 1, ahead, pairs, 40.0, 0.1),
        Link(1, 2, ahead, pairs, 30.0, 0.1),
        Link(0, 2, Pose.from_yaw(0.0, np.array([60.0, 0.0, 0.0])), pairs, 10.0, 0.3),
    ]
    found = _joined(drives, links, {}, [np.zeros(3)] * 3)
    [component] = found.components
    assert len(component.links) == 2
    assert np.abs(component.world_from_drive[2].translation - [20.0, 0.0, 0.0]).max() < 1e-9
    [said] = found.conflicts
    assert said.startswith("d0 and d2: the 3 cars that they seem to share would lay them 40.0 m")


def test_drives_without_links_are_components_of_their_own(street, drive_by):
    drives = [drive_by(f"d{k}", street(1), k)[0] for k in range(3)]
    links = [Link(1, 2, Pose.identity(), ((1, 1),), 20.0, 0.0)]
    found = _joined(drives, links, {}, [np.zeros(3)] * 3)
    assert [sorted(c.world_from_drive) for c in found.components] == [[1, 2], [0]]
    assert [c.anchor for c in found.components] == [1, 0]
