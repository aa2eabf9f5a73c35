//! A run of a board: the emulated core, everything that is wired to it, and a script.

use std::{
    collections::{BTreeMap, VecDeque},
    net::SocketAddr,
    sync::Arc,
    thread::JoinHandle,
};

use anyhow::{Result, anyhow};
use rigless::{
    emulator::{self, Driver, HitKind, Host, Settled, Stop, Watch as Watched},
    session::Session,
    soc::Width,
    time::VirtualNanos,
};

use crate::{
    bench::Bench,
    bootloader, compare,
    debugger::{self, Probe},
    machine::{Machine, SUPPLY_MV},
    plant::Plant,
    script::{Act, Cut, PowerUp},
    sender::Sender,
    watch::Watch,
};

mod wanted;

const MS: u64 = 1_000_000;
/// How often script and plant have a look, ns.
pub(crate) const STOP_INTERVAL_NS: u64 = MS / 2;
/// Between two requests of a report.
const POLL_MS: u64 = 20;
/// What the receive buffer of Grbl holds: the sender's window.
const WINDOW: usize = 128;
/// The supply below which nothing may be stored, mV: `src/board/supply.rs`.
const LOW_SUPPLY_MV: u32 = 2900;
/// `ICSR`, and what makes the NMI pending.
const ICSR: u32 = 0xE000_ED04;
const NMI_PENDING: u32 = 1 << 31;
/// What is in RAM after the supply has been off.
const NOISE: u64 = 0xA5A5_A5A5;
/// More resets of the chip than any case has, and more cases in which nothing is said than a board has that is not dead.
const MOST_RESETS: usize = 4;
const MOST_SILENT_CASES: usize = 2;
/// Bytes of a sector that hold the journal of settings, and what another firmware has left of its own in them.
const JOURNAL_BYTES: u64 = 16 * 1024;
const USED_BYTES: u64 = 256;
const ERASED: u64 = 0xFFFF_FFFF;
/// A text of the program that no start needs, of which a letter is changed.
const DAMAGED_TEXT: &[u8] = b"Check Limits";

/// What a run has shown.
#[derive(Debug, Default)]
pub(crate) struct Outcome {
    /// Each part in some words.
    pub(crate) parts: Vec<String>,
    /// What must not have been, in which cases, and by which instruction.
    pub(crate) faults: BTreeMap<String, (Vec<String>, Option<u64>)>,
}

/// What a part or a case has begun with.
#[derive(Debug, Clone, Copy, Default)]
struct Marks {
    lines: usize,
    resets: usize,
    steps: usize,
    switchings: usize,
    energised: usize,
    words: usize,
    erased: usize,
    handed_over: usize,
    at_ns: u64,
}

/// The sender's end of what leads to it.
fn sender(session: &mut Session<Machine>) -> &mut Sender {
    let peer = session.board_mut().peer_mut();
    peer.expect("it has been attached")
}

/// A run that follows a script.
pub(crate) struct Run {
    bench: Arc<Bench>,
    debugger: SocketAddr,
    script: VecDeque<Act>,
    /// What is waited for, since when.
    current: Option<(Act, VirtualNanos)>,
    /// The next request of a report.
    poll_at: VirtualNanos,
    /// Lines still to be streamed, and the bytes of unanswered lines.
    pending: VecDeque<String>,
    in_flight: VecDeque<usize>,
    probe: Option<JoinHandle<Result<Vec<u32>>>>,
    plant: Plant,
    watch: Watch,
    lines: Vec<String>,
    /// Resets that are known of.
    resets: usize,
    /// The function that is called once memory is initialised, and the handlers of interrupts.
    main: Option<u64>,
    handlers: Vec<u64>,
    is_initialised: bool,
    cut_after: usize,
    /// Where the count of stored records has begun, and the count; listed settings.
    counted_from: Option<usize>,
    counted: usize,
    remembered: Vec<String>,
    /// The resets before the last entry of the bootloaders, and their entries without a reset before.
    resets_at_entry: Option<usize>,
    handed_over: usize,
    /// What was where `TinyUF2` has its mark, at the last entry.
    uf2_word: u64,
    /// What has been changed in the firmware: an address and its word.
    damaged: Option<(u64, u64)>,
    now: VirtualNanos,
    part: Option<(&'static str, Marks)>,
    case: String,
    marks: Marks,
    cases: usize,
    silent_cases: usize,
    pub(crate) outcome: Outcome,
}

impl Run {
    pub(crate) fn new(
        bench: &Arc<Bench>,
        script: Vec<Act>,
        plant: Plant,
        debugger: SocketAddr,
    ) -> Self {
        Self {
            bench: Arc::clone(bench),
            debugger,
            script: script.into(),
            current: None,
            poll_at: VirtualNanos(0),
            pending: VecDeque::new(),
            in_flight: VecDeque::new(),
            probe: None,
            plant,
            watch: Watch::new(bench.board.crystal_mhz),
            lines: Vec::new(),
            resets: 0,
            main: bench.program.function("main"),
            handlers: bench.all_handlers(),
            is_initialised: false,
            cut_after: usize::MAX,
            counted_from: None,
            counted: 0,
            remembered: Vec::new(),
            resets_at_entry: None,
            handed_over: 0,
            uf2_word: 0,
            damaged: None,
            now: VirtualNanos(0),
            part: None,
            case: String::new(),
            marks: Marks::default(),
            cases: 0,
            silent_cases: 0,
            outcome: Outcome::default(),
        }
    }

