"""printcore as a program that uses it: jobs of numbered lines, on a line that may lose them.

printcore has no time limit: where an answer has been lost, its user must send something.
"""

import collections
import sys
import threading
import time

from printrun import gcoder
from printrun.printcore import printcore

from jobs import check, measured, port, run, until
from reprap_jobs import LINES, Walk, nearly, place_of

# How long nothing may come before the user sends something, s.
PUSH = 3.0


class Watcher:
    """Keeps what the machine says."""

    def __init__(self, core):
        self.lock = threading.Lock()
        self.core = core
        self.lines = collections.deque(maxlen=1000)
        self.count = 0
        self.heard = time.monotonic()
        self.pushes = 0
        core.recvcb = self.received
        core.errorcb = lambda line: None

    def received(self, line):
        with self.lock:
            self.lines.append(line.strip())
            self.count += 1
            # A line that tells that nothing goes on is no progress.
            if not line.startswith(("wait", "echo:busy")):
                self.heard = time.monotonic()

    def find(self, begin, since):
        """The newest line with such a beginning of those behind the first `since`."""
        with self.lock:
            new = list(self.lines)[len(self.lines) - (self.count - since):] if self.count > since else []
        return next((line for line in reversed(new) if line.startswith(begin)), None)

    def push(self):
        """What a user does where nothing goes on: he sends a line."""
        if time.monotonic() - self.heard > PUSH:
            self.heard = time.monotonic()
            self.pushes += 1
            self.core._send("M105")
        time.sleep(0.01)

    def until(self, claim, what):
        return until(claim, what, lambda: f"{self.count} lines heard", self.push)

    def ask(self, line, begin):
        """Sends a line beside a job until such an answer has come."""
        while True:
            since, end = self.count, time.monotonic() + 5
            self.core.send_now(line)
            while time.monotonic() < end:
                answer = self.find(begin, since)
                if answer is not None:
                    return answer
                time.sleep(0.01)
            self.pushes += 1


def report(core, watcher):
    """Asks for the machine's position, which ends in the account of the line."""
    since = watcher.count
    core.printer.write(b"?")
    watcher.until(lambda: watcher.find("<Idle", since), "the machine reports")


def job(core, watcher, walk):
    check(core.startprint(gcoder.LightGCode(walk.lines)), "the job begins")
    watcher.until(lambda: not core.printing, "the job has been sent")
    watcher.ask("M400", "ok")
    place = place_of(watcher.ask("M114", "X:"))
    check(nearly(place, walk.end), f"the job has ended at {place} instead of {walk.end}")


def main():
    core = printcore()
    watcher = Watcher(core)
    core.connect(port(), 115200)
    watcher.until(lambda: core.online, "printcore is connected")
    since = watcher.count
    core.send_now("G28")
    core.send_now("M400")
    core.send_now("M118 E1 homed")
    watcher.until(lambda: watcher.find("echo:homed", since), "the machine is homed")
    report(core, watcher)
    measured()
    walks = [Walk(LINES, seed) for seed in range(2)]
    for walk in walks:
        job(core, watcher, walk)
    job(core, watcher, Walk(0, 0))
    report(core, watcher)
    print(f"{watcher.pushes} pushes", file=sys.stderr)
    return -100, -100, -100


if __name__ == "__main__":
    run(main)
