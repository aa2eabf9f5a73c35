"""A sender of our own: the strictest use of character counting, and everything that Grbl does.

It keeps exactly 128 bytes in flight, line feeds counted: where no line fits, a comment of just the
right length does. `?` is asked 20 times a second, and while jobs run they are held and resumed,
overridden in every way, and reset.
"""

import collections
import itertools
import os
import select
import termios
import time
import tty

from jobs import (
    HOME, ORIGIN, check, measured, place_origin, port, run, spiral, two_tools, until,
)

WINDOW = 128
POLL = 0.05

HOLD, START, RESET, DOOR, JOG_CANCEL = b"!", b"~", b"\x18", b"\x84", b"\x85"


class Machine:
    """The line to the machine."""

    def __init__(self, path):
        self.port = os.open(path, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self.port)
        termios.tcflush(self.port, termios.TCIOFLUSH)
        self.received = b""
        self.in_flight = collections.deque()
        self.answers = 0
        self.messages = []
        self.report = {}
        self.reports = 0
        self.welcomes = 0
        self.refused = []
        self.asked = 0.0
        # The tools that the machine has asked for, and whether the user has still to load the last.
        self.tools = []
        self.loads = False

    def realtime(self, data):
        os.write(self.port, data)

    def room(self):
        return WINDOW - sum(self.in_flight)

    def put(self, line):
        """Sends a line that fits."""
        data = line.encode() + b"\n"
        check(len(data) <= self.room(), "the window is kept")
        self.in_flight.append(len(data))
        os.write(self.port, data)

    def listen(self, polls=True):
        """Takes what has come, after a short wait; asks for a report now and then."""
        now = time.monotonic()
        if polls and now - self.asked > POLL:
            self.asked = now
            self.realtime(b"?")
        if not select.select([self.port], [], [], 0.01)[0]:
            return
        self.received += os.read(self.port, 4096)
        *lines, self.received = self.received.split(b"\n")
        for line in lines:
            self.take(line.decode().rstrip("\r"))

    def take(self, line):
        if line == "ok" or line.startswith("error:"):
            check(self.in_flight, f"{line} answers nothing")
            self.in_flight.popleft()
            self.answers += 1
            if line != "ok":
                self.refused.append(line)
        elif line.startswith("<"):
            state, *fields = line[1:-1].split("|")
            self.report.update(field.split(":", 1) for field in fields)
            self.report["state"] = state
            self.reports += 1
            if self.loads and state == "Hold:0":
                self.loads = False
                self.realtime(START)
        elif line:
            if line.startswith("Grbl "):
                self.welcomes += 1
                self.in_flight.clear()
            if line.startswith("[MSG:Tool change: "):
                self.tools.append(line)
                self.loads = True
            self.messages.append(line)

    def progress(self):
        place = f"{self.report.get('state')} at {self.report.get('MPos')}"
        return f"{place}, {self.answers} answers, {self.welcomes} welcomes"

    def wait(self, claim, what):
        until(claim, what, self.progress, self.listen)

    def ask(self, line):
        """Sends a line alone; what comes with its answer."""
        self.wait(lambda: not self.in_flight, "all lines are answered")
        self.messages.clear()
        self.put(line)
        self.wait(lambda: not self.in_flight, f"{line} is answered")
        return [text for text in self.messages if not text.startswith("[MSG:")]

    def stream(self, lines, at=()):
        """Streams lines with the window full to the byte.

        `at` are line numbers, and calls due there; one that returns `False` is made again later.
        """
        due = list(at)
        for number, line in enumerate(lines):
            if due and number >= due[0][0] and due[0][1]() is not False:
                due.pop(0)
            while len(line) + 1 > self.room():
                self.fill()
                self.wait(lambda: self.room() >= 1, "a line is answered")
            self.put(line)
        check(not due, "the job is long enough")

    def fill(self):
        """Fills the window with a line that does nothing."""
        room = self.room()
        if room >= 3:
            self.put("(" + "x" * (room - 3) + ")")
        elif room:
            self.put(" " * (room - 1))

    def wait_for(self, *states):
        seen = self.reports + 1
        self.wait(
            lambda: self.reports > seen and self.report["state"] in states,
            f"the machine is in {states}",
        )

    def position(self):
        """The machine position in a report that has been asked for now."""
        seen = self.reports + 1
        self.wait(lambda: self.reports > seen, "there is a report")
        return [float(number) for number in self.report["MPos"].split(",")]

    def reset(self):
        """Resets, and returns the messages until the welcome."""
        welcomes = self.welcomes
        self.messages.clear()
        self.realtime(RESET)
        self.wait(lambda: self.welcomes > welcomes, "the welcome comes after a reset")
        return list(self.messages)


