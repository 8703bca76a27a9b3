"""The files that are handed over, each with what it holds in a line."""

from collections.abc import Sequence
from dataclasses import dataclass

from photogram.report.record.verdict import DeliverableRecord
from photogram.result_files import PURPOSES, ResultFolder, contents_of, is_picture, rank_of
from photogram.wording import things

PAGE = "report.html"


@dataclass(frozen=True)
class HandedOver:
    """A file that is handed over, or a folder, and what it holds; empty where that is not known."""

    name: str
    contents: str


def handed_over(listed: Sequence[DeliverableRecord]) -> list[HandedOver]:
    """Return this report and the deliverables, those that a reader looks for first, and the other folders of results;
    of results that earlier versions sorted into no folders, every file."""
    names = sorted((entry["file"] for entry in listed), key=lambda name: (rank_of(name), name))
    own = [name for name in names if "/" not in name or name.startswith(f"{ResultFolder.DELIVERABLES}/")]
    rows = [HandedOver(name.rpartition("/")[2], contents_of(name)) for name in own if not is_picture(name)]
    for folder in (ResultFolder.QUALITY, ResultFolder.TECHNICAL):
        count = sum(name.startswith(f"{folder}/") for name in names)
        if count:
            rows.append(HandedOver(f"{folder}/", f"{PURPOSES[folder]} ({things(count, 'file')})"))
    return [HandedOver(PAGE, contents_of(PAGE)), *rows]
