//! The virtual machine as a USB device, which clients of USB/IP have.

#[cfg(test)]
mod tests;

use std::{net::SocketAddr, os::unix::net::UnixStream, path::Path, time::Instant};

use anyhow::{Context, Result, anyhow};
use common::ui;
use leadscrew::sim::Simulator;
use otg::{Core, HostError, SetupEnd, Silicon, Version};
use rustix::{
    event::{PollFd, PollFlags, Timespec, poll},
    io::Errno,
};
use simulation::{figures::Figures, play::Recorder};
use usb_machine::{Device, PERIOD_US};
use usbip::Period;

use super::{PERIOD, record::Record, tcp};

/// The name of the device.
const DEVICE_NAME: &str = "Leadscrew simulator";

/// The machine at a bus that hosts reach by USB/IP.
pub(crate) struct UsbIp<'a, R> {
    device: Device,
    core: Core,
    server: usbip::Server,
    record: Record<'a, R>,
    address: SocketAddr,
    start: Instant,
}

impl<'a, R: Recorder> UsbIp<'a, R> {
    /// Serves a machine that has been switched on just now at an address.
    ///
    /// # Errors
    /// The address cannot be had, or the device does not answer.
    pub(crate) fn at(
        address: &str,
        mut simulator: Box<Simulator>,
        flash: Option<&'a Path>,
        recorder: &'a mut R,
    ) -> Result<Self> {
        let listener = tcp::listen(address, "127.0.0.1:3240")?;
        let address = listener.local_addr()?;
        let record = Record::new(simulator.flash(), flash, recorder);
        let silicon = Silicon {
            version: Version::V1,
            setup_end: SetupEnd::Entry,
            keeps_enabled: true,
        };
        let mut served = Self {
            // Simulators at other ports have other serial numbers.
            device: Device::new(simulator, DEVICE_NAME, [0, 0, address.port().into()]),
            core: Core::new(silicon),
            server: usbip::Server::new(listener)?,
            record,
            address,
            start: Instant::now(),
        };
        served.with_device(usbip::Server::plug)?;
        let bus = usbip::BUS_ID;
        ui::status(
            "Serving",
            &format!("usbip://{address} as {bus} (Ctrl-C ends)"),
        );
        ui::status("Attach by", &usbip::command(address));
        Ok(served)
    }

    /// Where it listens.
    pub(crate) const fn address(&self) -> SocketAddr {
        self.address
    }

    /// Does what takes time of the device.
    fn with_device(
        &mut self,
        act: fn(&mut usbip::Server, &mut Core, &mut Period<'_>) -> Result<(), HostError>,
    ) -> Result<()> {
        let (device, record) = (&mut self.device, &mut self.record);
        let mut period = |core: &mut Core| device.period(core, &mut |edge| record.edge(edge));
        let done = act(&mut self.server, &mut self.core, &mut period);
        done.map_err(|error| anyhow!("the device does not answer its host: {error:?}"))
    }

    /// Moves transfers and time until something is to be read from `stop`, and returns what was done.
    ///
    /// # Errors
    /// A file cannot be written.
    pub(crate) fn serve(mut self, stop: &UnixStream) -> Result<Figures> {
        loop {
            self.with_device(usbip::Server::read)?;
            self.run()?;
            self.server.write(&mut self.core);
            for (word, sentence) in self.server.events.drain(..) {
                ui::status(word, &sentence);
            }
            if self.wait(stop)? {
                break;
            }
        }
        for violation in self.core.violations() {
            ui::warning(&format!(
                "the driver does what the chip forbids: {violation}"
            ));
        }
        Ok(self.record.finish(&self.device.simulator))
    }

    /// Runs the machine until now.
    fn run(&mut self) -> Result<()> {
        let now_us = self.start.elapsed().as_micros();
        let record = &mut self.record;
        while u128::from(self.device.now_us() + PERIOD_US) <= now_us {
            self.device
                .period(&mut self.core, &mut |edge| record.edge(edge));
            self.server
                .run(&mut self.core, &mut |byte| record.hear(byte));
        }
        record.keep(self.device.simulator.flash())
    }

    /// Waits for the next period, or for somebody who says something. Returns whether the machine is to stop.
    fn wait(&self, stop: &UnixStream) -> Result<bool> {
        let stop = PollFd::new(stop, PollFlags::IN);
        let mut awaited: Vec<_> = [stop].into_iter().chain(self.server.awaited()).collect();
        let period = Timespec {
            tv_sec: 0,
            tv_nsec: PERIOD.subsec_nanos().into(),
        };
        match poll(&mut awaited, Some(&period)) {
            Ok(_) => Ok(!awaited[0].revents().is_empty()),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error).context("cannot wait for hosts"),
        }
    }
}
