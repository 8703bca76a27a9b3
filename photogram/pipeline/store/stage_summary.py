"""What a stage says of itself when it is done: seconds and counts, as stored in ``stage.json`` and told to watchers.

Which counts, each stage says in its own file; here is what all of them have in common.
"""

from collections.abc import Mapping
from typing import TypeVar

from pydantic import TypeAdapter
from typing_extensions import TypedDict

Summary = Mapping[str, object]
"""What a stage says of itself: as the stage made it, or with the keys of StageNote as it is stored."""

SummaryT = TypeVar("SummaryT")


class StageNote(TypedDict, total=False):
    """What is stored of every stage."""

    stage: str
    """Name of the stage."""
    fingerprint: str
    """Fingerprint of its settings and inputs."""
    format: int
    """Format of the files."""
    seconds: float
    """Time that it took, s."""
    compilation_seconds: float
    """Part of it in which kernels were compiled, s; 0 but for a first run on a machine."""
    peak_memory_bytes: int | None
    """Highest memory of the process; None where the system cannot tell."""
    products: list[str]
    """Names of files that it has written into the folder of results."""


def summary_from(value: object, kind: type[SummaryT]) -> SummaryT:
    """Return a summary, as it was made or stored, as the TypedDict of its stage, or a StageNote; keys of nothing in it
    are left out. Raises ValueError where it is something else."""
    return TypeAdapter(kind).validate_python(value, strict=True)
