"""When frames were exposed, also by a camera whose clock begins anew: one that lost its power, or was away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from bscd.acquisition import TimeBase
from bscd.procedures.recording.clocks import ClockFit
from bscd.procedures.recording.frames import SILENT_S, Exposure

#: No frame is so late that the camera's clock goes on by more beyond the host's: its silence would be noticed.
_JUMP_S = SILENT_S

#: A jump that is worth telling of a camera that was away.
_TOLD_S = 0.5


@dataclass(frozen=True, slots=True)
class _Part:
    """Frames between two breaks of the camera's clock; ``begins_s`` is the first one's time in the recording."""

    fit: ClockFit
    first: Exposure
    begins_s: float


class FrameTimes:
    """Lays a camera's frames on the host's clock, with a fit of its own for each part between two breaks.

    Parameters
    ----------
    fit
        Makes the fit of a part.
    period_s
        From frame to frame.
    tell
        Gets a remark for each break.
    """

    def __init__(self, fit: Callable[[], ClockFit], period_s: float, tell: Callable[[str], None]) -> None:
        self._fit = fit
        self._period_s = period_s
        self._tell = tell
        self._parts: list[_Part] = []
        self._last: Exposure | None = None

    def place(self, exposure: Exposure) -> tuple[int, float]:
        """The host's time at the middle of an exposure, ns, and seconds since the middle of the first one."""
        last, self._last = self._last, exposure
        frame = exposure.frame
        if last is None or exposure.after_absence or self._jumped(last, exposure):
            fit = self._fit()
            middle_ns = fit.middle_ns(frame, exposure.not_before_ns)
            begins_s = 0.0
            if last is not None:
                begins_s = self._since_first_s(middle_ns)
                self._tell(_told(last, exposure))
            self._parts.append(_Part(fit, exposure, begins_s))
            return middle_ns, begins_s
        part = self._parts[-1]
        middle_ns = part.fit.middle_ns(frame, exposure.not_before_ns)
        return middle_ns, part.begins_s + (frame.camera_time_ns - part.first.frame.camera_time_ns) * 1e-9

    def result(self) -> TimeBase | None:
        """The first part's offset and the worst bound of all parts; tells the offsets of the others."""
        bases: list[TimeBase] = []
        for part in self._parts:
            base = part.fit.result()
            if base is None:
                continue
            early_s = [abs(early) for early in part.fit.early_s]
            first_id = part.first.frame.frame_id
            if bases:
                # times are laid by the first frame alone
                base = TimeBase(base.offset_ns, base.uncertainty_s + (early_s[0] if early_s else 0.0))
                self._tell(
                    f"from frame id {first_id} on the host's clock minus the camera's is {base.offset_ns} ns, "
                    f"with an error of at most {base.uncertainty_s * 1e3:.2f} ms"
                )
            late = [number for number, by_s in enumerate(early_s, start=1) if by_s > base.uncertainty_s]
            if late:
                self._tell(
                    f"{late[-1]} frame{'s' * (late[-1] > 1)} from id {first_id} on with the pressure of another time, "
                    f"by {max(early_s) * 1e3:.0f} ms at most: longer on the way to the host than those after"
                )
            bases.append(base)
        if not bases:
            return None
        return TimeBase(bases[0].offset_ns, max(base.uncertainty_s for base in bases))

    def _since_first_s(self, middle_ns: int) -> float:
        part = self._parts[-1]
        began_ns = part.first.frame.camera_time_ns + part.fit.offset_ns
        return part.begins_s + (middle_ns - began_ns) * 1e-9

    def _jumped(self, last: Exposure, exposure: Exposure) -> bool:
        """Whether the camera's clock went back, or on as neither the host's did nor the exposures' numbers."""
        camera_s = (exposure.frame.camera_time_ns - last.frame.camera_time_ns) * 1e-9
        planned_s = (exposure.number - last.number) * self._period_s
        on = _jump_s(last, exposure) > _JUMP_S and camera_s - planned_s > _JUMP_S + self._period_s
        return camera_s < 0.0 or on


def _jump_s(last: Exposure, exposure: Exposure) -> float:
    """By how much more the camera's clock went on than the host's."""
    camera_ns = exposure.frame.camera_time_ns - last.frame.camera_time_ns
    return (camera_ns - (exposure.frame.host_time_ns - last.frame.host_time_ns)) * 1e-9


def _told(last: Exposure, exposure: Exposure) -> str:
    jump_s, frame_id = _jump_s(last, exposure), exposure.frame.frame_id
    if abs(jump_s) > _TOLD_S or not exposure.after_absence:
        return (
            f"the camera's clock jumped by {jump_s:+.3f} s before frame id {frame_id}; "
            "from there on it is laid on the host's anew"
        )
    return f"the camera was away before frame id {frame_id}; from there on its clock is laid on the host's anew"
