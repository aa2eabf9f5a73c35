//! A model of the OTG full-speed core of STM32F4 as a device, and hosts at the other end of the bus.
//!
//! Written from RM0090 34 and RM0390 31, and not from the driver. Where the manual is silent, the model does what is
//! worse for a driver, or either of two, by [`Silicon`]. What the manual forbids, or what would read garbage, is a
//! violation, which [`Core::violations`] lists.

mod core;
mod endpoint;
mod host;

pub use crate::{
    core::{Core, SetupEnd, Silicon, Version},
    endpoint::{FromDevice, Handshake},
    host::{DATA_ENDPOINT, Host, HostError, PACKET_BYTES, System},
};
