//! From events to positions, and back to them after events were lost.

use super::event::Event;
use super::{MAX_AXES, MAX_BUTTONS};

/// What a control of an input device does.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Control {
    /// An axis has moved.
    Axis {
        /// Its number.
        axis: u16,
        /// From -1 (the least value) to 1 (the greatest). Within the device's flat range it is 0. A
        /// trigger that rests at its least value rests at -1.
        position: f64,
    },
    /// A button was pressed or released. Repetitions are not reported.
    Button {
        /// Its number.
        button: u16,
        /// Pressed; else released.
        pressed: bool,
    },
}

/// The range of an axis, in its device's units.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Range {
    /// The least.
    pub least: i32,
    /// The most.
    pub most: i32,
    /// How far from the middle it counts as at rest.
    pub flat: i32,
}

impl Range {
    /// The position of `value`, from -1 to 1. An axis with a range of one value is at rest.
    ///
    /// ```
    /// use luna_links::joystick::Range;
    /// let range = Range { least: 0, most: 255, flat: 15 };
    /// assert_eq!((range.position(0), range.position(255), range.position(300)), (-1.0, 1.0, 1.0));
    /// assert_eq!((range.position(130), range.position(128)), (0.0, 0.0)); // near the middle
    /// ```
    pub fn position(self, value: i32) -> f64 {
        let (least, most) = (f64::from(self.least), f64::from(self.most));
        let half = (most - least) / 2.0;
        let from_middle = f64::from(value) - (least + half);
        if half <= 0.0 || from_middle.abs() <= f64::from(self.flat) {
            return 0.0;
        }
        (from_middle / half).clamp(-1.0, 1.0)
    }
}

/// The state of all controls of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Snapshot {
    /// The axes' values, by their numbers.
    pub axes: [i32; MAX_AXES],
    /// A bit for each pressed button, from the lowest of the first word.
    pub buttons: [u64; MAX_BUTTONS / 64],
}

impl Snapshot {
    /// All values 0, and no button pressed.
    pub const ZERO: Snapshot = Snapshot {
        axes: [0; MAX_AXES],
        buttons: [0; MAX_BUTTONS / 64],
    };

    /// Whether a button is pressed.
    pub fn is_pressed(&self, button: u16) -> bool {
        let word = self.buttons.get(usize::from(button) / 64);
        word.is_some_and(|word| word >> (button % 64) & 1 == 1)
    }

    /// Sets whether a button is pressed. A number without a button is ignored.
    pub fn press(&mut self, button: u16, is_pressed: bool) {
        if let Some(word) = self.buttons.get_mut(usize::from(button) / 64) {
            let bit = 1 << (button % 64);
            *word = if is_pressed {
                *word | bit
            } else {
                *word & !bit
            };
        }
    }
}

/// The state that was reported so far.
#[derive(Debug)]
pub(super) struct State {
    ranges: [Option<Range>; MAX_AXES],
    positions: [f64; MAX_AXES],
    /// Its buttons alone.
    reported: Snapshot,
    /// Events were lost: those up to the next report are useless, and then the device is queried.
    is_lost: bool,
}

/// What an event means.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Meaning {
    Nothing,
    Control(Control),
    /// Query the device's state, and [`compare`](State::compare).
    Ask,
}

impl State {
    pub(super) fn new(range: impl Fn(u16) -> Option<Range>) -> Self {
        let ranges = std::array::from_fn(|axis| range(axis as u16));
        Self {
            ranges,
            positions: [0.0; MAX_AXES],
            reported: Snapshot::ZERO,
            is_lost: false,
        }
    }

    pub(super) fn take(&mut self, event: Event) -> Meaning {
        let Event { kind, code, value } = event;
        match (kind, code) {
            (Event::SYNCHRONIZATION, Event::DROPPED) => {
                self.is_lost = true;
                Meaning::Nothing
            }
            (Event::SYNCHRONIZATION, Event::REPORT) if self.is_lost => {
                self.is_lost = false;
                Meaning::Ask
            }
            _ if self.is_lost => Meaning::Nothing,
            (Event::AXIS, axis) => self.move_to(axis, value),
            (Event::BUTTON, button) if value < 2 => self.press(button, value == 1),
            _ => Meaning::Nothing,
        }
    }

    fn move_to(&mut self, axis: u16, value: i32) -> Meaning {
        let Some(Some(range)) = self.ranges.get(usize::from(axis)) else {
            return Meaning::Nothing;
        };
        let position = range.position(value);
        let reported = &mut self.positions[usize::from(axis)];
        if *reported == position {
            return Meaning::Nothing;
        }
        *reported = position;
        Meaning::Control(Control::Axis { axis, position })
    }

