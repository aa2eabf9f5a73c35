"""The rehearsal itself, with programs of a few instructions: what is wrong with them is told, with status 1."""

import contextlib
import io
import struct
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from unittest import mock

sys.path.insert(0, str(Path(__file__).parent))

import rehearse
from chip import *

INTERRUPTS = 16
# The first instruction, behind the vectors.
CODE = FLASH + 64 + 4 * INTERRUPTS
SLEEP, LOOP, UNDEFINED, CALL = 0xBF20, 0xE7FE, 0xDE00, 0xDF00
FACTS = {
    "program": FLASH, "flash-kib": 512, "ram-kib": 128, "crystal-mhz": 8, "core-mhz": 168, "chip": 0x413,
    "interrupts": INTERRUPTS,
}  # fmt: skip


def move(register, value):
    return 0x2000 | register << 8 | value


def shift(register, bits):
    return bits << 6 | register << 3 | register


# Register 0 has the address of a peripheral, of flash or of nothing.
USART = [move(0, 0x40), shift(0, 24), move(1, 0x11), shift(1, 12), 0x1840]
IN_FLASH, NOWHERE = [move(0, 1), shift(0, 27)], [move(0, 0x60), shift(0, 24)]
# str r1, [r0, #0x40], of a vector; ldr r0, [r0].
OVERWRITE, LOAD = [move(1, 0), 0x6401], 0x6800
# Each byte into the data register, at 4.
REFUSAL = [word for byte in b"[ALARM:16]" for word in (move(1, byte), 0x7101)]


def elf(code):
    """One segment: vectors and code."""
    vectors = [RAM + 0x1_0000, CODE | 1, *[CODE | 1] * (14 + INTERRUPTS)]
    loaded = struct.pack(f"<{len(vectors)}I{len(code)}H", *vectors, *code)
    header = struct.pack("<2H5I6H", 2, 40, 1, 0, 52, 0, 0, 52, 32, 1, 40, 0, 0)
    segment = struct.pack("<8I", 1, 84, FLASH, FLASH, len(loaded), len(loaded), 7, 4)
    return b"\x7fELF\x01\x01\x01".ljust(16, b"\0") + header + segment + loaded


class Programs(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.elf = Path(folder.name, "program.elf")

    def arguments(self, code, *options):
        self.elf.write_bytes(elf(code))
        return [str(self.elf), *(f"--{name}={number}" for name, number in FACTS.items()), *options]

    def rehearse(self, code, *options):
        """The status and the lines of a rehearsal, which does not wait long for a program without an end."""
        arguments = ["rehearse.py", *self.arguments(code, *options)]
        with (
            mock.patch.object(sys, "argv", arguments),
            mock.patch.object(rehearse, "TIMEOUT_US", 100_000),
            contextlib.redirect_stdout(io.StringIO()) as told,
        ):
            status = int(rehearse.main())
        return status, told.getvalue().splitlines()

    def test_one_that_sleeps_at_once_has_started_nothing(self):
        expected = [
            "the core runs at 16 MHz instead of 168",
            "the sender's port has [] baud instead of 115200",
            "VTOR is 0x0",
            "the watchdog is not started",
        ]
        self.assertEqual(self.rehearse([SLEEP]), (1, expected))

    def test_one_that_never_sleeps_does_not_reach_idle(self):
        self.assertEqual(self.rehearse([LOOP]), (1, [f"idle is not reached: it stands at {CODE:#x}"]))

    def test_one_that_overwrites_itself_loses_bytes(self):
        status, told = self.rehearse([*IN_FLASH, *OVERWRITE, SLEEP])
        self.assertEqual(status, 1)
        for fault in [
            f"flash is written without PG: {FLASH + 0x40:#x}",
            f"the program is overwritten: {FLASH + 0x40:#x}",
            f"{sum(byte != 0 for byte in struct.pack('<I', CODE | 1))} bytes of the program are lost",
        ]:
            self.assertIn(fault, told)

    def test_one_that_the_processor_stops_is_told_with_its_place(self):
        for code, place, fault in [
            ([*NOWHERE, LOAD, SLEEP], CODE + 4, f"an invalid access at {CODE + 4:#x}: 0x60000000"),
            ([UNDEFINED, SLEEP], CODE, f"Invalid instruction (UC_ERR_INSN_INVALID) at {CODE:#x}"),
            ([CALL, SLEEP], CODE + 2, f"exception 2 of the processor at {CODE + 2:#x}"),
        ]:
            with self.subTest(fault):
                status, told = self.rehearse(code)
                self.assertEqual((status, told[0]), (1, fault))
                self.assertEqual(told[-1], f"idle is not reached: it stands at {place:#x}")

    def test_one_that_must_refuse_has_to_say_so(self):
        refusal = [*USART, *REFUSAL, LOOP]
        self.assertEqual(self.rehearse([SLEEP], "--refuses"), (1, ["it starts all the same"]))
        self.assertEqual(self.rehearse([LOOP], "--refuses")[0], 1)
        self.assertEqual(self.rehearse(refusal, "--refuses"), (0, ["16 MHz, 0 words written"]))
        self.assertEqual(self.rehearse(refusal)[0], 1)

    def test_the_status_is_that_of_the_program(self):
        script = str(Path(__file__).with_name("rehearse.py"))
        for code, status in [([SLEEP], 1), ([*USART, *REFUSAL], 0)]:
            command = [sys.executable, "-B", script, *self.arguments(code, "--refuses")]
            self.assertEqual(subprocess.run(command, stdout=subprocess.DEVNULL).returncode, status)


if __name__ == "__main__":
    unittest.main()
