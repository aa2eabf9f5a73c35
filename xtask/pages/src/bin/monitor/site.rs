//! What is served: files at an address, to those who ask for them by the server's own name.

use std::{
    io,
    net::{IpAddr, SocketAddr, TcpListener, UdpSocket},
};

use anyhow::{Context, Result};
use pages::control;

use crate::http::Request;

/// What a browser only takes from a header.
const FRAMES: &str = "; frame-ancestors 'none'";

pub(crate) const HTML: &str = "text/html; charset=utf-8";
pub(crate) const STYLE: &str = "text/css; charset=utf-8";
pub(crate) const SCRIPT: &str = "text/javascript; charset=utf-8";
pub(crate) const BYTES: &str = "application/octet-stream";

/// A file: path, type, content.
pub(crate) type File = (&'static str, &'static str, Vec<u8>);

/// A server's address and its files.
pub(crate) struct Site {
    /// The name in the address that the user has given.
    name: String,
    pub(crate) at: SocketAddr,
    policy: String,
    files: Vec<File>,
}

impl Site {
    /// Begins to listen at an address; the policy is what a browser may do with the files.
    pub(crate) fn bind(
        address: &str,
        policy: &str,
        files: Vec<File>,
    ) -> Result<(TcpListener, Self)> {
        let listener = TcpListener::bind(address);
        let listener = listener.with_context(|| format!("cannot serve the page at {address}"))?;
        let at = listener.local_addr().context("the page has no address")?;
        let name = address.rsplit_once(':').map_or(address, |(name, _)| name);
        let site = Self {
            name: name.into(),
            at,
            policy: [policy, FRAMES].concat(),
            files,
        };
        Ok((listener, site))
    }

    /// The address for browsers. A server at every address of the computer is named by the one by which others reach it.
    pub(crate) fn url(&self) -> String {
        let mut at = self.at;
        if at.ip().is_unspecified() {
            // No packet is sent: the network's choice of the own address is looked up.
            let outward = UdpSocket::bind("0.0.0.0:0");
            let outward = outward.and_then(|it| it.connect("192.0.2.1:9").and(it.local_addr()));
            at.set_ip(outward.map_or(IpAddr::from([127, 0, 0, 1]), |outward| outward.ip()));
        }
        format!("http://{at}/")
    }

    /// Why a request is refused: it was meant for another server, or another site's page asks.
    ///
    /// A page of another site that leads here by a name of its own (DNS rebinding) tells that name.
    pub(crate) fn refusal(&self, request: &Request) -> Option<&'static str> {
        let host = request.field("Host");
        let asked = host.rsplit_once(':').map_or(host, |(name, _)| name);
        let own = self.at.ip();
        let address = asked.trim_matches(['[', ']']).parse::<IpAddr>();
        let is_address = address.is_ok_and(|address| address == own || own.is_unspecified());
        let is_named = !asked.is_empty() && (asked == "localhost" || asked == self.name);
        if !is_named && !is_address {
            return Some("wrong host");
        }
        let is_elsewhere = matches!(request.field("Sec-Fetch-Site"), "cross-site" | "same-site");
        let origin = request.field("Origin");
        let is_own = origin.is_empty() || origin.strip_prefix("http://") == Some(host);
        (is_elsewhere || !is_own).then_some("another site")
    }

    /// Answers with a file.
    pub(crate) fn answer(&self, request: Request) -> io::Result<()> {
        // Browsers ask for it by themselves.
        if request.path == "/favicon.ico" {
            return request.answer("204 No Content", &[], &[]);
        }
        let mut files = self.files.iter();
        let Some((_, kind, content)) = files.find(|(path, ..)| *path == request.path) else {
            return request.answer("404 Not Found", &[], b"not found");
        };
        let policy = match request.path.as_str() {
            control::VIEW => control::VIEW_POLICY,
            _ => &self.policy,
        };
        let fields = [
            ("Content-Type", *kind),
            ("Content-Security-Policy", policy),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cache-Control", "no-store"),
        ];
        request.answer("200 OK", &fields, content)
    }
}
