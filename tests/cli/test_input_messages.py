"""What is wrong with a file that was given is told in one line that names it."""

import pytest

from bscd.acquisition import RunFile, RunWriter
from bscd.cli.app import run
from tests.acquisition.run_records import SETTINGS, frames


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("nope.png", None, "can not be read (No such file or directory)"),
        ("text.png", b"white where points are wanted\n", "is not an image or is damaged"),
        ("text.txt", b"white where points are wanted\n", "is not one of png"),
        ("empty.png", b"", "is an empty file"),
    ],
)
def test_a_region_that_is_no_image_is_named(tmp_path, capsys, name, content, said):
    region = tmp_path / name
    if content is not None:
        region.write_bytes(content)
    given = [str(tmp_path / "cal.h5"), str(tmp_path / "run.h5"), "-o", str(tmp_path / "result.h5")]
    assert run(["measure", *given, "--region", str(region)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"error: {region}: {said}")


def test_a_run_that_was_cut_off_is_recovered_as_the_message_says(tmp_path, capsys):
    path, copy = tmp_path / "run.h5", tmp_path / "COPY.h5"
    recorded = list(frames(40))
    with RunWriter(path, **SETTINGS) as writer:
        for record in recorded:
            writer.append(record)
    content = path.read_bytes()
    path.write_bytes(content[:-600])
    assert run(["recover", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    command = f"bscd recover {path} --out COPY.h5"
    assert line.startswith(f"error: {path} is cut off")
    assert line.endswith(command)
    assert run(["recover", str(path), "--out", str(copy)]) == 1  # not all of it is there
    (line,) = capsys.readouterr().err.splitlines()
    with RunFile(copy) as made:
        count = len(made.table())
        assert 0 < count < 40
        assert made.verify() is None
    assert line == f"error: {path}: 600 bytes of its end are missing ({count} frames restored)"
