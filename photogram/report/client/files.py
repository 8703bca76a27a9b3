"""The files that are handed over, each with what it holds in a line."""

from collections.abc import Sequence
from dataclasses import dataclass

from photogram.languages.language import ENGLISH, Language
from photogram.report.record.verdict import DeliverableRecord
from photogram.result_files import PURPOSES, ResultFolder, contents_of, is_picture, rank_of

PAGE = "report.html"


@dataclass(frozen=True)
class HandedOver:
    """A file that is handed over, or a folder, and what it holds; empty where that is not known."""

    name: str
    contents: str


def handed_over(listed: Sequence[DeliverableRecord], language: Language = ENGLISH) -> list[HandedOver]:
    """Return this report and the deliverables, those that a reader looks for first, and the other folders of results;
    of results that earlier versions sorted into no folders, every file."""
    names = sorted((entry["file"] for entry in listed), key=lambda name: (rank_of(name), name))
    own = [name for name in names if "/" not in name or name.startswith(f"{ResultFolder.DELIVERABLES}/")]
    rows = [HandedOver(name.rpartition("/")[2], _contents(name, language)) for name in own if not is_picture(name)]
    for folder in (ResultFolder.QUALITY, ResultFolder.TECHNICAL):
        count = sum(name.startswith(f"{folder}/") for name in names)
        if count:
            purpose = language.gettext(PURPOSES[folder])
            held = language.ngettext("{purpose} ({n} file)", "{purpose} ({n} files)", count, purpose=purpose)
            rows.append(HandedOver(f"{folder}/", held))
    return [HandedOver(PAGE, _contents(PAGE, language)), *rows]


def _contents(name: str, language: Language) -> str:
    contents = contents_of(name)
    return language.gettext(contents) if contents else ""
