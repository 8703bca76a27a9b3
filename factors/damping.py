"""The damping of Levenberg–Marquardt (Marquardt 1963), updated as Nielsen (1999) does: one rule for both engines."""

from __future__ import annotations

from dataclasses import dataclass

FIRST, LEAST, GREATEST = 1e-5, 1e-9, 1e12


@dataclass
class Damping:
    """How much the diagonal of the normal equations is raised, and by how much more after the next refusal."""

    value: float = FIRST
    growth: float = 2.0

    @property
    def exhausted(self) -> bool:
        """Return whether another refusal would raise it beyond what moves anything."""
        return self.value * self.growth > GREATEST

    def refuse(self) -> bool:
        """Raise the damping after a step that saved nothing; returns whether another attempt is worth while."""
        self.value *= self.growth
        self.growth *= 2.0
        return self.value <= GREATEST

    def accept(self, gain: float) -> None:
        """Lower the damping after a step that saved ``gain`` times what the linear model had predicted."""
        self.value = max(LEAST, self.value * max(1.0 / 3.0, 1.0 - (2.0 * gain - 1.0) ** 3))
        self.growth = 2.0
