//! Vectors that run an RTIC task besides the vector that the task binds.
//!
//! RTIC gives a task one vector. `inputs` also runs for the lines of EXTI, and the boards have
//! different USARTs; the handlers of such vectors call the handler of the vector that the task binds.
//!
//! RTIC 2.4 refuses `serial_rx` as one task for each USART under `#[cfg]`: "this task is defined
//! multiple times". It takes tasks with names of their own, but unmasks the vectors of all of them in every image:
//! [`is_bound`] says which have a handler.

use super::pac::{Interrupt, NVIC};

/// Vector of `usb`, and of its timer.
const USB: Interrupt = Interrupt::TIM1_TRG_COM_TIM11;
/// Vector of `usb_control`.
pub(super) const USB_CONTROL: Interrupt = Interrupt::I2C1_ER;

/// Returns whether a task of this image binds a vector, of those that tasks of `src/app.rs` bind.
pub(super) const fn is_bound(vector: Interrupt) -> bool {
    match vector {
        USB | USB_CONTROL => cfg!(feature = "usb"),
        Interrupt::USART1 => !cfg!(feature = "usb"),
        _ => true,
    }
}

/// Vector of `prepare` and of its timer.
pub(crate) const PREPARE: Interrupt = Interrupt::TIM1_BRK_TIM9;
/// Vector of `segment_start`.
pub(super) const SEGMENT_START: Interrupt = Interrupt::I2C3_EV;
/// Vector of `wake`, and of the clock of `interpret`.
pub(super) const WAKE: Interrupt = Interrupt::TIM4;

/// Makes the handlers of some vectors call the handler of the vector that a task binds.
macro_rules! forward_vectors {
    ($($vector:ident),+ => $bound:ident) => {
        #[expect(unsafe_code, reason = "the handler is RTIC's")]
        unsafe extern "C" {
            fn $bound();
        }
        $(
            #[unsafe(no_mangle)]
            #[expect(unsafe_code, reason = "the handler is RTIC's")]
            extern "C" fn $vector() {
                // SAFETY: `unmask` has given this vector the priority of the task, so that the task
                // is never interrupted by itself.
                unsafe { $bound() }
            }
        )+
    };
}
pub(super) use forward_vectors;

/// Returns a priority of RTIC as the NVIC has it: four bits, 0 is the highest.
pub(super) const fn nvic_priority(priority: u8) -> u8 {
    (16 - priority) << 4
}

/// Gives forwarded vectors the priority of their task, and unmasks them. `init` alone calls this.
#[expect(unsafe_code, reason = "vectors that RTIC does not manage")]
pub(super) fn unmask(nvic: &mut NVIC, vectors: &[Interrupt], priority: u8) {
    for &vector in vectors {
        // SAFETY: RTIC keeps interrupts off until `init` has returned, and the priority is that of
        // the only task that the vectors call.
        unsafe {
            nvic.set_priority(vector, nvic_priority(priority));
            NVIC::unmask(vector);
        }
    }
}
