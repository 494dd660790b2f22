"""Have a task done by a process of its own, so that neither its work nor its memory is the daemon's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from bscd.daemon.running.control import JobControl
from bscd.daemon.running.tasks import DeskDone, DeskFailure, DeskStop, DeskTask, DeskWarning
from bscd.dic.pool import end_program, start_program
from bscd.errors import BscdError
from bscd.procedures import ProcedureStoppedError, Progress

_LOOK_S = 0.2

#: After a stop it ends between two steps; a step longer than this is cut off.
_STOP_S = 60.0
_GRACE_S = 0.5


class DeskError(BscdError):
    """A task at the desk failed; the message is for the operator."""


def do_at_the_desk(
    task: DeskTask,
    control: JobControl,
    progress: Callable[[Progress], None],
    warn: Callable[[str], None],
) -> dict[str, Any]:
    """The task's figures.

    Raises `ProcedureStoppedError` for a stop (an abort ends it where it is), `DeskError` for what went wrong.
    """
    process, pipe = start_program("bscd.daemon.running.desk_program")
    waited_s, asked = 0.0, False
    try:
        pipe.send(task)
        while True:
            if control.aborted is not None:
                raise ProcedureStoppedError("ended at once")
            if control.stopping:
                if not asked:
                    pipe.send(DeskStop())
                asked, waited_s = True, waited_s + _LOOK_S
                if waited_s > _STOP_S:
                    raise ProcedureStoppedError(f"it did not stop in {_STOP_S:g} s and was cut off")
            if not pipe.poll(_LOOK_S):
                continue
            message = pipe.recv()
            if isinstance(message, Progress):
                progress(message)
            elif isinstance(message, DeskWarning):
                warn(message.text)
            elif isinstance(message, DeskDone):
                return message.figures
            elif isinstance(message, DeskFailure):
                if message.stopped:
                    raise ProcedureStoppedError(message.text)
                raise DeskError(message.text)
    except (EOFError, OSError) as error:
        told = f"its process ended by itself (code {process.poll()}); see the log, and start it again"
        raise DeskError(told) from error
    finally:
        if process.poll() is None and (control.aborted is not None or waited_s > _STOP_S):
            process.terminate()
        end_program(process, pipe, _GRACE_S)
