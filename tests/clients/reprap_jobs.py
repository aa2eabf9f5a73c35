"""What the scripts that drive hosts of RepRap machines have in common."""

import random
import sys
from decimal import Decimal

# Where jobs begin, mm from the negative ends of the axes.
START = (Decimal(100), Decimal(100), Decimal(100))
# How far jobs go from there, mm.
REACH = Decimal(40)

# Lines of a job: on the emulated machine time goes by with the steps.
LINES = {"sim": 150, "qemu": 30}[sys.argv[2]]

# Lines behind a job whose loss is none: a host that has two lines on their way may end its job before
# the machine asks for the last one again.
END = ["M105"] * 8


class Walk:
    """A job of relative moves: it ends where it should only if each line is carried out once."""

    def __init__(self, lines, seed, feed=6000):
        self.lines = ["G21", "G90", "G1 X{} Y{} Z{} F{}".format(*START, feed), "G91"]
        self.end = START
        source = random.Random(seed)
        for _ in range(lines):
            step = [Decimal(source.randrange(-4000, 4001)) / 1000 for _ in range(3)]
            step = [
                -way if abs(place + way - start) > REACH else way
                for way, place, start in zip(step, self.end, START)
            ]
            self.end = tuple(place + way for place, way in zip(self.end, step))
            self.lines.append("G1 X{} Y{} Z{}".format(*step))
        self.lines += ["G90", "M400", *END]


def place_of(answer):
    """The position in an answer to `M114`, mm."""
    words = dict(word.split(":") for word in answer.split(" Count")[0].split())
    return tuple(Decimal(words[axis]) for axis in "XYZ")


def nearly(place, wanted):
    """Whether a position is the wanted one but for the rounding to steps."""
    return all(abs(one - other) < Decimal("0.011") for one, other in zip(place, wanted))
