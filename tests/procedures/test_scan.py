import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bscd.acquisition import RunFile, RunState
from bscd.calibration import GridTarget
from bscd.errors import CheckFailedError, InputError
from bscd.procedures import ProcedureStoppedError, Progress, dry_run, record_scan, resume_scan
from drivers.errors import DeviceFaultError
from drivers.simulated.faults import Fault
from tests.procedures.conftest import BSC, REFERENCE
from tests.procedures.twin_rig import TARGET, TwinRig

SHORT = BSC.model_copy(update={"positions": 3, "step_mm": 8.0})


def frame_bytes(path: Path) -> list[bytes]:
    with RunFile(path) as run:
        return [np.asarray(record.data).tobytes() for record in run.frames()]


class TestWhatAScanRecords:
    def test_reference_scan_has_both_cameras_at_every_place(self, recorded: dict[str, Path]) -> None:
        with RunFile(recorded["reference"]) as run:
            table = run.table()
            seen = {(str(r["camera"]), str(r["phase"]), int(r["target_position"]), round(r["y_mm"], 3)) for r in table}
        places = [("reference-corner", 0, 0.0), *(("reference-face", k, 4.0 * k) for k in range(-2, 3))]
        assert seen == {(camera, *place) for camera in ("primary", "auxiliary") for place in places}
        assert len(table) == 12

    def test_readings_and_settings_are_kept_with_every_frame(self, recorded: dict[str, Path]) -> None:
        with RunFile(recorded["bsc"]) as run:
            table = run.table()
            assert set(run.cameras) == {"primary"}
            assert run.state is RunState.COMPLETE
            assert run.verify() is None
        assert np.all(table["jack_mm"] == 70.0)
        assert table["rotation_deg"].tolist() == [45.0] + [0.0] * 5
        assert np.all(table["exposure_s"] == 0.02)

    def test_validation_scan_lies_between_and_is_turned(self, recorded: dict[str, Path]) -> None:
        with RunFile(recorded["validation"]) as run:
            table = run.table()
        assert table["y_mm"].round(3).tolist() == [-6.0, -2.0, 2.0, 6.0]
        assert np.all(table["rotation_deg"] == 3.0)
        assert 0 not in table["target_position"]

    def test_every_frame_of_a_position_is_stored(self, twin: TwinRig, tmp_path: Path) -> None:
        recipe = SHORT.model_copy(
            update={"positions": 1, "frames_per_position": 3, "exposure_s": 0.015, "gain_db": 1.0}
        )
        result = record_scan(twin.rig, recipe, TARGET, tmp_path / "scan.h5")
        with RunFile(tmp_path / "scan.h5") as run:
            table = run.table()
        assert result.frames == len(table) == 6
        assert np.all(table["exposure_s"] == 0.015)
        assert np.all(table["gain_db"] == 1.0)

    def test_a_lost_frame_names_the_camera(self, twin: TwinRig, tmp_path: Path) -> None:
        twin.rig.primary.faults.inject(Fault.NO_ANSWER)  # type: ignore[attr-defined]  # the simulated camera's
        with pytest.raises(Exception, match="primary"):
            record_scan(twin.rig, SHORT, TARGET, tmp_path / "scan.h5")
        assert not twin.moving()


class TestDryRun:
    @pytest.mark.parametrize("recipe", [REFERENCE, BSC], ids=["reference", "bsc"])
    def test_duration_is_that_of_the_scan(self, twin: TwinRig, tmp_path: Path, recipe) -> None:
        recipe = recipe.model_copy(update={"positions": 3, "step_mm": 15.0})
        foreseen = dry_run(twin.rig, recipe)
        assert foreseen.ok
        result = record_scan(twin.rig, recipe, TARGET, tmp_path / "scan.h5")
        assert foreseen.duration_s == pytest.approx(result.duration_s, rel=0.03)
        assert foreseen.frames == result.frames
        with RunFile(tmp_path / "scan.h5") as run:
            assert foreseen.disk_bytes == sum(record.data.nbytes for record in run.frames())

    def test_nothing_moves_and_no_frame_is_taken(self, twin: TwinRig) -> None:
        before, then_s = twin.positions(), twin.clock.now_s()
        dry_run(twin.rig, REFERENCE)
        assert twin.positions() == before
        assert twin.clock.now_s() == then_s
        assert twin.rig.primary.snap().frame_id == 0

    def test_all_problems_are_told_together(self) -> None:
        twin = TwinRig(homed=False, origin_mm=95.0)
        recipe = REFERENCE.model_copy(update={"exposure_s": 5.0, "face_rotation_deg": 190.0})
        problems = " | ".join(dry_run(twin.rig, recipe, free_bytes=1000).problems)
        for part in (
            "translation: 103 mm is needed, its limits are 0 to 100 mm",
            "rotation: 190 deg is needed, its limits are -180 to 180 deg",
            "jacks: not homed",
            "primary camera: exposure_s = 5 is outside 1e-05 to 1 s",
            "the disk has 0 MB free",
        ):
            assert part in problems

    def test_out_of_limits_is_refused_before_anything_moves(self, tmp_path: Path) -> None:
        twin = TwinRig(origin_mm=95.0)
        before = twin.positions()
        with pytest.raises(InputError, match="nothing moved: translation: 103 mm is needed"):
            record_scan(twin.rig, REFERENCE, TARGET, tmp_path / "scan.h5")
        assert twin.positions() == before
        assert not (tmp_path / "scan.h5").exists()

    def test_a_streaming_camera_is_refused(self, twin: TwinRig) -> None:
        twin.rig.primary.start()
        assert dry_run(twin.rig, BSC).problems == ("primary camera: it is streaming; stop the stream first",)
        twin.rig.primary.stop()