def ask_for_everything(machine):
    check(len(machine.ask("$$")) >= 34, "all settings are listed")
    check(len(machine.ask("$#")) == 11, "all offsets are listed")
    check(machine.ask("$G")[0].startswith("[GC:G0 G54 G17 G21 G90 G94"), "the modes are listed")
    version, options = machine.ask("$I")
    check(version.startswith("[VER:1.1h."), "the version is told")
    check(options.startswith("[OPT:"), "the options are told")
    check(machine.messages[-1].startswith("[MSG:Step rate: "), "the step rate is told")
    check(machine.ask("$")[0].startswith("[HLP:"), "the help is listed")


def home(machine):
    machine.ask("$H")
    machine.wait_for("Idle")
    check(machine.position() == list(HOME), "the machine is homed")
    measured()


def hold(machine, during=lambda machine: None):
    """A feed hold in motion, something done in it, and the cycle start after it.

    `False` if all motion had ended before the byte came.
    """
    machine.realtime(HOLD)
    machine.wait_for("Hold:0", "Idle")
    if machine.report["state"] == "Idle":
        return False
    place = machine.position()
    during(machine)
    check(machine.position() == place, "nothing moves in a hold")
    machine.realtime(START)
    machine.wait_for("Run", "Idle")
    return True


def open_door(machine):
    """The safety door, which there is no pin for: its byte, and the cycle start after it."""
    machine.realtime(DOOR)
    machine.wait_for("Door:0")
    machine.realtime(START)
    machine.wait_for("Run", "Idle")


def stuff(machine):
    """Streams while the machine moves, until it takes nothing more."""
    for line in itertools.cycle(spiral(150)):
        while len(line) + 1 > machine.room():
            machine.fill()
            reports = machine.reports
            machine.wait(lambda: machine.room() or machine.reports > reports + 5, "it reports")
            if not machine.room():
                return
        machine.put(line)


def override(machine):
    """Every override, as single bytes and as some senders encode them, and back to 100 %."""
    for data, shown in [
        (b"\x91", "110,100,100"),
        (b"\xc2\x92\xc2\x94", "99,100,100"),
        (b"\x90\x96", "100,50,100"),
        (b"\x97", "100,25,100"),
        (b"\xc2\x95\x9a\x9c", "100,100,111"),
        (b"\x99\x93", "101,100,100"),
        (b"\x90", "100,100,100"),
    ]:
        machine.realtime(data)
        machine.wait(lambda: machine.report.get("Ov") == shown, f"the overrides are {shown}")


def jog(machine):
    """Jogs that are queued, and one that is cancelled with others behind it."""
    machine.wait_for("Idle")
    x, y, z = machine.position()
    for line in ["$J=G91 X5 F3000", "$J=G91 Y-5 F3000", "$J=G91 X-5 Y5 F3000"]:
        machine.put(line)
    machine.wait(lambda: not machine.in_flight, "the jogs are answered")
    machine.wait_for("Idle")
    check(machine.position() == [x, y, z], "jogs come back to where they began")
    # Far more than whoever cancels it would wait for; at their end they would be back, too.
    for line in ["$J=G91 Y90 F1000", "$J=G91 Y-90 F1000"] * 3:
        machine.put(line)
    machine.wait(lambda: not machine.in_flight, "the jogs are answered")
    machine.wait_for("Jog")
    machine.realtime(JOG_CANCEL)
    machine.wait_for("Idle")
    check(machine.position() != [x, y, z], "cancelled jogs have not reached their end")
    # Beyond the travel, and nothing that jogs.
    machine.ask("$J=G91 X1000 F1000 (error:15)")
    machine.ask("$J=G91 M3 X1 F100 (error:16)")


