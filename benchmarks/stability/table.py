"""The table of failure modes, family by family."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from benchmarks.stability import bouncing, existence, resting, sliding
from benchmarks.stability.modes import Mode

MODES: Final[Mapping[str, Mode]] = {**resting.MODES, **sliding.MODES, **bouncing.MODES, **existence.MODES}

# A ladder of each kind, to see that everything works.
QUICK: Final = (
    "column",
    "mass-ratio",
    "deck",
    "units",
    "glide",
    "heading",
    "edge-held",
    "overlap",
    "walls",
    "painleve",
    "jam",
    "fathi",
)
