//! The queues of bytes: `serial_rx` or `interpret` writes, a task that it interrupts reads.

use leadscrew::{
    atomic::end,
    protocol::{ByteReader, Bytes},
};

use super::{expect, needs_fences, shared, task};

/// A reader of a queue for three bytes that a writer interrupts with three more.
fn read_by(reader: fn(&mut ByteReader<'static>, &mut Vec<u8>)) -> usize {
    let (writer, bytes) = Box::leak(Box::new(Bytes::<4>::new())).split();
    let (writer, bytes) = (shared(writer), shared(bytes));
    needs_fences(|| {
        // From the memory of the beginning: the queue is empty.
        let next = shared(1_u8);
        let send = {
            let (writer, next) = (writer.clone(), next.clone());
            move || {
                let byte = *next.borrow();
                // A byte without room comes once more.
                if writer.borrow_mut().enqueue(byte).is_ok() {
                    *next.borrow_mut() += 1;
                }
            }
        };
        send();
        send();
        let bytes = bytes.clone();
        (vec![task(1, 3, send)], move || {
            let mut taken = Vec::new();
            let mut bytes = bytes.borrow_mut();
            reader(&mut bytes, &mut taken);
            end();
            while let Some(byte) = bytes.dequeue() {
                taken.push(byte);
            }
            expect(&taken, &(1..*next.borrow()).collect(), "bytes")
        })
    })
}

#[test]
fn bytes_come_once_and_in_order_one_by_one() {
    let needed = read_by(|bytes, taken| {
        for _ in 0..3 {
            taken.extend(bytes.dequeue());
        }
    });
    assert_eq!(needed, 1);
}

#[test]
fn bytes_come_once_and_in_order_as_lines() {
    let needed = read_by(|bytes, taken| {
        for _ in 0..2 {
            bytes.take_until(|waiting| {
                taken.extend(waiting);
                false
            });
        }
    });
    assert_eq!(needed, 1);
}

#[test]
fn bytes_come_once_and_in_order_as_pieces_to_be_sent() {
    let needed = read_by(|bytes, taken| {
        for _ in 0..2 {
            let [older, newer] = bytes.waiting();
            let piece: Vec<u8> = older.chain(newer).collect();
            bytes.consume(piece.len());
            taken.extend(piece);
        }
    });
    assert_eq!(needed, 1);
}

/// Bytes that `interpret` writes while another task sends them.
#[test]
fn what_is_sent_comes_once_and_in_order() {
    let (writer, reader) = Box::leak(Box::new(Bytes::<4>::new())).split();
    let (writer, reader) = (shared(writer), shared(reader));
    let needed = needs_fences(|| {
        let sent = shared(Vec::new());
        let send = {
            let (reader, sent) = (reader.clone(), sent.clone());
            move || sent.borrow_mut().extend(reader.borrow_mut().dequeue())
        };
        let (writer, reader) = (writer.clone(), reader.clone());
        (vec![task(1, 3, send)], move || {
            let mut written = Vec::new();
            let mut writer = writer.borrow_mut();
            for piece in [&[1, 2][..], &[3], &[4, 5]] {
                if let [byte] = piece {
                    written.extend(writer.enqueue(*byte).map(|_| *byte));
                } else if writer.append(piece) {
                    written.extend(piece);
                }
            }
            end();
            let sent = &mut *sent.borrow_mut();
            while let Some(byte) = reader.borrow_mut().dequeue() {
                sent.push(byte);
            }
            expect(sent, &written, "bytes")
        })
    });
    assert_eq!(needed, 2);
}
