//! `--live`: where the live view is served, and to whom.

use anyhow::{Context, Result, bail, ensure};
use sidehill_recording::live::LiveAddress;
use std::fs::File;
use std::io::Read;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

/// Default address of the live view: this machine only.
const LIVE: &str = "127.0.0.1:8765";
/// Shortest token, characters.
const TOKEN_MIN: usize = 8;

/// Arguments of the live view.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct LiveArgs {
    /// Show the drive live: a page for a browser, and a Foxglove WebSocket for Foxglove and Lichtblick. By default
    /// on this machine only: 127.0.0.1:8765. An address that others reach needs --token.
    #[arg(long, value_name = "ADDRESS", num_args = 0..=1, default_missing_value = LIVE)]
    pub live: Option<SocketAddr>,
    /// Show the live view only to who knows this token: 8 or more letters, digits, - or _. Without a value a new one
    /// is made and printed.
    #[arg(long, requires = "live", num_args = 0..=1, default_missing_value = "")]
    pub token: Option<String>,
}

impl LiveArgs {
    /// Returns where the live view is served, and to whom; none where it is not requested.
    ///
    /// # Errors
    /// An address that others reach without a token, or a token that is too short or does not fit into an address.
    pub fn address(&self) -> Result<Option<LiveAddress>> {
        let Some(address) = self.live else {
            return Ok(None);
        };
        let token = match self.token.as_deref() {
            Some("") => Some(new_token()?),
            Some(token) => {
                let fits = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
                ensure!(
                    token.len() >= TOKEN_MIN && token.chars().all(fits),
                    "--token: it must have {TOKEN_MIN} or more letters, digits, - or _; without a value one is made"
                );
                Some(token.to_owned())
            }
            None => None,
        };
        if token.is_none() && !address.ip().is_loopback() {
            bail!("--live: {address} can be reached from other machines: add --token");
        }
        Ok(Some(LiveAddress { address, token }))
    }
}

/// Returns a random token of 80 bits.
fn new_token() -> Result<String> {
    let mut bytes = [0; 10];
    File::open("/dev/urandom")
        .and_then(|mut random| random.read_exact(&mut bytes))
        .context("--token: /dev/urandom cannot be read; give a token")?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Returns the address at which other machines reach what listens at `address`.
pub(super) fn reached_at(address: SocketAddr) -> SocketAddr {
    if !address.ip().is_unspecified() {
        return address;
    }
    // Connecting a datagram socket sends nothing, and tells the machine's own address on the way to a network.
    let (any, far): (IpAddr, IpAddr) = match address {
        SocketAddr::V4(_) => (
            Ipv4Addr::UNSPECIFIED.into(),
            Ipv4Addr::new(192, 0, 2, 1).into(),
        ),
        SocketAddr::V6(_) => (
            Ipv6Addr::UNSPECIFIED.into(),
            Ipv6Addr::new(0x2001, 0xdb8, 0, 0, 0, 0, 0, 1).into(),
        ),
    };
    let own = UdpSocket::bind((any, 0)).and_then(|socket| {
        socket.connect((far, 9))?;
        socket.local_addr()
    });
    own.map_or(address, |own| SocketAddr::new(own.ip(), address.port()))
}
