"""pygrbl-streamer as a program uses it: whole jobs, and one of long moves.

The library keeps 127 bytes in flight, and gives up when a line has had no answer for 30 s. It asks `?` only
when it waits for the end of a job.
"""

from pygrbl_streamer import GrblStreamer

from jobs import check, long_moves, measured, place_origin, port, run, spiral


def main():
    streamer, errors = GrblStreamer(port()), []
    streamer.error_callback = errors.append
    # It resets the machine, and unlocks it.
    streamer.connect()
    check(streamer.home(wait_idle=True), "the machine is homed")
    measured()
    check(streamer.command(place_origin()), "the origin is set")
    for job in (spiral(100), long_moves(), ["G53 G0 X-20 Y-30 Z-10"]):
        check(streamer.stream(job), f"the library takes the job for done: {errors}")
    streamer.disconnect()
    check(not errors, f"the library tells {errors}")
    return -20, -30, -10


if __name__ == "__main__":
    run(main)
