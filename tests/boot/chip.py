"""Registers of the STM32F4 as far as the start of the firmware needs them, on Unicorn's Cortex-M4.

Unicorn has no interrupts: here, the registers of NVIC, SCB and SysTick only remember what was written to them.
Time of a timer passes by one tick with each access to a register; that of the watchdog by a cycle of the core with each
half-word that is executed, which is less than it takes. RM0090: 3.9 flash, 5.5 power, 7.3 clocks, 19.6
TIM11, 21.4 watchdog, 30.6 USART; ARMv7-M reference manual: B3.2 SCB, B3.3 SysTick, B3.4 NVIC.
"""

FLASH, RAM = 0x0800_0000, 0x2000_0000
RCC_CR, RCC_PLLCFGR, RCC_CFGR, RCC_BDCR = 0x4002_3800, 0x4002_3804, 0x4002_3808, 0x4002_3870
FLASH_ACR, FLASH_KEYR, FLASH_SR, FLASH_CR = 0x4002_3C00, 0x4002_3C04, 0x4002_3C0C, 0x4002_3C10
PWR_CR, PWR_CSR = 0x4000_7000, 0x4000_7004
IWDG_KR, IWDG_PR, IWDG_RLR, IWDG_SR = 0x4000_3000, 0x4000_3004, 0x4000_3008, 0x4000_300C
TIM11_SR, TIM11_CCMR1, TIM11_PSC = 0x4001_4810, 0x4001_4818, 0x4001_4828
TIM11_CR1, TIM11_CCER, TIM11_CCR1, TIM11_OR = 0x4001_4800, 0x4001_4820, 0x4001_4834, 0x4001_4850
SYST_CSR, NVIC_ISER, NVIC_ICER, NVIC_ISPR, NVIC_ICPR = 0xE000_E010, 0xE000_E100, 0xE000_E180, 0xE000_E200, 0xE000_E280
ICSR, VTOR, AIRCR, IDCODE = 0xE000_ED04, 0xE000_ED08, 0xE000_ED0C, 0xE004_2000
GPIO, GPIO_END = 0x4002_0000, 0x4002_2400
# Registers of each port.
MODER, OTYPER, IDR, ODR, BSRR = 0x00, 0x04, 0x10, 0x14, 0x18
# The sender's port is one of these; true: its clock is that of APB2.
USARTS = {0x4001_1000: True, 0x4001_1400: True, 0x4000_4400: False, 0x4000_4800: False}

HSI_MHZ = 16
HSEON, PLLON = 1 << 16, 1 << 24
PG, SER, STRT, LOCK = 1 << 0, 1 << 1, 1 << 16, 1 << 31
DBP, LSEON, PENDSTSET, PENDSVSET = 1 << 8, 1 << 0, 1 << 26, 1 << 28
KEYS = [0x4567_0123, 0xCDEF_89AB]
# What starts, unlocks and feeds the watchdog; the slow clock at its fastest, and how long the firmware may not feed.
DOG_START, DOG_UNLOCK, DOG_FEED = 0xCCCC, 0x5555, 0xAAAA
LSI_KHZ, UNFED_MS = 47, 100
# Reads of the status up to the end of a change of the watchdog's registers.
CHANGE_READS = 20
# Of the timer of the PWM.
TIM_CR1, TIM_CCER, TIM_PSC, TIM_ARR, TIM_CCR1 = 0x00, 0x20, 0x28, 0x2C, 0x34
# Sectors of all parts begin so, KiB; as many of them as the part has.
SECTORS_KIB = [0, 16, 32, 48, 64] + [128 * number for number in range(1, 16)]


