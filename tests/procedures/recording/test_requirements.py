"""What the disk must have before an inflation begins: room for the frames beside the reserve, and the folder."""

from types import SimpleNamespace

import pytest

from bscd.errors import InputError
from bscd.procedures.recording import InflationRecipe, Storing, record_inflation
from bscd.procedures.recording.requirements import inflation_problems
from tests.procedures.test_recording import twin

__all__ = ["twin"]

RECIPE = InflationRecipe(rest_frames=2, ramp_s=0.2, hold_s=0.2, top_kpa=4.0, exposure_s=0.02)
FRAMES_BYTES = RECIPE.frame_count * 640 * 512


@pytest.mark.parametrize(
    ("storing", "kept"),
    [
        (Storing(reserve_bytes=100_000_000), "beside 100 MB that are kept free or written meanwhile"),
        (Storing(reserve_bytes=40_000_000, beside_bytes=60_000_000), "beside 100 MB"),
    ],
)
def test_room_beside_what_is_kept(twin, tmp_path, monkeypatch, storing, kept):
    free = SimpleNamespace(free=100_000_000 + FRAMES_BYTES)  # none for the file's own
    monkeypatch.setattr("shutil.disk_usage", lambda path: free)
    with pytest.raises(InputError, match=f"nothing moved: it needs 3 MB {kept}.*the disk has 102 MB free; remove"):
        record_inflation(twin.rig, RECIPE, tmp_path / "i.h5", storing=storing)
    assert not (tmp_path / "i.h5").exists()
    assert twin.rig.pressure.set_point_kpa() == 0.0
    free.free += 1_100_000
    assert record_inflation(twin.rig, RECIPE, tmp_path / "i.h5", storing=storing).frames == RECIPE.frame_count


def test_who_keeps_a_reserve_himself_asks_for_the_frames_alone(twin, tmp_path, monkeypatch):
    monkeypatch.setattr("shutil.disk_usage", lambda path: SimpleNamespace(free=FRAMES_BYTES + 1_100_000))
    assert inflation_problems(twin.rig, RECIPE, tmp_path / "i.h5") == []


def test_a_folder_that_is_missing_is_told_with_what_to_do(twin, tmp_path):
    with pytest.raises(InputError, match=r"its folder .*/missing can not be reached \(No such file.*\); make it, or"):
        record_inflation(twin.rig, RECIPE, tmp_path / "missing/i.h5")
    assert twin.rig.pressure.set_point_kpa() == 0.0
