"""A disk that takes no more in the middle of a write: every flushed frame comes back, and the program survives."""

import subprocess
import sys
from pathlib import Path

FILLS = """
import gc, os, resource, sys
import numpy as np
from bscd.acquisition import RunFile, RunWriter, recover_in_place
from bscd.acquisition.stream import StreamSession
from bscd.errors import BscdError
from bscd.hdf5 import growing
from tests.acquisition.stream.sources import camera, image, record

SHAPE, path = (128, 160), sys.argv[1]
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
let_go = growing.abandon

def abandon(file):  # a full disk does not limit memory, as this test's limit does
    resource.setrlimit(resource.RLIMIT_FSIZE, (hard, hard))
    let_go(file)

growing.abandon = abandon
cameras = camera(SHAPE)
try:
    with RunWriter(path, title="t", cameras=cameras, flush_every=5) as writer:
        with StreamSession(writer, cameras["primary"]) as session:
            for number in range(200):
                if number == 40:
                    session.recorder.wait_idle(30.0)
                    room = os.stat(path).st_size + int(sys.argv[2])
                    resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
                session.publish(number, record(number, SHAPE), "")
                session.recorder.wait_idle(30.0)
except BscdError as error:
    print(error)
account = session.account
written = session.written
del session, writer
gc.collect()
recovery = recover_in_place(path)
with RunFile(path) as run:
    whole = all(np.array_equal(f.data, image(n, SHAPE)) for n, f in enumerate(run.frames()))
print(recovery.frames, written, whole, repr(recovery.damage), account.difference(written) == "")
"""


def run(path, room):
    done = subprocess.run(
        [sys.executable, "-c", FILLS, path, str(room)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=Path(__file__).resolve().parents[3],
    )
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout.splitlines()


def test_every_flushed_frame_is_restored(tmp_path):
    for room in (1_000, 30_000, 200_000, 1_234_567):
        told, left = run(tmp_path / f"{room}.h5", room)
        assert "failed (File too large); look whether the disk is full" in told
        recovered, written, whole, damage, closes = left.split(" ")
        assert int(recovered) >= int(written) - 5
        assert int(recovered) >= 40
        assert (whole, damage, closes) == ("True", "''", "True")
