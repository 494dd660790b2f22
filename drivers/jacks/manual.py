"""Two lab jacks that a person turns: the operator is asked, and the height they confirm is the position.

Between a request and its confirmation nobody knows the height, and the driver does not guess.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from drivers.errors import (
    DeviceBusyError,
    DeviceTimeoutError,
    MoveStoppedError,
    NotConnectedError,
    NotHomedError,
    OutOfLimitsError,
)
from drivers.interfaces import AxisInfo, AxisStatus, Range
from drivers.operator import Operator, Question, QuestionState
from drivers.registry import DriverContext, DriverEntry
from drivers.stacked import split_height


def _ordered(interval: tuple[float, float]) -> tuple[float, float]:
    if interval[0] >= interval[1]:
        raise ValueError(f"the limits {interval[0]:g}, {interval[1]:g} must be low, then high")
    return interval


Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Interval = Annotated[tuple[float, float], AfterValidator(_ordered)]


class ManualJacksOptions(BaseModel):
    """Two lab jacks, one on top of the other, turned by hand: one axis, the sum of both heights."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    lower_limits_mm: Interval = Field(default=(0.0, 42.0), description="range of the lower jack, mm")
    upper_limits_mm: Interval = Field(default=(0.0, 42.0), description="range of the upper jack, mm")
    lower_share: float = Field(
        default=0.5,
        ge=0.0,
        le=1.0,
        description="the lower jack's part of a height, as far as its range allows; 1: it goes first",
    )
    resolution_mm: Positive = Field(default=0.1, description="smallest step that the jacks' scales show, mm")
    repeatability_mm: float = Field(default=0.05, ge=0.0, description="one sigma of a true height about the scale, mm")
    tolerance_mm: Positive = Field(
        default=0.1,
        description="how far from what was asked a confirmed height may be before the operator is asked again",
    )
    turning_speed_mm_s: Positive = Field(default=1.0, description="how fast a person turns a jack, mm/s")
    answer_timeout_s: Positive = Field(default=600.0, description="how long an answer may take beyond the turning, s")
    serial: str = Field(default="by hand", min_length=1, description="serial numbers of the jacks, for the records")

    @property
    def ranges_mm(self) -> tuple[Range, Range]:
        """Ranges of the lower and the upper jack."""
        return Range(*self.lower_limits_mm), Range(*self.upper_limits_mm)

    @property
    def limits_mm(self) -> Range:
        """Range of both heights together."""
        lower, upper = self.ranges_mm
        return Range(lower.low + upper.low, lower.high + upper.high)


