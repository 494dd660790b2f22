"""What is wrong with an import, gathered so that everything can be mended at once."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from bscd.errors import InputError


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing that is wrong: ``where`` is ``file`` or ``file:line``, ``what`` says it and what is allowed."""

    where: str
    what: str

    def __str__(self) -> str:
        """As one line."""
        return f"{self.where}: {self.what}"


class ImportRefusedError(InputError):
    """A folder that can not be imported, with all its problems; nothing was written."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        count = f"{len(problems)} problems" if len(problems) > 1 else "1 problem"
        super().__init__("\n".join([*map(str, problems), f"nothing was written; mend the {count} and import again"]))


def allowed_hint(value: str, allowed: Iterable[str]) -> str:
    """``did you mean ...?`` when something allowed is close, else all that is allowed."""
    names = list(allowed)
    close = difflib.get_close_matches(value.lower(), names, n=1)
    return f"did you mean {close[0]}?" if close else f"allowed: {', '.join(names)}"


def shown(value: str, longest: int = 60) -> str:
    """A value as it stands in a message: quoted, on one line, not too long."""
    text = repr(value)
    return text if len(text) <= longest else f"{text[: longest - 4]}...{text[-1]}"
