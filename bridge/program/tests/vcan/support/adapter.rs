//! A CAN adapter on a pseudo terminal, played by the test: it connects the kernel's serial-line CAN
//! driver with the bus, and can claim errors that a virtual bus never has.

use super::BUS;
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use sidehill_bridge::drives::Epoch;
use sidehill_can::frame::{Frame, FrameId};
use sidehill_can_port::{BusEvent, BusMonitor, Sender};
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{Read, Write};
use std::process::{Child, Command, Stdio};
use std::time::Duration;

/// The adapter and its interface in the kernel.
pub struct Adapter {
    pub interface: String,
    terminal: File,
    attach: Child,
    _listener: BusMonitor,
}

impl Adapter {
    /// Attaches an adapter and switches its interface on.
    pub fn attach() -> Self {
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY).unwrap();
        grantpt(&master).unwrap();
        unlockpt(&master).unwrap();
        let mut raw = tcgetattr(&master).unwrap();
        raw.make_raw();
        tcsetattr(&master, OptionalActions::Now, &raw).unwrap();
        let name = ptsname(&master, Vec::new()).unwrap();
        let terminal = File::from(master);

        let before = interfaces();
        let attach = Command::new("slcan_attach")
            .args(["-w", name.to_str().unwrap()])
            // It stays attached until it reads something.
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        let interface = (0..100)
            .find_map(|_| {
                std::thread::sleep(Duration::from_millis(50));
                interfaces().difference(&before).next().cloned()
            })
            .expect("the kernel made no interface of the adapter");

        // From the adapter to the bus.
        let mut input = terminal.try_clone().unwrap();
        let epoch = Epoch::now();
        std::thread::spawn(move || {
            let (mut sender, mut line, mut byte) =
                (Sender::start(BUS, &[]).unwrap(), Vec::new(), [0]);
            while input.read_exact(&mut byte).is_ok() {
                if byte[0] != b'\r' {
                    line.push(byte[0]);
                    continue;
                }
                if let Some(frame) = parse(&String::from_utf8_lossy(&line)) {
                    let _ = sender.send(&frame);
                }
                line.clear();
            }
        });
        // And from the bus to the adapter.
        let mut output = terminal.try_clone().unwrap();
        let layout = super::layout();
        let wanted: Vec<_> = layout.from_vehicle().map(|message| message.id()).collect();
        let listener = BusMonitor::start(BUS, &wanted, epoch, move |heard| {
            if let BusEvent::Frame { frame, .. } = heard {
                let _ = output.write_all(text(&frame).as_bytes());
            }
        })
        .unwrap();
        super::ip(&["link", "set", &interface, "up"]);
        Self {
            interface,
            terminal,
            attach,
            _listener: listener,
        }
    }

    /// Sends text to the kernel.
    pub fn say(&self, words: &str) {
        (&self.terminal).write_all(words.as_bytes()).unwrap();
    }
}

impl Drop for Adapter {
    fn drop(&mut self) {
        let _ = self.attach.kill();
        let _ = self.attach.wait();
    }
}

fn interfaces() -> BTreeSet<String> {
    std::fs::read_dir("/sys/class/net")
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect()
}

fn parse(line: &str) -> Option<Frame> {
    let (digits, extended) = match line.get(..1)? {
        "t" => (3, false),
        "T" => (8, true),
        _ => return None,
    };
    let id = u32::from_str_radix(line.get(1..=digits)?, 16).ok()?;
    let hex = line.get(digits + 2..)?;
    let bytes: Option<Vec<u8>> = (0..hex.len() / 2)
        .map(|i| u8::from_str_radix(hex.get(2 * i..2 * i + 2)?, 16).ok())
        .collect();
    let id = if extended {
        FrameId::Extended(id)
    } else {
        FrameId::Standard(id as u16)
    };
    Frame::new(id, &bytes?)
}

fn text(frame: &Frame) -> String {
    let kind = match frame.id {
        FrameId::Standard(_) => 't',
        FrameId::Extended(_) => 'T',
    };
    let data: String = frame
        .bytes()
        .iter()
        .map(|byte| format!("{byte:02X}"))
        .collect();
    format!("{kind}{}{}{data}\r", frame.id, frame.length)
}