class ManualJacks:
    """See `drivers.interfaces.Axis`; homing is telling the height that the jacks show."""

    def __init__(self, options: ManualJacksOptions, context: DriverContext) -> None:
        self.name = context.name
        self._options = options
        self._clock = context.clock
        self._operator = context.operator
        self._open = False
        self._one_at_a_time = threading.Lock()
        self._asking = threading.Lock()
        self._question: Question | None = None
        self._interrupted = False
        self._turning = False
        self._height_mm: float | None = None
        self._target: float | None = None

    def connect(self) -> None:
        """Make sure that somebody can be asked. Raises `NotConnectedError` when nobody can."""
        self._reach("connecting")
        self._open = True

    def close(self) -> None:
        """Withdraw what is asked; a height that was being changed is not known any more."""
        self._open = False
        self._interrupt()

    def info(self) -> AxisInfo:
        """Identity and capabilities."""
        self._require_open("asking for its identity")
        options = self._options
        return AxisInfo(
            vendor="the operator",
            model="lab jacks turned by hand",
            serial=options.serial,
            unit="mm",
            limits=options.limits_mm,
            resolution=options.resolution_mm,
            repeatability=math.sqrt(2.0) * options.repeatability_mm,
            speed=options.turning_speed_mm_s,
            can_home=True,
        )

    def status(self) -> AxisStatus:
        """State now; the position is not known (NaN) while somebody turns, and until a height has been confirmed."""
        height_mm = math.nan if self._height_mm is None or not self._open else self._height_mm
        known = not math.isnan(height_mm)
        target = height_mm if self._target is None else self._target
        return AxisStatus(
            connected=self._open,
            homed=known,
            moving=self._open and self._turning,
            position=height_mm,
            target=target if self._open else math.nan,
        )

    def move_duration_s(self, position: float) -> float:
        """Seconds that turning takes; the confirmation comes on top."""
        doing = f"computing a move to {position:g} mm"
        self._require_open(doing)
        parts = self._split(position, doing)
        return self._turning_s(self._known_height_mm(doing), sum(parts))

    def home(self) -> None:
        """Ask what height the jacks show; nothing is turned."""
        doing = "asking for the height"
        self._require_open(doing)
        with self._one_move(doing):
            self._target = self._height_mm = None
            text = f"{self.name}: what height do both jacks show together, in mm? Do not turn them."
            self._height_mm = self._ask(doing, text, None, self._options.answer_timeout_s)

    def move_to(self, position: float) -> None:
        """Ask the operator to turn the jacks, and return when they have confirmed a height close to ``position``."""
        doing = f"moving to {position:g} mm"
        self._require_open(doing)
        parts = self._split(position, doing)
        with self._one_move(doing):
            here = self._known_height_mm(doing)
            wanted, self._target = round(sum(parts), 9), position
            if wanted == here:
                return
            timeout_s = self._turning_s(here, wanted) + self._options.answer_timeout_s
            text = (
                f"{self.name}: turn the lower jack to {parts[0]:g} mm and the upper jack to {parts[1]:g} mm, "
                f"{wanted:g} mm together; then tell the height that they show"
            )
            self._turn(doing, text, wanted, timeout_s)

    def stop(self) -> None:
        """Ask the operator to leave off turning, at once; does nothing when nobody turns."""
        if self._open:
            self._interrupt()

    def _turn(self, doing: str, text: str, wanted: float, timeout_s: float) -> None:
        self._height_mm, self._turning = None, True
        try:
            while True:
                height_mm = self._ask(doing, text, wanted, timeout_s)
                if abs(height_mm - wanted) <= self._options.tolerance_mm + 1e-9:
                    break
                text = f"{self.name}: {height_mm:g} mm is not {wanted:g} mm; turn on and tell the height again"
            self._height_mm = height_mm
        except MoveStoppedError:
            if self._open:
                self._height_mm = self._height_after_stop()
            raise
        finally:
            self._turning = False

    def _height_after_stop(self) -> float | None:
        text = f"{self.name}: STOP, turn no further. What height do both jacks show together, in mm?"
        with self._asking:
            self._interrupted = not self._open
        try:
            return self._ask("asking where it stopped", text, None, self._options.answer_timeout_s)
        except (MoveStoppedError, DeviceTimeoutError):
            return None

    def _ask(self, doing: str, text: str, proposal: float | None, timeout_s: float) -> float:
        """The operator's answer. Raises `MoveStoppedError` when withdrawn and `DeviceTimeoutError`."""
        question = Question(self.name, text, "mm", self._options.limits_mm, proposal)
        with self._asking:
            self._question = question
            interrupted = self._interrupted
        try:
            if interrupted:
                question.withdraw()
            else:
                self._reach(doing).ask(question)
            state = question.wait(self._clock, timeout_s)
        finally:
            question.withdraw()
            with self._asking:
                self._question = None
        if question.value is not None:
            return question.value
        if state is QuestionState.WITHDRAWN:
            raise MoveStoppedError(self.name, f"{doing}: stopped before the operator confirmed a height")
        words = f"{doing}: no height confirmed within {timeout_s:g} s"
        raise DeviceTimeoutError(self.name, words, "tell the height (home it), then go on")

    def _interrupt(self) -> None:
        with self._asking:
            self._interrupted = True
            if self._question is not None:
                self._question.withdraw()

    @contextmanager
    def _one_move(self, doing: str) -> Iterator[None]:
        with self._asking:  # a stop comes before all of this or counts
            if not self._one_at_a_time.acquire(blocking=False):
                raise DeviceBusyError(self.name, f"{doing}: the operator is being asked", "answer first, or stop it")
            self._interrupted = False
        try:
            yield
        finally:
            self._one_at_a_time.release()

    def _split(self, position: float, doing: str) -> tuple[float, float]:
        """Heights of the lower and the upper jack, in whole steps. Raises `OutOfLimitsError`."""
        options, limits = self._options, self._options.limits_mm
        if not limits.contains(position):
            allowed = f"choose a height from {limits.low:g} to {limits.high:g} mm"
            raise OutOfLimitsError(self.name, f"{doing}: outside its limits", allowed)
        stepped = round(round(position / options.resolution_mm) * options.resolution_mm, 9)
        stepped = min(max(stepped, limits.low), limits.high)
        lower, upper = split_height(stepped, options.ranges_mm, options.lower_share, options.resolution_mm)
        return lower, round(upper, 9)

    def _turning_s(self, here: float, there: float) -> float:
        return abs(there - here) / self._options.turning_speed_mm_s

    def _known_height_mm(self, doing: str) -> float:
        if self._height_mm is None:
            raise NotHomedError(self.name, f"{doing}: nobody has told the height", "home it: tell the height")
        return self._height_mm

    def _require_open(self, doing: str) -> None:
        if not self._open:
            raise NotConnectedError(self.name, f"{doing}: it is not connected", "call connect() first")

    def _reach(self, doing: str) -> Operator:
        if self._operator is None:
            hint = "run it where somebody can answer, or configure jacks with drives"
            raise NotConnectedError(self.name, f"{doing}: there is no operator to ask", hint)
        return self._operator


AXIS = DriverEntry("axis", ManualJacksOptions, ManualJacks, "lab jacks that the operator turns and confirms")