class Chip:
    """The registers. What must not be done is a fault, a sentence in `faults`, with what it was first seen at."""

    def __init__(self, board, uc, loaded):
        self.board, self.uc, self.loaded, self.faults = board, uc, loaded, {}
        self.words = {RCC_CR: 0x83, FLASH_CR: LOCK, GPIO: 0xA800_0000, GPIO + 0x400: 0x280}
        # Above DEV_ID stands the chip's revision.
        self.words |= {IDCODE: 0x1000_0000 | board.chip, RCC_PLLCFGR: 0x2400_3010}
        self.enabled, self.pending, self.keys, self.written = 0, 0, [], 0
        self.time, self.captured, self.has_watchdog = 0, 0, False
        self.cycles, self.fed, self.is_dog_open, self.status_reads = 0, 0, False, 0
        self.words[IWDG_RLR] = 0xFFF
        self.has_enabled, self.sent = False, b""

    def fault(self, text, first=None):
        self.faults.setdefault(text, first)

    def get(self, address):
        return self.words.get(address, 0)

    # Clocks.

    def pll_mhz(self):
        word = self.get(RCC_PLLCFGR)
        source = self.board.hse if word >> 22 & 1 else HSI_MHZ
        return source / max(word & 63, 1) * (word >> 6 & 511) / ((word >> 16 & 3) * 2 + 2)

    def core_mhz(self):
        source = {0: HSI_MHZ, 1: self.board.hse, 2: self.pll_mhz()}[self.get(RCC_CFGR) >> 2 & 3]
        divider = self.get(RCC_CFGR) >> 4 & 15
        return source / [2, 4, 8, 16, 64, 128, 256, 512][divider - 8] if divider & 8 else source

    def bus_mhz(self, is_apb2):
        divider = self.get(RCC_CFGR) >> (13 if is_apb2 else 10) & 7
        return self.core_mhz() / (2 << (divider & 3) if divider & 4 else 1)

    def read_clocks(self):
        """RCC_CR: what is on is ready, but for a crystal that is not there and a PLL without its source."""
        word = self.get(RCC_CR) & ~(1 << 1 | 1 << 17 | 1 << 25)
        has_crystal = word & HSEON and self.board.hse
        has_source = has_crystal if self.get(RCC_PLLCFGR) >> 22 & 1 else word & 1
        return word | (word & 1) << 1 | bool(has_crystal) << 17 | bool(word & PLLON and has_source) << 25

    def write_clocks(self, word):
        before, system = self.get(RCC_CR), self.get(RCC_CFGR) >> 2 & 3
        # What the core runs by cannot be switched off.
        kept = {0: 1, 1: HSEON, 2: PLLON | (HSEON if self.get(RCC_PLLCFGR) >> 22 & 1 else 1)}[system]
        word |= before & kept
        self.words[RCC_CR] = word
        if word & ~before & PLLON:
            if not self.has_watchdog:
                self.fault("the PLL is switched on before the watchdog is started")
            if not 50 <= self.pll_mhz() <= 216:
                self.fault(f"the PLL is asked for {self.pll_mhz():g} MHz")

    def write_pll(self, word):
        if self.get(RCC_CR) & PLLON:
            return self.fault("PLLCFGR is written while the PLL runs, which is ignored")
        self.words[RCC_PLLCFGR] = word

    def write_switch(self, word):
        """RCC_CFGR: the core takes the source that is ready, and the flash must have its wait states by then."""
        ready = self.read_clocks() >> {0: 1, 1: 17, 2: 25}.get(word & 3, 31) & 1
        taken = word & 3 if ready else self.get(RCC_CFGR) >> 2 & 3
        self.words[RCC_CFGR] = word & ~0xC | taken << 2
        if self.core_mhz() > 30 * ((self.get(FLASH_ACR) & 15) + 1):
            self.fault(f"too few wait states of the flash at {self.core_mhz():g} MHz")

    def write_backup(self, word):
        if not self.get(PWR_CR) & DBP:
            return self.fault("BDCR is written without DBP, which is ignored")
        self.words[RCC_BDCR] = word & ~2 | (word & LSEON) << 1

    # The crystal, measured by TIM11: its captures are those of HSE, divided by RTCPRE and IC1PSC.

    def read_captures(self):
        """TIM11_SR."""
        divider = self.get(RCC_CFGR) >> 16 & 31
        is_on = self.get(TIM11_CR1) & 1 and self.get(TIM11_CCER) & 1 and self.get(TIM11_OR) & 3 == 2
        if is_on and divider > 1 and self.read_clocks() >> 17 & 1:
            edges = divider << (self.get(TIM11_CCMR1) >> 2 & 3)
            period = edges * self.core_mhz() / self.board.hse / (self.get(TIM11_PSC) + 1)
            if self.time // period > self.captured:
                self.captured = self.time // period
                overrun = self.get(TIM11_SR) & 2
                self.words[TIM11_SR] = self.get(TIM11_SR) | 2 | overrun << 8
                self.words[TIM11_CCR1] = int(self.captured * period) & 0xFFFF
        return self.get(TIM11_SR)

    def read_capture(self):
        self.words[TIM11_SR] = self.get(TIM11_SR) & ~2
        return self.get(TIM11_CCR1)

    # Flash.

    def write_key(self, word):
        self.keys = [*self.keys, word][-2:]
        if self.keys == KEYS:
            self.words[FLASH_CR] = self.get(FLASH_CR) & ~LOCK

    def write_flash_control(self, word):
        if self.get(FLASH_CR) & LOCK:
            return self.fault("FLASH_CR is written while it is locked, which is ignored")
        if word & LOCK and word & (PG | SER | STRT):
            self.fault("FLASH_CR is written with LOCK and with what it locks", word)
        self.words[FLASH_CR] = word & ~STRT
        if word & SER and word & STRT:
            self.erase(word >> 3 & 31)

    def erase(self, sector):
        start, end = (FLASH + SECTORS_KIB[sector + more] * 1024 for more in (0, 1))
        if any(first < end and start < last for first, last in self.loaded):
            self.fault(f"sector {sector} is erased, which holds the program")
        if end <= FLASH + self.board.flash_kib * 1024:
            self.uc.mem_write(start, b"\xff" * (end - start))

    def program(self, address, size, value):
        before = int.from_bytes(self.uc.mem_read(address, size), "little")
        if not self.get(FLASH_CR) & PG or self.get(FLASH_CR) & LOCK:
            self.fault("flash is written without PG", address)
        if any(first <= address < last for first, last in self.loaded):
            self.fault("the program is overwritten", address)
        if value & ~before & ((1 << 8 * size) - 1):
            self.fault("flash is programmed that is not erased", address)
        self.written += 1

    # The processor's own registers.

    def disable(self, bits):
        if self.has_enabled and self.enabled & bits:
            self.fault("interrupts are disabled that the firmware has enabled")
        self.enabled &= ~bits

    def enable(self, bits):
        self.enabled, self.has_enabled = self.enabled | bits, self.has_enabled or bool(bits)

    def nvic(self, address, word):
        bits = word << 8 * (address & 0x1C)
        if address < NVIC_ISPR:
            self.disable(bits) if address & 0x80 else self.enable(bits)
        elif address & 0x80:
            self.pending &= ~bits
        else:
            self.pending |= bits

    def write_pending(self, word):
        """ICSR: a bit that clears stands below each that sets."""
        set_bits = word & (PENDSTSET | PENDSVSET)
        self.words[ICSR] = (self.get(ICSR) | set_bits) & ~((word & (1 << 25 | 1 << 27)) << 1)

    def write_reset_control(self, word):
        if word >> 16 != 0x5FA:
            return self.fault("AIRCR is written without its key, which is ignored")
        if word & 4:
            self.fault("the firmware resets the chip")
            self.uc.emu_stop()
        self.words[AIRCR] = word & 0x700

    # The watchdog.

    def write_watchdog(self, word):
        if word == DOG_START:
            self.has_watchdog, self.fed = True, self.fed if self.has_watchdog else self.cycles
        if word == DOG_FEED:
            self.feed()
        self.is_dog_open = word == DOG_UNLOCK

    def feed(self):
        unfed_ms = (self.cycles - self.fed) / self.core_mhz() / 1000
        if self.has_watchdog and unfed_ms > UNFED_MS:
            self.fault(f"the watchdog is not fed for more than {UNFED_MS} ms")
        self.fed = self.cycles

    def change_watchdog(self, address, flag, word):
        if not self.is_dog_open or self.get(IWDG_SR) & flag:
            return self.fault("the watchdog's period is written locked or in a change, which is ignored")
        self.words |= {address: word, IWDG_SR: self.get(IWDG_SR) | flag}

    def read_watchdog_status(self):
        """IWDG_SR: a change needs the slow clock, which the watchdog starts."""
        self.status_reads = self.status_reads + 1 if self.get(IWDG_SR) and self.has_watchdog else 0
        if self.status_reads == CHANGE_READS:
            self.words[IWDG_SR] = self.status_reads = 0
        return self.get(IWDG_SR)

    def watchdog_ms(self):
        """How long the watchdog waits at least."""
        return (4 << self.get(IWDG_PR)) * (self.get(IWDG_RLR) + 1) / LSI_KHZ

    def takeable(self):
        """Whether an interrupt would be taken where none is masked."""
        is_ticking = self.get(SYST_CSR) & 3 == 3 or self.get(ICSR) & (PENDSTSET | PENDSVSET)
        return bool(is_ticking or self.enabled & self.pending)

    def write_pins(self, port, word):
        """BSRR. What is an output keeps its level up to the first task: one that changes has had the wrong one.

        Open drains are the wires of an EEPROM.
        """
        before = self.get(port + ODR)
        after = before & ~(word >> 16) | word & 0xFFFF
        modes, changing = self.get(port + MODER), (before ^ after) & ~self.get(port + OTYPER)
        changed = [pin for pin in range(16) if changing >> pin & 1 and modes >> 2 * pin & 3 == 1]
        if changed:
            letter = chr(ord("A") + (port - GPIO) // 0x400)
            self.fault(f"outputs change their level: {', '.join(f'{letter}{pin}' for pin in changed)}")
        self.words[port + ODR] = after

    def send(self, byte):
        """A byte to the sender. One that refuses to start says so for ever: once is enough."""
        self.sent += bytes([byte])
        if self.is_refused() and byte == ord("]"):
            self.uc.emu_stop()

    def is_refused(self):
        return b"ALARM:16" in self.sent

    READ = {
        RCC_CR: read_clocks, TIM11_SR: read_captures, TIM11_CCR1: read_capture, FLASH_SR: lambda self: 0,
        # The regulator has reached its voltage; the supply is good.
        PWR_CSR: lambda self: 1 << 14, IWDG_SR: read_watchdog_status, AIRCR: lambda self: 0xFA05_0000 | self.get(AIRCR),
    }  # fmt: skip
    WRITE = {
        RCC_CR: write_clocks, RCC_PLLCFGR: write_pll, RCC_CFGR: write_switch, RCC_BDCR: write_backup,
        FLASH_KEYR: write_key, FLASH_CR: write_flash_control, ICSR: write_pending, AIRCR: write_reset_control,
        IWDG_KR: write_watchdog, IWDG_PR: lambda self, word: self.change_watchdog(IWDG_PR, 1, word),
        IWDG_RLR: lambda self, word: self.change_watchdog(IWDG_RLR, 2, word),
    }  # fmt: skip

    def read(self, address):
        """A word."""
        self.time += 1
        if NVIC_ISER <= address < NVIC_ICPR + 0x20:
            bits = self.enabled if address < NVIC_ISPR else self.pending
            return bits >> 8 * (address & 0x1C) & 0xFFFF_FFFF
        if GPIO <= address < GPIO_END and address & 0x3FF == IDR:
            # Nothing pulls a pin low.
            return 0xFFFF
        if address in USARTS:
            return 0xC0
        return self.READ.get(address, lambda self: self.get(address))(self)

    def write(self, address, value, size):
        """A word, or a part of one."""
        self.time += 1
        word, shift = address & ~3, 8 * (address & 3)
        if NVIC_ISER <= word < NVIC_ICPR + 0x20:
            return self.nvic(word, value << shift)
        mask = ((1 << 8 * size) - 1) << shift
        if word - 4 in USARTS:
            return self.send(value & 0xFF)
        if GPIO <= word < GPIO_END and word & 0x3FF == BSRR:
            return self.write_pins(word - BSRR, value << shift)
        value = self.get(word) & ~mask | value << shift & mask
        if word == TIM11_SR:
            # A zero clears.
            value &= self.get(word)
        self.words[word] = self.get(word)
        if word in self.WRITE:
            self.WRITE[word](self, value)
        else:
            self.words[word] = value
