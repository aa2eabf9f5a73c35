//! The interface to QEMU: TCG plugins, version 1 (QEMU 4.2 and later).
//!
//! `-plugin libcost.so,elf=PROGRAM,out=REPORT.json` records the profile; what else there is to observe
//! is said by further arguments, see [`observer`](crate::observer). QEMU calls in from its one
//! processor thread, and once more when it exits; the report is written then, so it must be left to
//! exit by itself.
#![expect(unsafe_code, reason = "QEMU is written in C")]

use std::{
    ffi::{CStr, c_char, c_int, c_uint, c_void},
    fs,
    path::PathBuf,
    ptr, slice,
    sync::{Mutex, MutexGuard, PoisonError},
};

use crate::observer::{self, Observer};

/// A translated block of instructions.
#[repr(C)]
struct Block {
    _private: [u8; 0],
}

/// One instruction of a block.
#[repr(C)]
struct Insn {
    _private: [u8; 0],
}

/// The callback does not look at processor registers.
const NO_REGISTERS: c_int = 0;
/// Reads and writes.
const READ_WRITE: c_int = 3;

type OnTranslate = extern "C" fn(u64, *mut Block);
type OnExecute = extern "C" fn(c_uint, *mut c_void);
type OnAccess = extern "C" fn(c_uint, u32, u64, *mut c_void);
type OnExit = extern "C" fn(u64, *mut c_void);

// As declared in QEMU's include/qemu/qemu-plugin.h.
unsafe extern "C" {
    fn qemu_plugin_register_vcpu_tb_trans_cb(id: u64, callback: OnTranslate);
    fn qemu_plugin_register_atexit_cb(id: u64, callback: OnExit, data: *mut c_void);
    fn qemu_plugin_tb_n_insns(block: *const Block) -> usize;
    fn qemu_plugin_tb_get_insn(block: *const Block, index: usize) -> *mut Insn;
    fn qemu_plugin_insn_vaddr(insn: *const Insn) -> u64;
    fn qemu_plugin_insn_data(insn: *const Insn) -> *const c_void;
    fn qemu_plugin_insn_size(insn: *const Insn) -> usize;
    fn qemu_plugin_register_vcpu_insn_exec_cb(
        insn: *mut Insn,
        callback: OnExecute,
        flags: c_int,
        data: *mut c_void,
    );
    fn qemu_plugin_register_vcpu_mem_cb(
        insn: *mut Insn,
        callback: OnAccess,
        flags: c_int,
        direction: c_int,
        data: *mut c_void,
    );
    fn qemu_plugin_mem_is_store(info: u32) -> bool;
}

/// The version of the interface, by which QEMU knows a plugin.
// SAFETY: the name is reserved for this by QEMU; no other plugin is linked in here.
#[unsafe(no_mangle)]
pub(crate) static qemu_plugin_version: c_int = 1;

/// Who observes, and where the report goes.
struct Session {
    observer: Box<dyn Observer>,
    out: PathBuf,
}

static SESSION: Mutex<Option<Session>> = Mutex::new(None);

/// A callback that panicked has ended QEMU already: nobody sees a poisoned lock.
fn session() -> MutexGuard<'static, Option<Session>> {
    SESSION.lock().unwrap_or_else(PoisonError::into_inner)
}

extern "C" fn translate(_: u64, block: *mut Block) {
    // SAFETY: QEMU passes a block that lives during this call.
    let count = unsafe { qemu_plugin_tb_n_insns(block) };
    for index in 0..count {
        // SAFETY: the index is below the number of instructions.
        let insn = unsafe { qemu_plugin_tb_get_insn(block, index) };
        // SAFETY: the instruction belongs to the block.
        let address = unsafe { qemu_plugin_insn_vaddr(insn) } as u32;
        // SAFETY: as above.
        let (data, size) = unsafe { (qemu_plugin_insn_data(insn), qemu_plugin_insn_size(insn)) };
        // SAFETY: QEMU keeps the `size` bytes at `data` until this callback returns.
        let bytes = unsafe { slice::from_raw_parts(data.cast::<u8>(), size) };
        let half = |at| {
            let bytes = bytes.get(at..at + 2)?;
            Some(u16::from_le_bytes([bytes[0], bytes[1]]))
        };
        let code = [half(0).unwrap_or(0), half(2).unwrap_or(0)];
        let Some(number) = session()
            .as_mut()
            .map(|session| session.observer.site(address, code))
        else {
            return;
        };
        // SAFETY: the callbacks live as long as the process; their data is a number, no address.
        unsafe {
            qemu_plugin_register_vcpu_insn_exec_cb(
                insn,
                execute,
                NO_REGISTERS,
                ptr::without_provenance_mut(number),
            );
            qemu_plugin_register_vcpu_mem_cb(
                insn,
                access,
                NO_REGISTERS,
                READ_WRITE,
                ptr::without_provenance_mut(number),
            );
        }
    }
}

extern "C" fn execute(_: c_uint, number: *mut c_void) {
    if let Some(session) = session().as_mut() {
        session.observer.execute(number.addr());
    }
}

extern "C" fn access(_: c_uint, info: u32, address: u64, number: *mut c_void) {
    // SAFETY: the function only looks at the bits of its argument.
    let store = unsafe { qemu_plugin_mem_is_store(info) };
    if let Some(session) = session().as_mut() {
        session.observer.touch(number.addr(), address as u32, store);
    }
}

extern "C" fn exit(_: u64, _: *mut c_void) {
    let Some(mut session) = session().take() else {
        return;
    };
    let written = session
        .observer
        .finish()
        .and_then(|text| fs::write(&session.out, text).map_err(|error| error.to_string()));
    if let Err(error) = written {
        eprintln!("cost: cannot write {}: {error}", session.out.display());
    }
}

/// Prepares what `arguments` ask for.
fn open(arguments: &[String]) -> Result<Session, String> {
    let observer = observer::asked_for(arguments)?;
    let out = observer::value(arguments, "out")?.into();
    Ok(Session { observer, out })
}

/// Called by QEMU when it loads the plugin; not 0 makes it stop.
///
/// # Safety
///
/// `arguments` must point to `count` zero-terminated strings.
// SAFETY: the name is reserved for this by QEMU; no other plugin is linked in here.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn qemu_plugin_install(
    id: u64,
    _info: *const c_void,
    count: c_int,
    arguments: *const *const c_char,
) -> c_int {
    let arguments: Vec<String> = (0..usize::try_from(count).unwrap_or(0))
        .map(|index| {
            // SAFETY: the caller promises `count` strings.
            let text = unsafe { CStr::from_ptr(*arguments.add(index)) };
            text.to_string_lossy().into_owned()
        })
        .collect();
    match open(&arguments) {
        Ok(opened) => *session() = Some(opened),
        Err(error) => {
            eprintln!("cost: {error}");
            return 1;
        }
    }
    // SAFETY: `id` is the one QEMU gave; the callbacks live as long as the process.
    unsafe {
        qemu_plugin_register_vcpu_tb_trans_cb(id, translate);
        qemu_plugin_register_atexit_cb(id, exit, ptr::null_mut());
    }
    0
}
