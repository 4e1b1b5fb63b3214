"""Pictures of a run: the HTML report, and its parts that stand alone."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.viewing.better import Better, better_of
    from meshslam.viewing.category_sheet import category_page, category_png
    from meshslam.viewing.charts import Line, line_charts
    from meshslam.viewing.comparison import (
        CarPair,
        ComparedCars,
        ComparedRun,
        Comparison,
        FigureRow,
        OverlayFrame,
        comparison_page,
        differing_settings,
        figure_rows_of,
        figure_text,
    )
    from meshslam.viewing.comparison_plan import LETTERS
    from meshslam.viewing.context import FRAMES_IN_REPORT, ReportContext, TrueObject
    from meshslam.viewing.fleet_table import FleetRow, fleet_page
    from meshslam.viewing.from_above import footprint
    from meshslam.viewing.markup import jpeg_uri, number, table, text
    from meshslam.viewing.mcap_log import McapLog, can_write_mcap
    from meshslam.viewing.merged_page import merge_page
    from meshslam.viewing.mesh_drawing import mesh_picture
    from meshslam.viewing.opened_log import LogTargets, OpenedLog, open_run_log
    from meshslam.viewing.overlay import draw_overlay
    from meshslam.viewing.overview import figure_rows, overview_page
    from meshslam.viewing.path_charts import iterations_chart, lines_from_above, path_chart
    from meshslam.viewing.recording import log_finished_run, write_recording
    from meshslam.viewing.report import write_report
    from meshslam.viewing.rerun_log import RerunLog, can_record
    from meshslam.viewing.run_log import Colouring, RunLog
    from meshslam.viewing.tables import describe
else:
    __getattr__ = deferred(
        __name__,
        {
            "better": "Better better_of",
            "category_sheet": "category_page category_png",
            "charts": "Line line_charts",
            "comparison": (
                "CarPair ComparedCars ComparedRun Comparison FigureRow OverlayFrame comparison_page "
                "differing_settings figure_rows_of figure_text"
            ),
            "comparison_plan": "LETTERS",
            "context": "FRAMES_IN_REPORT ReportContext TrueObject",
            "fleet_table": "FleetRow fleet_page",
            "from_above": "footprint",
            "markup": "jpeg_uri number table text",
            "mcap_log": "McapLog can_write_mcap",
            "merged_page": "merge_page",
            "mesh_drawing": "mesh_picture",
            "opened_log": "LogTargets OpenedLog open_run_log",
            "overlay": "draw_overlay",
            "overview": "figure_rows overview_page",
            "path_charts": "iterations_chart lines_from_above path_chart",
            "recording": "log_finished_run write_recording",
            "report": "write_report",
            "rerun_log": "RerunLog can_record",
            "run_log": "Colouring RunLog",
            "tables": "describe",
        },
    )

__all__ = [
    "FRAMES_IN_REPORT",
    "LETTERS",
    "Better",
    "CarPair",
    "Colouring",
    "ComparedCars",
    "ComparedRun",
    "Comparison",
    "FigureRow",
    "FleetRow",
    "Line",
    "LogTargets",
    "McapLog",
    "OpenedLog",
    "OverlayFrame",
    "ReportContext",
    "RerunLog",
    "RunLog",
    "TrueObject",
    "better_of",
    "can_record",
    "can_write_mcap",
    "category_page",
    "category_png",
    "comparison_page",
    "describe",
    "differing_settings",
    "draw_overlay",
    "figure_rows",
    "figure_rows_of",
    "figure_text",
    "fleet_page",
    "footprint",
    "iterations_chart",
    "jpeg_uri",
    "line_charts",
    "lines_from_above",
    "log_finished_run",
    "merge_page",
    "mesh_picture",
    "number",
    "open_run_log",
    "overview_page",
    "path_chart",
    "table",
    "text",
    "write_recording",
    "write_report",
]