    /// Has arrivals at `main` and at the bootloaders' handler reported, and at the firmware's until then.
    pub(crate) fn watch_start(&self, session: &mut Session<Machine>) {
        for address in [bootloader::HANDLER, bootloader::ENTRY] {
            session.watch(Watched::Instruction(address.into()));
        }
        if let Some(main) = self.main {
            session.watch(Watched::Instruction(main));
        }
        self.watch_handlers(session);
    }

    fn watch_handlers(&self, session: &mut Session<Machine>) {
        for &handler in &self.handlers {
            session.watch(Watched::Instruction(handler));
        }
    }

    /// A bootloader begins: out of a reset, or since the firmware has handed over to the chip's own.
    fn enter_bootloader(&mut self, session: &mut Session<Machine>, host: &mut dyn Host) {
        let word = host.read(bootloader::UF2_PLACE.into(), Width::W32);
        self.uf2_word = word.unwrap_or_default();
        let resets = session.resets().len();
        if self.resets_at_entry.replace(resets) != Some(resets) {
            return;
        }
        self.handed_over += 1;
        self.is_initialised = false;
        for fault in compare::not_as_for_rom(session.board_mut()) {
            self.watch.fault(fault, None);
        }
        if self.watch.has_watchdog() {
            let message = "the watchdog runs before the chip's own bootloader";
            self.watch.fault(message, None);
        }
    }

    fn arrive(&mut self, address: u64, session: &mut Session<Machine>, host: &mut dyn Host) {
        if address == u64::from(bootloader::ENTRY) {
            return self.enter_bootloader(session, host);
        }
        if self.main == Some(address) && !self.is_initialised {
            self.is_initialised = true;
            for &handler in &self.handlers {
                session.unwatch(Watched::Instruction(handler));
            }
        } else if address == u64::from(bootloader::HANDLER) {
            if self.is_initialised {
                let message = "VTOR is that of a bootloader, whose handler takes an interrupt";
                self.watch.fault(message, None);
            }
        } else if !self.is_initialised {
            let message = "an interrupt is taken before memory is initialised";
            self.watch.fault(message, Some(address));
        }
    }

    /// The chip has been reset since it was looked at.
    fn restart(&mut self, session: &mut Session<Machine>) {
        self.resets = session.resets().len();
        self.watch.restart();
        self.plant.is_greeted = false;
        if std::mem::take(&mut self.is_initialised) {
            self.watch_handlers(session);
        }
    }

    /// Takes what has come from the firmware, up to what is waited for.
    fn listen(&mut self, session: &mut Session<Machine>) {
        while let Some(line) = sender(session).lines.pop_front() {
            if line.starts_with("Grbl ") {
                self.plant.is_greeted = true;
                self.in_flight.clear();
            }
            let is_answer = line == "ok" || line.starts_with("error:");
            if is_answer {
                self.in_flight.pop_front();
            }
            let is_answered = is_answer && self.in_flight.is_empty() && self.pending.is_empty();
            let is_awaited = match &self.current {
                Some((act @ (Act::Line(_) | Act::Stream(_) | Act::Refused(_)), _)) => {
                    let is_right = matches!(act, Act::Refused(_)) != (line == "ok");
                    if is_answer && !is_right {
                        let message = format!("{line} comes instead of {}", act.awaited());
                        self.watch.fault(message, None);
                    }
                    is_answered
                }
                Some((Act::Await(beginning), _)) => line.starts_with(beginning),
                Some((Act::State(state), _)) => {
                    let report = line.strip_prefix('<');
                    report.is_some_and(|report| report.starts_with(state))
                }
                Some((Act::Field(field), _)) => line.starts_with('<') && line.contains(field),
                _ => false,
            };
            if self.bench.shows_lines {
                eprintln!(
                    "{:10.3} {line}  X {:?}",
                    self.now.0 as f64 / 1e6,
                    self.plant.position(0)
                );
            }
            self.lines.push(line);
            if is_awaited {
                self.current = None;
                return;
            }
        }
    }

