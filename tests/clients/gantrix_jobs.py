"""gantrix as a program uses it: a job of its own, and lines one by one, with long moves among them.

The library sends a line when the one before is answered, and gives up when a line has had no answer for 30 s.
Before it closes the port it waits 5 s for that of `M5`. It never asks `?`.
"""

import serial
from gantrix import GrblTransport, Job
from gantrix.design.shapes import RasterShape
from gantrix.planner.fill import Placed
from gantrix.tools import LaserTool

from jobs import long_moves, measured, place_origin, port, run, spiral, until


def ask(line, question, answer):
    """Asks until an answer begins as it should."""
    heard = b""

    def is_answered():
        nonlocal heard
        line.write(question)
        heard = line.readline()
        return heard.startswith(answer)

    until(is_answered, f"{answer} comes", lambda: heard)


def main():
    # A locked machine refuses the `M5` with which the library begins.
    line = serial.Serial(port(), timeout=60)
    line.write(b"$H\n")
    ask(line, b"", b"ok")
    ask(line, b"?", b"<Idle")
    measured()
    with GrblTransport(port()) as transport:
        for command in [place_origin(), *spiral(20), *long_moves()]:
            transport.send(command)
        shape = RasterShape([[True, False, True], [False, True, False]], 4.0)
        Job(transport, LaserTool(), [Placed(shape, 0)], shape.height, line_gap=1.0).run()
        transport.send("G53 G0 X-20 Y-30 Z-10")
    ask(line, b"?", b"<Idle")
    return -20, -30, -10


if __name__ == "__main__":
    run(main)
