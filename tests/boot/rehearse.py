"""Starts the firmware of a board as it lies in flash, up to the first time that it sleeps in `idle`.

It runs on a model of the chip's registers (`chip.py`), from a reset or from a state in which a bootloader leaves the
chip. Each fault that is found is a line, with status 1; without any, one line tells what was found instead.
"""

import argparse
import struct
import sys
from collections import Counter

import unicorn
from unicorn.arm_const import UC_ARM_REG_PC, UC_ARM_REG_PRIMASK, UC_ARM_REG_SP, UC_CPU_ARM_CORTEX_M4

from chip import *

# A guard for a start that never ends, no measure: a start takes a second.
TIMEOUT_US = 100_000_000
WFE = b"\x20\xbf"
BAUD = 115_200
# Periods of the PWM in a second, about: the nearest that a whole prescaler gives.
PWM_HZ = 5147


def arguments():
    def number(text):
        return int(text, 0)

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("elf")
    for name in ("program", "flash-kib", "ram-kib", "crystal-mhz", "core-mhz", "chip", "interrupts"):
        parser.add_argument(f"--{name}", type=number, required=True)
    parser.add_argument("--pwm", type=number, help="the timer of the PWM, by its address")
    parser.add_argument("--hse", type=float, help="the crystal that is there, MHz; 0: none")
    parser.add_argument("--stand-ins", type=number, nargs="*", default=[], help="interrupts for the emulator alone")
    parser.add_argument("--uses-c13", action="store_true", help="a pin of PC13 to PC15 is used")
    parser.add_argument("--dfu", action="store_true", help="as the loader in the chip's ROM leaves the clocks")
    parser.add_argument("--prigroup", type=number, default=0, help="groups of priorities")
    parser.add_argument("--systick", action="store_true", help="SysTick runs and is pending")
    parser.add_argument("--irqs", action="store_true", help="all interrupts are enabled and pending")
    parser.add_argument("--lse", action="store_true", help="the oscillator at PC14 and PC15 runs")
    parser.add_argument("--refuses", action="store_true", help="it must not start, and say so")
    parser.add_argument("--damaged", action="store_true", help="one bit of the program is another")
    options = parser.parse_args()
    if options.hse is None:
        options.hse = options.crystal_mhz
    return options


def segments(path):
    """What is loaded, by physical addresses."""
    with open(path, "rb") as file:
        elf = file.read()
    (table,), (size, count) = struct.unpack_from("<I", elf, 28), struct.unpack_from("<2H", elf, 42)
    for number in range(count):
        kind, offset, _, address, length = struct.unpack_from("<5I", elf, table + number * size)
        if kind == 1 and length:
            yield address, elf[offset : offset + length]


def damaged(image):
    """The same with one bit changed, in a text that no start needs."""
    text = b"Check Limits"
    if not any(text in content for _, content in image):
        sys.exit(f"the program has no {text!r} to be damaged")
    return [(address, content.replace(text, b"check Limits")) for address, content in image]


def leave_state(chip, board):
    """Leaves the chip as a bootloader may."""
    if board.dfu:
        # 60 MHz.
        pll = board.crystal_mhz | 240 << 6 | 1 << 16 | 1 << 22 | 5 << 24
        chip.words |= {RCC_CR: 0x83 | HSEON | PLLON, RCC_CFGR: 2 << 2 | 2, RCC_PLLCFGR: pll, FLASH_ACR: 1}
        # The longest period of the watchdog, in a change without a slow clock.
        chip.words |= {IWDG_PR: 6, IWDG_SR: 3}
    if board.systick:
        chip.words |= {SYST_CSR: 7, ICSR: PENDSTSET}
    if board.irqs:
        chip.enabled = chip.pending = (1 << board.interrupts) - 1
    if board.lse:
        chip.words[RCC_BDCR] = LSEON << 1 | LSEON
    chip.words[AIRCR] = board.prigroup << 8


