"""An XIMC controller as a stage's controller: its settings, its position in whole microsteps, its alarms in words."""

from __future__ import annotations

from drivers.stages.controller import Identity, MotorState
from drivers.stages.line import RefusedError, open_line
from drivers.stages.ximc.dialogue import Dialogue
from drivers.stages.ximc.messages import (
    FAULTS,
    HOME_STOPS,
    Command,
    Edge,
    Engine,
    EngineFlag,
    HomeFlag,
    Motion,
    MoveFlag,
    StateFlag,
    Status,
)
from drivers.stages.ximc.options import XimcOptions

BAUD = 115200
STOP_BITS = 2
IGNORE_ENCODER = 2


class XimcController:
    """One controller with one motor; see `drivers.stages.controller.StageController`."""

    def __init__(self, options: XimcOptions) -> None:
        self._options = options
        self._sense = -1 if options.reversed else 1
        self.microsteps_per_unit = self._sense * options.steps_per_unit * options.microsteps
        self.longest_homing_s = _longest_homing_s(options)
        self.longest_approach_s = 2.0 * abs(options.backlash) / (options.backlash_speed or options.speed / 2.0)
        self._dialogue = Dialogue(
            lambda: open_line(options.port, baud=BAUD, stop_bits=STOP_BITS, timeout_s=options.answer_timeout_s),
            options.answer_timeout_s,
        )

    def open(self) -> Identity:
        """Open the port, ask who is there, and give it the settings of the options (not saved there)."""
        self._dialogue.open()
        vendor, _, product, *version = self._dialogue.ask("geti")
        (serial,) = self._dialogue.ask("gser")
        firmware = self._dialogue.ask("gfwv")
        self._configure()
        name = f"{_text(product)} {version[0]}.{version[1]}.{version[2]}"
        return Identity(f"Standa {_text(vendor)}", name, str(serial), ".".join(str(part) for part in firmware))

    def close(self) -> None:
        """Give the port free."""
        self._dialogue.close()

    def state(self) -> MotorState:
        """One status message."""
        status = Status(*(int(value) for value in self._dialogue.ask("gets")))
        moving = bool(status.command_state & MoveFlag.RUNNING)
        failed = not moving and bool(status.command_state & MoveFlag.ERROR)
        command = status.command_state & MoveFlag.COMMAND
        return MotorState(
            count=status.steps * self._options.microsteps + status.microsteps,
            moving=moving,
            homed=bool(status.flags & StateFlag.IS_HOMED),
            fault=_faults(status, failed),
            interrupted=not moving and command in (Command.STOP, Command.SOFT_STOP),
            failed=failed,
        )

    def prepare(self) -> bool:
        """End an alarm; False when the settings are no longer ours, which a power cycle does."""
        status = Status(*(int(value) for value in self._dialogue.ask("gets")))
        if status.flags & StateFlag.ALARM:
            self._dialogue.ask("stop")
        return not self._configure()

    def begin_move(self, count: int) -> None:
        """Set off."""
        self._dialogue.ask("move", in_steps(count, self._options.microsteps))

    def begin_home(self) -> None:
        """Give it the recipe and set off."""
        recipe, division = self._options.homing, self._options.microsteps
        flags = HOME_STOPS[recipe.stop_at] << 4 | HOME_STOPS[recipe.second_stop_at] << 6
        flags |= HomeFlag.FIRST_TO_THE_RIGHT if recipe.direction == "right" else 0
        flags |= HomeFlag.SECOND_TO_THE_RIGHT if recipe.second_direction == "right" else 0
        flags |= HomeFlag.SECOND if recipe.second else 0
        flags |= HomeFlag.HALF_TURN if recipe.half_turn else 0
        flags |= HomeFlag.FAST if recipe.fast_algorithm else 0
        shift = round(recipe.shift * self._options.steps_per_unit * division)
        rates = (*self._rate(recipe.fast_speed), *self._rate(recipe.slow_speed))
        self._dialogue.ask("shom", (*rates, *in_steps(shift, division), flags))
        self._dialogue.ask("home")

    def end_home(self) -> None:
        """The reference is 0, or the position of the recipe: homing alone does not set it."""
        count = round(self._options.homing.position * self.microsteps_per_unit)
        if count == 0:
            self._dialogue.ask("zero")
            return
        self._dialogue.ask("spos", (*in_steps(count, self._options.microsteps), 0, IGNORE_ENCODER))

    def halt(self) -> None:
        """A soft stop: a hard one would lose the reference."""
        self._dialogue.ask("sstp")

    def _rate(self, speed: float) -> tuple[int, int]:
        """A speed in unit/s as whole steps/s and microsteps/s."""
        division = self._options.microsteps
        return divmod(round(speed * self._options.steps_per_unit * division), division)

    def _configure(self) -> bool:
        """Give it what the options ask for; whether anything was different."""
        return any([self._configure_engine(), self._configure_motion()])

    def _configure_engine(self) -> bool:
        options = self._options
        found = Engine(*(int(value) for value in self._dialogue.ask("geng")))
        if found.flags & EngineFlag.LIMIT_SPEED and options.speed * options.steps_per_unit > found.speed:
            most = f"{found.speed / options.steps_per_unit:g} {options.unit}/s"
            raise RefusedError(f"the motor's nominal speed, {most}, is less than the speed of the options")
        antiplay = self._sense * round(options.backlash * options.steps_per_unit)
        flags = found.flags | EngineFlag.ANTIPLAY if antiplay else found.flags & ~EngineFlag.ANTIPLAY
        wanted = found._replace(
            flags=flags,
            antiplay=antiplay or found.antiplay,
            microstep_mode=options.microsteps.bit_length(),
        )
        if wanted == found:
            return False
        self._dialogue.ask("seng", wanted)
        if Engine(*(int(value) for value in self._dialogue.ask("geng"))) != wanted:
            raise RefusedError("the controller does not take the microsteps or the backlash")
        return True

    def _configure_motion(self) -> bool:
        options = self._options
        found = Motion(*(int(value) for value in self._dialogue.ask("gmov")))
        speed, microspeed = self._rate(options.speed)
        slow, microslow = self._rate(options.backlash_speed or options.speed / 2.0)
        ramp = round(options.acceleration * options.steps_per_unit)
        wanted = Motion(speed, microspeed, ramp, ramp, slow, microslow, found.flags)
        if wanted == found:
            return False
        self._dialogue.ask("smov", wanted)
        if Motion(*(int(value) for value in self._dialogue.ask("gmov"))) != wanted:
            raise RefusedError("the controller does not take the speed or the acceleration")
        return True


