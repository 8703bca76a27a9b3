"""The epochs and flights of a survey: which photographs were taken in each."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from photogram.project.document import Document
from photogram.project.schema import DEFAULT_FLIGHT, EpochEntry, FlightEntry, PhotographEntry, ProjectFile
from photogram.wording import some

FEWEST_PHOTOGRAPHS = 3
_FOLDER = re.compile(r"\w(?:[\w .-]*[\w-])?")


@dataclass(frozen=True)
class ProjectEpoch:
    """An epoch: its name, and the numbers of its photographs."""

    name: str
    photographs: tuple[int, ...]


def _matched(groups: Sequence[EpochEntry | FlightEntry], names: Sequence[str]) -> list[list[int]]:
    """Return the numbers of the photographs of each epoch or flight."""
    return [
        [n for n, name in enumerate(names) if any(fnmatchcase(name, pattern) for pattern in group.photographs or ())]
        for group in groups
    ]


def check_flights(document: Document, file: ProjectFile, names: Sequence[str]) -> None:
    """Note the errors of flights: patterns that match nothing, and photographs of two flights."""
    of = {n: p.flight for n, p in enumerate(file.photographs.list or ()) if p.flight != DEFAULT_FLIGHT}
    for i, (flight, own) in enumerate(zip(file.flights, _matched(file.flights, names), strict=True)):
        if flight.name is None or flight.photographs is None:
            continue
        key = ("flights", i, "photographs")
        if not own:
            document.add_error(key, f"match none of {len(names)} photographs: patterns are a shell's: battery1/*")
        twice = [n for n in own if of.get(n, flight.name) != flight.name]
        if twice:
            which = some([names[n] for n in twice])
            document.add_error(key, f"match {which}, of the flight {of[twice[0]]} already: each is of one flight")
        of.update(dict.fromkeys(own, flight.name))


def check_epochs(document: Document, file: ProjectFile, names: Sequence[str]) -> None:
    """Note the errors of epochs: names that are there twice, photographs in none of them or in two, and too few."""
    if not file.epochs:
        return
    if len(file.epochs) == 1:
        document.add_error(("epochs",), "names one epoch: a change needs two; leave epochs out for a survey of one")
    taken: dict[int, str] = {}
    called = set[str]()
    for i, (epoch, own) in enumerate(zip(file.epochs, _matched(file.epochs, names), strict=True)):
        if epoch.name is None or epoch.photographs is None:
            continue
        if not _FOLDER.fullmatch(epoch.name):
            text = f"{epoch.name!r} cannot be part of a folder's name: use letters, digits, spaces, dots, - and _"
            document.add_error(("epochs", i, "name"), text)
        if epoch.name.casefold() in called:
            document.add_error(("epochs", i, "name"), f"{epoch.name!r} is there twice: name each by itself")
        called.add(epoch.name.casefold())
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
        for epoch, own in zip(file.epochs, _matched(file.epochs, names), strict=True)
    )


def with_flights(file: ProjectFile, photographs: Sequence[PhotographEntry]) -> list[PhotographEntry]:
    """Return photographs with the flights that they are of: each one's own, else that whose pattern it matches, else
    its epoch: another day has another GNSS offset."""
    names = [p.name or "" for p in photographs]
    of = {n: epoch.name for epoch in epochs_of(file, names) for n in epoch.photographs}
    for flight, own in zip(file.flights, _matched(file.flights, names), strict=True):
        of.update(dict.fromkeys(own, flight.name or ""))
    return [
        p.model_copy(update={"flight": of[n]}) if n in of and p.flight == DEFAULT_FLIGHT else p
        for n, p in enumerate(photographs)
    ]
