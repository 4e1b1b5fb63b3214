"""Calibration files of other tools: one file a format behind `read_camera`."""

from meshslam.sequences.cameras.read import read_camera

__all__ = ["read_camera"]
