"""Each fault of the model is found, and what is right is none."""

import argparse
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from chip import *
from rehearse import damaged, judge, leave_state

PROGRAM, DEFAULT, TASK = FLASH + 0x8000, 0x800_9001, 0x800_A001
# The interrupt of a task among those of nobody.
VECTORS = [DEFAULT] * 10 + [TASK] + [DEFAULT] * 20
STATES = {"dfu": False, "prigroup": 0, "systick": False, "irqs": False, "lse": False}
LAYOUT = {"program": PROGRAM, "flash_kib": 1024, "interrupts": len(VECTORS), "chip": 0x413}
CLOCKS = {"crystal_mhz": 8, "core_mhz": 168, "hse": 8}
PLL = 8 | 336 << 6 | 1 << 22


class Memory:
    """Flash, in the place of Unicorn."""

    is_stopped = False

    def __init__(self):
        self.bytes = {}

    def mem_read(self, address, size):
        return bytes(self.bytes.get(address + offset, 0xFF) for offset in range(size))

    def mem_write(self, address, content):
        self.bytes |= {address + offset: byte for offset, byte in enumerate(content[:4])}

    def emu_stop(self):
        self.is_stopped = True


def chip(**facts):
    board = argparse.Namespace(**(STATES | LAYOUT | CLOCKS | {"stand_ins": [], "uses_c13": True, "pwm": None} | facts))
    chip = Chip(board, Memory(), [(FLASH, PROGRAM), (PROGRAM, PROGRAM + 0x4000)])
    leave_state(chip, board)
    return chip


