//! Debug probes at USB, as far as the system lists its devices without one of them being opened.

use std::{fs, path::Path};

use anyhow::{Result, bail, ensure};

use crate::ui;

/// What to do without a probe.
pub const NONE: &str = "no debug probe is attached\n\
    Connect the board by USB (a Nucleo board's own ST-Link, or a probe on its SWD pins).\n\
    On Linux, probes need udev rules: https://probe.rs/docs/getting-started/probe-setup\n\
    If another program (OpenOCD, a debugger) has the probe, stop it.";

/// The bootloader in the ROM of the chips, over USB: the numbers of its maker and of the product.
pub const DFU: (u16, u16) = (0x0483, 0xdf11);
const NO_DFU: &str = "for a board in DFU mode: there is none at USB yet. The tool waits for it before it builds anything";

/// What `bring-up` needs.
pub const BRING_UP: &str = "bring-up needs a board at a debug probe, its serial port as `--port`, and no \
    other wire at the board\n\
    What needs no board: `cargo xtask bring-up --board netduino-plus-2 --qemu`";

/// Where Linux lists USB devices.
const DEVICES: &str = "/sys/bus/usb/devices";
/// Makers of probes that do not say that they speak CMSIS-DAP: ST and SEGGER.
const MAKERS: [&str; 2] = ["0483", "1366"];

/// Makes sure that a probe is attached, the one of `VID:PID` or `VID:PID:SERIAL` where that is given.
/// Where the system does not list its devices, whoever opens the probe finds out.
pub fn need(selector: Option<&str>) -> Result<()> {
    need_among(Path::new(DEVICES), selector)
}

fn need_among(devices: &Path, selector: Option<&str>) -> Result<()> {
    let Some(mut devices) = listed(devices) else {
        return Ok(());
    };
    if let Some(selector) = selector {
        let mut parts = selector.split(':').map(str::to_lowercase);
        let wanted = (parts.next(), parts.next());
        let is_there = devices.any(|(vendor, product, _)| (Some(vendor), Some(product)) == wanted);
        ensure!(is_there, "there is no probe {selector} at USB");
    } else if !devices.any(|(vendor, _, product)| {
        MAKERS.contains(&vendor.as_str()) || product.contains("CMSIS-DAP")
    }) {
        bail!("{NONE}");
    }
    Ok(())
}

/// Maker, product and its name of each device; none where the system does not list them there.
fn listed(devices: &Path) -> Option<impl Iterator<Item = (String, String, String)>> {
    let devices = fs::read_dir(devices).ok()?.flatten();
    Some(devices.filter_map(|device| {
        let read = |name: &str| fs::read_to_string(device.path().join(name)).ok();
        let id = |name: &str| Some(read(name)?.trim().to_owned());
        let product = read("product").unwrap_or_default();
        Some((id("idVendor")?, id("idProduct")?, product))
    }))
}

/// Says at once when no board is in DFU mode, while what waits for it is compiled.
pub fn announce_dfu() {
    if is_without_dfu(Path::new(DEVICES)) {
        ui::status("Looking", NO_DFU);
    }
}

fn is_without_dfu(devices: &Path) -> bool {
    let (vendor, product) = DFU;
    let wanted = (format!("{vendor:04x}"), format!("{product:04x}"));
    listed(devices)
        .is_some_and(|mut devices| !devices.any(|(vendor, product, _)| (vendor, product) == wanted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probe_is_found_among_usb_devices() {
        let folder = tempfile::tempdir().unwrap();
        let list = |name: &str, files: [(&str, &str); 3]| {
            let device = folder.path().join(name);
            fs::create_dir(&device).unwrap();
            for (name, text) in files {
                fs::write(device.join(name), format!("{text}\n")).unwrap();
            }
        };
        let need =
            |selector| need_among(folder.path(), selector).map_err(|error| error.to_string());
        let mouse = [
            ("idVendor", "046d"),
            ("idProduct", "c077"),
            ("product", "Mouse"),
        ];
        list("1-1", mouse);
        assert_eq!(need(None), Err(NONE.to_owned()));
        list(
            "1-2",
            [
                ("idVendor", "0483"),
                ("idProduct", "374b"),
                ("product", "STM32 STLink"),
            ],
        );
        assert_eq!(need(None), Ok(()));
        assert_eq!(need(Some("0483:374B:066F")), Ok(()));
        let missing = Err("there is no probe 2e8a:000c at USB".to_owned());
        assert_eq!(need(Some("2e8a:000c")), missing);
        list(
            "1-3",
            [
                ("idVendor", "2e8a"),
                ("idProduct", "000c"),
                ("product", "CMSIS-DAP"),
            ],
        );
        assert_eq!(need(Some("2e8a:000c")), Ok(()));
        assert!(is_without_dfu(folder.path()));
        list(
            "1-4",
            [
                ("idVendor", "0483"),
                ("idProduct", "df11"),
                ("product", "STM32  BOOTLOADER"),
            ],
        );
        assert!(!is_without_dfu(folder.path()));
        let none = folder.path().join("none");
        assert!(need_among(&none, None).is_ok() && !is_without_dfu(&none));
    }
}
