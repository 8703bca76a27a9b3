"""The epochs of a survey: which photographs were taken in each, oldest first."""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from photogram.project.document import Document
from photogram.project.schema import DEFAULT_FLIGHT, ProjectFile
from photogram.wording import some

FEWEST_PHOTOGRAPHS = 3


@dataclass(frozen=True)
class ProjectEpoch:
    """An epoch: its name, and the numbers of its photographs."""

    name: str
    photographs: tuple[int, ...]


def _matched(file: ProjectFile, names: Sequence[str]) -> list[list[int]]:
    """Return the numbers of the photographs of each epoch."""
    return [
        [n for n, name in enumerate(names) if any(fnmatchcase(name, pattern) for pattern in epoch.photographs or ())]
        for epoch in file.epochs
    ]


def check_epochs(document: Document, file: ProjectFile, names: Sequence[str]) -> None:
    """Note the errors of epochs: names that are there twice, photographs in none of them or in two, and too few."""
    if not file.epochs:
        return
    if len(file.epochs) == 1:
        document.add_error(("epochs",), "names one epoch: a change needs two; leave epochs out for a survey of one")
    taken: dict[int, str] = {}
    called = set[str]()
    for i, (epoch, own) in enumerate(zip(file.epochs, _matched(file, names), strict=True)):
        if epoch.name is None or epoch.photographs is None:
            continue
        if epoch.name in called:
            document.add_error(("epochs", i, "name"), f"{epoch.name!r} is there twice: name each by itself")
        called.add(epoch.name)
        if len(own) < FEWEST_PHOTOGRAPHS:
            document.add_error(
                ("epochs", i, "photographs"),
                f"match {len(own)} photographs of {len(names)}: an epoch needs {FEWEST_PHOTOGRAPHS}; patterns are "
                "those of a shell, such as may/*.JPG",
            )
        twice = [n for n in own if n in taken]
        if twice:
            document.add_error(
                ("epochs", i, "photographs"),
                f"match {some([names[n] for n in twice])}, which are of the epoch {taken[twice[0]]} already: each "
                "photograph is of one epoch",
            )
        taken.update(dict.fromkeys(own, epoch.name))
    left = [name for n, name in enumerate(names) if n not in taken]
    if left and len(taken) >= FEWEST_PHOTOGRAPHS:
        document.add_error(("epochs",), f"{some(left)}: in no epoch: add a pattern, or take them out of the folder")


def epochs_of(file: ProjectFile, names: Sequence[str]) -> tuple[ProjectEpoch, ...]:
    """Return the epochs of photographs by these names."""
    return tuple(
        ProjectEpoch(epoch.name or "", tuple(own))
        for epoch, own in zip(file.epochs, _matched(file, names), strict=True)
    )


def flights_of(flights: Sequence[str], epochs: Sequence[ProjectEpoch]) -> list[str]:
    """Return the flights of photographs, those of an epoch a flight of its own where nobody has said which: another day
    has another GNSS offset."""
    of = {n: epoch.name for epoch in epochs for n in epoch.photographs}
    return [of.get(n, flight) if flight == DEFAULT_FLIGHT else flight for n, flight in enumerate(flights)]
