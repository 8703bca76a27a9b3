"""Verbs of data types whose work is done in rooms above them: by name, so that the types know none of these rooms.

A survey's types lie on the ground floor, writers and plots above it. ``Raster.write`` is a line that calls its verb.
"""

from importlib import import_module

VERBS = {
    "plot_adjustment": "photogram.report.figures.plots:plot_adjustment",
    "plot_cloud": "photogram.report.figures.plots:plot_cloud",
    "plot_raster": "photogram.report.figures.plots:plot_raster",
    "write_adjustment": "photogram.files.poses:write_pose_table",
    "write_cloud": "photogram.files.clouds.points:write_cloud",
    "write_raster": "photogram.files.maps.rasters:write_raster",
}
"""Module and function of each verb."""


def call(verb: str, *arguments: object) -> None:
    """Call a verb of VERBS; its module is imported when it is called first."""
    module, definition = VERBS[verb].split(":")
    getattr(import_module(module), definition)(*arguments)
