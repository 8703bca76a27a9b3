"""The stages of a survey in their order, one row each, but for `results`, which hands over what they have made."""

from photogram.pipeline.stage import Stage
from photogram.pipeline.stages.adjustment import ADJUSTMENT
from photogram.pipeline.stages.comparison import COMPARISON
from photogram.pipeline.stages.dense import DENSE
from photogram.pipeline.stages.features import FEATURES
from photogram.pipeline.stages.matches import MATCHES, PAIRS
from photogram.pipeline.stages.orientation import INTERSECTION, ORIENTATION, TRANSFER
from photogram.pipeline.stages.orthophoto import ORTHOPHOTO
from photogram.pipeline.stages.photographs import PHOTOGRAPHS
from photogram.pipeline.stages.surfaces.relief import RELIEF
from photogram.pipeline.stages.surfaces.surface import SURFACE
from photogram.pipeline.stages.surfaces.volumes import VOLUMES
from photogram.pipeline.stages.tie_points import TIE_POINTS

BEFORE_RESULTS: tuple[Stage, ...] = (
    PHOTOGRAPHS,
    FEATURES,
    PAIRS,
    MATCHES,
    TIE_POINTS,
    ORIENTATION,
    TRANSFER,
    INTERSECTION,
    ADJUSTMENT,
    DENSE,
    SURFACE,
    VOLUMES,
    RELIEF,
    ORTHOPHOTO,
    COMPARISON,
)
