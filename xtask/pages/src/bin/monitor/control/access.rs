//! Who may open the page: whoever has the address that was printed, and then the cookie that it is exchanged for.
//!
//! The arguments of a program can be read by every user of the computer; so the browser is opened with a token that
//! counts once.

use std::{
    fmt::Write as _,
    hint,
    net::SocketAddr,
    sync::atomic::{AtomicBool, Ordering},
    time::{Duration, Instant},
};

use anyhow::{Result, anyhow};

use common::ui;

use crate::http::Request;

/// How long a token for one request counts.
const ONE_TIME_TOKEN_LIFE: Duration = Duration::from_mins(1);

/// A secret of 128 bits, in hexadecimal digits.
pub(super) struct Token(String);

impl Token {
    pub(super) fn new() -> Result<Self> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)
            .map_err(|error| anyhow!("the system has no random number for the page: {error}"))?;
        Ok(Self(bytes.iter().fold(
            String::new(),
            |mut digits, byte| {
                // Writing to a string never fails.
                let _ = write!(digits, "{byte:02x}");
                digits
            },
        )))
    }

    /// What stands after the page's address.
    pub(super) fn query(&self) -> String {
        format!("token={}", self.0)
    }

    /// Whether a request has the token in its address.
    pub(super) fn is_asked_with(&self, request: &Request) -> bool {
        self.is(request.query.strip_prefix("token=").unwrap_or_default())
    }

    /// Whether a request has the cookie of the server at an address.
    pub(super) fn is_known(&self, request: &Request, at: SocketAddr) -> bool {
        let cookies = request.field("Cookie").split(';').map(str::trim);
        let mut own = cookies
            .filter_map(|it| it.strip_prefix(&format!("{}=", name(at))))
            .map(|it| self.is(it));
        own.any(|is_own| is_own)
    }

    /// The cookie of the server at an address, for this site's own requests alone.
    pub(super) fn cookie(&self, at: SocketAddr) -> String {
        format!("{}={}; HttpOnly; SameSite=Strict; Path=/", name(at), self.0)
    }

    /// Compares in a time that does not depend on where the first difference is.
    fn is(&self, text: &str) -> bool {
        let pairs = self.0.bytes().zip(text.bytes());
        let difference = pairs.fold(0, |sum, (own, other)| hint::black_box(sum | (own ^ other)));
        text.len() == self.0.len() && difference == 0
    }
}

/// A token for one request: that of the browser which is started with it.
pub(super) struct OneTimeToken {
    token: Token,
    since: Instant,
    is_used: AtomicBool,
}

impl OneTimeToken {
    pub(super) fn new() -> Result<Self> {
        Ok(Self {
            token: Token::new()?,
            since: Instant::now(),
            is_used: AtomicBool::new(false),
        })
    }

    /// What stands after the page's address.
    pub(super) fn query(&self) -> String {
        format!("once={}", self.token.0)
    }

    /// Whether a request is the first one with the token. Somebody else's may have been before a second one.
    pub(super) fn is_exchanged_by(&self, request: &Request) -> bool {
        let query = request.query.strip_prefix("once=").unwrap_or_default();
        if !self.token.is(query) {
            return false;
        }
        let is_used = self.is_used.swap(true, Ordering::Relaxed);
        if is_used {
            ui::warning(
                "the browser's address was used twice: if you see no page, end this program, for somebody else does",
            );
        }
        !is_used && self.since.elapsed() < ONE_TIME_TOKEN_LIFE
    }
}

/// Browsers keep one cookie of a name for all ports.
fn name(at: SocketAddr) -> String {
    format!("leadscrew-{}", at.port())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_itself_alone_and_no_two_are_the_same() {
        let (token, other) = (Token::new().unwrap(), Token::new().unwrap());
        assert_eq!(token.0.len(), 32);
        assert!(token.is(&token.0) && !token.is(&other.0) && !token.is(""));
        assert!(!token.is(&token.0[1..]) && !token.is(&format!("{}0", token.0)));
    }
}
