//! The commands of the last second.

use sidehill_plant::speeds::MotorSpeeds;

/// A command and the instant from which it was given.
#[derive(Debug, Clone, Copy)]
struct Issued {
    time_s: f64,
    command: MotorSpeeds,
}

/// Commands of the last second, the newest last: those that the drives have yet to follow are among them.
pub(super) struct IssuedCommands {
    commands: Vec<Issued>,
    /// When the vehicle was last told to stand, s; none before its first command.
    stood_s: Option<f64>,
}

impl IssuedCommands {
    /// Returns room for the commands of a second at one per period.
    pub(super) fn new(period_s: f64) -> Self {
        let commands = (1.0 / period_s).ceil() as usize + 2;
        Self {
            commands: Vec::with_capacity(commands + 1),
            stood_s: None,
        }
    }

    /// Adds a command; the oldest makes room.
    pub(super) fn push(&mut self, time_s: f64, command: MotorSpeeds) {
        if self.commands.len() + 1 > self.commands.capacity() {
            self.commands.remove(0);
        }
        self.commands.push(Issued { time_s, command });
        if command == MotorSpeeds::STOP || self.stood_s.is_none() {
            self.stood_s = Some(time_s);
        }
    }

    /// Returns the time since the vehicle was last told to stand, s; 0 where the clock was put back since.
    pub(super) fn driving_s(&self, now_s: f64) -> f64 {
        let stood_s = self.stood_s.unwrap_or(now_s);
        (now_s - stood_s).max(0.0)
    }

    /// Returns the newest command; before the first the vehicle stands.
    pub(super) fn last(&self) -> MotorSpeeds {
        self.commands
            .last()
            .map_or(MotorSpeeds::STOP, |issued| issued.command)
    }

    /// Returns the commands between two times with how long each was in force, s, the oldest first.
    pub(super) fn between(
        &self,
        begin_s: f64,
        end_s: f64,
    ) -> impl Iterator<Item = (MotorSpeeds, f64)> {
        let in_force = move |(i, issued): (usize, &Issued)| {
            let next = self.commands.get(i + 1);
            let until_s = next.map_or(end_s, |next| next.time_s);
            (issued.command, until_s - issued.time_s.max(begin_s))
        };
        let commands = self.commands.iter().enumerate().map(in_force);
        commands.filter(|(_, time_s)| *time_s > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn driving_counts_from_the_last_command_to_stand() {
        let ahead = MotorSpeeds {
            traction_m_s: 0.3,
            steer_m_s: 0.0,
        };
        let mut issued = IssuedCommands::new(0.05);
        assert_eq!(issued.driving_s(7.0), 0.0);
        for (time_s, command) in [(7.0, ahead), (7.05, MotorSpeeds::STOP), (7.1, ahead)] {
            issued.push(time_s, command);
        }
        assert!((issued.driving_s(8.05) - 1.0).abs() < 1e-9);
        // A clock that was put back.
        assert_eq!(issued.driving_s(1.0), 0.0);
    }
}
