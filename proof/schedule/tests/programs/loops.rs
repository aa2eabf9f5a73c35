//! Loops, and what must not be reached.

use schedule::{Bound, Count, Program, Rule};

use super::{assert_flaw, bounds, flaws, reached, read};

/// Tests that a program has a flaw, reported with one of its lines: name, rule, program.
macro_rules! flawed {
    ($($name:ident: $rule:ident, $body:literal;)*) => {$(
        #[test]
        fn $name() {
            assert_flaw($body, Rule::$rule);
        }
    )*};
}

flawed! {
    a_loop_without_a_bound_is_named: UnboundedLoop,
    "fn task() {
        let mut left = input();
        while left != 0 { left = black_box(left - 1); }
    }";
    a_comment_that_is_too_small_is_wrong: WrongBound,
    "fn task() {
        // wcet-bound: 3
        for step in 0..1000 { output(black_box(step)); }
    }";
    a_comment_that_is_too_small_for_a_loop_with_two_constant_ends_is_wrong: WrongBound,
    "fn task() {
        // wcet-bound: 2: it is not
        for back in 1..=256 { output(black_box(back)); }
    }";
    a_comment_that_is_too_small_for_runs_that_come_first_is_wrong: WrongBound,
    "fn task() {
        // wcet-bound: 2: it is not
        for step in 0..1000 {
            if step > 500 && input() == 7 { break; }
            output(black_box(step));
        }
    }";
    an_index_that_is_not_checked_is_a_panic: ReachablePanic,
    "fn task() {
        output(WORDS[input() as usize].load(Relaxed));
    }
    static WORDS: [AtomicU32; 8] = [const { AtomicU32::new(0) }; 8];";
    a_function_that_calls_itself_is_recursion: Recursion,
    "#[inline(never)]
    fn deeper(depth: u32) -> u32 {
        if depth == 0 { 0 } else { black_box(deeper(black_box(depth - 1))) + 1 }
    }
    fn task() { output(deeper(input())); }";
    a_call_through_a_trait_object_is_indirect: IndirectCall,
    "trait Act { fn act(&self); }
    struct One; struct Two;
    impl Act for One { fn act(&self) { output(1); } }
    impl Act for Two { fn act(&self) { output(2); } }
    fn task() {
        let acts: [&dyn Act; 2] = [&One, &Two];
        black_box(&acts)[input() as usize & 1].act();
    }";
    waiting_for_an_interrupt_is_forbidden: ForbiddenInstruction,
    "fn task() {
        unsafe { core::arch::asm!(\"wfi\") };
    }";
    a_trap_is_found: ReachableTrap,
    "fn task() {
        if input() == 3 { unsafe { core::arch::asm!(\"udf #1\") }; }
    }";
    an_instruction_of_another_processor_is_unknown: UnknownInstruction,
    "fn task() {
        unsafe { core::arch::asm!(\".inst.w 0xfe000a00\") };
    }";
}

#[test]
fn a_loop_over_constants_needs_no_comment() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            let mut sum = 0;
            for _ in 0..100 { sum += black_box(1); }
            for word in &WORDS { output(word.load(Relaxed) + sum); }
        }
        static WORDS: [AtomicU32; 40] = [const { AtomicU32::new(0) }; 40];",
    ));
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let bounds = bounds(&program);
    assert!(!bounds.is_empty());
    for (count, origin) in bounds {
        let Some(Count::Number(count)) = count else {
            panic!("{count:?}");
        };
        assert!((1..=100).contains(&count), "{count}");
        assert_eq!(origin, "constants");
    }
}

#[test]
fn a_comment_bounds_the_loop_beneath_it_and_no_other() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            // wcet-bound: 5
            for _ in 0..input() {
                output(black_box(1));
                let mut left = input();
                while left != 0 { left = black_box(left - 1); }
            }
        }",
    ));
    let program = Program::new(&image, &annotations);
    let found = bounds(&program);
    assert_eq!(found.len(), 2, "{found:?}");
    assert_eq!(found[0].0, Some(Count::Number(5)), "{found:?}");
    assert_eq!(found[1].0, None, "{found:?}");
}

