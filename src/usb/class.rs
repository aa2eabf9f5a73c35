//! The class: a serial port, CDC ACM, which also accepts a break.
//!
//! `usbd-serial` has this class without the break: its descriptor denies what Linux then refuses to send.

use usb_device::{
    Result,
    bus::{InterfaceNumber, StringIndex},
    class_prelude::{ControlIn, ControlOut, DescriptorWriter, UsbBusAllocator, UsbClass},
    control::{Recipient, Request, RequestType},
    descriptor::lang_id::LangID,
    endpoint::{EndpointIn, EndpointOut},
};

use super::{ControlBus, NOTIFICATION_BYTES, PACKET_BYTES};

/// Codes of CDC 1.2, tables 2, 4, 6 and 12, and of its subclass PSTN, tables 3 and 13.
const COMMUNICATIONS: u8 = 0x02;
const COMMUNICATIONS_DATA: u8 = 0x0a;
const ABSTRACT_CONTROL_MODEL: u8 = 0x02;
const CLASS_DESCRIPTOR: u8 = 0x24;
const HEADER: u8 = 0x00;
const CALL_MANAGEMENT: u8 = 0x01;
const CAPABILITIES: u8 = 0x02;
const UNION: u8 = 0x06;
/// The port takes the line's coding and state, and a break.
const LINE_CODING_AND_BREAK: u8 = 0x02 | 0x04;
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;
const SEND_BREAK: u8 = 0x23;
/// The bit of the line's state that says that a program has the port open.
const DTR: u16 = 1;
/// Time between two looks at the notifications, ms: the longest, as there are none.
const NOTIFICATION_INTERVAL_MS: u8 = 255;
/// Rate, stop bits, parity and data bits: 115 200 8N1. The port has no rate, and keeps what it is told.
const USUAL_CODING: [u8; CODING_BYTES] = [0x00, 0xc2, 0x01, 0x00, 0, 0, 8];
const CODING_BYTES: usize = 7;

/// The port.
pub(super) struct SerialPort<'a> {
    control: InterfaceNumber,
    notifications: EndpointIn<'a, ControlBus<'a>>,
    data: InterfaceNumber,
    received: EndpointOut<'a, ControlBus<'a>>,
    sent: EndpointIn<'a, ControlBus<'a>>,
    coding: [u8; CODING_BYTES],
    /// A program has the port open.
    pub(super) is_open: bool,
    /// The host has sent a break.
    pub(super) has_break: bool,
    /// The host has chosen a configuration, and which one.
    pub(super) configuration: Option<u16>,
}

impl<'a> SerialPort<'a> {
    pub(super) fn new(allocator: &'a UsbBusAllocator<ControlBus<'a>>) -> Self {
        Self {
            control: allocator.interface(),
            notifications: allocator.interrupt(NOTIFICATION_BYTES, NOTIFICATION_INTERVAL_MS),
            data: allocator.interface(),
            received: allocator.bulk(PACKET_BYTES as u16),
            sent: allocator.bulk(PACKET_BYTES as u16),
            coding: USUAL_CODING,
            is_open: false,
            has_break: false,
            configuration: None,
        }
    }

    /// Returns whether a request is for the port.
    fn is_asked(&self, request: &Request) -> bool {
        request.request_type == RequestType::Class
            && request.recipient == Recipient::Interface
            && request.index == u16::from(u8::from(self.control))
    }
}

impl<'a> UsbClass<ControlBus<'a>> for SerialPort<'a> {
    fn get_configuration_descriptors(&self, writer: &mut DescriptorWriter) -> Result<()> {
        let (control, data) = (self.control.into(), self.data.into());
        writer.iad(
            self.control,
            2,
            COMMUNICATIONS,
            ABSTRACT_CONTROL_MODEL,
            0,
            None,
        )?;
        writer.interface(self.control, COMMUNICATIONS, ABSTRACT_CONTROL_MODEL, 0)?;
        // Version 1.10 of the class.
        writer.write(CLASS_DESCRIPTOR, &[HEADER, 0x10, 0x01])?;
        writer.write(CLASS_DESCRIPTOR, &[CALL_MANAGEMENT, 0, data])?;
        writer.write(CLASS_DESCRIPTOR, &[CAPABILITIES, LINE_CODING_AND_BREAK])?;
        writer.write(CLASS_DESCRIPTOR, &[UNION, control, data])?;
        writer.endpoint(&self.notifications)?;
        writer.interface(self.data, COMMUNICATIONS_DATA, 0, 0)?;
        writer.endpoint(&self.sent)?;
        writer.endpoint(&self.received)
    }

    fn get_string(&self, _index: StringIndex, _language: LangID) -> Option<&str> {
        None
    }

    fn reset(&mut self) {
        self.is_open = false;
        self.configuration = None;
    }

    fn control_in(&mut self, transfer: ControlIn<'_, '_, '_, ControlBus<'a>>) {
        let request = transfer.request();
        if !self.is_asked(request) {
            return;
        }
        // Without a transfer, the host has given the request up.
        let _ = match request.request {
            GET_LINE_CODING => transfer.accept_with(&self.coding),
            _ => transfer.reject(),
        };
    }

    fn control_out(&mut self, transfer: ControlOut<'_, '_, '_, ControlBus<'a>>) {
        let request = *transfer.request();
        let is_configuration = request.request_type == RequestType::Standard
            && request.recipient == Recipient::Device
            && request.request == Request::SET_CONFIGURATION;
        if is_configuration {
            // `usb-device` accepts it, or refuses.
            self.configuration = Some(request.value);
        }
        if !self.is_asked(&request) {
            return;
        }
        let _ = match request.request {
            SET_LINE_CODING => match transfer.data().first_chunk() {
                Some(coding) => {
                    self.coding = *coding;
                    transfer.accept()
                }
                None => transfer.reject(),
            },
            SET_CONTROL_LINE_STATE => {
                self.is_open = request.value & DTR != 0;
                transfer.accept()
            }
            SEND_BREAK => {
                // Its duration, ms; 0 ends a break of no known end.
                self.has_break |= request.value != 0;
                transfer.accept()
            }
            _ => transfer.reject(),
        };
    }
}