    /// Sends lines as long as the window has room.
    fn stream(&mut self, session: &mut Session<Machine>) {
        while let Some(line) = self.pending.front() {
            let bytes = line.len() + 1;
            if self.in_flight.iter().sum::<usize>() + bytes > WINDOW {
                return;
            }
            let line = self.pending.pop_front().unwrap_or_default();
            let sender = sender(session);
            sender.outgoing.extend(line.bytes().chain([b'\n']));
            self.in_flight.push_back(bytes);
        }
    }

    /// Begins what is next in the script.
    fn begin(&mut self, act: Act, session: &mut Session<Machine>, host: &mut dyn Host) {
        let now = self.now;
        let chip = &mut session.board_mut().chip;
        match &act {
            Act::Part(name) => {
                self.end_case();
                self.end_part();
                self.part = Some((name, self.marks_now()));
            }
            Act::Case(name, power_up) => {
                self.end_case();
                self.case.clone_from(name);
                self.cases += 1;
                self.power_up(*power_up, session, host);
                self.marks = self.marks_now();
            }
            Act::Line(line) => self.pending.push_back(line.clone()),
            Act::Refused(line) => self.pending.push_back((*line).to_owned()),
            Act::Stream(lines) => self.pending.extend(lines.iter().cloned()),
            Act::Bytes(bytes) => sender(session).outgoing.extend(*bytes),
            Act::Press(input) => self.plant.press(*input, true, now, chip),
            Act::Release(input) => self.plant.press(*input, false, now, chip),
            Act::Mount(input, closes) => self.plant.mount(*input, *closes),
            Act::Supply(millivolts) => {
                chip.supply(now, *millivolts);
                self.watch.is_supply_low = *millivolts < LOW_SUPPLY_MV;
            }
            Act::StopCrystal => {
                if !chip.stop_crystal(now) {
                    let message = "the crystal stops, and CSSON of RCC_CR is not set";
                    self.watch.fault(message, None);
                }
                let nmi = Probe::Write(ICSR, NMI_PENDING);
                self.probe = Some(debugger::probe(self.debugger, nmi));
            }
            Act::Compare => {
                let words = Probe::Read(compare::ADDRESSES.to_vec());
                self.probe = Some(debugger::probe(self.debugger, words));
            }
            Act::Host(action) => chip.otg.act(*action),
            Act::Hang => host.hold(true),
            Act::Reset => session.reset_by_pin(now, 0, host),
            Act::CountStored => self.counted_from = Some(self.stored()),
            Act::CutAfter(cut) => {
                let count = match cut {
                    Cut::After(count) => *count,
                    Cut::Half => self.counted / 2,
                    Cut::Before(count) => self.counted.saturating_sub(*count),
                };
                self.cut_after = self.watch.words + count;
                self.plant.cut_after(count);
            }
            Act::Remember => self.remembered = self.settings_listed(),
            Act::Want(wanted) => self.compare(wanted, session),
            Act::Await(_) | Act::State(_) | Act::Field(_) | Act::Pause(_) => {}
        }
        self.current = act.is_awaited().then_some((act, now));
    }

    /// Words that have been stored, or bytes in an EEPROM.
    fn stored(&self) -> usize {
        self.watch.words + self.plant.eeprom_written()
    }

    /// The settings that were listed in this case.
    fn settings_listed(&self) -> Vec<String> {
        let lines = self.lines[self.marks.lines..].iter();
        lines
            .filter(|line| line.starts_with('$'))
            .cloned()
            .collect()
    }