#[test]
fn a_loop_of_a_library_needs_a_comment_of_its_own() {
    const FIND: &str = "let words: &[u32] = unsafe { core::slice::from_raw_parts(
            input() as *const u32, input() as usize) };";
    let (image, annotations) = or_skip!(read(&format!(
        "fn task() {{
            {FIND}
            // wcet-bound: 5
            for _ in 0..input() {{
                output(words.iter().filter(|&&word| black_box(word) == 9).count() as u32);
            }}
        }}"
    )));
    let program = Program::new(&image, &annotations);
    let found = bounds(&program);
    // The compiler may make two of the outer loop.
    let (known, unknown): (Vec<_>, Vec<_>) = found.iter().partition(|(count, _)| count.is_some());
    let is_five = |(count, _): &&(Option<Count>, String)| *count == Some(Count::Number(5));
    assert!(known.iter().all(is_five), "{known:?}");
    assert_eq!(unknown.len(), 1, "{found:?}");
    let rules: Vec<Rule> = flaws(&program).into_iter().map(|(rule, _)| rule).collect();
    assert!(rules.contains(&Rule::UnboundedLoop), "{rules:?}");
}

#[test]
fn a_comment_above_a_statement_bounds_the_loops_of_libraries_in_it() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            let words: &[u32] = unsafe {
                core::slice::from_raw_parts(input() as *const u32, input() as usize & 63)
            };
            // wcet-bound: 64
            let found = words.iter().filter(|&&word| black_box(word) == 9).count();
            output(found as u32);
        }",
    ));
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let found = bounds(&program);
    assert!(!found.is_empty());
    let origins = found.iter().map(|(_, origin)| origin.as_str());
    assert!(
        origins
            .into_iter()
            .all(|origin| origin.starts_with("src/main.rs:"))
    );
}

#[test]
fn names_and_totals_are_kept() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            // wcet-bound: axes, wcet-total: segment_steps
            for _ in 0..input() { output(black_box(1)); }
        }",
    ));
    let names: Vec<(&str, String)> = annotations.names().collect();
    assert_eq!(names.len(), 2);
    let program = Program::new(&image, &annotations);
    let functions = reached(&program);
    let one = functions.iter().find_map(|function| function.loops.first());
    let one = one.expect("there is a loop");
    let bound = one.bound.as_ref().map(|bound| &bound.count);
    let total = one.total.as_ref().map(|total| &total.bound.count);
    assert_eq!(bound, Some(&Count::Named("axes".to_owned())));
    assert_eq!(total, Some(&Count::Named("segment_steps".to_owned())));
    assert!(
        names
            .iter()
            .all(|(_, place)| place.starts_with("src/main.rs:"))
    );
}

#[test]
fn a_loop_that_is_counted_exactly_needs_no_name() {
    let (image, annotations) = or_skip!(read(
        "fn task() {
            // wcet-bound: axes
            for step in 0..100 { output(black_box(step)); }
        }",
    ));
    let program = Program::new(&image, &annotations);
    let functions = reached(&program);
    let one = functions.iter().find_map(|function| function.loops.first());
    let one = one.expect("there is a loop");
    let is_named = |bound: &Option<Bound>| {
        let bound = bound.as_ref().expect("it has a bound");
        matches!(bound.count, Count::Named(_))
    };
    assert!(!is_named(&one.bound) && is_named(&one.stated), "{one:?}");
    let runs = one.counted.expect("it is counted");
    assert_eq!((runs.least, runs.is_open), (runs.returns, false));
}

#[test]
fn an_exclusive_store_is_tried_again_once() {
    let (image, annotations) = or_skip!(read("fn task() { COUNT.fetch_add(1, Relaxed); }"));
    let program = Program::new(&image, &annotations);
    assert_eq!(flaws(&program), []);
    let counts: Vec<Option<Count>> = bounds(&program)
        .into_iter()
        .map(|(count, _)| count)
        .collect();
    assert_eq!(counts, [Some(Count::Number(1))]);
}
