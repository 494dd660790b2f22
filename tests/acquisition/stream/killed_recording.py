"""A recording for tests to kill: forks one for each line of stdin, which tells what it has written on stdout.

Line: path, frames a second, flush interval in frames. The fork prints "written N" after frame N went to the file.
"""

import os
import sys
import time

import numpy as np

from bscd.acquisition import PressureMeta, RunWriter
from bscd.acquisition.stream import FrameAccount, FrameRing, Recorder
from drivers.interfaces import PressureReading
from tests.acquisition.stream.sources import camera, record

SHAPE = (128, 160)


def record_until_killed(path, rate_hz, flush_every):
    writer = RunWriter(path, title="killed", cameras=camera(SHAPE), pressure=PressureMeta(), flush_every=flush_every)
    append = writer.append

    def told(frame):
        append(frame)
        os.write(1, b"written %d\n" % (frame.frame_id - 1000))

    writer.append = told
    ring, account = FrameRing(SHAPE, np.uint8, 16), FrameAccount()
    recorder = Recorder(writer, ring, account)
    recorder.start()
    number, begun_s = 0, time.monotonic()
    while time.monotonic() - begun_s < 60.0:
        frame = record(number, SHAPE)
        recorder.log_pressure(PressureReading(0.01 * number, frame.host_time_ns))
        account.exposed(number, "")
        while not ring.publish(number, frame):  # on a loaded machine; the test counts on every number
            time.sleep(0.001)
        number += 1
        time.sleep(max(0.0, begun_s + number / rate_hz - time.monotonic()))


def main():
    print("ready", flush=True)
    for line in sys.stdin:
        path, rate_hz, flush_every = line.split()
        child = os.fork()
        if child == 0:
            record_until_killed(path, float(rate_hz), int(flush_every))
            os._exit(0)
        print(f"pid {child}", flush=True)
        os.waitpid(child, 0)
        print("gone", flush=True)


if __name__ == "__main__":
    main()
