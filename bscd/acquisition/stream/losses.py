"""The account of a stream: every exposure is written or lost, and each loss has its reason."""

from __future__ import annotations

import threading

from bscd.acquisition.records import FrameLoss


class FrameAccount:
    """Counts exposures and losses of one stream by the exposure's number, from 0; safe to use from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._acquired = 0
        self._losses: list[FrameLoss] = []

    @property
    def acquired(self) -> int:
        """Exposures so far, lost ones among them."""
        with self._lock:
            return self._acquired

    @property
    def lost(self) -> int:
        """Exposures that will not be in the file."""
        with self._lock:
            return sum(loss.count for loss in self._losses)

    @property
    def losses(self) -> tuple[FrameLoss, ...]:
        """The losses in the order of the exposures; neighbours with one reason are one loss."""
        merged: list[FrameLoss] = []
        with self._lock:
            losses = sorted(self._losses, key=lambda loss: loss.first)
        for loss in losses:
            last = merged[-1] if merged else None
            if last and last.first + last.count == loss.first and last.reason == loss.reason:
                merged[-1] = FrameLoss(last.first, last.count + loss.count, loss.reason)
            else:
                merged.append(loss)
        return tuple(merged)

    def exposed(self, number: int, reason: str) -> int:
        """An exposure's frame came; those between the one before and it are lost for ``reason``. Returns how many."""
        with self._lock:
            missing = number - self._acquired
            if missing < 0:
                raise ValueError(f"exposure {number} comes after exposure {self._acquired - 1}")
            if missing:
                self._losses.append(FrameLoss(self._acquired, missing, reason))
            self._acquired = number + 1
            return missing

    def ended(self, count: int, reason: str) -> int:
        """The stream ended after ``count`` exposures; those that never came are lost. Returns how many."""
        with self._lock:
            missing = max(0, count - self._acquired)
            if missing:
                self._losses.append(FrameLoss(self._acquired, missing, reason))
            self._acquired += missing
            return missing

    def lose(self, number: int, reason: str) -> None:
        """A frame that came will not be in the file."""
        with self._lock:
            self._losses.append(FrameLoss(number, 1, reason))

    def difference(self, written: int) -> str:
        """Why the account does not close with so many frames written; empty when it does."""
        acquired, lost = self.acquired, self.lost
        if acquired == written + lost:
            return ""
        return f"{acquired} exposures, but {written} frames written and {lost} counted as lost"
