"""The live process: takes frames from its pipe, measures them, and tells; ends when the pipe does."""

from __future__ import annotations

import os
import signal
import sys
import threading
from multiprocessing.connection import Connection
from typing import Any

from bscd.dic.pool import LocalPool
from bscd.errors import BscdError
from bscd.procedures.live.engine import ArrivedFrame, LiveEngine
from bscd.procedures.live.inbox import GivenUpError, Inbox
from bscd.procedures.live.messages import (
    DamagedFrame,
    Finish,
    GiveUp,
    LiveFailure,
    LiveReady,
    LiveSetup,
    PushedFrame,
    TakenFrame,
)
from bscd.procedures.measuring.chunks import load


def serve(pipe: Connection) -> None:
    """Measure what comes, up to a `Finish`."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # whoever started this is interrupted, and finishes it
    inbox = Inbox(pipe)
    signal.signal(signal.SIGTERM, lambda *_: inbox.give_up(GiveUp("live measuring was asked to end")))
    lock = threading.Lock()

    def tell(message: Any) -> None:
        with lock:
            pipe.send(message)

    try:
        setup: LiveSetup = inbox.take()
        os.nice(setup.nice)
        with LocalPool(setup.workers) as pool:
            _measure(inbox, tell, setup, pool)
    except (GivenUpError, OSError):  # nobody wants it, or whoever did is gone
        return


def _measure(inbox: Inbox, tell: Any, setup: LiveSetup, pool: LocalPool) -> None:
    engine: LiveEngine | None = None
    reason, run = "live measuring was cut off", None
    try:
        engine = LiveEngine(setup, pool, tell)
        for loading in [pool.submit(load, near=f"worker {number}") for number in range(setup.workers)]:
            loading.result()
        tell(LiveReady())
        while True:
            message = inbox.take()
            if isinstance(message, Finish):
                tell(engine.finish(message, inbox.require_wanted))
                return
            if isinstance(message, DamagedFrame):
                engine.skip(message.number)
            else:
                engine.push(_arrived(message, tell))
    except GivenUpError as error:  # whoever gave it up knows
        reason, run = str(error), error.run
    except BrokenPipeError:
        return
    except (BscdError, OSError, ValueError, RuntimeError) as error:
        reason = str(error) or type(error).__name__
        tell(LiveFailure(reason))
    finally:
        if engine is not None:
            engine.close(reason, run)


def _arrived(frame: PushedFrame, tell: Any) -> ArrivedFrame:
    image = frame.image.read()
    tell(TakenFrame(frame.image.name))
    return ArrivedFrame(frame.number, (image,), frame.time_s, frame.pressure_kpa, frame.exposed_ns)


if __name__ == "__main__":
    serve(Connection(int(sys.argv[1])))
