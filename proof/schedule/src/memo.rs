//! Results that are kept, so that each is found once.

use std::{cell::RefCell, collections::HashMap, hash::Hash};

/// Returns what is kept under a key, or finds and keeps it.
pub(crate) fn memoised<K: Eq + Hash, V: Clone>(
    kept: &RefCell<HashMap<K, V>>,
    key: K,
    find: impl FnOnce() -> V,
) -> V {
    if let Some(known) = kept.borrow().get(&key) {
        return known.clone();
    }
    let found = find();
    kept.borrow_mut().insert(key, found.clone());
    found
}
