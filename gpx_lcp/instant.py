"""What a world is between two steps, and how that changes when bodies come, leave or are moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from formulations.checks import Array
from gpx_lcp import _core
from gpx_lcp.solution import Solution


@dataclass(frozen=True)
class Instant:
    """All that a step changes, so that an interrupted step changes nothing.

    Attributes
    ----------
    steps, unsolved : int
        Steps taken since the start, and how many of them ended above the tolerance.
    state : _core.State
    time_step : float, s
        Of the last step.
    contacts : _core.Contacts or None
        Of the last step; None before the first.
    impulse : (n, rows) array, N s
        Theirs.
    solution : callable or None
        Works the Solution of the last step out, once.
    step : _core.Step or None
        What the core keeps of a step of its own.
    """

    steps: int
    unsolved: int
    state: _core.State
    time_step: float
    contacts: _core.Contacts | None = None
    impulse: Array = field(default_factory=lambda: np.zeros((0, 3)))
    solution: Callable[[], Solution] | None = None
    step: _core.Step | None = None

    def impulse_of_rows(self, rows: int) -> Array:
        """Return the impulses as (n, rows), whatever number of rows they were found with."""
        if self.impulse.shape[1] == rows:
            return self.impulse
        impulse = np.zeros((len(self.impulse), rows))
        impulse[:, 0] = self.impulse[:, 0]
        return impulse

    def start_impulse(self, rows: int, time_step: float) -> Array:
        """Return the impulses that a step of another length may start from: forces last, impulses do not."""
        impulse = self.impulse_of_rows(rows)
        return impulse if time_step == self.time_step else impulse * (time_step / self.time_step)

    def placed(
        self, positions: Array | None = None, orientations: Array | None = None, velocities: Array | None = None
    ) -> Instant:
        """Return the instant with the bodies there; what is not given stays."""
        state = _core.State(
            self.state.positions if positions is None else positions,
            self.state.orientations if orientations is None else orientations,
            self.state.velocities if velocities is None else velocities,
        )
        return replace(self, state=state)

    def with_body(self, core: _core.Bodies, row: int) -> Instant:
        """Return the instant among the bodies of `core`, of which the one in this row is new, without its state."""
        if self.contacts is None:
            return self
        pairs = self.contacts.pairs
        return self._renumbered(
            core, self.contacts, pairs + (pairs >= row).astype(np.uint32), np.ones(len(pairs), dtype=bool)
        )

    def without_body(self, core: _core.Bodies, row: int) -> Instant:
        """Return the instant among the bodies of `core`, where the one that was in this row is missing."""
        if self.contacts is None:
            return self
        pairs = self.contacts.pairs
        return self._renumbered(
            core, self.contacts, pairs - (pairs > row).astype(np.uint32), (pairs != row).all(axis=1)
        )

    def _renumbered(
        self, core: _core.Bodies, contacts: _core.Contacts, pairs: npt.NDArray[np.uint32], keep: npt.NDArray[np.bool]
    ) -> Instant:
        """Return the instant with those contacts that are to be kept, the bodies of each by their new numbers."""
        kept = _core.Contacts(
            core,
            pairs[keep],
            contacts.features[keep],
            contacts.points[keep],
            contacts.frames[keep].reshape(-1, 9),
            contacts.gaps[keep],
        )
        return replace(self, contacts=kept, impulse=self.impulse[keep])
