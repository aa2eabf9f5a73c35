//! Bootloaders at the system's USB.

use std::{thread, time::Duration};

use anyhow::{Context as _, Result, anyhow, bail};
use common::{probe, ui};
use dfu_core::{
    DfuIo, DfuProtocol, functional_descriptor::FunctionalDescriptor, memory_layout::MemoryLayout,
};
use nusb::{
    Device, DeviceInfo, Error, ErrorKind, Interface, MaybeFuture as _,
    transfer::{ControlIn, ControlOut, ControlType, Recipient, TransferError},
};

use crate::Fault;

/// How long a device is waited for, and how often the system is asked.
const MOST_WAITED: Duration = Duration::from_mins(2);
const BETWEEN: Duration = Duration::from_millis(250);
/// The longest that a transfer may take: while it erases a sector, a chip may answer nothing.
const TIMEOUT: Duration = Duration::from_secs(10);
/// The interface, and its alternate setting of the flash.
const INTERFACE: u8 = 0;
const OF_FLASH: u8 = 0;

/// A bootloader that is open.
pub struct UsbDevice {
    interface: Interface,
    descriptor: FunctionalDescriptor,
    protocol: DfuProtocol<MemoryLayout>,
}

/// Waits until one bootloader is at USB, and opens it. `how` says how a board gets there.
pub fn wait(how: &str) -> Result<UsbDevice> {
    let mut waited = Duration::ZERO;
    loop {
        let devices = nusb::list_devices().wait();
        let devices = devices.map_err(|error| anyhow!("USB devices cannot be listed: {error}"))?;
        let (vendor, product) = probe::DFU;
        let found = devices.filter(|it| (it.vendor_id(), it.product_id()) == (vendor, product));
        if let Some(device) = only(found.collect())? {
            return open(&device);
        }
        if waited.is_zero() {
            let seconds = MOST_WAITED.as_secs();
            ui::status(
                "Waiting",
                &format!("up to {seconds} s for a board in DFU mode. {how}"),
            );
        }
        if waited >= MOST_WAITED {
            bail!("no board in DFU mode has come to USB: nothing was built, nothing was written");
        }
        thread::sleep(BETWEEN);
        waited += BETWEEN;
    }
}

/// The only one of some devices.
fn only<T>(mut found: Vec<T>) -> Result<Option<T>> {
    if found.len() > 1 {
        bail!(
            "{} chips in DFU mode are at USB, and nothing tells which is whose: unplug the others",
            found.len()
        );
    }
    Ok(found.pop())
}

fn open(info: &DeviceInfo) -> Result<UsbDevice> {
    let refused = |error: Error| anyhow!("{}", advice(error.kind(), &error.to_string()));
    let device = info.open().wait().map_err(refused)?;
    let interface = device.claim_interface(INTERFACE).wait().map_err(refused)?;
    let selected = interface.set_alt_setting(OF_FLASH).wait();
    selected.map_err(refused)?;
    let descriptor = { interface.descriptors() }
        .flat_map(|it| it.descriptors().map(|it| it.to_vec()).collect::<Vec<_>>())
        .find_map(|bytes| FunctionalDescriptor::from_bytes(&bytes));
    let descriptor = descriptor.context("the device at USB is no DFU device")??;
    let name = layout(&device, &interface);
    let name = name.context("the device at USB has no name of its flash")?;
    let protocol = DfuProtocol::new(&name, descriptor.dfu_version);
    let protocol = protocol.with_context(|| format!("the device at USB has {name:?} as flash"))?;
    Ok(UsbDevice {
        interface,
        descriptor,
        protocol,
    })
}

/// The string of the alternate setting.
fn layout(device: &Device, interface: &Interface) -> Option<String> {
    let mut settings = interface.descriptors();
    let setting = settings.find(|it| it.alternate_setting() == OF_FLASH)?;
    let index = setting.string_index()?;
    let languages = device.get_string_descriptor_supported_languages(TIMEOUT);
    let language = languages.wait().ok()?.next()?;
    let name = device.get_string_descriptor(index, language, TIMEOUT);
    name.wait().ok()
}

