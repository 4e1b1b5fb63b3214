"""Pictures of a run: the HTML report, and its parts that stand alone."""

from meshslam.viewing.birds_eye import birds_eye
from meshslam.viewing.context import ReportContext
from meshslam.viewing.overlay import draw_overlay
from meshslam.viewing.recording import can_record, write_recording
from meshslam.viewing.report import write_report

__all__ = ["ReportContext", "birds_eye", "can_record", "draw_overlay", "write_recording", "write_report"]
