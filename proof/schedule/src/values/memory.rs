//! Loads and stores: what is known of memory.

use super::{
    Base, Origins, Value,
    state::{State, Surroundings},
};
use crate::{Operation, Region};

impl State {
    pub(super) fn load(
        &mut self,
        around: Surroundings<'_>,
        at: u32,
        from: Value,
        operation: Operation,
    ) {
        let Operation::Load {
            writes,
            bytes,
            writeback,
            ..
        } = operation
        else {
            return;
        };
        if bytes != 4 {
            self.write_back(writeback);
            self.write_all(at, writes);
            return;
        }
        let places = (0..).step_by(4).map(|distance| from.add(distance));
        let loaded: Vec<_> = targets(operation)
            .zip(places)
            .map(|(to, place)| (to, self.loaded(around, place), place))
            .collect();
        let regions: Vec<Region> = loaded
            .iter()
            .map(|&(_, _, place)| self.pointed_to(around, place))
            .collect();
        self.write_back(writeback);
        for ((to, value, place), region) in loaded.into_iter().zip(regions) {
            match (value, place.argument_offset()) {
                (Some(value), _) => self.set(to, value),
                (None, Some((register, distance))) => {
                    self.write_as(Base::LoadedFrom(register, distance), to, region);
                }
                (None, None) => self.write(at, to, region),
            }
        }
    }

    /// The abstract value of a loaded word, when known.
    fn loaded(&self, around: Surroundings<'_>, from: Value) -> Option<Value> {
        if from.origins().contains(Origins::FRAME) {
            // Any pointer that was kept there.
            let kept = Value::of(Region::Unknown, Origins::ALL);
            let slot = from.in_frame().and_then(|slot| self.slots.get(slot));
            return Some(slot.unwrap_or(kept));
        }
        let address = from.constant()?;
        if Region::of(address) == Region::Flash {
            return around.image.word(address).map(Value::Constant);
        }
        None
    }

    /// The memory that the word at an address points into.
    fn pointed_to(&self, around: Surroundings<'_>, from: Value) -> Region {
        let known = match (from.constant(), from.argument_offset(), around.callees) {
            (Some(address), _, Some(callees)) => callees.statics.get(&address).copied(),
            (None, Some(place), _) => self.given.get(place),
            _ => None,
        };
        known.unwrap_or(Region::Unknown)
    }

    /// Forgets what a store to the address `to` may overwrite.
    pub(super) fn store(&mut self, around: Surroundings<'_>, to: Value, length: i32) {
        if to.constant().is_some() {
            return;
        }
        if let Some(slot) = to.in_frame() {
            self.forget_slots(slot, slot + length);
            return;
        }
        if let Some((register, offset)) = to.argument_offset() {
            self.forget_given(register, offset, offset + length);
            return;
        }
        if matches!(to.region(), Region::Sram | Region::Ccm | Region::Unknown) {
            self.forget_pointees(around, to, &[(i32::MIN, i32::MAX)]);
            self.weaken(around);
        }
    }

    /// Forgets the words of the frame from `start` to before `end`.
    fn forget_slots(&mut self, start: i32, end: i32) {
        self.slots
            .retain(|slot, value| (slot + 4 <= start || slot >= end).then_some(value));
    }

    /// Forgets words at offsets from an argument.
    fn forget_given(&mut self, register: u8, start: i32, end: i32) {
        self.given.retain(|(other, offset), region| {
            let is_kept = other != register || offset.saturating_add(4) <= start || offset >= end;
            is_kept.then_some(region)
        });
    }

    /// Forgets the words that are written through a pointer.
    pub(super) fn forget_pointees(
        &mut self,
        around: Surroundings<'_>,
        pointer: Value,
        spans: &[(i32, i32)],
    ) {
        for &(start, end) in spans {
            if let Some(base) = pointer.in_frame() {
                self.forget_slots(base.saturating_add(start), base.saturating_add(end));
            } else if let Some((register, base)) = pointer.argument_offset() {
                let (start, end) = (base.saturating_add(start), base.saturating_add(end));
                self.forget_given(register, start, end);
            } else {
                let origins = pointer.origins();
                if origins.contains(Origins::FRAME) {
                    let lowest = around.lowest_pointer;
                    self.slots
                        .retain(|slot, value| (slot < lowest).then_some(value));
                }
                self.given.retain(|(register, _), region| {
                    (!origins.contains(Origins::argument(register))).then_some(region)
                });
            }
        }
    }

    /// After stores through pointers from memory: words of the frame that pointers reach keep the
    /// kind of memory that they point into, and no more.
    pub(super) fn weaken(&mut self, around: Surroundings<'_>) {
        self.slots.retain(|slot, value| {
            if slot < around.lowest_pointer {
                return Some(value);
            }
            let (region, origins) = (value.region(), value.origins());
            let is_known = region != Region::Unknown || origins != Origins::NONE;
            is_known.then_some(Value::of(region, origins))
        });
    }

    /// The words that a store puts at constant addresses.
    pub(crate) fn stored(&self, store: Operation) -> Vec<(u32, Value)> {
        let stored = store.stored();
        let address = stored.and_then(|it| Some((self.address(it.0).constant()?, it.1)));
        let Some((start, length)) = address else {
            return Vec::new();
        };
        let first = start & !3;
        let words = (first..start + length.cast_unsigned()).step_by(4);
        let known = sources(store).map(|source| self.get(source).abroad());
        let all = known.chain(std::iter::repeat(Value::UNKNOWN));
        words.zip(all).collect()
    }

    /// Remembers the words that a store puts into the frame.
    pub(super) fn keep(&mut self, to: Value, store: Operation) {
        if let Some(slot) = to.in_frame() {
            for (slot, source) in (slot..).step_by(4).zip(sources(store)) {
                self.slots.insert(slot, self.get(source));
            }
        }
    }
}

/// The registers whose words a store puts into memory, in their order there.
pub(crate) fn sources(store: Operation) -> impl Iterator<Item = u8> {
    let (words, first, all) = match store {
        Operation::Store {
            words,
            source,
            reads,
            bytes: 4,
            ..
        } => (words, source, reads),
        _ => (0, None, 0),
    };
    in_order(words, first, all)
}

/// The registers that a load writes, in the order of their words in memory.
pub(crate) fn targets(load: Operation) -> impl Iterator<Item = u8> {
    let (words, first, all) = match load {
        Operation::Load {
            words,
            first,
            writes,
            ..
        } => (words, first, writes),
        _ => (0, None, 0),
    };
    in_order(words, first, all)
}

/// Two registers are loaded and stored in any order, more in that of their numbers.
fn in_order(words: u8, first: Option<u8>, all: u16) -> impl Iterator<Item = u8> {
    let registers = (0..16_u8).filter(move |register| all >> register & 1 == 1);
    let others = registers.filter(move |&register| Some(register) != first);
    let repeated = first.filter(|_| words == 2 && all.is_power_of_two());
    first.into_iter().chain(others).chain(repeated)
}
