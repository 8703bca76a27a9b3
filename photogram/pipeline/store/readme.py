"""README.txt of a folder of results: which file is where, and what it holds, for those who are handed them."""

from collections.abc import Iterator
from pathlib import Path

from photogram.files.atomic import replacing
from photogram.pipeline.store.results_record import CHECKSUMS, read_record, recorded
from photogram.result_files import PURPOSES, ResultFolder, contents_of, rank_of, within_results
from photogram.wording import things

README = "README.txt"
_HEADING = """Results of a photogrammetric survey, calculated by photogram.
Begin with report.html, which opens in any browser; its first four pages need no knowledge of photogrammetry.
"""
_ENDING = f"""
{CHECKSUMS} in each folder holds the checksums of its files: sha256sum --check {CHECKSUMS}
"""


def write_readme(results: Path) -> None:
    """Write README.txt to the deliverables of a folder of results, of what photogram has written there; nothing where
    the results are in no folders yet. Raises WorkspaceError where it cannot be written."""
    if not (results / ResultFolder.DELIVERABLES).is_dir():
        return
    names = [*read_record(results), within_results(README)]
    with recorded(results), replacing(results / within_results(README)) as temporary:
        temporary.write_text("".join((_HEADING, *_listed(dict.fromkeys(names)), _ENDING)), encoding="utf-8")


def _listed(names: dict[str, None]) -> Iterator[str]:
    for folder in ResultFolder:
        own = [name.removeprefix(f"{folder}/") for name in names if name.startswith(f"{folder}/")]
        if not own:
            continue
        yield f"\n{folder}/\n{PURPOSES[folder]}.\n\n"
        files = sorted((name for name in own if "/" not in name), key=lambda name: (rank_of(name), name))
        further = sorted({name.partition("/")[0] for name in own if "/" in name})
        lines = [(name, contents_of(name)) for name in files]
        lines += [(f"{f}/", things(sum(name.startswith(f"{f}/") for name in own), "picture")) for f in further]
        width = max(len(name) for name, _ in lines)
        yield from (f"  {name:<{width}}  {contents}".rstrip() + "\n" for name, contents in lines)