/// What to do when a device cannot be opened.
fn advice(kind: ErrorKind, error: &str) -> String {
    match kind {
        ErrorKind::PermissionDenied => format!(
            "the board is in DFU mode, and you may not open it ({error})\n\
             On Linux, this needs a udev rule: docs/platforms.md, \"DFU\""
        ),
        ErrorKind::Busy => {
            format!("another program has the board ({error}): dfu-util, STM32CubeProgrammer")
        }
        ErrorKind::Unsupported | ErrorKind::NotFound if cfg!(windows) => format!(
            "Windows has no driver WinUSB for the board in DFU mode ({error}): Zadig installs it; without it, \
             take the SD card or UF2"
        ),
        ErrorKind::Disconnected => Fault::Gone.to_string(),
        _ => format!("the board in DFU mode cannot be opened: {error}"),
    }
}

impl From<TransferError> for Fault {
    fn from(error: TransferError) -> Self {
        match error {
            TransferError::Cancelled => Self::Silent,
            TransferError::Stall => Self::Stalled,
            TransferError::Disconnected => Self::Gone,
            other => Self::Usb(other.to_string()),
        }
    }
}

impl DfuIo for UsbDevice {
    type Read = usize;
    type Write = usize;
    type Reset = ();
    type Error = Fault;
    type MemoryLayout = MemoryLayout;

    /// The type of the request is that of the class, to the interface: there is no other.
    fn read_control(
        &self,
        _request_type: u8,
        request: u8,
        value: u16,
        buffer: &mut [u8],
    ) -> Result<usize, Fault> {
        let transfer = ControlIn {
            control_type: ControlType::Class,
            recipient: Recipient::Interface,
            request,
            value,
            index: INTERFACE.into(),
            length: u16::try_from(buffer.len()).unwrap_or(u16::MAX),
        };
        let bytes = self.interface.control_in(transfer, TIMEOUT).wait()?;
        let length = bytes.len().min(buffer.len());
        buffer[..length].copy_from_slice(&bytes[..length]);
        Ok(length)
    }

    fn write_control(
        &self,
        _request_type: u8,
        request: u8,
        value: u16,
        data: &[u8],
    ) -> Result<usize, Fault> {
        let transfer = ControlOut {
            control_type: ControlType::Class,
            recipient: Recipient::Interface,
            request,
            value,
            index: INTERFACE.into(),
            data,
        };
        self.interface.control_out(transfer, TIMEOUT).wait()?;
        Ok(data.len())
    }

    /// The bootloader leaves by itself.
    fn usb_reset(self) -> Result<(), Fault> {
        Ok(())
    }

    fn protocol(&self) -> &DfuProtocol<MemoryLayout> {
        &self.protocol
    }

    fn functional_descriptor(&self) -> &FunctionalDescriptor {
        &self.descriptor
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_bootloaders_none_is_chosen() {
        assert_eq!(only(Vec::<u8>::new()).unwrap(), None);
        assert_eq!(only(vec![1]).unwrap(), Some(1));
        let error = only(vec![1, 2]).unwrap_err().to_string();
        assert!(
            error.starts_with("2 chips in DFU mode") && error.ends_with("unplug the others"),
            "{error}"
        );
    }

    #[test]
    fn a_device_that_cannot_be_opened_is_told_with_what_to_do() {
        for (kind, words) in [
            (
                ErrorKind::PermissionDenied,
                "needs a udev rule: docs/platforms.md",
            ),
            (ErrorKind::Busy, "another program has the board"),
            (ErrorKind::Disconnected, "no longer at USB"),
            (ErrorKind::Other, "cannot be opened: why"),
        ] {
            let text = advice(kind, "why");
            assert!(text.contains(words), "{text}");
        }
    }
}