    /// Switches the supply off and on, with nothing left in RAM.
    fn power_up(&mut self, power_up: PowerUp, session: &mut Session<Machine>, host: &mut dyn Host) {
        let memory = self.bench.board.memory(self.bench.axes);
        if let Some(from) = self.counted_from.take() {
            self.counted = self.stored() - from;
        }
        if self.now.0 > STOP_INTERVAL_NS {
            let ram = bootloader::RAM_START..bootloader::RAM_START + memory.ram_bytes;
            for address in ram.step_by(4) {
                self.put(host.write(address.into(), Width::W32, NOISE));
            }
        }
        let number = power_up.bootloader.map_or(0, |number| number as u64 + 1);
        self.put(host.write(bootloader::SELECTION.into(), Width::W32, number));
        if let Some((address, word)) = self.damaged.take() {
            self.put(host.program(address, Width::W32, word));
        }
        if power_up.is_damaged {
            self.damage(host);
        }
        if power_up.is_used {
            for sector in memory.journal.into_iter().flatten() {
                let flash = &mut session.board_mut().chip.flash;
                flash.forget(sector.address.into(), sector.bytes.into());
                for offset in (0..JOURNAL_BYTES).step_by(4) {
                    let address = u64::from(sector.address) + offset;
                    let word = if offset < USED_BYTES { NOISE } else { ERASED };
                    self.put(host.program(address, Width::W32, word));
                }
            }
        }
        self.cut_after = usize::MAX;
        self.watch.crystal_mhz = power_up.fitted.crystal_hz as f64 / 1e6;
        self.watch.is_supply_low = false;
        let chip = &mut session.board_mut().chip;
        chip.flash.is_cut = false;
        chip.fit(power_up.fitted);
        self.plant.restart(power_up.has_eeprom, self.now, chip);
        chip.supply(self.now, SUPPLY_MV);
        host.hold(false);
        self.pending.clear();
        self.in_flight.clear();
        sender(session).clear();
        session.reset_by_pin(self.now, 0, host);
        // That one is none of the firmware's.
        self.restart(session);
    }

    /// What cannot be written into memory was not there.
    fn put(&mut self, written: Result<(), emulator::Error>) {
        if let Err(error) = written {
            self.watch
                .fault(format!("the memory takes nothing: {error}"), None);
        }
    }

    /// Changes a letter of the firmware.
    fn damage(&mut self, host: &mut dyn Host) {
        let found = self
            .bench
            .program
            .segments
            .iter()
            .find_map(|(start, bytes)| {
                let mut places = bytes.windows(DAMAGED_TEXT.len());
                Some(start + places.position(|it| it == DAMAGED_TEXT)? as u64)
            });
        let word = found.and_then(|at| {
            let address = at & !3;
            Some((address, host.read(address, Width::W32).ok()?))
        });
        match word {
            Some((address, word)) => {
                // One bit of it.
                self.put(host.program(address, Width::W32, word ^ 0x20));
                self.damaged = Some((address, word));
            }
            None => self
                .watch
                .fault("the firmware has no text to be damaged", None),
        }
    }

    /// Looks whether what is waited for has come.
    fn check(&mut self, session: &mut Session<Machine>, host: &mut dyn Host) {
        let Some((act, since)) = &self.current else {
            return;
        };
        let waited_ms = (self.now.0 - since.0) / MS;
        let is_over = match act {
            Act::Pause(ms) => waited_ms >= *ms,
            Act::State(_) | Act::Field(_) if self.now >= self.poll_at => {
                self.poll_at = VirtualNanos(self.now.0 + POLL_MS * MS);
                sender(session).outgoing.push_back(b'?');
                false
            }
            Act::Hang => {
                let resets = session.resets();
                let is_reset = resets.last().is_some_and(|reset| reset.at > *since);
                if is_reset {
                    host.hold(false);
                }
                is_reset
            }
            Act::Compare | Act::StopCrystal => {
                let is_compared = matches!(act, Act::Compare);
                let probe = self.probe.take_if(|it| it.is_finished());
                let is_over = probe.is_some();
                if let Some(probe) = probe {
                    self.end_probe(probe, is_compared, session);
                }
                is_over
            }
            _ => false,
        };
        if is_over {
            self.current = None;
        }
    }

    fn end_probe(
        &mut self,
        probe: JoinHandle<Result<Vec<u32>>>,
        is_compared: bool,
        session: &mut Session<Machine>,
    ) {
        let words = probe
            .join()
            .unwrap_or_else(|_| Err(anyhow!("it has panicked")));
        match words {
            Ok(words) if is_compared => {
                let machine = session.board_mut();
                for fault in compare::faults(&self.bench, machine, &words) {
                    self.watch.fault(fault, None);
                }
            }
            Ok(_) => {}
            Err(error) => self.watch.fault(format!("the debug port: {error:#}"), None),
        }
    }

