//! Kinds of fault that a firmware may have and keep working.

use schedule::Rule;

use super::site::Site;

/// Where a kind of fault is one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Where {
    /// In whatever a task with a deadline runs.
    Deadline,
    /// In what a task above `prepare` runs.
    Urgent,
    /// In what any task runs, where unsafe code may stand.
    Board,
    /// The same, but for tasks above `prepare`: their own priority holds up as many.
    BoardBelow,
}

/// A kind of fault.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) name: &'static str,
    pub(super) place: Where,
    /// The rule that it breaks wherever it stands; none, if times alone tell.
    pub(super) rule: Option<Rule>,
    /// Code for the beginning of a function; several variants are used in turn.
    codes: &'static [&'static str],
}

impl Fault {
    pub(super) fn code(&self, variant: usize) -> String {
        let code = self.codes[variant % self.codes.len()];
        format!("\n{{ {code} }}\n")
    }

    /// Whether it is a fault there.
    pub(super) fn fits(&self, site: &Site) -> bool {
        let is_board = site.file.starts_with("src/board/");
        match self.place {
            Where::Deadline => site.priority.is_some(),
            Where::Urgent => site.priority.is_some_and(|priority| priority > PREPARE),
            Where::Board => is_board,
            Where::BoardBelow => is_board && site.priority.is_none_or(|it| it <= PREPARE),
        }
    }
}

/// Its priority: that of the most urgent task that may use floating point.
const PREPARE: u8 = 2;

const fn fault(
    name: &'static str,
    place: Where,
    rule: Option<Rule>,
    codes: &'static [&'static str],
) -> Fault {
    Fault {
        name,
        place,
        rule,
        codes,
    }
}

pub(super) const FAULTS: [Fault; 12] = [
    fault(
        "panic",
        Where::Deadline,
        Some(Rule::ReachablePanic),
        &[
            "let table = core::hint::black_box([1_u8; 4]);
              core::hint::black_box(table[core::hint::black_box(3_usize)]);",
            "core::hint::black_box(core::hint::black_box(Some(1_u8)).unwrap());",
        ],
    ),
    fault(
        "loop without a bound",
        Where::Deadline,
        Some(Rule::UnboundedLoop),
        &[
            "static LEFT: core::sync::atomic::AtomicU32 = core::sync::atomic::AtomicU32::new(0);
           let left = core::hint::black_box(&LEFT);
           while left.load(core::sync::atomic::Ordering::Relaxed) != 0 {
               core::hint::black_box(0_u32);
           }",
        ],
    ),
    fault(
        "call of a pointer",
        Where::Deadline,
        Some(Rule::IndirectCall),
        &["fn called() { core::hint::black_box(1_u32); }
           let call: fn() = core::hint::black_box(called);
           call();"],
    ),
    fault(
        "recursion",
        Where::Deadline,
        Some(Rule::Recursion),
        &["#[inline(never)]
           fn again(left: u32) -> u32 {
               if core::hint::black_box(left) == 0 {
                   1
               } else {
                   again(left - 1).wrapping_mul(core::hint::black_box(3))
               }
           }
           core::hint::black_box(again(2));"],
    ),
    fault(
        "long computation",
        Where::Deadline,
        None,
        &["let mut count = 0_u32;
           // wcet-bound: BAUD: it counts up
           while count < 115_200 {
               count += core::hint::black_box(1_u32);
           }"],
    ),
    fault(
        "wait with a stated bound",
        Where::Deadline,
        Some(Rule::Wait),
        &[
            "static READY: core::sync::atomic::AtomicU32 = core::sync::atomic::AtomicU32::new(1);
           let ready = core::hint::black_box(&READY);
           // wcet-bound: axes: it is ready
           while ready.load(core::sync::atomic::Ordering::Relaxed) == 0 {}",
        ],
    ),
    fault(
        "bound too small",
        Where::Deadline,
        Some(Rule::WrongBound),
        &[
            // A name, and a constant end in the middle.
            "let mut count = 0_u32;
           // wcet-bound: axes: there are no more
           while count < 100 {
               count += 1;
               core::hint::black_box(count);
           }",
            "// wcet-bound: 2: there are no more
           for back in 1..=256_u32 {
               core::hint::black_box(back);
           }",
        ],
    ),
    fault(
        "total of two calls",
        Where::Deadline,
        Some(Rule::BelievedBound),
        &["#[inline(never)]
           fn count_down(mut left: u32) {
               // wcet-total: SLOTS: there are no more in a run
               while left != 0 {
                   left = core::hint::black_box(left) / 2;
               }
           }
           count_down(core::hint::black_box(7));
           count_down(core::hint::black_box(9));"],
    ),
    fault(
        "floating point",
        Where::Urgent,
        Some(Rule::FloatingPoint),
        &[
            "core::hint::black_box(core::hint::black_box(1.5_f32) * core::hint::black_box(2.0_f32));",
        ],
    ),
    fault(
        "interrupts off",
        Where::Board,
        None,
        &["cortex_m::interrupt::free(|_| {
               let mut count = 0_u32;
               // wcet-bound: SLOTS: it counts up
               while count < 2_048 {
                   count += core::hint::black_box(1_u32);
               }
           });"],
    ),
    fault(
        "priority raised",
        Where::BoardBelow,
        None,
        &[
            "#[allow(unsafe_code)]
             unsafe { cortex_m::register::basepri::write(core::hint::black_box(0x20_u8)) };
             let mut count = 0_u32;
             // wcet-bound: SLOTS: it counts up
             while count < 2_048 {
                 count += core::hint::black_box(1_u32);
             }
             #[allow(unsafe_code)]
             unsafe { cortex_m::register::basepri::write(0) };",
            "#[allow(unsafe_code)]
             unsafe { cortex_m::register::basepri::write(0xd0) };",
        ],
    ),
    fault(
        "register",
        Where::Board,
        Some(Rule::Register),
        &[
            "#[allow(unsafe_code)]
             unsafe { (0x4002_3c00 as *mut u32).write_volatile(0x60f) };",
            "let clocks = 0x4002_3808 as *mut u32;
             #[allow(unsafe_code)]
             unsafe { clocks.write_volatile(clocks.read_volatile() | 0x1400) };",
            "#[allow(unsafe_code)]
             unsafe { (0x4002_6410 as *mut u32).write_volatile(1) };",
            "#[allow(unsafe_code)]
             unsafe { (0xe000_ef34 as *mut u32).write_volatile(0) };",
            // The vector of USART1, which is that of a task.
            "let vector = core::hint::black_box(37_usize);
             #[allow(unsafe_code)]
             unsafe { (0xe000_e400_usize as *mut u8).add(vector).write_volatile(0) };",
            "#[allow(unsafe_code)]
             unsafe { (0x4247_0128 as *mut u32).write_volatile(1) };",
        ],
    ),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_kinds_break_the_same_rule() {
        let rules: Vec<_> = FAULTS.iter().filter_map(|fault| fault.rule).collect();
        let different: std::collections::BTreeSet<_> = rules.iter().collect();
        assert_eq!(rules.len(), 9);
        assert_eq!(different.len(), rules.len());
    }

    #[test]
    fn each_kind_has_a_name_of_its_own_and_code_that_parses() {
        let mut names: Vec<_> = FAULTS.iter().map(|fault| fault.name).collect();
        names.dedup();
        assert_eq!(names.len(), FAULTS.len());
        for fault in &FAULTS {
            for variant in 0..fault.codes.len() {
                let parsed = syn::parse_str::<syn::Block>(fault.code(variant).trim());
                assert!(parsed.is_ok(), "{}", fault.name);
            }
        }
    }
}
