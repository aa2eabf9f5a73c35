//! A pseudo-terminal with one sender at a time.
//!
//! Whoever opens the link gets a terminal of his own: as soon as one has been opened, the link leads to
//! another. So a second sender does not share the line of the first, and can be told who that is. Only
//! Linux says when a terminal is opened; elsewhere there is one for all, as at any serial port.

use std::{os::fd::BorrowedFd, path::Path};

use anyhow::Result;
use common::ui;
use simulation::pty::{Link, Pty};

use super::Port;

/// A link, and the terminals to which it leads or has led.
pub(crate) struct Terminal {
    #[cfg_attr(
        not(target_os = "linux"),
        expect(dead_code, reason = "it goes with the terminal")
    )]
    link: Link,
    line: Pty,
    #[cfg(target_os = "linux")]
    watched: Option<watched::Terminals>,
}

impl Terminal {
    /// Makes `path` a link to a new terminal.
    pub(crate) fn at(path: &Path) -> Result<Self> {
        let (line, link) = Pty::at(path)?;
        let terminal = Self {
            #[cfg(target_os = "linux")]
            watched: watched::Terminals::new(&line),
            link,
            line,
        };
        // From here on it sees who opens the terminal.
        ui::status(
            "Serving",
            &format!("{} (115200 baud; Ctrl-C ends)", path.display()),
        );
        Ok(terminal)
    }
}

impl Port for Terminal {
    fn line(&self) -> Option<BorrowedFd<'_>> {
        Some(self.line.controller())
    }

    #[cfg(target_os = "linux")]
    fn door(&self) -> Option<BorrowedFd<'_>> {
        self.watched.as_ref().map(watched::Terminals::door)
    }

    #[cfg(target_os = "linux")]
    fn open_door(&mut self) -> Option<Vec<u8>> {
        let mut left = None;
        if let Some(watched) = &mut self.watched
            && watched.turn(&mut self.line, &self.link, &mut left).is_err()
        {
            // It goes on as elsewhere.
            self.watched = None;
        }
        left
    }
}

#[cfg(target_os = "linux")]
mod watched {
    use std::{
        mem::{MaybeUninit, replace},
        os::fd::{AsFd as _, BorrowedFd, OwnedFd},
    };

    use anyhow::Result;
    use common::ui;
    use rustix::{
        fs::inotify::{self, CreateFlags, ReadFlags, Reader, WatchFlags},
        io::Errno,
    };
    use simulation::{
        holder,
        pty::{Link, Pty},
    };

    use super::super::MAX_UNREAD_BYTES;

    /// The terminals, by the numbers of their watches.
    pub(super) struct Terminals {
        events: OwnedFd,
        line: i32,
        /// How often the line is open.
        opened: u32,
        /// The terminal to which the link leads, once the line has been opened.
        next: Option<(i32, Pty)>,
        /// Those of senders that came too early; they hear nothing but that.
        refused: Vec<Refused>,
    }

    /// A terminal that is not served.
    struct Refused {
        number: i32,
        terminal: Pty,
        /// How often it is open.
        opened: u32,
        /// What its senders hear.
        message: String,
    }

    impl Refused {
        /// Another program has opened it.
        fn print(&mut self) {
            self.opened += 1;
            // Fewer bytes than a new terminal has room for.
            let _ = rustix::io::write(self.terminal.controller(), self.message.as_bytes());
        }
    }

    impl Terminals {
        pub(super) fn new(line: &Pty) -> Option<Self> {
            let events = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC).ok()?;
            Some(Self {
                line: watch(&events, line).ok()?,
                events,
                opened: 0,
                next: None,
                refused: Vec::new(),
            })
        }

        pub(super) fn door(&self) -> BorrowedFd<'_> {
            self.events.as_fd()
        }

        /// Follows what has been opened and closed; `left` is what has not been read of a sender that has left.
        pub(super) fn turn(
            &mut self,
            line: &mut Pty,
            link: &Link,
            left: &mut Option<Vec<u8>>,
        ) -> Result<()> {
            let mut buffer = [MaybeUninit::uninit(); 1024];
            let mut seen = Vec::new();
            let mut reader = Reader::new(&self.events, &mut buffer);
            loop {
                match reader.next() {
                    Ok(event) => seen.push((event.wd(), event.events().contains(ReadFlags::OPEN))),
                    Err(Errno::AGAIN | Errno::INTR) => break,
                    Err(error) => return Err(error.into()),
                }
            }
            for (number, is_opened) in seen {
                if number == self.line && is_opened {
                    self.opened += 1;
                    if self.next.is_none() {
                        self.lead_on(link)?;
                    }
                } else if number == self.line {
                    self.opened = self.opened.saturating_sub(1);
                    if self.opened == 0 {
                        ui::status("Left", &line.name().display().to_string());
                        *left = Some(unread(line));
                    }
                } else if let Some(refused) = self.refused(number) {
                    if is_opened {
                        refused.print();
                    } else {
                        refused.opened = refused.opened.saturating_sub(1);
                    }
                } else if is_opened && self.next.as_ref().is_some_and(|(next, _)| *next == number) {
                    self.enter(line, link)?;
                }
            }
            self.refused.retain(|refused| refused.opened > 0);
            Ok(())
        }

        fn refused(&mut self, number: i32) -> Option<&mut Refused> {
            self.refused
                .iter_mut()
                .find(|refused| refused.number == number)
        }

        /// Lets a sender in that has opened the next terminal, or tells it who is connected.
        fn enter(&mut self, line: &mut Pty, link: &Link) -> Result<()> {
            let Some((number, next)) = self.next.take() else {
                return Ok(());
            };
            // First of all: who is refused may come again as soon as he hears of it.
            self.lead_on(link)?;
            if self.opened == 0 {
                (self.line, self.opened) = (number, 1);
                drop(replace(line, next));
            } else {
                let holder = holder::of_file(line.name());
                let holder = holder.unwrap_or_else(|| "another program".into());
                ui::status("Refused", &format!("a program: {holder} is connected"));
                let message = format!("[MSG:In use by {holder}]\r\n");
                let mut refused = Refused {
                    number,
                    terminal: next,
                    opened: 0,
                    message,
                };
                refused.print();
                self.refused.push(refused);
            }
            Ok(())
        }

        /// Makes the link lead to a new terminal.
        fn lead_on(&mut self, link: &Link) -> Result<()> {
            let next = Pty::open()?;
            let number = watch(&self.events, &next)?;
            link.lead_to(&next)?;
            self.next = Some((number, next));
            Ok(())
        }
    }

    /// Reads what its sender has sent and nobody has read: no more than an operating system keeps.
    fn unread(terminal: &Pty) -> Vec<u8> {
        let mut unread = Vec::new();
        let mut chunk = [0; 1024];
        while unread.len() < MAX_UNREAD_BYTES
            && let Ok(length @ 1..) = rustix::io::read(terminal.controller(), &mut chunk)
        {
            unread.extend(&chunk[..length]);
        }
        unread
    }

    fn watch(events: &OwnedFd, terminal: &Pty) -> rustix::io::Result<i32> {
        inotify::add_watch(
            events,
            terminal.name(),
            WatchFlags::OPEN | WatchFlags::CLOSE,
        )
    }
}
