"""The rules by which OctoPrint 1.11 sends, written anew from what it does on the line.

One line is on its way at a time, numbered and checked while a job runs; the next goes at an `ok`. A
`Resend` is followed from there, and further requests for the same line that come from lines sent before
it are passed by. `wait` stands for a lost `ok`. Silence for 30 s, or 3 s once the machine has told that
it is busy, makes it send `M105`. `start` within a job ends the job, as any `Error:` does whose words do
not say that a line was damaged.
"""

import re
import time

import serial

from jobs import check, measured, port, run, until
from reprap_jobs import LINES, Walk, nearly, place_of

SILENCE, SILENCE_IF_BUSY = 30.0, 3.0
# How long after a request its `ok` is waited for, s.
RESEND_OK = 1.0
# Words of errors after which a job goes on.
RECOVERABLE = (
    "checksum", "line number", "linenumber", "format error", "expected line", "unknown command",
)


class JobCancelled(Exception):
    """The machine has said what ends a job."""


class Host:
    """One machine on a serial line."""

    def __init__(self, path):
        self.serial = serial.Serial(path, 115200, timeout=0.02)
        self.begun = b""
        self.count = 0
        self.silence = SILENCE
        self.hello()

    def hello(self):
        """Begins anew with the numbers of lines."""
        self.number, self.sent = 1, {}
        self.is_clear, self.resend, self.passes = False, None, (None, 0)
        self.is_printing = False
        self.heard, self.asked = time.monotonic(), None
        self.answers = []

    def put(self, text):
        self.is_clear = False
        self.heard = time.monotonic()
        self.serial.write((text + "\n").encode())

    def put_checked(self, words):
        line = f"N{self.number} {words}"
        self.sent[self.number] = line
        self.number += 1
        self.put(checked(line))

    def listen(self):
        """Takes what has come."""
        self.begun += self.serial.read(256)
        *lines, self.begun = self.begun.split(b"\n")
        for line in lines:
            self.count += 1
            self.heard = time.monotonic()
            self.take(line.decode(errors="replace").strip())
        now = time.monotonic()
        if self.asked is not None and now - self.asked > RESEND_OK:
            # The `ok` behind a request has been lost.
            self.asked, self.is_clear = None, True
        if now - self.heard > self.silence:
            self.heard = now
            if self.is_printing and self.resend is None:
                self.put_checked("M105")
            elif self.is_printing:
                self.is_clear = True
            else:
                self.put("M105")

    def take(self, line):
        self.answers.append(line)
        if line.startswith("ok"):
            self.asked, self.is_clear = None, True
        elif line == "wait":
            self.is_clear = True
        elif line.startswith("Resend:"):
            self.request(int(re.search(r"\d+", line).group()))
        elif line.startswith("Error:"):
            if not any(words in line.lower() for words in RECOVERABLE):
                raise JobCancelled(line)
        elif line.startswith("start") and self.is_printing:
            raise JobCancelled("the machine has started anew")
        elif line.startswith("echo:busy") and self.silence != SILENCE_IF_BUSY:
            self.silence = SILENCE_IF_BUSY

    def request(self, number):
        """The machine asks for a line and those behind it."""
        self.asked = time.monotonic()
        before, left = self.passes
        if number == before and left > 0:
            # It comes from a line that was sent before the first request.
            self.passes = (before, left - 1)
            return
        if number == self.number:
            return
        if number not in self.sent:
            raise JobCancelled(f"line {number} is asked for, and {self.number} is the next")
        self.passes = (number, self.number - number - 1)
        self.resend = number

    def go_on(self, lines):
        """Sends what is next, if that may be."""
        if not self.is_clear:
            return
        if self.resend is not None:
            number = self.resend
            self.resend = number + 1 if number + 1 < self.number else None
            self.put(checked(self.sent[number]))
        elif lines:
            self.put_checked(lines.pop(0))

    def until(self, claim, what):
        return until(claim, what, lambda: f"{self.count} lines heard", self.listen)

    def ask(self, words):
        """Sends a line beside a job; the lines that answer it."""
        while True:
            self.until(lambda: self.is_clear, "the machine is ready")
            self.answers.clear()
            self.put(words)
            self.until(lambda: self.is_clear, f"{words} is answered")
            if any(line.startswith("ok") for line in self.answers):
                return list(self.answers)

    def job(self, lines):
        lines = list(lines)
        self.hello()
        self.is_printing = True
        self.put(checked("N0 M110 N0"))

        def is_done():
            self.go_on(lines)
            return not lines and self.resend is None and self.is_clear

        self.until(is_done, "the job has been sent")
        self.is_printing = False


def checked(line):
    """A line with its checksum."""
    checksum = 0
    for byte in line.encode():
        checksum ^= byte
    return f"{line}*{checksum}"


def report(host):
    """Asks for the machine's position, which ends in the account of the line."""
    host.answers.clear()
    host.serial.write(b"?")
    host.until(lambda: any(line.startswith("<Idle") for line in host.answers), "the machine reports")


def walk(host, lines, seed):
    job = Walk(lines, seed)
    host.job(job.lines)
    host.ask("M400")
    told = [line for line in host.ask("M114") if line.startswith("X:")]
    check(told and nearly(place_of(told[-1]), job.end), f"{told} instead of {job.end}")


def main():
    host = Host(port())
    host.put(checked("N0 M110 N0"))
    told = host.ask("M115")
    check(any("FIRMWARE_NAME:Leadscrew" in line for line in told), f"the machine is {told}")
    if any("Cap:BUSY_PROTOCOL:1" in line for line in told):
        host.ask("M113 S2")
    host.ask("G28")
    report(host)
    measured()
    for seed in range(2):
        walk(host, LINES, seed)
    walk(host, 0, 0)
    report(host)
    return -100, -100, -100


if __name__ == "__main__":
    run(main)
