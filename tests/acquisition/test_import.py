import struct

import cv2
import numpy as np
import pytest

from bscd.acquisition import ImportRefusedError, RunFile, import_folder
from bscd.cli.app import run as bscd
from bscd.errors import InputError

TITLE = "file,camera,phase,target_position,y_mm,rotation_deg,pressure_kpa,time_s"
RIG = '[target]\ncolumns = 9\nrows = 23\npitch_mm = 2.0 # "µ"\n'


def image(seed, shape=(8, 12), dtype=np.uint8):
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max + 1, shape).astype(dtype)


@pytest.fixture
def folder(tmp_path):
    """Three images of the primary camera, one of the auxiliary, a manifest and a rig.toml."""
    where = tmp_path / "photographs"
    (where / "sub").mkdir(parents=True)
    cv2.imwrite(str(where / "a.png"), image(1))
    cv2.imwrite(str(where / "sub" / "b.tif"), image(2))
    cv2.imwrite(str(where / "c.bmp"), image(3))
    cv2.imwrite(str(where / "aux.png"), image(4, (6, 10), np.uint16))
    (where / "rig.toml").write_text(RIG, encoding="utf-8")
    write_manifest(
        where,
        "a.png,primary,reference-corner,0,0.001,45.002,,",
        "aux.png,auxiliary,reference-corner,0,0.001,45.002,,",
        "sub/b.tif,primary,bsc-face,-8,-16.002,0.01,,",
        "c.bmp,primary,inflation,,,,0.05,0.25",
    )
    return where


def write_manifest(folder, *rows):
    (folder / "manifest.csv").write_text("\n".join([TITLE, *rows]) + "\n", encoding="utf-8")


def refused(folder, tmp_path):
    """The problems of an import that is refused and leaves nothing behind."""
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(ImportRefusedError) as caught:
        import_folder(folder, tmp_path / "run.h5")
    assert sorted(tmp_path.rglob("*")) == before
    assert str(caught.value).splitlines()[:-1] == [str(problem) for problem in caught.value.problems]
    assert "nothing was written" in str(caught.value).splitlines()[-1]
    return [str(problem) for problem in caught.value.problems]


