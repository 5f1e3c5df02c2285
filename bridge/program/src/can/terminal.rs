use anyhow::{Context, Result, ensure};
use rustix::termios::{
    InputModes, LocalModes, OptionalActions, SpecialCodeIndex, Termios, tcgetattr, tcsetattr,
};
use std::io::{IsTerminal, Read, stdin};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};

/// Switches a special key of a terminal off.
const NO_KEY: u8 = 0;

/// Keys and lines of a terminal on standard input. On drop, also after a panic, it is as it was before.
pub(super) struct Terminal {
    before: Termios,
    bytes: Receiver<u8>,
    line: Vec<u8>,
    /// Whether standard input has ended.
    closed: Arc<AtomicBool>,
}

/// Presses since the look before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Presses {
    /// Of the space bar.
    pub(super) space: bool,
    /// Of another key.
    pub(super) other: bool,
}

impl Terminal {
    /// Takes the terminal for keys.
    ///
    /// # Errors
    /// Standard input is no terminal, or the system refuses it.
    pub(super) fn take() -> Result<Self> {
        ensure!(
            stdin().is_terminal(),
            "standard input is no terminal, and the key that is held while a motor turns is read from it: run this in a terminal, \
             over ssh with -t"
        );
        let before = tcgetattr(stdin()).context("standard input: the terminal's settings")?;
        let (pressed, bytes) = channel();
        let closed = Arc::new(AtomicBool::new(false));
        let ended = Arc::clone(&closed);
        // Ends with the program.
        std::thread::Builder::new()
            .name("keys".to_owned())
            .spawn(move || {
                for byte in stdin().lock().bytes().map_while(Result::ok) {
                    if pressed.send(byte).is_err() {
                        break;
                    }
                }
                ended.store(true, Ordering::Relaxed);
            })?;
        let mut terminal = Self {
            before,
            bytes,
            line: Vec::new(),
            closed,
        };
        terminal.take_keys()?;
        Ok(terminal)
    }

    /// Takes single keys from now on, without their echo. Ctrl-C goes on to end the program; keys that suspend or hold it
    /// have no effect.
    pub(super) fn take_keys(&mut self) -> Result<()> {
        let mut keys = self.settings();
        keys.local_modes
            .remove(LocalModes::ICANON | LocalModes::ECHO);
        keys.special_codes[SpecialCodeIndex::VMIN] = 1;
        keys.special_codes[SpecialCodeIndex::VTIME] = 0;
        self.apply(&keys)
    }

    /// Takes lines from now on, with their echo.
    pub(super) fn take_lines(&mut self) -> Result<()> {
        self.apply(&self.settings())
    }

    /// Returns whether standard input has ended.
    pub(super) fn is_closed(&self) -> bool {
        self.closed.load(Ordering::Relaxed)
    }

    /// Returns what has been pressed since the look before.
    pub(super) fn presses(&mut self) -> Presses {
        let mut presses = Presses::default();
        for byte in self.bytes.try_iter() {
            match byte {
                b' ' => presses.space = true,
                _ => presses.other = true,
            }
        }
        presses
    }

    /// Returns a line that has been entered.
    pub(super) fn line(&mut self) -> Option<String> {
        while let Ok(byte) = self.bytes.try_recv() {
            if byte != b'\n' {
                self.line.push(byte);
                continue;
            }
            let line = std::mem::take(&mut self.line);
            return Some(String::from_utf8_lossy(&line).trim().to_owned());
        }
        None
    }

    fn settings(&self) -> Termios {
        let mut settings = self.before.clone();
        for key in [SpecialCodeIndex::VSUSP, SpecialCodeIndex::VQUIT] {
            settings.special_codes[key] = NO_KEY;
        }
        settings.input_modes.remove(InputModes::IXON);
        settings
    }

    fn apply(&mut self, settings: &Termios) -> Result<()> {
        tcsetattr(stdin(), OptionalActions::Flush, settings)
            .context("standard input: the terminal's settings")?;
        self.line.clear();
        self.bytes.try_iter().for_each(drop);
        Ok(())
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        // A terminal that is gone needs nothing.
        let _ = tcsetattr(stdin(), OptionalActions::Flush, &self.before);
    }
}
