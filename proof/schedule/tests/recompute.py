"""Computes the response times of a report of `cargo xtask schedule --json` once more.

Knows nothing of the analysis but the report: of each task with a deadline, the releases of its own
work and of all that may come before it, with what each costs, and what its busy window pays once.
Prints how many response times are those of the report; fails at the first that is not.

usage: recompute.py REPORT
"""

import json
import math
import sys

# What a quotient may be above the true one.
ROUNDING = 1e-9
# With more jobs in a window, the processor is all but overloaded.
MOST_JOBS = 10_000


def due(stream, time):
    """Most releases that are due in a time."""
    count = stream["group"] * math.ceil(time / stream["period"] - ROUNDING)
    if stream["rate"] is not None:
        sustained = math.ceil(stream["rate"] * time + stream["burst"] - ROUNDING)
        count = min(count, sustained)
    return max(count, 0)


def release(stream, job):
    """When a job is due at the earliest, from the window's beginning."""
    spaced = (job // stream["group"]) * stream["period"]
    if stream["rate"] is None:
        return spaced
    return max(spaced, (job - stream["burst"]) / stream["rate"])


def demand(window, time, job):
    """Cycles of all that has to be done by the end of a job in a window that is so long so far."""
    last = window["own"][-1]
    following = release(last, job + 1)
    cycles = window["once"] + (job + 1) * last["cost"]
    for stream in window["own"][:-1]:
        cycles += max(due(stream, following), 1) * stream["cost"]
    for stream in window["others"]:
        cycles += max(due(stream, time + stream["jitter"]), 1) * stream["cost"]
    return cycles


def response(window):
    """The longest time from when a job is due to its end."""
    last = window["own"][-1]
    longest = 0
    time = window["once"]
    for job in range(MOST_JOBS):
        while (more := demand(window, time, job)) > time:
            time = more
        longest = max(longest, math.ceil(time - (release(last, job) - last["jitter"])))
        if time <= release(last, job + 1) - last["jitter"]:
            return longest
    return None


def busy(window):
    """How long the processor is busy with all of a window."""
    streams = window["own"] + window["others"]
    time = window["once"]
    while True:
        more = window["once"] + sum(
            max(due(stream, time + stream["jitter"]), 1) * stream["cost"] for stream in streams
        )
        if more <= time:
            return time
        time = more


def undeadlined(report):
    """How long those without a deadline wait for those with one."""
    tasks = [task for task in report["tasks"] if task.get("window")]
    lowest = min(task["priority"] for task in tasks)
    return max(busy(task["window"]) for task in tasks if task["priority"] == lowest)


def main(path):
    with open(path, encoding="utf-8") as file:
        report = json.load(file)
    count = 0
    for task in report["tasks"]:
        window = task.get("window")
        if window is None:
            continue
        found = response(window)
        if found != task["response_cycles"]:
            print(f"{task['name']}: {found}, and not {task['response_cycles']} cycles")
            return 1
        # Work that is not in the window cannot be in its response time.
        least = sum(stream["cost"] for stream in window["own"] + window["others"])
        assert window["once"] + least <= found + last_jitter(window), task["name"]
        count += 1
    # Older reports do not say it.
    point = report["step_rate_hz"], report["baud"]
    for wait in report.get("undeadlined_waits", []):
        if (wait["step_rate_hz"], wait["baud"]) == point and wait["cycles"] != undeadlined(report):
            print(f"without a deadline: {undeadlined(report)}, and not {wait['cycles']} cycles")
            return 1
    print(count)
    return 0


def last_jitter(window):
    """How much of a window may be before its job is due."""
    return window["own"][-1]["jitter"]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
