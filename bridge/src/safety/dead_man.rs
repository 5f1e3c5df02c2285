/// Whether an operator holds a key, judged by its repeats: a terminal does not tell when a key is released.
///
/// The first press alone is nothing. The key is held once its repeats come in a row, and released as soon as one is
/// late. From then on repeats are ignored until there was none for [`DeadMan::RELEASED_S`], so that a connection that
/// stalls does not move the vehicle again where it recovers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadMan {
    /// The newest press, s.
    pressed_s: f64,
    /// Looks in a row that found a press, none of them late.
    presses: u32,
    /// Whether the key has to be released first.
    must_release: bool,
    /// The look before, s.
    looked_s: f64,
}

impl DeadMan {
    /// Longest time between two repeats, s.
    pub const REPEAT_S: f64 = 0.2;
    /// Looks with a press that convince.
    pub const CONVINCING: u32 = 4;
    /// Time without a press after which the key counts as released, s: longer than the pause before the first repeat.
    pub const RELEASED_S: f64 = 0.8;

    /// Returns a key that has never been pressed.
    pub fn new() -> Self {
        Self {
            pressed_s: f64::NEG_INFINITY,
            presses: 0,
            must_release: false,
            looked_s: f64::NEG_INFINITY,
        }
    }

    /// Takes whether the key has been pressed since the look before, and returns whether it is held. A look that is late
    /// itself counts as a late repeat: nobody knows when the presses were.
    pub fn look(&mut self, now_s: f64, pressed: bool) -> bool {
        let before = self.presses >= Self::CONVINCING;
        let late = |since_s: f64| !(..=Self::REPEAT_S).contains(&(now_s - since_s));
        if late(self.pressed_s) || late(self.looked_s) {
            self.presses = 0;
            self.must_release |= before;
            if late(self.looked_s) {
                // A release is measured by looks.
                self.pressed_s = now_s;
            }
        }
        if self.must_release && now_s - self.pressed_s >= Self::RELEASED_S {
            self.must_release = false;
        }
        if pressed {
            self.pressed_s = now_s;
            self.presses = self.presses.saturating_add(u32::from(!self.must_release));
        }
        self.looked_s = now_s;
        self.presses >= Self::CONVINCING
    }

    /// Ends the hold, as for another key: it has to be released first.
    pub fn let_go(&mut self) {
        self.presses = 0;
        self.must_release = true;
        // A release is measured from now.
        self.pressed_s = self.pressed_s.max(self.looked_s);
    }
}

impl Default for DeadMan {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const CYCLE_S: f64 = 0.05;

    /// Returns at which of the looks, 20 a second, the key was held that was pressed at these times.
    fn held(pressed: impl Fn(f64) -> bool, until_s: f64) -> Vec<f64> {
        let mut key = DeadMan::new();
        let looks = (0..(until_s / CYCLE_S) as u32).map(|look| CYCLE_S * f64::from(look));
        looks
            .filter(|now_s| key.look(*now_s, pressed(*now_s)))
            .collect()
    }

    #[test]
    fn a_key_is_held_from_its_repeats_to_the_first_that_is_late() {
        // Pressed at 1 s, repeats from 1.5 s on, released at 4 s.
        let pressed = |now_s: f64| (now_s - 1.0).abs() < 0.02 || (1.49..4.01).contains(&now_s);
        let held = held(pressed, 8.0);
        let (first, last) = (held[0], held[held.len() - 1]);
        assert!((1.6..1.7).contains(&first), "{first}");
        assert!((4.15..=4.2 + 1e-9).contains(&last), "{last}");
        assert_eq!(held.len(), ((last - first) / CYCLE_S).round() as usize + 1);
    }

    #[test]
    fn single_presses_and_pasted_text_hold_nothing() {
        assert!(held(|now_s| (now_s - 1.0).abs() < 0.02, 5.0).is_empty());
        assert!(held(|now_s| now_s % 0.5 < 0.04, 5.0).is_empty());
    }

    #[test]
    fn after_a_stall_the_key_must_be_released_first() {
        let stall = |now_s: f64| !(2.0..2.3).contains(&now_s);
        assert!(held(stall, 10.0).iter().all(|now_s| *now_s < 2.3));
        let pause = |now_s: f64| !(2.0..3.0).contains(&now_s);
        assert!(held(pause, 10.0).iter().any(|now_s| *now_s > 3.0));
        // A program that was suspended knows nothing of the time in between.
        let mut key = DeadMan::new();
        let mut now_s = 0.0;
        for _ in 0..10 {
            now_s += CYCLE_S;
            key.look(now_s, true);
        }
        for suspended_s in [0.5, 5.0] {
            let mut key = key;
            now_s += suspended_s;
            let mut looks = (0..20).map(|look| now_s + CYCLE_S * f64::from(look));
            assert!(looks.all(|now_s| !key.look(now_s, true)));
        }
    }

    #[test]
    fn another_key_ends_the_hold() {
        let mut key = DeadMan::new();
        let holds = |key: &mut DeadMan, from: u32, pressed: bool| {
            let looks = (from..from + 15).map(|look| key.look(CYCLE_S * f64::from(look), pressed));
            looks.fold(false, |before, held| before | held)
        };
        assert!(holds(&mut key, 0, true));
        key.let_go();
        assert!(!holds(&mut key, 15, true), "still pressed");
        assert!(!holds(&mut key, 30, false) && !holds(&mut key, 45, false));
        assert!(holds(&mut key, 60, true), "pressed anew");
    }

    proptest! {
        /// Whatever the presses and the clock: never held longer than a late repeat after the last press.
        #[test]
        fn it_is_never_held_without_presses(steps in prop::collection::vec((0.0..0.4f64, any::<bool>()), 0..200)) {
            let mut key = DeadMan::new();
            let (mut now_s, mut pressed_s) = (0.0, f64::NEG_INFINITY);
            for (step_s, pressed) in steps {
                now_s += step_s;
                if pressed {
                    pressed_s = now_s;
                }
                let held = key.look(now_s, pressed);
                prop_assert!(!held || now_s - pressed_s <= DeadMan::REPEAT_S);
            }
            prop_assert!(!key.look(f64::NAN, true));
        }
    }
}