def probe(machine):
    """A touch of the plate: the position is told before the answer."""
    machine.ask("G53 G0 Z-180")
    told = machine.ask("G38.2 Z-145 F600")
    check(told and told[0].startswith("[PRB:") and told[0].endswith(":1]"), "the plate is found")
    machine.ask("G53 G0 Z-100")
    machine.wait_for("Idle")
    check(any(line == told[0] for line in machine.ask("$#")), "the touch is kept")


def sleep(machine):
    machine.wait_for("Idle")
    machine.ask("$SLP")
    machine.wait_for("Sleep")
    machine.reset()
    machine.wait_for("Alarm")
    machine.ask("$X")
    machine.wait_for("Idle")


def check_mode(machine):
    """A job that is only checked: every line is answered, nothing moves."""
    place = machine.position()
    machine.ask("$C")
    machine.wait_for("Check")
    machine.stream(with_errors(spiral(30)))
    machine.wait(lambda: not machine.in_flight, "the job is checked")
    welcomes = machine.welcomes
    machine.ask("$C")
    machine.wait(lambda: machine.welcomes > welcomes, "leaving the check resets")
    machine.wait_for("Idle", "Alarm")
    machine.ask("$X")
    check(machine.position() == place, "a check moves nothing")


def with_errors(lines):
    """Lines to be refused between those of a job: the error says which one is answered."""
    wrong = itertools.cycle(["G33 (error:20)", "G17 G18 (error:21)", "X1 X2 (error:25)", "G4 (error:28)"])
    for number, line in enumerate(lines):
        yield line
        if number % 7 == 3:
            yield next(wrong)


def main():
    machine = Machine(port())
    machine.reset()
    home(machine)
    ask_for_everything(machine)
    machine.ask(place_origin())
    machine.ask("G0 X0 Y0 Z10 F6000")

    # A whole job, held, overridden and with its door opened, with lines that are refused in between.
    job = list(with_errors(spiral(200)))
    refused = sum("(error:" in line for line in job)
    events = [
        (90, lambda: hold(machine)),
        (110, lambda: machine.realtime(b"\x91\xc2\x96\x9a")),
        (130, lambda: open_door(machine)),
        (160, lambda: machine.realtime(b"\xc2\x90\x95\x99")),
        (180, lambda: hold(machine, override)),
    ]
    machine.stream(job, events)
    machine.wait(lambda: not machine.in_flight, "the job is answered")
    check(len(machine.refused) == refused, "every wrong line is refused")
    machine.wait_for("Idle")
    x, y, z = ORIGIN
    check(machine.position() == [x, y, z + 10], "the job ends where it should")

    # Two tools: the sender knows nothing of them, its user presses cycle start.
    machine.stream(two_tools())
    machine.wait(lambda: not machine.in_flight, "the job with two tools is answered")
    machine.wait_for("Idle")
    asked = [f"[MSG:Tool change: T{tool} Tool {tool} of 2]" for tool in (1, 2)]
    check(machine.tools == asked, "the machine asks for each tool")
    check(machine.report.get("T") == "2", "the second tool is in the spindle")
    check(machine.position() == [x, y, z + 10], "the job with two tools ends where it should")

    # A reset in motion, with all buffers full: the position stays true, and the next job ends where
    # it should.
    for line in ["G1 X40 F1000", "X-40", "X0"]:
        machine.ask(line)
    stuff(machine)
    messages = machine.reset()
    check("ALARM:3" in messages, "a reset in motion is an alarm")
    machine.wait_for("Alarm")
    machine.ask("$X")
    machine.wait_for("Idle")
    machine.stream(spiral(60))
    machine.wait(lambda: not machine.in_flight, "the job is answered")
    machine.wait_for("Idle")
    check(machine.position() == [x, y, z + 10], "the job after a reset ends where it should")

    jog(machine)
    check_mode(machine)
    sleep(machine)
    probe(machine)

    machine.ask("G53 G0 X-20 Y-30 Z-10")
    machine.wait_for("Idle")
    machine.position()
    return -20, -30, -10


if __name__ == "__main__":
    run(main)
