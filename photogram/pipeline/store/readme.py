"""README.txt of a folder of results: which file is where, and what it holds, for those who are handed them."""

from collections.abc import Iterator
from pathlib import Path

from photogram.files.atomic import replacing
from photogram.languages.language import Language
from photogram.pipeline.store.results_record import CHECKSUMS, read_record, recorded
from photogram.result_files import PURPOSES, ResultFolder, contents_of, rank_of, within_results

README = "README.txt"


def write_readme(results: Path, language: Language) -> None:
    """Write README.txt in a language to the deliverables of a folder of results, of what photogram has written there;
    nothing where the results are in no folders yet. Raises WorkspaceError where it cannot be written."""
    if not (results / ResultFolder.DELIVERABLES).is_dir():
        return
    names = [*read_record(results), within_results(README)]
    heading = (
        language.gettext("Results of a photogrammetric survey, calculated by photogram."),
        language.gettext(
            "Begin with report.html, which opens in any browser; its first four pages need no knowledge of "
            "photogrammetry."
        ),
    )
    ending = language.gettext(
        "{checksums} in each folder holds the checksums of its files: sha256sum --check {checksums}",
        checksums=CHECKSUMS,
    )
    listed = "".join(_listed(dict.fromkeys(names), language))
    with recorded(results), replacing(results / within_results(README)) as temporary:
        temporary.write_text("\n".join((*heading, f"{listed}\n{ending}\n")), encoding="utf-8")


def _listed(names: dict[str, None], language: Language) -> Iterator[str]:
    for folder in ResultFolder:
        own = [name.removeprefix(f"{folder}/") for name in names if name.startswith(f"{folder}/")]
        if not own:
            continue
        yield f"\n{folder}/\n{language.gettext(PURPOSES[folder])}.\n\n"
        files = sorted((name for name in own if "/" not in name), key=lambda name: (rank_of(name), name))
        further = sorted({name.partition("/")[0] for name in own if "/" in name})
        lines = [(name, language.gettext(contents) if (contents := contents_of(name)) else "") for name in files]
        for within in further:
            inner = [name for name in own if name.startswith(f"{within}/")]
            known = next(filter(None, map(contents_of, inner)), None)
            said = language.ngettext("{n} picture", "{n} pictures", len(inner))
            lines.append((f"{within}/", said if known is None else language.gettext(known)))
        width = max(len(name) for name, _ in lines)
        yield from (f"  {name:<{width}}  {contents}".rstrip() + "\n" for name, contents in lines)
