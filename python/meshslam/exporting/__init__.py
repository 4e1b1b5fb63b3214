"""A finished run in the formats of other tools: meshes, paths, labels, tables, logs, bags."""

from typing import TYPE_CHECKING

from meshslam.deferred import deferred

if TYPE_CHECKING:
    from meshslam.exporting.export import check_format, export_content
    from meshslam.exporting.finished_run import FinishedRun
    from meshslam.exporting.formats import FORMATS, Format
    from meshslam.exporting.geojson import GeoOrigin
    from meshslam.exporting.logs import log_run
else:
    __getattr__ = deferred(
        __name__,
        {
            "export": "check_format export_content",
            "finished_run": "FinishedRun",
            "formats": "FORMATS Format",
            "geojson": "GeoOrigin",
            "logs": "log_run",
        },
    )

__all__ = ["FORMATS", "FinishedRun", "Format", "GeoOrigin", "check_format", "export_content", "log_run"]
