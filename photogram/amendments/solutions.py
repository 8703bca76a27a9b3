"""The adjustments between which decisions are made: with all rays, and as alternatives to one of these."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeVar

from photogram.adjustment.adjustment import adjust
from photogram.adjustment.problem import AdjustmentSettings
from photogram.adjustment.solutions.alternatives import Summarised, alternative, summarised, summarised_at
from photogram.arrays import FloatArray
from photogram.errors import PhotogramError
from photogram.results import Adjustment, EstimatedSigmas
from photogram.survey import Block
from photogram.wording import Progress

T = TypeVar("T")

MOST_SUMMARIES, STAYS = 6, 0.2
"""Summaries of the tie points of a part of the pictures, each where the one before led; and the part of its standard
deviation by which a focal length may still move."""


def attempted(compute: Callable[[], T]) -> T | None:
    """Return what ``compute`` returns, None where the block cannot be adjusted for it."""
    try:
        return compute()
    except PhotogramError:
        return None


@dataclass(eq=False)
class Solutions:
    """How blocks are adjusted while explanations are compared: as alternatives to ``base``, which was adjusted with all
    rays of tie points, beginning with the sigmas ``begun``. All have its sigmas: one that bends the block would
    otherwise raise those of the tie points, and hide behind them."""

    settings: AdjustmentSettings
    progress: Progress
    start: Sequence[FloatArray]
    begun: EstimatedSigmas = field(default_factory=EstimatedSigmas.none)
    base: Summarised | None = None

    def solve(self, block: Block, near: Adjustment | None = None) -> Adjustment:
        """Adjust a block with all rays, and estimate its sigmas unless the settings do not; it is the base from then
        on."""
        return self._based(adjust(block, self.settings, self.progress, start=self.start, begun=self.begun, near=near))

    def solve_as_stated(self, block: Block) -> Adjustment:
        """Adjust a block with all rays and the sigmas as stated; it is the base from then on."""
        return self._based(self.as_stated(block))

    def stand_on(self, result: Adjustment) -> None:
        """Take an adjustment with all rays for the base."""
        if self.base is None or self.base.result is not result:
            self.base = summarised(result, self.settings)

    def _based(self, result: Adjustment) -> Adjustment:
        self.stand_on(result)
        return result

    def alternative(self, block: Block) -> Adjustment:
        """Adjust a block that differs from the base in what is measured beside the tie points: from their summary, but
        with their rays where these have more unknowns of their own, the velocities of photographs or a datum."""
        assert self.base is not None
        solved = self.base.result
        if block.is_free or solved.decisions.neighbours_scatter_m_s > 0.0:
            return self.compared(block, solved)
        return alternative(self.base, block, self.settings)

    def as_stated(self, block: Block) -> Adjustment:
        """Adjust a block with all rays and the sigmas as stated, whatever the base."""
        return adjust(block, self.settings, self.progress, start=self.start, sigmas=self.begun)

    def compared(self, block: Block, near: Adjustment) -> Adjustment:
        """Adjust a block with all rays, from another adjustment of them and with its sigmas, whatever the base."""
        return adjust(block, self.settings, self.progress, near=near, sigmas=near.decisions.sigmas)

    def part(self, result: Adjustment, block: Block, c: int) -> Adjustment:
        """Adjust a block with those tie points alone that ``result`` has, near its solution, until the focal length of
        camera ``c`` stays."""
        base = summarised(result, self.settings)
        for _ in range(MOST_SUMMARIES):
            part = alternative(base, block, self.settings)
            moved_px = part.block.cameras[c].focal_px - base.result.block.cameras[c].focal_px
            if moved_px**2 < STAYS**2 * part.covariances.calibration[c, 0, 0]:
                break
            base = summarised_at(base, part, self.settings)
        return part
