"""bCNC without its window: its own reader and sender thread, its controller for Grbl, its jobs.

The window is what this script stands in for: it watches the counters as bCNC's `monitorSerial` does,
and presses the same buttons. bCNC keeps 127 bytes in flight, polls `?` eight times a second, asks `$#`
and `$G` whenever the machine becomes idle, and ends every job with a hold and a reset.
"""

import os
import sys
import threading
import time

import bCNC

FOLDER = os.path.dirname(bCNC.__file__)
sys.path += [FOLDER] + [os.path.join(FOLDER, part) for part in ("lib", "plugins", "controllers")]

import Helpers  # noqa: E402, F401  (bCNC is found only now; this gives it its language)
import Utils  # noqa: E402

Utils.loadConfiguration()

from CNC import CNC, WAIT  # noqa: E402
from Sender import Sender  # noqa: E402

from jobs import (  # noqa: E402
    HOME, ORIGIN, check, measured, place_origin, port, run, spiral, two_tools, until,
)


class Window(Sender):
    """What bCNC's main window does for its sender."""

    def __init__(self):
        super().__init__()
        self.controllerSet("GRBL1")
        # All that happens in the window is done by one thread.
        self.window = threading.RLock()
        self.errors = []
        self.told = []
        self.purges = self.purged = 0
        threading.Thread(target=self.watch, daemon=True).start()

    def watch(self):
        """As `monitorSerial`: empties the log, follows the hold, notices the end of a job."""
        while True:
            with self.window:
                while not self.log.empty():
                    kind, text = self.log.get_nowait()
                    if kind == Sender.MSG_ERROR:
                        self.errors.append(text)
                    elif kind == Sender.MSG_RECEIVE:
                        self.told.append(text)
                if self._posUpdate:
                    self._pause = "Hold" in CNC.vars["state"]
                    self._posUpdate = False
                if self.running and self._gcount >= self._runLines:
                    self.runEnded()
            time.sleep(0.1)

    def start(self):
        """The button that runs the job."""
        with self.window:
            self.cleanAfter = True
            self.initRun()
            self._runLines = sys.maxsize
            self._gcount = 0
            CNC.vars["running"] = True
            CNC.vars["_OvChanged"] = True
            paths = self.gcode.compile(self.queue, lambda: self._stop)
            check(paths, "the job is compiled")
            self._runLines = len(paths) + 1
            self.queue.put((WAIT,))

    def purgeController(self):
        """How bCNC ends a job: a hold, a reset, and everything as it was before."""
        CNC.vars["version"] = ""
        super().purgeController()
        self.purges += 1

    def has_dropped(self):
        """Whether bCNC has dropped its queue, which it does when it has read the welcome."""
        return CNC.vars["version"] and not self._stop

    def refused(self):
        """What the machine has refused.

        Right behind the reset of a purge bCNC sends lines. What comes before the welcome is lost, as
        with Grbl, so half of one line may be left, which is none.
        """
        refused = list(self.errors)
        for _ in range(self.purges):
            half = next((text for text in refused if text in ("error:1", "error:2")), None)
            if half:
                refused.remove(half)
        return refused

    def progress(self):
        """How far the machine is, and what bCNC makes of it."""
        counted = f"{self._gcount} of {self._runLines} lines" if self.running else "no job"
        queued = f"{self.queue.qsize()} lines in the queue, {len(self.errors)} errors"
        flags = {"paused": self._pause, "stopping": self._stop, "waits for idle": self.sio_wait}
        set_flags = [name for name, is_set in flags.items() if is_set]
        place = f"{state()} at {position()}, {self.purges} purges"
        return ", ".join([place, counted, queued, *set_flags])

    def until(self, claim, what):
        return until(claim, what, self.progress)

    def disable(self):
        """Greys the buttons."""

    def event_generate(self, *_, **__):
        """Tells other windows."""


def state():
    return CNC.vars["state"]


def position():
    return tuple(CNC.vars[name] for name in ("mx", "my", "mz"))


def go(window, line, *target):
    window.sendGCode(line)
    window.until(lambda: position() == target and state() == "Idle", f"{line} is done")


def load(window, lines):
    with open("job.nc", "w") as file:
        # bCNC drops the last character of a file.
        file.writelines(f"{line}\n" for line in lines)
    window.gcode.init()
    window.load("job.nc")


def hold(window, during=lambda window: None):
    """The buttons for a feed hold and for going on, and others between them."""
    window.feedHold()
    window.until(lambda: state() == "Hold:0", "the machine is held")
    during(window)
    window.resume()
    window.until(lambda: state() != "Hold:0", "the machine goes on")