def map_memory(chip, uc, image):
    """Maps memory and registers, and has the model see every access to registers and every write to flash."""
    uc.mem_map(FLASH, chip.board.flash_kib * 1024)
    uc.mem_map(RAM, chip.board.ram_kib * 1024)
    # Nothing is to be expected of what is in RAM.
    uc.mem_write(RAM, b"\xa5" * (chip.board.ram_kib * 1024))
    uc.mem_write(FLASH, b"\xff" * (chip.board.flash_kib * 1024))
    for address, content in image:
        uc.mem_write(address, content)
    # The size of the flash, and beside it the number of the chip.
    uc.mem_map(0x1FFF_0000, 0x1_0000)
    uc.mem_write(0x1FFF_7A22, struct.pack("<H", chip.board.flash_kib))

    def read(_, offset, size, base):
        address = base + offset
        return chip.read(address & ~3) >> 8 * (address & 3) & ((1 << 8 * size) - 1)

    def write(_, offset, size, value, base):
        chip.write(base + offset, value & ((1 << 8 * size) - 1), size)

    def bit(offset):
        """What a word of the bit-band region stands for: a word, and a bit of it."""
        return 0x4000_0000 + (offset >> 5 & ~3), offset >> 2 & 31

    def read_bit(_, offset, *__):
        word, number = bit(offset)
        return chip.read(word) >> number & 1

    def write_bit(_, offset, __, value, ___):
        word, number = bit(offset)
        chip.write(word, chip.read(word) & ~(1 << number) | (value & 1) << number, 4)

    for base, length in ((0x4000_0000, 0x8_0000), (0x5000_0000, 0x8_0000), (0xE000_0000, 0x10_0000)):
        uc.mmio_map(base, length, read, base, write, base)
    uc.mmio_map(0x4200_0000, 0x100_0000, read_bit, None, write_bit, None)
    end = FLASH + chip.board.flash_kib * 1024 - 1
    program = lambda _, __, address, size, value, ___: chip.program(address, size, value)
    uc.hook_add(unicorn.UC_HOOK_MEM_WRITE, program, begin=FLASH, end=end)


def run(chip, uc, image):
    """Runs up to the first sleep; returns whether it has come."""
    asleep = []

    def sleep(uc, *_):
        asleep.append(True)
        uc.emu_stop()

    def masked(uc, *_):
        """At writes to RAM: as long as nothing has masked interrupts, none may be due."""
        if uc.reg_read(UC_ARM_REG_PRIMASK):
            uc.hook_del(hook)
        elif chip.takeable():
            chip.fault("an interrupt can be taken before memory is initialised")

    def invalid(uc, _, address, *__):
        chip.fault(f"an invalid access at {uc.reg_read(UC_ARM_REG_PC):#x}", address)
        return False

    def exception(uc, number, _):
        chip.fault(f"exception {number} of the processor at {uc.reg_read(UC_ARM_REG_PC):#x}")
        uc.emu_stop()

    def count(_, __, size, ___):
        chip.cycles += size // 2

    uc.hook_add(unicorn.UC_HOOK_BLOCK, count)
    hook = uc.hook_add(unicorn.UC_HOOK_MEM_WRITE, masked, begin=RAM, end=RAM + chip.board.ram_kib * 1024 - 1)
    uc.hook_add(unicorn.UC_HOOK_MEM_INVALID, invalid)
    uc.hook_add(unicorn.UC_HOOK_INTR, exception)
    for address, content in image:
        for at in range(0, len(content) - 1, 2):
            if content[at : at + 2] == WFE:
                uc.hook_add(unicorn.UC_HOOK_CODE, sleep, begin=address + at, end=address + at)
    stack, reset = struct.unpack("<2I", uc.mem_read(chip.board.program, 8))
    uc.reg_write(UC_ARM_REG_SP, stack)
    try:
        uc.emu_start(reset, 0xFFFF_FFFF, timeout=TIMEOUT_US)
    except unicorn.UcError as error:
        chip.fault(f"{error} at {uc.reg_read(UC_ARM_REG_PC):#x}")
    return bool(asleep)


