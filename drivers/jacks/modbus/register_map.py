"""A drive's register map: which words mean what, read from a file that a user can copy and change."""

from __future__ import annotations

import tomllib
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

MAPS = files("drivers.jacks.modbus") / "maps"
SUFFIX = ".toml"

RegisterAddress = Annotated[int, Field(ge=0, le=0xFFFF)]
Word = Annotated[int, Field(ge=0, le=0xFFFF)]
Mask = Annotated[int, Field(ge=1, le=0xFFFF)]
Argument = Literal["position", "speed", "acceleration", "deceleration"]
Constant = Annotated[int, Field(ge=-(2**31), lt=2**31)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class MoveBlock(_Part):
    """An absolute move: 32-bit values, one after the other, that are written in one message."""

    address: RegisterAddress = Field(description="register of the first value's first word")
    values: tuple[Argument | Constant, ...] = Field(max_length=61, description="numbers, and words for a move's own")

    @field_validator("values")
    @classmethod
    def _has_a_position(cls, values: tuple[Argument | Constant, ...]) -> tuple[Argument | Constant, ...]:
        if "position" not in values:
            raise ValueError('the values of a move must hold "position"')
        return values


class InputWord(_Part):
    """The word that commands a drive."""

    address: RegisterAddress
    release: Word = Field(default=0, description="commands nothing")
    home: Word = Field(description="begins homing when it is written after `release`")
    stop: Word = Field(description="stops, and keeps from moving until `release` is written")
    alarm_reset: Word = Field(description="clears an alarm when it is written after `release`")


class OutputWord(_Part):
    """The word that tells a drive's state, as masks."""

    address: RegisterAddress
    homed: Mask = Field(description="set: the drive knows where it is")
    alarm: Mask = Field(description="set: an alarm is present")
    moving: Mask = Field(description="set: the motor moves")


class PositionValue(_Part):
    """The 32-bit value that tells where the motor is, in steps."""

    address: RegisterAddress


class AlarmValue(_Part):
    """The 32-bit value that tells the present alarm, 0 for none."""

    address: RegisterAddress
    words: dict[str, str] = Field(default={}, description="what the codes mean; keys are numbers, 0x30 or 48")

    @field_validator("words")
    @classmethod
    def _are_numbers(cls, words: dict[str, str]) -> dict[str, str]:
        for code in words:
            int(code, 0)
        return words

    def meaning(self, code: int) -> str:
        """The alarm in words, with its code."""
        known = {int(key, 0): word for key, word in self.words.items()}
        return f"{known.get(code, 'an alarm that the register map does not name')} (alarm 0x{code:02X})"


class RegisterMap(_Part):
    """What the words of a drive mean."""

    vendor: str = Field(min_length=1)
    model: str = Field(min_length=1)
    word_order: Literal["big", "little"] = Field(default="big", description="of 32-bit values")
    move: MoveBlock
    inputs: InputWord
    outputs: OutputWord
    position: PositionValue
    alarm: AlarmValue


def shipped_maps() -> list[str]:
    """Names of the maps that come with bscd."""
    return sorted(entry.name.removesuffix(SUFFIX) for entry in MAPS.iterdir() if entry.name.endswith(SUFFIX))


def load_register_map(name: str) -> RegisterMap:
    """A shipped map by its name, or one from a file by its path.

    Raises `ValueError` for an unknown name, a missing file, or a map that is wrong.
    """
    if name in shipped_maps():
        text = (MAPS / f"{name}{SUFFIX}").read_text()
    elif name.endswith(SUFFIX):
        try:
            text = Path(name).read_text()
        except OSError as error:
            raise ValueError(f"register map {name}: {error.strerror}") from error
    else:
        known = ", ".join(shipped_maps())
        raise ValueError(f"no register map {name!r}; shipped: {known}; or give the path of a {SUFFIX} file")
    try:
        return RegisterMap.model_validate(tomllib.loads(text))
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"register map {name}: {error}") from error
