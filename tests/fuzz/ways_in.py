"""All targets: ways in for spoilt inputs, by name."""

import cases
import file_cases
import foreign_cases
from cases import Target

TARGETS: dict[str, Target] = {**cases.TARGETS, **file_cases.TARGETS, **foreign_cases.TARGETS}
CUT = (*cases.CUT, *foreign_cases.CUT)
"""Targets whose files are cut off too."""