@pytest.mark.parametrize(
    ("largest", "bits"), [(200, 10), (1023, 10), (1024, 12), (4095, 12), (16383, 14), (16384, 16), (65535, 16)]
)
def test_depth_of_a_camera_in_16_bit_files(folder, tmp_path, largest, bits):
    """Of all its images together: a dark one does not tell."""
    pixels = np.full((6, 10), largest // 8, np.uint16)
    cv2.imwrite(str(folder / "dark.png"), pixels)
    pixels[2, 3] = largest
    cv2.imwrite(str(folder / "aux.png"), pixels)
    write_manifest(folder, "dark.png,auxiliary,reference-face,1,2,0,,", "aux.png,auxiliary,reference-face,2,4,0,,")
    result = import_folder(folder, tmp_path / "run.h5")
    with RunFile(tmp_path / "run.h5") as run:
        assert run.cameras["auxiliary"].bit_depth == bits
        assert all(frame.data.dtype == np.uint16 for frame in run.frames("auxiliary"))
    assert any(f"16-bit images use {bits} bits" in text for text in result.warnings) == (bits < 16)


def test_images_and_readings_come_back_as_they_were(folder, tmp_path):
    result = import_folder(folder, tmp_path / "run.h5")
    assert result.warnings == ()
    assert result.frames == {
        ("primary", "reference-corner"): 1,
        ("auxiliary", "reference-corner"): 1,
        ("primary", "bsc-face"): 1,
        ("primary", "inflation"): 1,
    }
    with RunFile(tmp_path / "run.h5") as run:
        frames = list(run.frames())
        assert run.complete
        assert run.verify() is None
        assert run.uuid == result.uuid
        assert run.config_text == RIG
        assert run.cameras["auxiliary"].bit_depth == 16
    for frame, original in zip(frames, [image(1), image(4, (6, 10), np.uint16), image(2), image(3)], strict=True):
        assert frame.data.dtype == original.dtype
        np.testing.assert_array_equal(frame.data, original)
    face, inflation = frames[2], frames[3]
    assert [frame.frame_id for frame in frames] == [0, 0, 1, 2]
    assert (face.phase, face.target_position, face.y_mm, face.rotation_deg) == ("bsc-face", -8, -16.002, 0.01)
    assert (inflation.target_position, inflation.pressure_kpa, inflation.time_s) == (None, 0.05, 0.25)
    assert inflation.camera_time_ns == 250_000_000
    assert np.isnan(inflation.y_mm)


def test_positions_that_follow_by_definition_are_filled_in(folder, tmp_path):
    write_manifest(
        folder,
        "a.png,primary,reference-corner,,,,,",
        "aux.png,auxiliary,sphere,,,,,",
        "sub/b.tif,primary,bsc-face,-3,,,,",
        "c.bmp,primary,bsc-corner,2,4.1,,,",
    )
    result = import_folder(folder, tmp_path / "run.h5")
    assert any("y_mm is empty" in warning for warning in result.warnings)
    with RunFile(tmp_path / "run.h5") as run:
        table = run.table()
    np.testing.assert_array_equal(table["target_position"], [0, np.nan, -3, 2])
    np.testing.assert_array_equal(table["y_mm"], [0, np.nan, -6, 4.1])


def test_every_format_keeps_its_pixels(folder, tmp_path):
    pixels8, pixels16 = image(5), image(6, dtype=np.uint16)
    for name, pixels in [
        ("x.png", pixels8), ("x.tiff", pixels8), ("x.BMP", pixels8), ("x.pgm", pixels8),
        ("y.png", pixels16), ("y.tif", pixels16), ("y.pgm", pixels16),
    ]:  # fmt: skip
        (folder / name).write_bytes(cv2.imencode("." + name.split(".")[1].lower(), pixels)[1].tobytes())
    write_manifest(
        folder,
        *(f"{name},primary,sphere,,,,," for name in ("x.png", "x.tiff", "x.BMP", "x.pgm")),
        *(f"{name},auxiliary,sphere,,,,," for name in ("y.png", "y.tif", "y.pgm")),
    )
    import_folder(folder, tmp_path / "run.h5")
    with RunFile(tmp_path / "run.h5") as run:
        assert all(np.array_equal(frame.data, pixels8) for frame in run.frames("primary"))
        assert all(np.array_equal(frame.data, pixels16) for frame in run.frames("auxiliary"))


def test_a_pgm_written_by_hand_is_read(folder, tmp_path):
    """Netpbm: 16 bit is big-endian."""
    pixels = image(7, dtype=np.uint16)
    (folder / "hand.pgm").write_bytes(b"P5\n12 8\n65535\n" + pixels.astype(">u2").tobytes())
    write_manifest(folder, "hand.pgm,primary,sphere,,,,,")
    import_folder(folder, tmp_path / "run.h5")
    with RunFile(tmp_path / "run.h5") as run:
        np.testing.assert_array_equal(next(run.frames()).data, pixels)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_colour_becomes_rec_601_luma_and_is_said(folder, tmp_path, dtype):
    red, green, blue = (image(seed, dtype=dtype).astype(np.float64) for seed in (1, 2, 3))
    cv2.imwrite(str(folder / "colour.png"), np.stack([blue, green, red], axis=-1).astype(dtype))
    write_manifest(folder, "colour.png,primary,sphere,,,,,")
    result = import_folder(folder, tmp_path / "run.h5")
    said = [warning for warning in result.warnings if "Rec. 601" in warning]
    assert said
    assert "colour.png" in said[0]
    with RunFile(tmp_path / "run.h5") as run:
        luma = 0.299 * red + 0.587 * green + 0.114 * blue  # ITU-R BT.601-7, 2.5.1
        scale = np.iinfo(dtype).max
        np.testing.assert_allclose(next(run.frames()).data, luma, atol=0.51 + scale * 2**-14)
        assert said[0] in [event.text for event in run.events]


def test_what_is_worth_knowing_is_warned_of_and_kept(folder, tmp_path):
    cv2.imwrite(str(folder / "left-over.PNG"), image(1))
    cv2.imwrite(str(folder / "lossy.jpg"), image(1))
    (folder / "notes.txt").write_text("no image")
    (folder / ".hidden.png").write_text("a file browser's")
    (folder / "rig.toml").unlink()
    write_manifest(
        folder,
        "lossy.jpg,primary,inflation,,,,,2.0",
        "a.png,primary,inflation,,,,,1.0",
        "sub/b.tif,primary,inflation,,,,,3.0",
        "c.bmp,primary,inflation,,,,,4.0",
    )
    result = import_folder(folder, tmp_path / "run.h5")
    left_over, jpeg, back, no_rig = result.warnings
    assert left_over == "manifest.csv does not name 2 images (aux.png, left-over.PNG) in the folder; not imported"
    assert "lossy.jpg" in jpeg
    assert "goes back in line 3" in back
    assert "no rig.toml" in no_rig
    with RunFile(tmp_path / "run.h5") as run:
        assert [event.text for event in run.events] == list(result.warnings)
        assert run.config_text == ""


def test_all_problems_of_all_kinds_are_told_together(folder, tmp_path):
    cv2.imwrite(str(folder / "wide.png"), image(1, (8, 13)))
    (folder / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    (folder / "rig.toml").write_text("[target\n")
    write_manifest(
        folder,
        "a.png,primary,sphere,,,,,",
        "wide.png,primary,sphere,,,,,",
        "broken.png,primary,sphere,,,,,",
        "gone.png,primary,sphere,,,,,",
        "c.bmp,primary,spheer,,,,,",
        "sub/b.tif,primary,sphere,,,,x,",
    )
    rig, wide, broken, gone, phase, pressure = refused(folder, tmp_path)
    assert rig.startswith("rig.toml: is not valid TOML")
    assert wide.startswith("manifest.csv:3: file wide.png is 13 x 8 px, 8 bit, the primary camera's others are 12 x 8")
    assert broken.startswith("manifest.csv:4: file broken.png is not an image or is damaged")
    assert gone.startswith("manifest.csv:5: file 'gone.png' is not in the folder")
    assert phase.startswith("manifest.csv:6: phase 'spheer' is not a phase; did you mean sphere?")
    assert pressure.startswith("manifest.csv:7: pressure_kpa 'x' is not a number")


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp", ".jpg", ".pgm"])
@pytest.mark.parametrize("part", [0.0, 0.02, 0.5, 0.9])
def test_a_cut_off_image_is_told(folder, tmp_path, capfd, suffix, part):
    whole = cv2.imencode(suffix, image(1, (40, 60)))[1].tobytes()
    (folder / f"cut{suffix}").write_bytes(whole[: int(len(whole) * part)])
    write_manifest(folder, f"cut{suffix},primary,sphere,,,,,")
    (told,) = refused(folder, tmp_path)
    assert told.startswith(f"manifest.csv:2: file cut{suffix} is ")
    assert ("empty" if part == 0.0 else "damaged") in told
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [
        ("float.tif", cv2.imencode(".tiff", np.zeros((8, 12), np.float32))[1].tobytes(), "has float32 pixels"),
        ("pages.tif", None, "holds 2 images"),
        ("text.txt", b"hello", "is not one of png, tif"),
        ("text.png", b"hello, this is a text", "is not an image"),
    ],
)
def test_images_that_are_of_no_use_are_told(folder, tmp_path, name, content, told):
    if content is None:
        cv2.imwritemulti(str(folder / name), [image(1), image(2)])
    else:
        (folder / name).write_bytes(content)
    write_manifest(folder, f"{name},primary,sphere,,,,,")
    (line,) = refused(folder, tmp_path)
    assert told in line


def test_another_bit_depth_is_another_camera(folder, tmp_path):
    cv2.imwrite(str(folder / "deep.png"), image(1, dtype=np.uint16))
    write_manifest(folder, "a.png,primary,sphere,,,,,", "deep.png,primary,sphere,,,,,", "c.bmp,primary,sphere,,,,,")
    (line,) = refused(folder, tmp_path)
    assert "deep.png is 12 x 8 px, 16 bit, the primary camera's others are 12 x 8 px, 8 bit" in line


def test_a_link_out_of_the_folder_is_refused(folder, tmp_path):
    cv2.imwrite(str(tmp_path / "secret.png"), image(1))
    (folder / "link.png").symlink_to(tmp_path / "secret.png")
    write_manifest(folder, "link.png,primary,sphere,,,,,")
    (line,) = refused(folder, tmp_path)
    assert "is a link out of the folder" in line


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda folder, out: (folder / "manifest.csv").unlink(), "holds no manifest.csv"),
        (lambda folder, out: (folder / "manifest.csv").write_bytes(b"\xff\xfe\x00"), "can not be read as UTF-8"),
        (lambda folder, out: out.write_text("precious"), "exists already"),
        (lambda folder, out: folder.rename(folder.with_name("elsewhere")), "is not a folder"),
    ],
)
def test_what_stops_an_import_before_it_begins(folder, tmp_path, spoil, told):
    spoil(folder, tmp_path / "run.h5")
    with pytest.raises(InputError, match=told) as caught:
        import_folder(folder, tmp_path / "run.h5")
    assert "\n" not in str(caught.value)


