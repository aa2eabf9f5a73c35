//! Pages for browsers.

use std::path::PathBuf;

use super::files::{InputPath, OutputPath};
use crate::BAUD;

/// Show in a browser what a machine does
///
/// The machine is a board at a serial port, any machine that speaks Grbl, or the simulator. A page on
/// this computer shows path, position, state and speed. With FILE the program is streamed, and the
/// command ends with it; otherwise it ends with Ctrl-C. With --link a sender connects through it, and
/// every byte passes. Of FILE, or of the --program that a sender sends, the page shows the whole path
/// from the beginning, what has been cut of it, and how long the rest will take.
/// With --control the page operates the machine: only who has the address that is printed can open it.
#[derive(Debug, clap::Args)]
#[command(group = clap::ArgGroup::new("where").required(true).args(["port", "tcp", "sim"]))]
pub struct Monitor {
    /// The program; `-` is standard input
    #[arg(conflicts_with = "link")]
    pub file: Option<InputPath>,
    /// The program that is sent by somebody else: the page shows its path and the time that is left
    #[arg(long, value_name = "FILE", conflicts_with = "file")]
    pub program: Option<InputPath>,
    /// The serial port of the machine, such as /dev/ttyACM0
    #[arg(long, value_name = "DEVICE")]
    pub port: Option<InputPath>,
    /// The TCP address of the machine, such as 127.0.0.1:2323
    #[arg(long, value_name = "ADDR:PORT")]
    pub tcp: Option<String>,
    /// Watch the virtual machine, in real time
    #[arg(long)]
    pub sim: bool,
    /// The baud rate of the serial port
    #[arg(long, value_name = "BAUD", default_value_t = BAUD, requires = "port")]
    pub baud: u32,
    /// Read settings of the virtual machine from a file of $n=value lines; with --program, those of a
    /// machine that is already in motion and cannot be asked
    #[arg(long, value_name = "FILE")]
    pub settings: Option<InputPath>,
    /// Change a setting of the virtual machine, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE", requires = "sim")]
    pub set: Vec<String>,
    /// Make a serial device at which a sender reaches the machine
    #[arg(long, value_name = "PATH")]
    pub link: Option<PathBuf>,
    /// Operate the machine from the page: jog it, set it up, run programs
    #[arg(long, conflicts_with_all = ["file", "program", "link", "svg"])]
    pub control: bool,
    /// Where the page is served; port 0 is any that is free, and 0.0.0.0 is for other computers
    #[arg(long, value_name = "ADDR:PORT", default_value = "127.0.0.1:0")]
    pub listen: String,
    /// Do not open the browser
    #[arg(long, requires = "control")]
    pub no_open: bool,
    /// Draw the picture into a file at the end
    #[arg(long, value_name = "OUT.svg")]
    pub svg: Option<OutputPath>,
}

/// Show a G-code program as a page: its path, its speeds and its time
///
/// The program runs on the virtual machine as with `cargo xtask sim`, and everything that it does goes into
/// one HTML file, which needs nothing else: no network, no other program than a browser. The browser is
/// opened, unless the file is named with -o. The exit status is 1 when a line was refused or an alarm rose.
#[derive(Debug, clap::Args)]
pub struct View {
    /// The program; `-` is standard input
    pub file: InputPath,
    /// Change a setting, as '$110=5000'; repeatable
    #[arg(long, value_name = "$N=VALUE")]
    pub set: Vec<String>,
    /// Read settings from a file of $n=value lines
    #[arg(long, value_name = "FILE")]
    pub settings: Option<InputPath>,
    /// Give the machine limit switches at the ends of its travel, in whose middle it stands, and a
    /// probe plate 10 mm above the low end of Z with a block on it, which is an eighth of the travel from the
    /// low ends of X and Y, a quarter wide, and a tenth high
    #[arg(long)]
    pub switches: bool,
    /// Where to write the page, instead of a temporary folder
    #[arg(short, long, value_name = "OUT.html")]
    pub output: Option<OutputPath>,
    /// Draw a picture that moves, for documents, instead of the page
    #[arg(long, value_name = "OUT.svg", conflicts_with = "output")]
    pub picture: Option<OutputPath>,
    /// Do not open the browser
    #[arg(long)]
    pub no_open: bool,
}

/// Make a page that runs G-code programs on the virtual machine in the browser
///
/// The page is the file index.html of a folder for any web server, and needs nothing else; it can also be opened
/// as a file. Whoever drops a program and a list of settings on it sees what `cargo xtask view` would show: the
/// code of the firmware runs as WebAssembly, and nothing leaves the browser.
#[derive(Debug, clap::Args)]
pub struct Web {
    /// Where the folder is made; without it, among the results of builds
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Add a page that installs the firmware of a release, a folder of `cargo xtask release`, which is copied beside it
    #[arg(long, value_name = "DIR")]
    pub release: Option<PathBuf>,
    /// Play a program here and under node too, and compare times, hashes and pages
    #[arg(long, value_name = "FILE")]
    pub measure: Option<InputPath>,
    /// Read the settings for that from a file of $n=value lines
    #[arg(long, value_name = "FILE", requires = "measure")]
    pub settings: Option<InputPath>,
}
