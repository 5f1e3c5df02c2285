//! The commands of the last second.

use sidehill_plant::speeds::MotorSpeeds;

/// A command and the instant from which it was given.
#[derive(Debug, Clone, Copy)]
struct Issued {
    time_s: f64,
    command: MotorSpeeds,
}

/// Commands of the last second, the newest last: those that the drives have yet to follow are among them.
#[derive(Clone)]
pub(super) struct IssuedCommands {
    /// Most commands that are kept.
    most: usize,
    commands: Vec<Issued>,
}

impl IssuedCommands {
    /// Returns room for the commands of a second at one per period.
    pub(super) fn new(period_s: f64) -> Self {
        let most = (1.0 / period_s).ceil() as usize + 3;
        Self {
            most,
            commands: Vec::with_capacity(most),
        }
    }

    /// Adds a command; the oldest makes room.
    pub(super) fn push(&mut self, time_s: f64, command: MotorSpeeds) {
        if self.commands.len() == self.most {
            self.commands.remove(0);
        }
        self.commands.push(Issued { time_s, command });
    }

    /// Returns the newest command; before the first the vehicle stands.
    pub(super) fn last(&self) -> MotorSpeeds {
        self.commands
            .last()
            .map_or(MotorSpeeds::STOP, |issued| issued.command)
    }

    /// Forgets the commands of a vehicle that stands: what it does next depends on nothing before.
    pub(super) fn restart(&mut self) {
        if self.last() == MotorSpeeds::STOP {
            self.commands.clear();
        }
    }

    /// Returns the command in force at a time; none before the oldest that is kept.
    pub(super) fn at(&self, time_s: f64) -> Option<MotorSpeeds> {
        let after = self
            .commands
            .partition_point(|issued| issued.time_s <= time_s);
        let last = after.checked_sub(1)?;
        Some(self.commands[last].command)
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

    fn speed(traction_m_s: f64) -> MotorSpeeds {
        MotorSpeeds {
            traction_m_s,
            steer_m_s: 0.1 * traction_m_s,
        }
    }

    /// Commands of 1, 2, 3 m/s from 0 s, 0.25 s and 0.5 s on.
    fn three() -> IssuedCommands {
        let mut issued = IssuedCommands::new(0.25);
        for count in 1..=3 {
            issued.push(0.25 * f64::from(count - 1), speed(f64::from(count)));
        }
        issued
    }

    #[test]
    fn a_command_is_in_force_until_the_next() {
        let issued = three();
        for (time_s, command) in [
            (-0.1, None),
            (0.0, Some(speed(1.0))),
            (0.24, Some(speed(1.0))),
            (0.25, Some(speed(2.0))),
            (9.0, Some(speed(3.0))),
        ] {
            assert_eq!(issued.at(time_s), command, "{time_s}");
        }
        let between = |begin_s, end_s| issued.between(begin_s, end_s).collect::<Vec<_>>();
        assert_eq!(
            between(0.125, 1.0),
            [(speed(1.0), 0.125), (speed(2.0), 0.25), (speed(3.0), 0.5)]
        );
        assert_eq!(
            between(0.25, 0.75),
            [(speed(2.0), 0.25), (speed(3.0), 0.25)]
        );
    }

    #[test]
    fn the_commands_of_a_second_are_kept_unless_the_vehicle_stands_and_begins_anew() {
        let mut issued = three();
        for count in 4..=8 {
            issued.push(0.25 * f64::from(count - 1), speed(f64::from(count)));
        }
        assert_eq!(issued.at(0.2), None);
        assert_eq!(issued.at(0.7), Some(speed(3.0)));
        issued.restart();
        assert_eq!(
            (issued.last(), issued.at(0.7)),
            (speed(8.0), Some(speed(3.0)))
        );
        issued.push(2.0, MotorSpeeds::STOP);
        issued.restart();
        assert_eq!((issued.last(), issued.at(2.0)), (MotorSpeeds::STOP, None));
    }
}
