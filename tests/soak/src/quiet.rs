//! Panics that are caught and told later: not a word of them where they happen.

use std::{
    cell::{Cell, RefCell},
    panic::{self, AssertUnwindSafe},
    sync::Once,
};

thread_local! {
    static IS_QUIET: Cell<bool> = const { Cell::new(false) };
    static LAST: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Does something in this thread. What panics in it and is caught there is not told.
pub(crate) fn quietly<T>(work: impl FnOnce() -> T) -> T {
    static HOOK: Once = Once::new();
    HOOK.call_once(|| {
        let usual = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if IS_QUIET.get() {
                LAST.replace(info.to_string());
            } else {
                usual(info);
            }
        }));
    });
    IS_QUIET.set(true);
    let result = work();
    IS_QUIET.set(false);
    result
}

/// Does something, and returns how it panics, with the place.
pub(crate) fn panic_of(work: impl FnOnce()) -> Option<String> {
    let caught = quietly(|| panic::catch_unwind(AssertUnwindSafe(work)));
    caught.is_err().then(|| LAST.take())
}