def judge(chip, vectors):
    """Compares what is found in `idle` with what the board needs."""
    board = chip.board
    # Without its crystal, the chip stays at what it starts with, and says so.
    expected = board.core_mhz if board.hse == board.crystal_mhz else HSI_MHZ
    if chip.core_mhz() != expected:
        chip.fault(f"the core runs at {chip.core_mhz():g} MHz instead of {expected}")
    ports = [usart for usart in USARTS if chip.get(usart + 12) >> 13 & 1]
    baud = [chip.bus_mhz(USARTS[usart]) * 1e6 / max(chip.get(usart + 8), 1) for usart in ports]
    if len(ports) != 1 or abs(baud[0] / BAUD - 1) > 0.005:
        chip.fault(f"the sender's port has {[round(one) for one in baud]} baud instead of {BAUD}")
    if board.pwm and expected == board.core_mhz:
        judge_pwm(chip, board.pwm)
    default = Counter(vectors).most_common(1)[0][0]
    own = {number for number, vector in enumerate(vectors) if vector not in (0, default)}
    enabled = {number for number in range(board.interrupts) if chip.enabled >> number & 1}
    if missing := own - enabled - set(board.stand_ins):
        chip.fault(f"interrupts {sorted(missing)} have a handler and are not enabled")
    if stray := enabled - own:
        chip.fault(f"interrupts {sorted(stray)} are enabled and have no handler")
    if chip.get(AIRCR):
        chip.fault(f"PRIGROUP is {chip.get(AIRCR) >> 8}: priorities are grouped")
    if chip.get(ICSR) & (PENDSTSET | PENDSVSET):
        chip.fault("SysTick or PendSV is pending")
    if chip.get(VTOR) != board.program:
        chip.fault(f"VTOR is {chip.get(VTOR):#x}")
    chip.feed()
    if not chip.has_watchdog:
        chip.fault("the watchdog is not started")
    elif not UNFED_MS <= chip.watchdog_ms() < 2 * UNFED_MS:
        chip.fault(f"the watchdog waits {chip.watchdog_ms():.0f} ms at least")
    if board.uses_c13 and chip.get(RCC_BDCR) & LSEON:
        chip.fault("LSEON is set: PC14 and PC15 are the oscillator's")


def judge_pwm(chip, timer):
    """The PWM runs with its frequency, and is off."""
    is_apb2 = timer >= 0x4001_0000
    bus_mhz = chip.bus_mhz(is_apb2)
    # Where the clock of the bus is divided, its timers have twice that.
    timer_mhz = bus_mhz if bus_mhz == chip.core_mhz() else 2 * bus_mhz
    hz = timer_mhz * 1e6 / (chip.get(timer + TIM_PSC) + 1) / (chip.get(timer + TIM_ARR) + 1)
    if abs(hz / PWM_HZ - 1) > 0.03:
        chip.fault(f"the PWM has {hz:.0f} Hz instead of about {PWM_HZ}")
    if not chip.get(timer + TIM_CR1) & 1 or not chip.get(timer + TIM_CCER):
        chip.fault("the timer of the PWM does not run")
    if any(chip.get(timer + TIM_CCR1 + 4 * channel) for channel in range(4)):
        chip.fault("the PWM is on")


def main():
    board = arguments()
    image = list(segments(board.elf))
    if board.damaged:
        image = damaged(image)
    loaded = [(address, address + len(content)) for address, content in image]
    uc = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    uc.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
    # A bootloader is not to be touched, either.
    chip = Chip(board, uc, [(FLASH, board.program), *loaded])
    map_memory(chip, uc, image)
    leave_state(chip, board)
    vectors = struct.unpack(f"<{board.interrupts}I", uc.mem_read(board.program + 64, 4 * board.interrupts))
    starts = run(chip, uc, image)
    if starts and board.refuses:
        chip.fault("it starts all the same")
    elif starts:
        judge(chip, vectors)
    elif not board.refuses or not chip.is_refused():
        chip.fault(f"idle is not reached: it stands at {uc.reg_read(UC_ARM_REG_PC):#x}")
    now = [bytes(uc.mem_read(address, len(content))) for address, content in image]
    if lost := sum(old != new for (_, before), after in zip(image, now) for old, new in zip(before, after)):
        chip.fault(f"{lost} bytes of the program are lost")
    for text, first in chip.faults.items():
        print(text if first is None else f"{text}: {first:#x}")
    if not chip.faults:
        print(f"{chip.core_mhz():g} MHz, {chip.written} words written")
    return bool(chip.faults)


if __name__ == "__main__":
    sys.exit(main())
