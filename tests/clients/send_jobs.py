"""`cargo xtask send`: a job undisturbed, and the same with holds, a change of the tool, and a port that goes.

Between the program and the machine is a terminal of the script's own, which is closed in the middle of the
job as when a cable is pulled out. The job is then continued. The machine must end at the same steps both
times, which the pins tell.
"""

import os
import pty
import select
import subprocess
import threading
import tty

from jobs import ORIGIN, check, measured, place_origin, port, run, spiral, until

SEND = os.environ["SEND"]
TOOL = "the machine waits"
# Goes on with a feed of 20 %: the job is not at its end, however long the next key takes.
SLOWLY = "-" * 8 + "r"


class Cable:
    """A terminal that leads to the machine's, until it is unplugged."""

    def __init__(self, machine):
        self.near, far = pty.openpty()
        tty.setraw(far)
        self.name = os.ttyname(far)
        # Kept open until the program has opened it.
        self.far = far
        self.machine = machine
        self.stop, self.stopped = os.pipe()
        self.thread = threading.Thread(target=self.carry)
        self.thread.start()

    def carry(self):
        while True:
            ready = select.select([self.near, self.machine, self.stop], [], [])[0]
            if self.stop in ready:
                return
            for source, target in ((self.near, self.machine), (self.machine, self.near)):
                if source in ready:
                    data = os.read(source, 512)
                    while data:
                        data = data[os.write(target, data):]

    def unplug(self):
        os.write(self.stopped, b"x")
        self.thread.join()
        os.close(self.far)
        os.close(self.near)


class Sending:
    """A run of the program."""

    def __init__(self, cable, *arguments):
        command = [SEND, "send", *arguments, "--port", cable.name, "--timeout", "180"]
        self.process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        self.said = []
        self.seen = 0
        self.thread = threading.Thread(target=self.listen, daemon=True)
        self.thread.start()

    def listen(self):
        for line in self.process.stdout:
            self.said.append(line.rstrip())
            print(line.rstrip(), flush=True)

    def until(self, text):
        """Waits for a line with a text behind the last one that was waited for."""

        def found():
            said = list(self.said)
            for index in range(self.seen, len(said)):
                if text in said[index]:
                    self.seen = index + 1
                    return True
            ended = self.process.poll() is not None and not self.thread.is_alive()
            check(not ended or len(said) < len(self.said), f"no {text}")
            return False

        until(found, text, lambda: self.said[-1:])

    def press(self, keys):
        self.process.stdin.write(keys)
        self.process.stdin.flush()

    def end(self, status):
        until(lambda: self.process.poll() is not None, "the program ends", lambda: self.said[-1:])
        # What it has written last may still be on its way.
        self.thread.join()
        check(self.process.returncode == status, f"it has ended with {self.process.returncode}")


def job(path):
    """Two tools, each with a spiral."""
    lines = ["G21 G90 G17 G54"]
    for tool in (1, 2):
        lines += ["G0 Z10", f"T{tool} M6", "M3 S800", *spiral(60), "M5"]
    with open(path, "w") as file:
        file.write("\n".join(lines) + "\n")
    return path


def change_tool(sending, tool, keys="r"):
    sending.until(f"[MSG:Tool change: T{tool}]")
    sending.until(TOOL)
    sending.press(keys)
    sending.until("Run ")


def place(sending):
    """Where the program says that the machine is."""
    done = next(line for line in sending.said if "machine position" in line)
    return tuple(float(number) for number in done.split("machine position ")[1].split())


def main():
    machine = os.open(port(), os.O_RDWR | os.O_NOCTTY)
    tty.setraw(machine)
    with open("home.nc", "w") as file:
        file.write(f"{place_origin()}\nG54 G90 G0 X0 Y0 Z10\n")

    cable = Cable(machine)
    home = Sending(cable, "home.nc", "--home")
    home.end(0)
    x, y, z = ORIGIN
    check(place(home) == (x, y, z + 10), "the machine is at the origin")
    measured()

    plain = Sending(cable, job("plain.nc"))
    change_tool(plain, 1)
    change_tool(plain, 2)
    plain.end(0)

    # The tool of the machine is that of the last job: the first change would be none.
    with open("tool.nc", "w") as file:
        file.write("M61 Q0\n")
    Sending(cable, "tool.nc").end(0)

    sending = Sending(cable, job("job.nc"))
    change_tool(sending, 1, SLOWLY)
    sending.press("h")
    sending.until("the machine is held")
    sending.press("0r")
    change_tool(sending, 2, SLOWLY)
    sending.press("h")
    sending.until("the machine is held")
    sending.press("-r")
    sending.until("Run ")
    cable.unplug()
    sending.end(1)

    cable = Cable(machine)
    resumed = Sending(cable, "job.nc", "--resume", "--spin-up", "0.1")
    resumed.until("modes     [GC:")
    resumed.until("[y/n]")
    resumed.press("y")
    if any(line == "tool      T1" for line in resumed.said):
        change_tool(resumed, 2)
    resumed.end(0)
    check(place(resumed) == place(plain), "both end at the same place")
    cable.unplug()
    return place(plain)


run(main)
