"""A USB host in pure Python at what serves a machine by USB/IP: what a driver of the port does, and a job.

Gets the server's TCP port, the file of the job and the name of the device. The package waits for the end of each transfer, so answers
are fetched where the next line would be more in flight than Grbl's senders have.
"""

import collections
import socket
import sys
import time

import usbip.host
from usbip.core import Stall
from usbip.transport import USBIP

from jobs import TIMEOUT, check

WINDOW = 128
DATA_OUT, DATA_IN = 0x01, 0x81
WELCOME = b"Grbl 1.1h ['$' for help]"


class Port:
    """The serial port of the device, as the class CDC ACM has it."""

    def __init__(self, transport):
        self.device = usbip.host.open(0x1209, 0x0001, transport=transport)
        connection = self.device.conn.sock
        connection.settimeout(TIMEOUT)
        # The package sends a command and its data apart.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.received = b""

    def ask(self, kind, code, value, length):
        return bytes(self.device.control(kind, code, value, 0, length))

    def enumerate(self, name):
        """Reads all descriptors, and one that a device of one speed does not have."""
        configuration = self.ask(0x80, 6, 0x200, 255)
        check(len(configuration) == configuration[2] == 75, "the configuration is whole")
        check(configuration[4] == 2, "there are two interfaces")
        texts = [self.device.control(0x80, 6, 0x300 | index, 0x409, 255) for index in (1, 2, 3)]
        texts = [bytes(text)[2:].decode("utf-16-le") for text in texts]
        check(texts[:2] == ["Leadscrew", name], texts)
        check(len(texts[2]) == 24, "the serial number is that of a chip")
        try:
            self.ask(0x80, 6, 0x600, 10)
        except Stall:
            return
        check(False, "a descriptor of another speed is refused")

    def open(self):
        """Sets the line's coding and state. Returns the welcome."""
        coding = (115200).to_bytes(4, "little") + bytes([0, 0, 8])
        self.device.control(0x21, 0x20, 0, 0, coding)
        check(self.ask(0xA1, 0x21, 0, 7) == coding, "the coding is kept")
        self.device.control(0x21, 0x22, 3, 0, b"")
        return self.line() or self.line()

    def send(self, data):
        check(self.device.bulk_out(DATA_OUT, data) == len(data), "all bytes are taken")

    def line(self):
        """The next line."""
        while b"\n" not in self.received:
            self.received += bytes(self.device.bulk_in(DATA_IN, 512))
        line, self.received = self.received.split(b"\n", 1)
        return line.rstrip(b"\r")

    def stream(self, lines):
        """Sends lines, and returns what comes beside their answers."""
        in_flight, others = collections.deque(), []

        def answered():
            line = self.line()
            check(not line.startswith(b"error:"), line)
            if line == b"ok":
                in_flight.popleft()
            elif line:
                others.append(line)

        for line in lines:
            while in_flight and sum(in_flight) + len(line) > WINDOW:
                answered()
            in_flight.append(len(line))
            self.send(line)
        while in_flight:
            answered()
        return others

    def report(self):
        self.send(b"?")
        line = self.line()
        check(line.startswith(b"<"), line)
        return line

    def wait_for_idle(self):
        while not self.report().startswith(b"<Idle|"):
            time.sleep(0.02)


def main():
    number, job, name = sys.argv[1:]
    transport = USBIP("127.0.0.1", int(number))
    (listed,) = usbip.host.list_devices(transport)
    check((listed["busid"], listed["speed"]) == ("1-1", 2), listed)
    check(listed["interfaces"] == [(2, 2, 0), (10, 0, 0)], listed)
    # The second time behind a plug that has been pulled.
    for attachment in ("the first", "the second"):
        port = Port(transport)
        port.enumerate(name)
        check(port.open() == WELCOME, f"{attachment} attachment is welcomed")
        with open(job, "rb") as file:
            lines = [line.strip() + b"\n" for line in file]
        if attachment == "the first":
            others = port.stream(lines)
            check(others == [b"[MSG:Pgm End]"], others)
            port.wait_for_idle()
        check(port.report().startswith(b"<Idle|"), "the machine stands still")
        port.device.close()
    print(len(lines), "lines")


if __name__ == "__main__":
    main()
