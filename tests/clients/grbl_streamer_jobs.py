"""grbl-streamer as a program that uses it: jobs, holds, a reset in motion, and its own counting.

The library fills the receive buffer to exactly 128 bytes. It polls `?` five times a second, and asks
`$#` and `$G` when it feels like it.
"""

import collections
import threading

from grbl_streamer import GrblStreamer

from jobs import (
    HOME, ORIGIN, check, measured, place_origin, port, run, spiral, two_tools, until,
)


class Watcher:
    """Keeps what the library tells."""

    def __init__(self):
        self.lock = threading.Lock()
        self.counts = collections.Counter()
        self.errors = []
        self.state = ""
        self.position = ()

    def __call__(self, event, *data):
        with self.lock:
            self.counts[event] += 1
            if event == "on_error":
                self.errors.append(data)
            elif event == "on_stateupdate":
                self.state, self.position = data[0], data[1]

    def count(self, event):
        with self.lock:
            return self.counts[event]

    def progress(self):
        """How far the machine is."""
        done, boots = self.count("on_processed_command"), self.count("on_boot")
        place = f"{self.state} at {self.position}"
        return f"{place}, {done} lines done, {boots} welcomes, {len(self.errors)} errors"

    def until(self, claim, what):
        return until(claim, what, self.progress)


class Streamer(GrblStreamer):
    """The library, with one thread that streams at a time.

    It begins a job in the thread that asks for it, and goes on in the one that reads the answers: at
    the same time they might leave out a line.
    """

    def __init__(self, callback):
        self.streams = threading.RLock()
        self.reports = 0
        super().__init__(callback)

    def _stream(self):
        with self.streams:
            super()._stream()

    def _update_state(self, line):
        """Counts each report: `on_stateupdate` comes only when something has changed."""
        super()._update_state(line)
        self.reports += 1


def run_job(grbl, watcher, lines, during=None):
    """Runs a job to the end of its last motion; `during` is called while it moves."""
    done = watcher.count("on_processed_command")
    grbl.job_new()
    grbl.write("\n".join(lines))
    grbl.job_run()
    if during:
        watcher.until(lambda: watcher.state == "Run", "the job runs")
        during()
    watcher.until(lambda: grbl.job_finished, "the library takes the job for finished")
    # The report that came last may have been asked for before.
    heard = grbl.reports
    watcher.until(
        lambda: grbl.reports > heard + 1 and watcher.state == "Idle", "the machine is idle"
    )
    return watcher.count("on_processed_command") - done


def hold(grbl, watcher):
    grbl.hold()
    watcher.until(lambda: watcher.state == "Hold:0", "the machine is held")
    place = watcher.position
    grbl.resume()
    watcher.until(lambda: watcher.state != "Hold:0", "the machine goes on")
    check(len(place) == 3, "the position is known")


def go(grbl, watcher, line, *target):
    """Sends a line as from a console, and waits until the machine is there."""
    grbl.send_immediately(line)
    watcher.until(lambda: watcher.position == target and watcher.state == "Idle", f"{line} is done")


def main():
    watcher = Watcher()
    grbl = Streamer(watcher)
    grbl.poll_interval = 0.1
    grbl.cnect(port())
    watcher.until(grbl.is_connected, "the library is connected")
    grbl.poll_start()
    watcher.until(lambda: watcher.count("on_hash_stateupdate") > 1, "the offsets are read")
    watcher.until(lambda: watcher.state, "a report is understood")
    grbl.homing()
    watcher.until(lambda: watcher.state == "Idle" and watcher.position == HOME, "the machine is homed")
    measured()
    x, y, z = ORIGIN
    grbl.send_immediately(place_origin())
    go(grbl, watcher, "G0 X0 Y0 Z10", x, y, z + 10)

    # A whole job with two holds, slow enough for both; the library counts what it has processed.
    lines = list(spiral(100, feed=700))
    processed = run_job(
        grbl, watcher, lines, lambda: [hold(grbl, watcher) for _ in range(2)]
    )
    check(processed == grbl.buffer_size, f"{processed} of {grbl.buffer_size} lines are processed")
    check(watcher.position == (x, y, z + 10), f"the job has ended at {watcher.position}")

    # Two tools: the library leaves `T` and `M6` out of what it sends.
    run_job(grbl, watcher, list(two_tools()))
    check(watcher.position == (x, y, z + 10), f"the job with two tools has ended at {watcher.position}")

    # A reset in the middle of a job, and another job.
    boots = watcher.count("on_boot")
    grbl.job_new()
    grbl.write("\n".join(spiral(2000, feed=700)))
    grbl.job_run()
    watcher.until(lambda: watcher.state == "Run", "the job runs")
    watcher.until(lambda: grbl.current_line_number > 60, "the job is under way")
    grbl.softreset()
    watcher.until(lambda: watcher.count("on_boot") > boots, "the library sees the welcome")
    check(watcher.count("on_alarm") >= 1, "a reset in motion is an alarm")
    watcher.until(lambda: watcher.state == "Alarm", "the machine is locked")
    grbl.killalarm()
    watcher.until(lambda: watcher.state == "Idle", "the machine is unlocked")
    # It goes on streaming until it sees the welcome, and a locked machine refuses that.
    watcher.errors.clear()
    processed = run_job(grbl, watcher, list(spiral(100)))
    check(processed == grbl.buffer_size, f"{processed} of {grbl.buffer_size} lines are processed")

    # Line by line: the library's other way to stream.
    grbl.incremental_streaming = True
    run_job(grbl, watcher, list(spiral(20)))
    check(not watcher.errors, f"the machine refuses {watcher.errors}")
    go(grbl, watcher, "G53 G0 X-20 Y-30 Z-10", -20, -30, -10)
    grbl.poll_stop()
    return -20, -30, -10


if __name__ == "__main__":
    run(main)