def in_steps(count: int, microsteps: int) -> tuple[int, int]:
    """A count of microsteps as steps and microsteps, both of its sign; ``microsteps`` is how many a step has."""
    steps, rest = divmod(abs(count), microsteps)
    return (steps, rest) if count >= 0 else (-steps, -rest)


def _longest_homing_s(options: XimcOptions) -> float:
    """All the travel fast, the second way slowly, and the shift, with a ramp for each."""
    recipe = options.homing
    low, high = options.limits
    slow_s = recipe.slow_travel / recipe.slow_speed if recipe.second else 0.0
    shift_s = abs(recipe.shift) / recipe.slow_speed
    ramps_s = 3.0 * max(recipe.fast_speed, recipe.slow_speed) / options.acceleration
    return (high - low) / recipe.fast_speed + slow_s + shift_s + ramps_s


def _faults(status: Status, failed: bool) -> str:
    words = [text for flag, text in FAULTS.items() if status.flags & flag]
    if failed and status.gpio & (Edge.LEFT | Edge.RIGHT):
        words.append(f"{'right' if status.gpio & Edge.RIGHT else 'left'} limit switch hit")
    if status.flags & StateFlag.ALARM and not words:
        words.append("the controller reports an alarm")
    return "; ".join(words)


def _text(value: int | bytes) -> str:
    return value.rstrip(b"\0 ").decode("ascii", "replace") if isinstance(value, bytes) else str(value)