def test_a_byte_order_mark_is_no_part_of_the_header(folder, tmp_path):
    text = (folder / "manifest.csv").read_text(encoding="utf-8")
    (folder / "manifest.csv").write_text(text, encoding="utf-8-sig")
    assert sum(import_folder(folder, tmp_path / "run.h5").frames.values()) == 4


def test_a_failure_while_writing_leaves_no_half_run(folder, tmp_path, monkeypatch):
    def pull_the_plug(done, total, what):
        if what == "writing sub/b.tif":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        import_folder(folder, tmp_path / "run.h5", progress=pull_the_plug)
    assert not (tmp_path / "run.h5").exists()


def test_progress_counts_to_its_end(folder, tmp_path):
    calls = []
    import_folder(folder, tmp_path / "run.h5", progress=lambda *call: calls.append(call))
    assert [done for done, _, _ in calls] == list(range(9))
    assert {total for _, total, _ in calls} == {8}


def test_a_large_header_in_a_small_file_does_not_take_the_memory(folder, tmp_path):
    (folder / "bomb.bmp").write_bytes(
        b"BM"
        + struct.pack("<IHHI", 54, 0, 0, 54)
        + struct.pack("<IiiHHIIiiII", 40, 60000, 60000, 1, 24, 0, 0, 0, 0, 0, 0)
    )
    write_manifest(folder, "bomb.bmp,primary,sphere,,,,,")
    (line,) = refused(folder, tmp_path)
    assert "bomb.bmp is not an image or is damaged" in line