class TestWhatStopsAScan:
    def stopped(self, twin: TwinRig, path: Path, recipe, match: str, target: GridTarget = TARGET) -> None:
        with pytest.raises(CheckFailedError, match=match):
            record_scan(twin.rig, recipe, target, path)
        with RunFile(path) as run:
            assert run.state is RunState.INTERRUPTED
            assert run.reason
        assert not twin.moving()

    def test_saturated_image(self, twin: TwinRig, tmp_path: Path) -> None:
        recipe = SHORT.model_copy(update={"exposure_s": 0.06})
        self.stopped(twin, tmp_path / "scan.h5", recipe, r"primary camera, corner pose, POS.\+0.*saturated; shorten")
        assert frame_bytes(tmp_path / "scan.h5") == []

    def test_dark_image(self, twin: TwinRig, tmp_path: Path) -> None:
        recipe = SHORT.model_copy(update={"exposure_s": 0.0005})
        self.stopped(twin, tmp_path / "scan.h5", recipe, "the image is dark")

    def test_prism_not_in_view_of_a_biprism_scan(self, tmp_path: Path) -> None:
        twin = TwinRig(raised_mm=5.0)
        self.stopped(twin, tmp_path / "scan.h5", SHORT, "biprism is not in the view; raise it")

    def test_prism_in_view_of_a_reference_scan(self, tmp_path: Path) -> None:
        twin = TwinRig(lowered_mm=70.0)
        recipe = SHORT.model_copy(update={"kind": "reference"})
        self.stopped(twin, tmp_path / "scan.h5", recipe, "biprism is in the view; lower it")

    def test_prism_half_in_view(self, tmp_path: Path) -> None:
        twin = TwinRig(lowered_mm=40.0)
        recipe = SHORT.model_copy(update={"kind": "reference"})
        self.stopped(twin, tmp_path / "scan.h5", recipe, "primary camera, corner pose")

    @pytest.mark.parametrize(("columns", "rows"), [(9, 21), (11, 23), (7, 23)])
    def test_wrong_dot_count(self, twin: TwinRig, tmp_path: Path, columns: int, rows: int) -> None:
        target = GridTarget(columns=columns, rows=rows)
        self.stopped(twin, tmp_path / "scan.h5", SHORT, r"(dots|columns|rows)", target)

    def test_empty_stage(self, twin: TwinRig, tmp_path: Path) -> None:
        twin.world.place("empty")
        self.stopped(twin, tmp_path / "scan.h5", SHORT, "primary camera, corner pose")

    def test_a_stalled_axis(self, twin: TwinRig, tmp_path: Path) -> None:
        twin.rig.translation.faults.inject(Fault.STALLED_MOVE)  # type: ignore[attr-defined]  # the simulated axis's
        with pytest.raises(DeviceFaultError, match="translation"):
            record_scan(twin.rig, SHORT, TARGET, tmp_path / "scan.h5")
        assert not twin.moving()
        assert len(frame_bytes(tmp_path / "scan.h5")) == 1


class TestStopAndGoOn:
    def test_goes_on_from_where_it_was_stopped(self, twin: TwinRig, tmp_path: Path) -> None:
        path, stop = tmp_path / "scan.h5", threading.Event()

        def stop_at_two(progress: Progress) -> None:
            if progress.done == 1:
                stop.set()

        with pytest.raises(ProcedureStoppedError) as stopped:
            record_scan(twin.rig, SHORT, TARGET, path, progress=stop_at_two, stop=stop)
        assert stopped.value.next_step == 2
        assert not twin.moving()
        before = frame_bytes(path)
        assert len(before) == 2
        seen: list[Progress] = []
        result = resume_scan(twin.rig, TARGET, path, progress=seen.append)
        assert (result.first_step, result.steps) == (2, 2)
        after = frame_bytes(path)
        assert after[:2] == before
        assert [progress.done for progress in seen] == [2, 2, 3, 4]
        with RunFile(path) as run:
            assert run.table()["target_position"].tolist() == [0, -1, 0, 1]
            assert run.state is RunState.COMPLETE
            assert run.verify() is None

    def test_goes_on_from_an_earlier_step_but_leaves_no_gap(self, twin: TwinRig, tmp_path: Path) -> None:
        path = tmp_path / "scan.h5"
        self.interrupt_before(2, lambda **how: record_scan(twin.rig, SHORT, TARGET, path, **how))
        with pytest.raises(InputError, match="going on from 3 would leave a gap"):
            resume_scan(twin.rig, TARGET, path, first_step=3)
        self.interrupt_before(2, lambda **how: resume_scan(twin.rig, TARGET, path, first_step=1, **how))
        assert resume_scan(twin.rig, TARGET, path).first_step == 2
        with RunFile(path) as run:
            assert run.table()["target_position"].tolist() == [0, -1, -1, 0, 1]

    def test_a_complete_scan_is_refused(self, twin: TwinRig, recorded: dict[str, Path]) -> None:
        with pytest.raises(InputError, match="complete"):
            resume_scan(twin.rig, TARGET, recorded["bsc"])

    def test_nothing_moves_when_stopped_before_the_start(self, twin: TwinRig, tmp_path: Path) -> None:
        stop = threading.Event()
        stop.set()
        before = twin.positions()
        with pytest.raises(ProcedureStoppedError, match="before step 0"):
            record_scan(twin.rig, REFERENCE, TARGET, tmp_path / "scan.h5", stop=stop)
        assert twin.positions() == before

    def interrupt_before(self, step: int, scan: Callable[..., object]) -> None:
        stop = threading.Event()

        def at_step(progress: Progress) -> None:
            if progress.done == step - 1 and "pose" in progress.doing:
                stop.set()

        with pytest.raises(ProcedureStoppedError):
            scan(progress=at_step, stop=stop)