def slide(window, name, *values):
    """A slider, moved by as much as one byte does: bCNC sends each of its bytes, in UTF-8.

    Farther, it would send bytes until it reads that the machine is there, and one more for each
    report that is late: it may go to and fro for ever.
    """
    for value in values:
        CNC.vars["_" + name] = value
        CNC.vars["_OvChanged"] = True
        window.until(lambda: CNC.vars[name] == value, f"{name} is {value}")


def override(window):
    slide(window, "OvFeed", 100, 110, 111, 110, 100, 90, 100)
    slide(window, "OvRapid", 25, 50, 100)
    slide(window, "OvSpindle", 90, 89, 90, 100, 110, 100)


def jog(window, target):
    """The arrows: each press is one line; the last comes back."""
    x, y, z = target
    for direction, place in [("X5", (x + 5, y, z)), ("Y-5", (x + 5, y - 5, z)), ("X-5Y5", target)]:
        window.mcontrol.jog(direction)
        window.until(
            lambda: position() == place and state() == "Idle", f"the jog {direction} is done"
        )


def change_tools(window, end):
    """A job with two tools. By its settings bCNC leaves `M6` out, or sends it and its user goes on."""
    load(window, two_tools())
    for policy, wanted in [(1, 0), (0, 2)]:
        CNC.toolPolicy = policy
        window.told.clear()
        window.start()
        for _ in range(wanted):
            window.until(lambda: state() == "Hold:0", "the machine waits for a tool")
            window.resume()
            window.until(lambda: state() != "Hold:0", "the machine goes on with the tool")
        finished(window)
        asked = [line for line in window.told if line.startswith("[MSG:Tool change: T")]
        check(len(asked) == wanted, f"the machine asks for {wanted} tools: {asked}")
        check(position() == end, f"the job with two tools has ended at {position()}")
        check(not window.refused(), f"the machine refuses {window.errors}")


def finished(window, purges=1):
    """Waits until bCNC has ended its job, reset the machine, and has sent all that it wants."""
    wanted = window.purged + purges
    window.until(lambda: window.purges >= wanted, f"bCNC has ended its job, with {wanted} purges")
    # Nobody presses the next button before bCNC has read the welcome.
    window.until(window.has_dropped, "bCNC reads the welcome")
    window.until(lambda: window.queue.empty() and state() == "Idle", "the machine is idle after it")
    check(window.purges == wanted, f"bCNC has purged {window.purges} times, not {wanted}")
    window.purged = wanted


def main():
    window = Window()
    window.open(port(), 115200)
    window.until(lambda: state() in ("Idle", "Alarm"), "a report is understood")
    window.home()
    window.until(lambda: state() == "Idle" and position() == HOME, "the machine is homed")
    measured()
    window.viewSettings()
    window.until(lambda: CNC.vars.get("grbl_132"), "the settings are read")
    # It shows the lines of `$I` as they are, and takes its `ok` for that of the line.
    window.sendGCode("$I")
    window.until(
        lambda: any(line.startswith("[MSG:Step rate: ") for line in window.told),
        "the step rate is shown",
    )
    x, y, z = ORIGIN
    window.sendGCode(place_origin())
    go(window, "G54 G0 X0 Y0 Z10", x, y, z + 10)

    # A whole job with two holds. bCNC ends it with `!`, a reset, `$X` and the modes that were active.
    # Until the second one it goes slowly, so that it is not at its end.
    load(window, spiral(100))
    slide(window, "OvFeed", *range(90, 0, -10))
    window.start()
    window.until(lambda: state() == "Run", "the job runs")
    hold(window)
    hold(window, override)
    finished(window)
    check(position() == (x, y, z + 10), f"the job has ended at {position()}")
    check(not window.refused(), f"the machine refuses {window.errors}")

    jog(window, (x, y, z + 10))

    # The stop button in the middle of a job: a hold, and a reset one second later. How much time
    # that is for the machine is not known; so the motion has ended before.
    load(window, spiral(2000))
    window.start()
    window.until(lambda: state() == "Run", "the job runs")
    window.feedHold()
    window.until(lambda: state() == "Hold:0", "the machine is held")
    window.stopRun()
    # Once for the button, and once more when the machine is idle.
    finished(window, 2)
    check(not window.refused(), f"the machine refuses {window.errors}")

    # And a whole job.
    load(window, spiral(100))
    window.start()
    window.until(lambda: state() == "Run", "the job runs")
    finished(window)
    check(position() == (x, y, z + 10), f"the job has ended at {position()}")
    change_tools(window, (x, y, z + 10))
    go(window, "G53 G0 X-20 Y-30 Z-10", -20, -30, -10)
    return -20, -30, -10


if __name__ == "__main__":
    run(main)
