"""The dense cloud as Cloud Optimized Point Cloud: dense.copc.laz."""

from pathlib import Path

from photogram.delivery.survey_contents import SurveyContents
from photogram.files.atomic import scratch_folder, temporary_name
from photogram.files.clouds.copc import point_count, write_copc
from photogram.geodesy.crs import map_units
from photogram.wording import things


def write_copc_cloud(path: Path, contents: SurveyContents) -> tuple[str, tuple[str, ...]]:
    """Write the points of the dense cloud as COPC, whole or not at all; return in words what it holds, nothing where
    there is no cloud and no file was written, and sentences on what it does not hold.

    The cloud is made anew of the surface, as LAZ beside the file, so it is that of the survey as it stands, whatever
    became of dense.laz. Raises WorkspaceError where a file cannot be read or written.
    """
    if contents.write_cloud is None:
        return "", (f"Dense cloud: {contents.absent.get('dense cloud') or 'there is none'}.",)
    with scratch_folder(temporary_name(path.parent)) as folder:
        cloud = folder / "dense.laz"
        contents.write_cloud(cloud)
        if point_count(cloud) == 0:
            return "", ("Dense cloud: no cell of the surface has a height and a colour.",)
        made = write_copc(path, cloud)
    spacing = f"{made.spacing:.2g} {map_units(contents.crs).plan_symbol}"
    return f"{things(made.points, 'point')} in {things(made.levels, 'level')} of detail, the first every {spacing}", ()
