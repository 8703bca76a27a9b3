"""The masks that a project names: a folder with one for each photograph, one for all photographs of a camera, and kinds
that are found automatically."""

from collections.abc import Sequence
from dataclasses import dataclass
from os.path import isdir, isfile  # false, not an exception, for a name that cannot be
from pathlib import Path

from photogram.errors import ImageError
from photogram.files.photographs.masks import MaskFiles, find_masks
from photogram.files.stage_folders import stage_folder_around
from photogram.project.document import Document, Key
from photogram.project.schema import AutomaticMask, PhotographEntry, ProjectFile
from photogram.surface.dense.tile_matching import DenseSettings
from photogram.wording import some, things

MASKS_KEY: Key = ("photographs", "masks")


@dataclass(frozen=True)
class ProjectMasks:
    """The masks of a project's photographs."""

    files: tuple[tuple[Path, ...], ...] = ()
    """By photograph: its own mask, and that of its camera; what one of them leaves out is left out. () for none."""
    auto: tuple[AutomaticMask, ...] = ()
    """What is found and left out automatically."""

    @property
    def given(self) -> bool:
        """Return whether any photograph has a mask."""
        return any(self.files)

    def of(self, photograph: int) -> tuple[Path, ...]:
        """Return the files of a photograph's masks, by its number."""
        return self.files[photograph] if self.files else ()


def masks_of_photographs(
    document: Document, file: ProjectFile, photographs: Sequence[str], folder: Path | None
) -> MaskFiles:
    """Return the masks in the project's folder of masks; what is wrong with it is noted in the document.

    ``photographs`` are the names of the photographs in ``folder``.
    """
    none = MaskFiles({}, ())
    if file.photographs.masks is None or file.photographs.masks.folder is None:
        return none
    masks = document.base / file.photographs.masks.folder
    if not isdir(masks):
        document.add_error(MASKS_KEY, f"folder {masks} not found")
        return none
    if folder is not None and masks.resolve() == folder.resolve():
        document.add_error(MASKS_KEY, "is the folder of the photographs too: move the masks to a folder of their own")
        return none
    written = (document.base / file.results).resolve()
    if masks.resolve().is_relative_to(written) or stage_folder_around(document.base / file.work, masks / "mask.png"):
        text = "lies in a folder that photogram makes and removes as it works"
        if masks.resolve().is_relative_to(written):
            text = f"lies in {written}, where photogram writes"
        document.add_error(MASKS_KEY, f"{text}: copy the masks to a folder of their own")
        return none
    try:
        files = find_masks(masks, photographs)
    except ImageError as error:
        for line in str(error).splitlines():
            document.add_error(MASKS_KEY, line)
        return none
    if files.others:
        text = f"{things(len(files.others), 'picture')} in {masks} fit no photograph: {some(files.others)}"
        document.warn(MASKS_KEY, text, "call masks after their photographs, IMG_1_mask.png for example")
    return files


def check_camera_masks(document: Document, file: ProjectFile) -> None:
    """Note the masks of cameras that are not there."""
    for name, camera in file.cameras.items():
        if camera.mask is not None and not isfile(document.base / camera.mask):
            document.add_error(("cameras", name, "mask"), f"file {document.base / camera.mask} not found")


def check_automatic_masks(document: Document, file: ProjectFile, dense: DenseSettings | None) -> None:
    """Note water that is asked for where it cannot be found: where no surface is matched, or no key points are
    detected. ``dense`` is None where its section is wrong."""
    asked, start = file.photographs.masks, file.start
    if asked is None or "water" not in asked.auto:
        return
    if dense is not None and not dense.enabled:
        document.warn(MASKS_KEY, "water is looked for in the dense surface, and none is matched", "enable dense")
    if start is not None and start.solution is not None and start.tie_points == "theirs":
        text = "water is found by key points without a match, and a project that starts from tie points detects none"
        document.warn(MASKS_KEY, text, "write start: {tie_points: own}")


def project_masks(
    file: ProjectFile, photographs: Sequence[PhotographEntry], cameras: Sequence[str], masks: MaskFiles, base: Path
) -> ProjectMasks:
    """Return the masks of photographs; ``cameras`` are the names of theirs in the project file."""
    files = []
    for photograph, camera in zip(photographs, cameras, strict=True):
        own, common = masks.of_photograph.get(photograph.name or ""), file.cameras[camera].mask
        files.append(tuple(p for p in (own, None if common is None else base / common) if p is not None))
    asked = file.photographs.masks
    return ProjectMasks(tuple(files), () if asked is None else tuple(dict.fromkeys(asked.auto)))
