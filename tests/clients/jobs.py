"""Jobs for the senders, and what the scripts that drive them have in common.

Every script gets the path of a serial port and the name of the machine behind it (`sim`, `qemu` or `board`),
checks what its sender makes of the machine, and prints at the end where the machine must be:
`at X,Y,Z`, machine coordinates in mm. What passes on the line is checked by who starts the script.
"""

import math
import os
import sys
import time
import traceback

# How long nothing may happen, s: a guard for a machine that is stuck, no measure. How long anything
# takes is no concern of the scripts: the emulated machine goes as fast as its host lets it.
TIMEOUT = 180.0

# Where the work coordinates G54 of all jobs begin, machine coordinates in mm.
ORIGIN = (-100, -100, -50)


def place_origin():
    """The line that sets G54."""
    x, y, z = ORIGIN
    return f"G10 L2 P1 X{x} Y{y} Z{z}"


def spiral(lines, feed=6000):
    """A job of short lines, arcs and empty and comment lines, within 25 mm of the origin.

    It begins and ends 10 mm above the origin, whatever position it finds.
    """
    yield from ["(a spiral)", "G21 G90 G17 G54", "", "G0 Z10", f"G1 X0 Y0 F{feed}", "Z-1"]
    for number in range(lines):
        angle, radius = number * 0.15, 5 + 20 * number / lines
        x, y = radius * math.cos(angle), radius * math.sin(angle)
        yield f"G1 X{x:.3f} Y{y:.3f}"
        if number % 50 == 49:
            # A full circle about the origin, counter-clockwise from where the spiral is.
            yield f"G3 X{x:.3f} Y{y:.3f} I{-x:.3f} J{-y:.3f}"
        if number % 10 == 9:
            yield f"; after {number + 1}"
    yield from ["G0 Z10", "X0 Y0"]


def two_tools():
    """A job with two tools. It begins and ends 10 mm above the origin."""
    for tool in (1, 2):
        yield from ["G21 G90 G54 G0 Z10", f"T{tool} M6 (MSG, Tool {tool} of 2)", "M3 S800"]
        yield from spiral(20)
        yield "M5"


def long_moves():
    """A job whose moves would keep a full look-ahead busy for 45 s, with the spindle switched behind them.

    It begins and ends 10 mm above the origin.
    """
    yield from ["G21 G90 G54 G0 Z10", "X0 Y0", "M3 S800"]
    for number in range(140):
        yield f"G1 X{3.5 * (1 - number % 2)} F600"
    yield "M5"


def until(claim, what, progress, listen=lambda: time.sleep(0.01)):
    """Waits until a claim is true, and returns what it says.

    `progress` tells how far the machine is, in words: as long as they change, nothing is stuck.
    """
    seen, end = None, 0.0
    while True:
        result = claim()
        if result:
            return result
        now, before = time.monotonic(), seen
        seen = progress()
        if seen != before:
            end = now + TIMEOUT
        elif now > end:
            raise TimeoutError(f"nothing has happened for {TIMEOUT:.0f} s: {what}; {seen}")
        listen()


def check(claim, what):
    """Ends the script when a claim is false."""
    if not claim:
        raise AssertionError(what)


def port():
    """The serial port."""
    return sys.argv[1]


# Where a machine stands that has been homed: the pull-off away from its switches.
HOME = (-1, -1, -1)


def measured():
    """Lets who started the script compare the pins with the report: to be called after homing."""
    print("homed", flush=True)
    until(lambda: os.path.exists("measured"), "the pins are compared", lambda: "homed")


def run(main):
    """Runs a script, and says where the machine must be, which the script returns.

    Ends at once then: senders leave threads behind that wait for ever.
    """
    try:
        place = main()
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    print("at", ",".join(str(number) for number in place), flush=True)
    os._exit(0)