    fn marks_now(&self) -> Marks {
        Marks {
            lines: self.lines.len(),
            resets: self.resets,
            steps: self.plant.steps.len(),
            switchings: self.plant.switchings.len(),
            energised: self.plant.energised,
            words: self.watch.words,
            erased: self.watch.erased,
            handed_over: self.handed_over,
            at_ns: self.now.0,
        }
    }

    /// What is waited for does not come: the rest of the case is left out.
    fn give_up(&mut self) {
        let mut is_silent = false;
        if let Some((act, _)) = self.current.take() {
            let last = self.lines.last().map_or("nothing", String::as_str);
            let message = format!("{} does not come; the last line is {last:?}", act.awaited());
            self.watch.fault(message, None);
            is_silent = self.lines.len() == self.marks.lines;
        } else {
            self.watch.fault("the chip is reset again and again", None);
        }
        while !matches!(
            self.script.front(),
            None | Some(Act::Part(_) | Act::Case(..))
        ) {
            self.script.pop_front();
        }
        if is_silent {
            self.silent_cases += 1;
            if self.silent_cases >= MOST_SILENT_CASES {
                self.script.clear();
            }
            // The registers may say why.
            self.script.push_front(Act::Compare);
        }
    }

    /// Keeps what was wrong in a case.
    fn end_case(&mut self) {
        for fault in self.plant.take_faults() {
            self.watch.fault(fault, None);
        }
        for (fault, by) in std::mem::take(&mut self.watch.faults) {
            let part = self.part.map_or("", |it| it.0);
            let case = format!("{part}: {}", self.case);
            let (cases, _) = self.outcome.faults.entry(fault).or_insert((Vec::new(), by));
            cases.push(case);
        }
    }

    fn end_part(&mut self) {
        let Some((name, marks)) = self.part.take() else {
            return;
        };
        let cases = std::mem::take(&mut self.cases);
        let now = self.marks_now();
        let figures = [
            (cases, "cases"),
            (now.lines - marks.lines, "lines received"),
            (now.steps - marks.steps, "steps"),
            (now.words - marks.words, "words stored"),
            (now.erased - marks.erased, "sectors erased"),
            (now.resets - marks.resets, "resets"),
        ];
        let figures = figures.iter().filter(|(count, _)| *count > 0);
        let figures: Vec<_> = figures
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        let seconds = (now.at_ns - marks.at_ns) as f64 / 1e9;
        let figures = figures.join(", ");
        self.outcome.parts.push(format!(
            "{name}: {figures} in {seconds:.1} s of the board's time"
        ));
    }

    /// Cuts the supply once enough words have been stored.
    fn cut_supply_when_due(&mut self, session: &mut Session<Machine>) {
        if self.watch.words >= self.cut_after {
            session.board_mut().chip.flash.is_cut = true;
        }
    }
}

impl Driver<Machine> for Run {
    fn on_settled(
        &mut self,
        session: &mut Session<Machine>,
        host: &mut dyn Host,
        settled: Settled,
    ) {
        if session.resets().len() > self.resets {
            self.restart(session);
        }
        match settled {
            Settled::Access { access, .. } => {
                self.watch
                    .record_access(&access, session, &self.bench.program);
                self.cut_supply_when_due(session);
            }
            Settled::Stop(_) => session.board_mut().chip.correct_ready_flags(),
            Settled::Hit(hit) if hit.kind == HitKind::Instruction => {
                self.arrive(hit.address, session, host);
            }
            _ => {}
        }
        self.plant.follow(&mut session.board_mut().chip);
    }

    fn on_stop(
        &mut self,
        session: &mut Session<Machine>,
        stop: Stop,
        host: &mut dyn Host,
    ) -> Option<VirtualNanos> {
        self.now = stop.at;
        for fault in session.board_mut().chip.otg.take_faults() {
            self.watch.fault(fault, None);
        }
        self.listen(session);
        self.check(session, host);
        let is_late = self
            .current
            .as_ref()
            .is_some_and(|(act, since)| stop.at.0 - since.0 > act.limit_ms() * MS);
        let handed_over = self.handed_over - self.marks.handed_over;
        let restarts = self.resets - self.marks.resets + handed_over;
        if is_late || restarts > MOST_RESETS {
            self.give_up();
        }
        while self.current.is_none() {
            let Some(act) = self.script.pop_front() else {
                self.end_case();
                self.end_part();
                return None;
            };
            self.begin(act, session, host);
        }
        self.stream(session);
        Some(VirtualNanos(stop.at.0 + STOP_INTERVAL_NS))
    }
}
