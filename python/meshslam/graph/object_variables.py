"""The objects' variables in the window, and the observations that tie them to cameras."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import gtsam
import numpy as np
from gtsam.symbol_shorthand import O, S, Z

from meshslam.geometry import Floats, Pose
from meshslam.graph.camera_states import CameraStates
from meshslam.graph.object_factor import ObservationCost
from meshslam.graph.record_factors import add_record
from meshslam.graph.records import Record, pose_record, vector_record
from meshslam.graph.tags import ObservationTag, RoadTag
from meshslam.graph.view_terms import ViewTerm, view_factor
from meshslam.graph.window import Entry, Window
from meshslam.motion import from_pose3, to_gtsam_covariance, to_pose3

SIZE = S(0)  # how much larger all objects are than their category's mean, in its sigmas
_WEAK_SIGMAS = np.array([1.0] * 3 + [10.0] * 3)  # of a new object's pose: rad, m


class ObjectVariables:
    """Objects of the window: known ones with a prior, and landmarks whose pose and modes are both estimated."""

    def __init__(self, window: Window, cameras: CameraStates) -> None:
        self._window, self._cameras = window, cameras
        self._last_frame: dict[int, int] = {}  # of each object in the window, the frame that observed it last
        self._landmarks: dict[int, list[ObservationTag]] = {}  # with the observations of each

    @property
    def landmarks(self) -> list[int]:
        """Objects in the window whose pose and modes are estimated."""
        return sorted(self._landmarks)

    def holds(self, number: int) -> bool:
        """Whether an object is in the window."""
        return number in self._last_frame

    def last_frame(self, number: int) -> int:
        """The frame that observed an object of the window last."""
        return self._last_frame[number]

    def observe_known(
        self, cost: ObservationCost, number: int, world_from_object: Pose, covariance: Floats | None
    ) -> None:
        """Add an observation, in the newest frame, of a mapped object.

        Without a covariance (6, 6) the object is fixed; with one its pose is estimated along.
        """
        key: Pose | int = world_from_object
        if covariance is not None:
            key = O(number)
            if number not in self._last_frame:
                self._window.values.insert(key, to_pose3(world_from_object))
                prior = gtsam.noiseModel.Gaussian.Covariance(to_gtsam_covariance(covariance))
                self._window.add(gtsam.PriorFactorPose3(key, to_pose3(world_from_object), prior))
            self._last_frame[number] = self._cameras.newest
        frame = self._cameras.newest
        self._add(ViewTerm(cost, self._cameras.keys(frame), self._cameras.memo(frame), key, None), number, frame)

    def add_landmark(
        self, number: int, world_from_object: Pose, z: Floats, scale_direction: Floats, size_sigma: float
    ) -> None:
        """Add an object: its pose is free, its modes z ~ N(s g, I).

        g (modes,), of unit length, makes an object larger as a whole; s ~ N(0, size_sigma^2) is one for all objects:
        the cars of one place may all be larger than the category's mean, and without s their size would fix the scale.
        """
        values = self._window.values
        values.insert(O(number), to_pose3(world_from_object))
        values.insert(Z(number), z)
        records = [pose_record(O(number), world_from_object, _WEAK_SIGMAS)]
        if not values.exists(SIZE):
            values.insert(SIZE, np.zeros(1))
            records.append(vector_record(SIZE, np.zeros(1), size_sigma))
        records.append(Record("size", (Z(number), SIZE), scale_direction))
        for record in records:
            add_record(self._window, record, self._cameras)
        self._last_frame[number] = self._cameras.newest
        self._landmarks[number] = []

    def observe_landmark(self, cost: ObservationCost, number: int, frame: int) -> Entry:
        """Add an observation of a landmark in a frame that is held."""
        keys, memo = self._cameras.keys(frame), self._cameras.memo(frame)
        self._last_frame[number] = max(frame, self._last_frame[number])
        entry = self._add(ViewTerm(cost, keys, memo, O(number), Z(number)), number, frame)
        assert isinstance(entry.tag, ObservationTag)
        self._landmarks[number].append(entry.tag)
        return entry

    def _add(self, term: ViewTerm, number: int, frame: int) -> Entry:
        return self._window.add(view_factor(term), ObservationTag(number, frame, term.cost), term)

    def state(self, number: int) -> tuple[Pose, Floats]:
        """world_from_object and modes of a landmark."""
        values = self._window.values
        return from_pose3(values.atPose3(O(number))), values.atVector(Z(number))

    def pose_covariance(self, number: int) -> Floats:
        """Covariance (6, 6) of a landmark's world_from_object, right perturbation, (translation, rotation)."""
        return to_gtsam_covariance(self._window.covariance(O(number)))

    def pose_covariances(self, numbers: Sequence[int]) -> dict[int, Floats]:
        """As `pose_covariance` of each landmark, at the cost of one."""
        found = self._window.covariances([O(number) for number in numbers])
        return {number: to_gtsam_covariance(found[O(number)]) for number in numbers}

    @contextmanager
    def linearizations_kept(self) -> Iterator[None]:
        """Whatever is evaluated in the block, observations are linearized afterwards where they were before."""
        kept = [(tag.cost, tag.cost.linearization) for _, tag in self.observations()]
        try:
            yield
        finally:
            for cost, linearization in kept:
                cost.linearization = linearization

    def observations(self) -> list[tuple[Entry, ObservationTag]]:
        """All observations in the window."""
        return [(e, e.tag) for e in self._window.entries if isinstance(e.tag, ObservationTag)]

    def linear_observations(self, number: int) -> list[tuple[int, Floats, Floats]]:
        """Frame, Jacobian (n, 6 + modes) and residual (n,) of each observation of a landmark."""
        pose, z = self.state(number)
        cameras = self._cameras
        return [
            (tag.frame, *tag.cost.linearize(cameras.world_from_camera(tag.frame).inverse() @ pose, z))
            for tag in self._landmarks[number]
        ]

    def drop(self, entries: Sequence[Entry]) -> None:
        """Take observations of the newest frame back."""
        self._window.drop(entries)
        gone = {id(entry.tag) for entry in entries}
        self._landmarks = {n: [tag for tag in tags if id(tag) not in gone] for n, tags in self._landmarks.items()}

    def forget(self, number: int) -> None:
        """Take back all observations of an object, but for what has become a prior of others."""
        self._window.drop([e for e, tag in self.observations() if tag.number == number])
        if number in self._landmarks:
            self._window.drop([e for e in self._window.entries if e.tag == RoadTag(number)])
            self._landmarks[number] = []

    def retire_unobserved(self) -> set[int]:
        """Objects that no frame of the window observes leave it. Returns their variables."""
        unseen = [n for n, last in self._last_frame.items() if not self._cameras.holds(last)]
        for number in unseen:
            del self._last_frame[number]
            self._freeze(number)
        shaped = {Z(n) for n in unseen if n in self._landmarks}
        for number in unseen:
            self._landmarks.pop(number, None)
        return {O(n) for n in unseen} | shaped

    def clear(self) -> None:
        """Forget which objects the window holds."""
        self._last_frame, self._landmarks = {}, {}

    def to_arrays(self) -> dict[str, Floats]:
        """Which objects the window holds, as a plain array."""
        rows = [[n, f, n in self._landmarks] for n, f in self._last_frame.items()]
        return {"objects": np.array(rows, float).reshape(-1, 3)}

    def fill(self, arrays: Mapping[str, Floats], open_observations: Sequence[ObservationTag]) -> None:
        """The reverse of `to_arrays`, with the observations of landmarks in the order in which they came."""
        self._last_frame = {int(n): int(f) for n, f, _ in arrays["objects"]}
        self._landmarks = {int(n): [] for n, _, shaped in arrays["objects"] if shaped}
        for tag in open_observations:
            self._landmarks[tag.number].append(tag)

    def open_observations(self) -> list[ObservationTag]:
        """Those that are linearized once more when their landmark leaves the window."""
        return [tag for tags in self._landmarks.values() for tag in tags]

    def _freeze(self, number: int) -> None:
        """Linearize a landmark's observations for good, now that all of them have had their say."""
        for tag in self._landmarks.get(number, []):
            pose, z = self.state(number)
            tag.cost.freeze(self._cameras.world_from_camera(tag.frame).inverse() @ pose, z)
