//! Requests in real time: made by the receiver and the buttons, taken by tasks of lower priority.

use leadscrew::{
    atomic::{Fences, barrier, end, explore},
    machine::{Contact, Inputs, Watch},
    model::{Awaited, Levels, Release, Requests},
    protocol::{ByteReader, ByteWriter, Bytes, DamagedByte, realtime},
    stepper::{EventRing, StepEvent},
};

use super::{MOST, Shared, expect, is_right, needs_fences, shared, task};

fn leaked<T>(value: T) -> &'static mut T {
    Box::leak(Box::new(value))
}

/// The requests, and the receiver that makes them.
#[derive(Clone)]
struct Receiver {
    requests: &'static Requests,
    writer: Shared<ByteWriter<'static>>,
    reader: Shared<ByteReader<'static>>,
}

impl Receiver {
    fn new() -> Self {
        let (writer, reader) = leaked(Bytes::<16>::new()).split();
        Self {
            requests: leaked(Requests::new()),
            writer: shared(writer),
            reader: shared(reader),
        }
    }

    /// Receives a byte, or a damaged one, behind so many bytes.
    fn receive(&self, byte: Result<u8, DamagedByte>, before: usize) -> Release {
        realtime::receive(byte, before, self.requests, &mut self.writer.borrow_mut())
    }
}

/// Feed holds and cycle starts from the receiver, and so many feed holds from a button, while `prepare` takes them.
fn requests_of(bytes: &'static [u8], presses: u32) -> usize {
    let receiver = Receiver::new();
    let requests = receiver.requests;
    needs_fences(|| {
        // The requests that have been made and not taken since: feed hold, cycle start.
        let open = shared([false; 2]);
        let receive = {
            let (open, receiver) = (open.clone(), receiver.clone());
            let waiting = shared(bytes.iter());
            move || {
                if let Some(byte) = waiting.borrow_mut().next() {
                    open.borrow_mut()[usize::from(*byte == b'~')] = true;
                    receiver.receive(Ok(*byte), 0);
                }
            }
        };
        let press = {
            let open = open.clone();
            move || {
                open.borrow_mut()[0] = true;
                requests.press(Levels::HOLD);
            }
        };
        let tasks = vec![
            task(4, bytes.len() as u32, receive),
            task(3, presses, press),
        ];
        (tasks, move || {
            // As `prepare` does: the number first, and once more while it is another one.
            let handle = || {
                let handled = requests.count();
                if requests.take_hold() {
                    open.borrow_mut()[0] = false;
                }
                if requests.take_start() {
                    open.borrow_mut()[1] = false;
                }
                handled
            };
            let handled = handle();
            end();
            if handled != requests.count() {
                handle();
            }
            expect(&*open.borrow(), &[false; 2], "requests that nobody takes")
        })
    })
}

#[test]
fn no_request_is_lost() {
    assert_eq!(requests_of(b"!!", 0), 2);
    assert_eq!(requests_of(b"!~", 1), 2);
    assert_eq!(requests_of(b"~", 2), 2);
}

/// A request that `interpret` makes while `prepare` interrupts it.
#[test]
fn no_request_of_interpret_is_lost() {
    let requests: &Requests = leaked(Requests::new());
    let needed = needs_fences(|| {
        let handled = shared((requests.count(), false));
        let handle = {
            let handled = handled.clone();
            move || {
                let count = requests.count();
                let handled = &mut *handled.borrow_mut();
                if count != handled.0 {
                    *handled = (count, handled.1 | requests.take_hold());
                }
            }
        };
        let last = handle.clone();
        (vec![task(2, 2, handle)], move || {
            requests.accept_from_interpret(b'!', 0);
            // It releases `prepare`.
            barrier();
            end();
            last();
            expect(&handled.borrow().1, &true, "the request has been taken")
        })
    });
    assert_eq!(needed, 1);
}

/// Overrides that wait, and overrides that interrupt `prepare`, which takes them twice.
fn overrides(waiting: u8, interrupting: u8) {
    let receiver = Receiver::new();
    let requests = receiver.requests;
    let begin = || {
        let next = shared(0x90_u8);
        let send = {
            let (receiver, next) = (receiver.clone(), next.clone());
            move || {
                let byte = *next.borrow();
                *next.borrow_mut() += 1;
                receiver.receive(Ok(byte), 0);
            }
        };
        (0..waiting).for_each(|_| send());
        (vec![task(4, interrupting.into(), send)], move || {
            let mut taken: Vec<u8> = Vec::new();
            taken.extend(requests.take_overrides().into_iter().flatten());
            end();
            taken.extend(requests.take_overrides().into_iter().flatten());
            // Of more than there is room for, the oldest are dropped.
            let all = 0x90..*next.borrow();
            let dropped = all.len() - taken.len();
            let least = all.len().saturating_sub(leadscrew::model::OVERRIDES);
            expect(&taken, &all.skip(dropped).collect(), "overrides")?;
            expect(
                &(dropped <= least),
                &true,
                "no more dropped than have no room",
            )
        })
    };
    is_right(begin);
    // With more, the executions without fences are too many.
    if waiting == 2 {
        assert_eq!(needs_fences(begin), 1);
    }
}

#[test]
fn overrides_come_once_and_in_order_and_the_oldest_are_dropped() {
    overrides(2, 3);
    overrides(14, 4);
}

