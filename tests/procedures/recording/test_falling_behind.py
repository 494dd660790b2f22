"""Whoever follows an inflation is told while it lasts that the disk falls behind, and what was lost by it."""

import threading
from dataclasses import replace

from bscd.acquisition import RunFile, RunWriter
from bscd.procedures.recording import InflationRecipe, Storing, record_inflation
from tests.procedures.test_recording import twin

__all__ = ["twin"]

RECIPE = InflationRecipe(rest_frames=4, ramp_s=1.0, hold_s=1.0, top_kpa=8.0, exposure_s=0.02)


class Unhurried:
    """The twin's clock, whose time goes on whether the disk has the frames or not."""

    def __init__(self, clock):
        self.now_s, self.sleep, self.call_at = clock.now_s, clock.sleep, clock.call_at


class Looking:
    """A follower that takes no frame."""

    name = "looking"

    def begin(self, ring):
        self.ring = ring

    def end(self):
        pass


def test_progress_tells_it(twin, tmp_path, monkeypatch):
    free, append, told, looking = threading.Event(), RunWriter.append, {}, Looking()

    def held(writer, frame):
        assert free.wait(30.0)
        append(writer, frame)

    def look(progress):
        told[progress.done] = progress.doing
        if progress.done == 15:
            free.set()
            while looking.ring.fill:
                threading.Event().wait(0.01)

    monkeypatch.setattr(RunWriter, "append", held)
    rig = replace(twin.rig, clock=Unhurried(twin.clock))
    done = record_inflation(
        rig, RECIPE, tmp_path / "i.h5", storing=Storing(ring_frames=8), progress=look, followers=[looking]
    )
    behind, lost = "kPa, the disk falls behind, 8 of 8 buffers in use", done.lost_frames
    assert lost == 15 - 8
    assert [told[number].endswith("kPa") for number in range(1, 6)] == [True] * 5
    assert told[8].endswith(behind)
    assert told[9].endswith(f"{behind}, 1 frame lost")
    assert told[15].endswith(f"{behind}, 7 frames lost")
    assert told[17].endswith("kPa, 7 frames lost")
    assert not any(": " in doing for doing in told.values())  # the command line shows what comes after the last one
    with RunFile(done.path) as run:
        assert [event.text for event in run.events] == [
            "the disk falls behind: 6 of 8 buffers in use",
            "7 frames lost before frame id 15: the ring was full: the disk fell behind",
            "the disk has caught up",
        ]