# How a firmware starts that is right: register, word.
WATCHDOG, CRYSTAL, VECTOR_TABLE = (IWDG_KR, 0xCCCC), (RCC_CR, 0x83 | HSEON), (VTOR, PROGRAM)
FAST = [(RCC_PLLCFGR, PLL), (FLASH_ACR, 5), (RCC_CR, 0x83 | HSEON | PLLON), (RCC_CFGR, 2 | 4 << 13 | 5 << 10)]
TASKS, PORT = (NVIC_ISER, 1 << 10), [(0x4001_1008, 84_000_000 // 115_200), (0x4001_100C, 1 << 13)]
PERIOD = [(IWDG_KR, DOG_UNLOCK), (IWDG_PR, 0), (IWDG_RLR, 1175)]
START = [VECTOR_TABLE, TASKS, WATCHDOG, *PERIOD, CRYSTAL, *FAST, *PORT]
# TIM12, of 84 MHz.
TIMER = 0x4000_1800
PWM = [(TIMER + TIM_PSC, 15), (TIMER + TIM_ARR, 1019), (TIMER + TIM_CCER, 1 << 4), (TIMER + TIM_CR1, 1)]
UNLOCK = [(FLASH_KEYR, key) for key in KEYS]
NO_LSE = [(PWR_CR, DBP), (RCC_BDCR, 0)]


def start(writes, **facts):
    """The faults of a start with these writes."""
    started = chip(**facts)
    for address, value in writes:
        started.write(address, value, 4)
        while (address, value) == WATCHDOG and started.read(IWDG_SR):
            pass
    judge(started, VECTORS)
    return started.faults


def without(one):
    return [write for write in START if write != one]


class Faults(unittest.TestCase):
    def test_a_right_start_has_none(self):
        self.assertEqual(start(START), {})
        self.assertEqual(start([*START, *UNLOCK, (FLASH_CR, SER | STRT | 10 << 3), (FLASH_CR, LOCK)]), {})
        self.assertEqual(start([*NO_LSE, *START], lse=True), {})
        self.assertEqual(start([(AIRCR, 0x5FA_0000), *START], prigroup=5), {})
        quiet = [(SYST_CSR, 0), (ICSR, 1 << 25), *((NVIC_ICER + 4 * word, 0xFFFF_FFFF) for word in range(8))]
        self.assertEqual(start([*quiet, *START], systick=True, irqs=True), {})
        slow = [VECTOR_TABLE, TASKS, WATCHDOG, *PERIOD, (0x4001_1008, 139), PORT[1]]
        self.assertEqual(start(slow, hse=0), {})
        self.assertEqual(start(slow, hse=0, pwm=TIMER), {})
        self.assertEqual(start([*START, *PWM], pwm=TIMER), {})
        levels = [(GPIO + BSRR, 1 << 3 | 1 << 21), (GPIO + MODER, 1 << 6 | 1 << 10), (GPIO + BSRR, 1 << 3 | 1 << 4)]
        self.assertEqual(start([*START, *levels]), {})
        wire = [(GPIO + OTYPER, 1 << 3), (GPIO + MODER, 1 << 6), (GPIO + BSRR, 1 << 3)]
        self.assertEqual(start([*START, *wire]), {})
        undone = [(RCC_CR, 0x83 | HSEON | PLLON), (RCC_CFGR, 0), (RCC_CR, 0x83)]
        self.assertEqual(start([*undone, *START], dfu=True), {})

    def test_each_is_found(self):
        for text, writes, facts in [
            ("the watchdog is not started", without(WATCHDOG), {}),
            ("before the watchdog", [*without(WATCHDOG), WATCHDOG], {}),
            ("the watchdog waits 349 ms", without(PERIOD[0]), {}),
            ("the watchdog's period is written locked", without(PERIOD[0]), {}),
            ("interrupts [10] have a handler", without(TASKS), {}),
            ("are disabled that", [*START, (NVIC_ICER, 0xFFFF_FFFF)], {}),
            ("interrupts [3] are enabled", [*START, (NVIC_ISER, 1 << 3)], {}),
            ("interrupts [0, 1, ", START, {"irqs": True}),
            ("VTOR", without(VECTOR_TABLE), {}),
            ("PRIGROUP is 5", START, {"prigroup": 5}),
            ("without its key", [*START, (AIRCR, 0)], {}),
            ("resets the chip", [*START, (AIRCR, 0x5FA_0004)], {}),
            ("SysTick or PendSV is pending", START, {"systick": True}),
            ("LSEON is set", START, {"lse": True}),
            ("BDCR is written without DBP", [*NO_LSE[1:], *START], {"lse": True}),
            ("PLLCFGR is written while", START, {"dfu": True}),
            ("the core runs at 60 MHz instead of 168", START, {"dfu": True}),
            ("the sender's port has [] baud", without(PORT[1]), {}),
            ("the sender's port has [41", START, {"dfu": True}),
            ("the sender's port has [116667]", [*START, (0x4001_1008, 45 << 4)], {}),
            ("the timer of the PWM does not run", [*START, *PWM[:3]], {"pwm": TIMER}),
            ("the PWM has 4844 Hz", [*START, *PWM, (TIMER + TIM_PSC, 16)], {"pwm": TIMER}),
            ("the PWM is on", [*START, *PWM, (TIMER + TIM_CCR1 + 4, 1)], {"pwm": TIMER}),
            ("their level: B3", [*START, (GPIO + 0x400 + MODER, 1 << 6), (GPIO + 0x400 + BSRR, 1 << 3)], {}),
            ("the PLL is asked for 252 MHz", START, {"hse": 12}),
            ("the core runs at 252 MHz instead of 16", START, {"hse": 12}),
            ("too few wait states", without(FAST[1]), {}),
            ("while it is locked", [*START, (FLASH_CR, PG)], {}),
            ("with LOCK and with what", [*START, *UNLOCK, (FLASH_CR, PG | LOCK)], {}),
            ("sector 2 is erased", [*START, *UNLOCK, (FLASH_CR, SER | STRT | 2 << 3)], {}),
        ]:
            with self.subTest(text):
                found = start(writes, **facts)
                self.assertTrue(any(text in fault for fault in found), found)

    def test_flash_that_is_written_wrongly_is_found(self):
        free, used = FLASH + 0xC_0000, PROGRAM
        for unlock, address, words, text in [
            (UNLOCK[:1], free, [7], "without PG"),
            (UNLOCK, used, [7], "the program is overwritten"),
            (UNLOCK, free, [7, 8], "that is not erased"),
        ]:
            written = chip()
            for key in [*unlock, (FLASH_CR, PG)]:
                written.write(*key, 4)
            for word in words:
                written.program(address, 4, word)
                written.uc.mem_write(address, word.to_bytes(4, "little"))
            self.assertTrue(any(text in fault for fault in written.faults), written.faults)

    def test_interrupts_that_would_be_taken_are_seen(self):
        for facts, is_taken in [({}, False), ({"systick": True}, True), ({"irqs": True}, True)]:
            self.assertEqual(chip(**facts).takeable(), is_taken, facts)

    def test_a_watchdog_that_is_not_fed_in_time_is_found(self):
        # 16 MHz.
        for cycles, is_late in ((1_599_999, False), (1_600_001, True)):
            started = chip()
            for address, value in (WATCHDOG, (IWDG_KR, DOG_FEED)):
                started.write(address, value, 4)
            started.cycles += cycles
            started.write(IWDG_KR, DOG_FEED, 4)
            self.assertEqual(bool(started.faults), is_late)

    def test_a_period_that_a_loader_leaves_stays_until_its_change_has_ended(self):
        started = chip(dfu=True)
        started.write(*WATCHDOG, 4)
        for address, value in PERIOD:
            started.write(address, value, 4)
        self.assertEqual(len(started.faults), 1)
        self.assertGreater(started.watchdog_ms(), 1000)
        for _ in range(2):
            # The firmware reads up to the first 0.
            reads = next((read for read in range(100) if not started.read(IWDG_SR)), None)
            self.assertEqual(reads, CHANGE_READS - 1)
            for address, value in PERIOD:
                started.write(address, value, 4)
        self.assertAlmostEqual(started.watchdog_ms(), 100, 0)

    def test_a_refusal_ends_a_start_once_it_is_told(self):
        for text, is_refused in [("ALARM:1]", False), ("ALARM:16", False), ("ALARM:16 [MSG:x]", True)]:
            refusing = chip()
            for byte in text.encode():
                refusing.write(0x4001_1004, byte, 4)
            self.assertEqual(refusing.uc.is_stopped, is_refused, text)

    def test_the_chip_says_which_it_is(self):
        self.assertEqual(chip(chip=0x419).read(IDCODE) & 0xFFF, 0x419)

    def test_one_bit_of_a_text_is_damaged(self):
        image = [(FLASH, b"1234"), (FLASH + 4, b"x Check Limits y")]
        self.assertEqual(damaged(image), [image[0], (FLASH + 4, b"x check Limits y")])
        with self.assertRaises(SystemExit):
            damaged(image[:1])

    def test_the_captures_of_tim11_are_those_of_the_crystal(self):
        for hse in (8, 12, 25):
            measured = chip(hse=hse)
            writes = [CRYSTAL, (RCC_CFGR, 31 << 16), (TIM11_OR, 2), (TIM11_CCMR1, 1 | 3 << 2)]
            for write in [*writes, (TIM11_CCER, 1), (TIM11_CR1, 1)]:
                measured.write(*write, 4)
            captures = []
            while len(captures) < 5:
                if measured.read(TIM11_SR) & 2:
                    captures.append(measured.read(TIM11_CCR1))
            ticks = (captures[-1] - captures[0]) / 4
            self.assertAlmostEqual(31 * 8 * HSI_MHZ / ticks, hse, delta=0.1)


if __name__ == "__main__":
    unittest.main()