#[test]
fn a_second_writer_of_overrides_would_lose_one() {
    let receiver = Receiver::new();
    let requests = receiver.requests;
    let found = explore(&Fences::All, MOST, || {
        let (receiver, sent) = (receiver.clone(), shared(0));
        let is_sent = sent.clone();
        let send = move || {
            *is_sent.borrow_mut() += 1;
            receiver.receive(Ok(0x91), 0);
        };
        (vec![task(4, 1, send)], move || {
            requests.accept_from_interpret(0x92, 0);
            end();
            let taken = requests.take_overrides().map_or(0, Iterator::count);
            expect(&taken, &(1 + *sent.borrow()), "overrides")
        })
    });
    assert!(found.wrong.is_some(), "{found:?}");
}

#[test]
fn a_line_that_has_lost_bytes_is_refused() {
    let receiver = Receiver::new();
    let requests = receiver.requests;
    let needed = needs_fences(|| {
        // Whether bytes are lost before the one of number 12, which comes before the first line is over, and of 25.
        let lost = shared([false; 2]);
        let is_first_over = shared(false);
        let lose = {
            let (lost, is_over, receiver) = (lost.clone(), is_first_over.clone(), receiver.clone());
            move || {
                let is_late = lost.borrow()[0] || *is_over.borrow();
                lost.borrow_mut()[usize::from(is_late)] = true;
                receiver.receive(Err(DamagedByte), if is_late { 25 } else { 12 });
            }
        };
        let reader = receiver.reader.clone();
        (vec![task(4, 2, lose)], move || {
            let _ = requests.take_losses_before(10);
            // The bytes of the next line are read.
            *is_first_over.borrow_mut() = true;
            reader.borrow_mut().take_until(|_| false);
            if lost.borrow()[0] {
                expect(
                    &requests.take_losses_before(20),
                    &true,
                    "the line with byte 12",
                )?;
            }
            end();
            if lost.borrow()[1] {
                expect(
                    &requests.take_losses_before(30),
                    &true,
                    "the line with byte 25",
                )?;
            }
            expect(&requests.take_losses_before(40), &false, "a line behind")
        })
    });
    assert_eq!(needed, 1);
}

#[test]
fn a_line_that_comes_while_interpret_goes_to_sleep_wakes_it() {
    let receiver = Receiver::new();
    let requests = receiver.requests;
    let needed = needs_fences(|| {
        let is_awake = shared(false);
        requests.wake_on(Awaited::ENTRIES);
        let receive = {
            let (receiver, is_awake) = (receiver.clone(), is_awake.clone());
            move || {
                let before = receiver.writer.borrow().enqueued();
                let release = receiver.receive(Ok(b'\n'), before);
                *is_awake.borrow_mut() |= release == Release::Interpret;
            }
        };
        let reader = receiver.reader.clone();
        (vec![task(4, 2, receive)], move || {
            requests.wake_on(Awaited::ALL);
            *is_awake.borrow_mut() = false;
            while reader.borrow().may_have_line() {
                reader.borrow_mut().take_until(|waiting| {
                    waiting.for_each(drop);
                    false
                });
            }
            requests.wake_on(Awaited::LINE);
            end();
            let has_line = reader.borrow().may_have_line();
            expect(
                &(has_line && !*is_awake.borrow()),
                &false,
                "a line waits, and nobody is woken",
            )
        })
    });
    assert_eq!(needed, 1);
}

#[test]
fn the_position_of_a_contact_is_that_of_its_edge() {
    let inputs: &Inputs = leaked(Inputs::new());
    let (mut events, mut steps) = leaked(EventRing::new()).split();
    for _ in 0..8 {
        events.push(StepEvent::new(1000, 1, 0));
    }
    let _ = events.set_up();
    let event_tap = events.tap();
    // An old contact, at number 2.
    let _ = (steps.advance(), steps.advance());
    inputs.arm_probe(Contact::Made);
    Watch::new(Levels::NONE, inputs).latch(Levels::PROBE, inputs, event_tap);
    let steps = shared(steps);
    let needed = needs_fences(|| {
        let output = shared(2_u32);
        let edge = shared(None);
        let step = {
            let (steps, output) = (steps.clone(), output.clone());
            move || {
                let _ = steps.borrow_mut().advance();
                *output.borrow_mut() += 1;
            }
        };
        let touch = {
            let (output, edge) = (output.clone(), edge.clone());
            let watch = shared(Watch::new(Levels::NONE, inputs));
            move || {
                let first = *output.borrow();
                if watch.borrow_mut().latch(Levels::PROBE, inputs, event_tap) {
                    *edge.borrow_mut() = Some(first..=*output.borrow());
                }
            }
        };
        (vec![task(5, 2, step), task(3, 1, touch)], move || {
            inputs.disarm_probe();
            inputs.arm_probe(Contact::Made);
            let latch = inputs.probe_latch();
            end();
            let latches = latch.into_iter().chain(inputs.probe_latch());
            let edge = edge.borrow();
            let is_edge = |number| edge.as_ref().is_some_and(|edge| edge.contains(&number));
            expect(
                &latches.into_iter().all(is_edge),
                &true,
                "the number of the edge",
            )
        })
    });
    assert_eq!(needed, 1);
}
