"""Waiting until drives are at rest, and why each came to rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from enum import StrEnum

from drivers.clock import Clock
from drivers.errors import DeviceTimeoutError
from drivers.jacks.modbus.drive import Drive, DriveState

POLL_S = 0.02
SET_OFF_WITHIN_S = 0.3
"""A drive that does not tell of motion by then did not set off, or had nowhere to go."""


class Arrival(StrEnum):
    """Why a drive is at rest."""

    THERE = "there"
    ON_THE_WAY = "on the way"
    NEVER_SET_OFF = "never set off"


class Waiting:
    """Watches the drives of one axis, polling them.

    Parameters
    ----------
    device : str
        Name of the axis, for messages.
    clock : Clock
        Measures the time-out and paces the polls.
    drives : sequence of Drive
        What to watch.
    """

    def __init__(self, device: str, clock: Clock, drives: Sequence[Drive]) -> None:
        self._device = device
        self._clock = clock
        self._drives = drives

    def until_rest(
        self,
        doing: str,
        targets: Sequence[int | None],
        near: Sequence[int],
        timeout_s: float,
        stopped: Callable[[], bool],
    ) -> list[tuple[Arrival, DriveState]]:
        """Why and where each drive came to rest.

        ``targets`` are in steps, None for homing; a drive is there within ``near`` steps. An alarm of one, or one
        that stands before its target, does not end the wait for the other: it stops all. Raises
        `DeviceTimeoutError` after ``timeout_s``, and the errors of the line.
        """
        began_s = self._clock.now_s()
        set_off = [False] * len(self._drives)
        halted = False
        while True:
            states = [drive.state(doing) for drive in self._drives]
            elapsed_s = self._clock.now_s() - began_s
            set_off = [before or state.moving for before, state in zip(set_off, states, strict=True)]
            settled = elapsed_s >= SET_OFF_WITHIN_S or stopped()
            arrivals = [
                None if state.moving else _arrival(state, target, width, moved, settled)
                for state, target, width, moved in zip(states, targets, near, set_off, strict=True)
            ]
            if all(arrivals):
                return [(arrival, state) for arrival, state in zip(arrivals, states, strict=True) if arrival]
            failed = any(state.alarm for state in states) or any(arrival not in (None, "there") for arrival in arrivals)
            if failed and not halted:
                halted = True
                for drive in self._drives:
                    drive.stop(doing)
            if elapsed_s >= timeout_s:
                words = f"{doing}: not there within {timeout_s:.1f} s"
                raise DeviceTimeoutError(self._device, words, "look what blocks it, then home it")
            self._clock.sleep(min(POLL_S, timeout_s - elapsed_s))


def _arrival(state: DriveState, target: int | None, near: int, moved: bool, settled: bool) -> Arrival | None:
    """Why a drive that does not move is at rest; None while it may still set off."""
    if state.homed and state.position == target:
        return Arrival.THERE
    if not (moved or settled or state.alarm):
        return None
    there = state.homed and (target is None or abs(state.position - target) <= near)
    if there and not state.alarm:
        return Arrival.THERE
    return Arrival.ON_THE_WAY if moved else Arrival.NEVER_SET_OFF