    fn press(&mut self, button: u16, pressed: bool) -> Meaning {
        if usize::from(button) >= MAX_BUTTONS || self.reported.is_pressed(button) == pressed {
            return Meaning::Nothing;
        }
        self.reported.press(button, pressed);
        Meaning::Control(Control::Button { button, pressed })
    }

    /// The next control from `*place` on with a state that was not reported; `place` is 0 at first.
    /// O(axes and buttons) in all.
    pub(super) fn compare(&mut self, now: &Snapshot, place: &mut usize) -> Option<Control> {
        while *place < MAX_AXES + MAX_BUTTONS {
            let number = *place;
            *place += 1;
            let meaning = match number.checked_sub(MAX_AXES) {
                None => self.move_to(number as u16, now.axes[number]),
                Some(button) => self.press(button as u16, now.is_pressed(button as u16)),
            };
            if let Meaning::Control(control) = meaning {
                return Some(control);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: Range = Range {
        least: -100,
        most: 100,
        flat: 5,
    };

    fn state() -> State {
        State::new(|axis| (axis < 2).then_some(RANGE))
    }

    fn event(kind: u16, code: u16, value: i32) -> Event {
        Event { kind, code, value }
    }

    fn axis(axis: u16, position: f64) -> Meaning {
        Meaning::Control(Control::Axis { axis, position })
    }

    #[test]
    fn axes_and_buttons_are_reported_when_they_change() {
        let mut state = state();
        assert_eq!(state.take(event(3, 0, 50)), axis(0, 0.5));
        assert_eq!(state.take(event(3, 0, 50)), Meaning::Nothing);
        assert_eq!(state.take(event(3, 0, 3)), axis(0, 0.0));
        assert_eq!(state.take(event(3, 0, -4)), Meaning::Nothing, "flat");
        assert_eq!(state.take(event(3, 1, 1000)), axis(1, 1.0));
        assert_eq!(state.take(event(3, 2, 1)), Meaning::Nothing, "no such axis");
        let button = |pressed| {
            Meaning::Control(Control::Button {
                button: 0x120,
                pressed,
            })
        };
        assert_eq!(state.take(event(1, 0x120, 1)), button(true));
        assert_eq!(state.take(event(1, 0x120, 2)), Meaning::Nothing, "repeated");
        assert_eq!(state.take(event(1, 0x120, 0)), button(false));
        for (kind, code) in [
            (1, 768),
            (1, u16::MAX),
            (3, 64),
            (3, u16::MAX),
            (2, 0),
            (0, 0),
        ] {
            assert_eq!(
                state.take(event(kind, code, 1)),
                Meaning::Nothing,
                "{kind} {code}"
            );
        }
    }

    #[test]
    fn after_lost_events_only_differences_are_reported() {
        let mut state = state();
        state.take(event(3, 0, 50));
        state.take(event(1, 700, 1));
        assert_eq!(state.take(event(0, 3, 0)), Meaning::Nothing);
        assert_eq!(state.take(event(3, 1, 9)), Meaning::Nothing, "of no use");
        assert_eq!(state.take(event(0, 0, 0)), Meaning::Ask);
        let mut now = Snapshot::ZERO;
        now.axes[0] = 50;
        now.axes[1] = -100;
        now.press(3, true);
        let mut place = 0;
        let mut reported = Vec::new();
        while let Some(control) = state.compare(&now, &mut place) {
            reported.push(control);
        }
        assert_eq!(
            reported,
            [
                Control::Axis {
                    axis: 1,
                    position: -1.0
                },
                Control::Button {
                    button: 3,
                    pressed: true
                },
                Control::Button {
                    button: 700,
                    pressed: false
                },
            ]
        );
        assert_eq!(state.compare(&now, &mut 0), None);
    }

    #[test]
    fn extreme_ranges_make_no_nonsense() {
        let whole = Range {
            least: i32::MIN,
            most: i32::MAX,
            flat: 0,
        };
        assert_eq!(whole.position(i32::MIN), -1.0);
        assert_eq!(whole.position(i32::MAX), 1.0);
        for range in [
            Range {
                least: 5,
                most: 5,
                flat: 0,
            },
            Range {
                least: 5,
                most: -5,
                flat: 0,
            },
            Range {
                least: -5,
                most: 5,
                flat: i32::MAX,
            },
        ] {
            assert_eq!(range.position(4), 0.0);
        }
    }
}
