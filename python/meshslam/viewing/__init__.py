"""Pictures of a run: the HTML report, and its parts that stand alone."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.viewing.category_sheet import category_page, category_png
    from meshslam.viewing.charts import Line, line_charts
    from meshslam.viewing.context import ReportContext
    from meshslam.viewing.from_above import birds_eye, footprint
    from meshslam.viewing.markup import jpeg_uri, number, table, text
    from meshslam.viewing.mesh_drawing import mesh_picture
    from meshslam.viewing.overlay import draw_overlay
    from meshslam.viewing.overview import figure_rows, overview_page
    from meshslam.viewing.path_charts import iterations_chart, lines_from_above, path_chart
    from meshslam.viewing.recording import can_record, write_recording
    from meshslam.viewing.report import write_report
else:
    __getattr__ = deferred(
        __name__,
        {
            "category_sheet": "category_page category_png",
            "charts": "Line line_charts",
            "context": "ReportContext",
            "from_above": "birds_eye footprint",
            "markup": "jpeg_uri number table text",
            "mesh_drawing": "mesh_picture",
            "overlay": "draw_overlay",
            "overview": "figure_rows overview_page",
            "path_charts": "iterations_chart lines_from_above path_chart",
            "recording": "can_record write_recording",
            "report": "write_report",
        },
    )

__all__ = [
    "Line",
    "ReportContext",
    "birds_eye",
    "can_record",
    "category_page",
    "category_png",
    "draw_overlay",
    "figure_rows",
    "footprint",
    "iterations_chart",
    "jpeg_uri",
    "line_charts",
    "lines_from_above",
    "mesh_picture",
    "number",
    "overview_page",
    "path_chart",
    "table",
    "text",
    "write_recording",
    "write_report",
]