@pytest.fixture
def only_import(monkeypatch):
    """The command line with this command alone, which loads faster."""
    monkeypatch.setattr("bscd.cli.app.COMMANDS", {"import_": ("import",)})


@pytest.mark.usefixtures("only_import")
def test_the_command_imports_and_sums_up(folder, tmp_path, capsys):
    cv2.imwrite(str(folder / "left-over.png"), image(1))
    assert bscd(["import", str(folder), str(tmp_path / "run.h5")]) == 0
    out, err = capsys.readouterr()
    assert "run.h5: 4 frames: 1 reference-corner (primary), 1 reference-corner (auxiliary)" in out
    assert "warning: manifest.csv does not name 1 image (left-over.png)" in err
    with RunFile(tmp_path / "run.h5") as run:
        assert run.verify() is None


@pytest.mark.usefixtures("only_import")
def test_the_command_tells_every_problem_and_fails(folder, tmp_path, capsys):
    (folder / "rig.toml").write_text("[target]\ncolums = 9\n")
    write_manifest(folder, "a.png,primry,sphere,,,,,", "gone.png,primary,sphere,,,,,")
    assert bscd(["import", str(folder), str(tmp_path / "run.h5")]) == 1
    error = capsys.readouterr().err
    assert "rig.toml: [target] colums" in error or "rig.toml: target.colums" in error
    assert "did you mean columns?" in error
    assert "manifest.csv:2: camera 'primry'" in error
    assert "manifest.csv:3: file 'gone.png'" in error
    assert "Traceback" not in error
    assert not (tmp_path / "run.h5").exists()
