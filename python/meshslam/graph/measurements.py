"""Measurements of the images that are no objects, as factors: point tracks, displacements, objects on the road."""

from __future__ import annotations

import numpy as np
from gtsam.symbol_shorthand import O, X

from meshslam.features import PointConfig, PointTracks
from meshslam.geometry import Camera
from meshslam.graph.camera_states import CameraStates
from meshslam.graph.point_factor import point_factor, point_term
from meshslam.graph.record_factors import add_record
from meshslam.graph.records import Record
from meshslam.graph.tags import DISPLACEMENT, PointTag, RoadTag
from meshslam.graph.window import Window


class Measurements:
    """Adds measurements to a window; what a newer one replaces is taken out, what it outdates is held linear."""

    def __init__(self, window: Window, cameras: CameraStates) -> None:
        self._window, self._cameras = window, cameras

    def add_point_tracks(self, tracks: PointTracks, camera: Camera, config: PointConfig) -> None:
        """Point tracks over some frames; those of the same first frame are replaced."""
        tag = PointTag(tracks.row, tracks.first)
        points = [e for e in self._window.entries if isinstance(e.tag, PointTag) and e.tag.row == tracks.row]
        self._window.drop([e for e in points if e.tag == tag])
        self._window.settle([e for e in points if e.tag != tag])
        if tracks.tracks and self._cameras.holds(tracks.first):
            frames = range(tracks.first, tracks.last + 1)
            keys = {f: self._cameras.keys(f) for f in frames}
            memos = {f: self._cameras.memo(f) for f in frames}
            term = point_term(tracks, keys, memos, camera, config)
            self._window.add(point_factor(term), tag, term)

    def add_displacement(self, first: int, second: int, displacement_m: float, sigma_m: float) -> None:
        """The distance between the cameras of two frames, both of which are held."""
        self._window.settle([e for e in self._window.entries if e.tag == DISPLACEMENT])
        record = Record("displacement", (X(first), X(second)), np.array([displacement_m, sigma_m]))
        add_record(self._window, record, self._cameras, DISPLACEMENT)

    def add_road_height(self, number: int, frame: int, below_camera_m: float, sigma_m: float) -> None:
        """An object's origin lies so far below the camera of a frame: its wheels stand on the road.

        An earlier measurement of its height in the window is replaced.
        """
        self._window.drop([e for e in self._window.entries if e.tag == RoadTag(number)])
        record = Record("road height", (X(frame), O(number)), np.array([below_camera_m, sigma_m]))
        self._window.settle([add_record(self._window, record, self._cameras, RoadTag(number))])
