//! The interface to QEMU: TCG plugins, versions 1 (up to QEMU 8), 2 (9.0) and 3 (from 9.1 on; later versions add to it).
//!
//! QEMU reads the version of a plugin after loading it, and refuses a version outside of its own
//! range: no number suits all. So a constructor, which runs while the plugin is loaded, sets the
//! number, by what the QEMU around it exports.
//!
//! `-plugin libcost.so,elf=PROGRAM,out=REPORT.json` records the profile; what else there is to
//! observe is said by further arguments, see [`observer`](crate::observer). QEMU calls in from its
//! one processor thread, and once more at its exit, when the report is written: so QEMU must be
//! left to exit by itself.
#![expect(unsafe_code, reason = "QEMU is written in C")]

use std::{
    ffi::{CStr, c_char, c_int, c_uint, c_void},
    fs, mem,
    path::PathBuf,
    ptr, slice,
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicI32, Ordering::Relaxed},
    },
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
    fn qemu_plugin_insn_data(insn: *const Insn, to: *mut c_void, size: usize) -> usize;
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

unsafe extern "C" {
    /// POSIX: the address of a symbol, null if nothing that is loaded exports it.
    fn dlsym(handle: *mut c_void, name: *const c_char) -> *mut c_void;
}

/// Everything that is loaded.
const RTLD_DEFAULT: *mut c_void = if cfg!(target_os = "macos") {
    ptr::without_provenance_mut(-2_isize as usize)
} else {
    ptr::null_mut()
};

/// The first version in which the bytes of an instruction are copied.
const COPIES: c_int = 3;
/// Functions that came with a version of the interface, the newest first.
const NEW_IN: [(c_int, &CStr); 2] = [
    (COPIES, c"qemu_plugin_register_vcpu_insn_exec_cond_cb"),
    (2, c"qemu_plugin_scoreboard_new"),
];

/// The version of the interface, by which QEMU knows a plugin; from [`choose_version`] on that of this QEMU.
// SAFETY: the name is reserved for this by QEMU; no other plugin is linked in here.
#[unsafe(no_mangle)]
pub(crate) static qemu_plugin_version: AtomicI32 = AtomicI32::new(1);

/// Has the loader call [`choose_version`].
#[used]
#[cfg_attr(target_os = "macos", unsafe(link_section = "__DATA,__mod_init_func"))]
#[cfg_attr(not(target_os = "macos"), unsafe(link_section = ".init_array"))]
static CONSTRUCTOR: extern "C" fn() = choose_version;

extern "C" fn choose_version() {
    let is_there = |name: &CStr| {
        // SAFETY: the name ends with a zero.
        !unsafe { dlsym(RTLD_DEFAULT, name.as_ptr()) }.is_null()
    };
    qemu_plugin_version.store(version(is_there), Relaxed);
}

/// Returns the version of a QEMU that exports these functions.
fn version(is_there: impl Fn(&CStr) -> bool) -> c_int {
    let mut new = NEW_IN.into_iter();
    new.find(|(_, name)| is_there(name))
        .map_or(1, |(version, _)| version)
}

/// The observer, and the path of the report.
struct Session {
    observer: Box<dyn Observer>,
    out: PathBuf,
}

static SESSION: Mutex<Option<Session>> = Mutex::new(None);

/// A callback that panicked has ended QEMU already: nobody sees a poisoned lock.
fn session() -> MutexGuard<'static, Option<Session>> {
    SESSION.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the halves of an instruction; the second half of a short instruction is 0.
///
/// # Safety
///
/// The instruction must belong to the block that is being translated.
unsafe fn code(insn: *const Insn) -> [u16; 2] {
    let mut bytes = [0; 4];
    // SAFETY: as the caller promises.
    let size = unsafe { qemu_plugin_insn_size(insn) }.min(bytes.len());
    if qemu_plugin_version.load(Relaxed) >= COPIES {
        // SAFETY: `bytes` has room.
        unsafe { qemu_plugin_insn_data(insn, bytes.as_mut_ptr().cast(), size) };
    } else {
        let with_copy: unsafe extern "C" fn(*const Insn, *mut c_void, usize) -> usize =
            qemu_plugin_insn_data;
        // SAFETY: this is the function of the older versions.
        let with_pointer: unsafe extern "C" fn(*const Insn) -> *const u8 =
            unsafe { mem::transmute(with_copy) };
        // SAFETY: QEMU keeps the bytes until the callback for the block returns.
        let data = unsafe { slice::from_raw_parts(with_pointer(insn), size) };
        bytes[..size].copy_from_slice(data);
    }
    let half = |at| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
    [half(0), half(2)]
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
        let code = unsafe { code(insn) };
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_version_is_known_by_what_came_with_it() {
        const OLD: &str = "qemu_plugin_insn_data";
        const SCORES: &str = "qemu_plugin_scoreboard_new";
        const CONDITIONS: &str = "qemu_plugin_register_vcpu_insn_exec_cond_cb";
        for (exported, expected) in [
            (&[][..], 1),
            (&[OLD], 1),
            (&[OLD, SCORES], 2),
            (&[OLD, SCORES, CONDITIONS], 3),
        ] {
            let is_there = |name: &CStr| exported.iter().any(|it| name.to_bytes() == it.as_bytes());
            assert_eq!(version(is_there), expected, "{exported:?}");
        }
    }
}
