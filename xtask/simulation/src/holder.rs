//! Who has something open, as far as the system tells: on Linux.

use std::{
    fs,
    net::{SocketAddr, SocketAddrV4},
    path::Path,
    process,
};

/// Returns the process that has the end of a TCP connection, or that listens, at an address of this
/// computer: `process 12 (python3)`.
pub fn of_address(address: SocketAddr) -> Option<String> {
    let SocketAddr::V4(address) = address else {
        return None;
    };
    let sockets = fs::read_to_string("/proc/net/tcp").ok()?;
    of_file(Path::new(&format!(
        "socket:[{}]",
        inode(&sockets, address)?
    )))
}

/// Returns the process, other than this one, that has a file open.
pub fn of_file(path: &Path) -> Option<String> {
    let processes = fs::read_dir("/proc").ok()?.flatten();
    let mut numbers = processes.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    numbers.find(|number| has_open(*number, path)).map(named)
}

/// Returns a process with the name of its program, where that is known.
pub fn named(number: u32) -> String {
    let name = fs::read_to_string(format!("/proc/{number}/comm"));
    match name {
        Ok(name) => format!("process {number} ({})", name.trim()),
        Err(_) => format!("process {number}"),
    }
}

/// Returns whether a process, which is not this one, has something open.
fn has_open(number: u32, what: &Path) -> bool {
    let files = fs::read_dir(format!("/proc/{number}/fd"));
    let mut links = files.into_iter().flatten().flatten();
    number != process::id()
        && links.any(|link| fs::read_link(link.path()).is_ok_and(|to| to == what))
}

/// Finds the socket of a local address in the table of all sockets.
fn inode(sockets: &str, address: SocketAddrV4) -> Option<&str> {
    // The address is the number that its bytes are in memory.
    let bytes = u32::from_ne_bytes(address.ip().octets());
    let local = format!("{bytes:08X}:{:04X}", address.port());
    let mut rows = sockets.lines().map(str::split_whitespace);
    rows.find_map(|mut fields| (fields.nth(1)? == local).then(|| fields.nth(7))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_socket_is_found_by_its_address() {
        let sockets = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode\n\
             0: 00000000:07E8 00000000:0000 0A 00000000:00000000 00:00000000 00000000     0        0 1209 1 0\n\
             1: 0100007F:0913 0100007F:A001 01 00000000:00000000 00:00000000 00000000     0        0 77 1 0\n";
        let found = |address: &str| inode(sockets, address.parse().unwrap());
        assert_eq!(found("127.0.0.1:2323"), Some("77"));
        assert_eq!(found("0.0.0.0:2024"), Some("1209"));
        assert_eq!(found("127.0.0.1:40961"), None);
    }

    #[test]
    fn a_process_has_its_number_and_the_name_of_its_program() {
        let name = named(process::id());
        assert!(
            name.starts_with(&format!("process {}", process::id())),
            "{name}"
        );
        assert_eq!(named(u32::MAX), format!("process {}", u32::MAX));
    }
}
