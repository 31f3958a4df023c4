//! The library's group of subdevices, with or without distributed clocks.

use crate::State;
use crate::bus::{Group, MAX_SUBDEVICES};
use ethercrab::error::Error;
use ethercrab::subdevice_group::{HasDc, SafeOp};
use ethercrab::{Command, MainDevice, RegisterAddress, TxRxResponse};

/// All subdevices of a bus. The library's type says SAFE-OP; the answers say where they are.
pub(crate) enum Running {
    /// Without any distributed clock.
    Clockless(Box<Group<SafeOp>>),
    /// Clocks are kept together, and make no pulses.
    Free(Box<Group<SafeOp>>),
    /// Clocks may make pulses.
    Clocked(Box<Group<SafeOp, HasDc>>),
}

/// What came back of an exchange of process data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Answer {
    pub(super) counter: u16,
    /// The first subdevice that answered and is not in OP.
    pub(super) not_op: Option<(usize, State)>,
    /// The first subdevice that did not answer.
    pub(super) silent: Option<usize>,
    /// Whether there is a state of each subdevice, and none is silent.
    pub(super) is_complete: bool,
    /// The time of the reference clock when it had the frame.
    pub(super) time: Option<u64>,
}

impl Answer {
    fn of<T>(
        response: &TxRxResponse<MAX_SUBDEVICES, T>,
        subdevices: usize,
        time: Option<u64>,
    ) -> Self {
        let states = response.subdevice_states.iter();
        let states = states.map(|state| State::of((*state).into()));
        Self::new(response.working_counter, states, subdevices, time)
    }

    fn new(
        counter: u16,
        states: impl ExactSizeIterator<Item = State>,
        subdevices: usize,
        time: Option<u64>,
    ) -> Self {
        let mut answer = Self {
            counter,
            not_op: None,
            silent: None,
            is_complete: states.len() == subdevices,
            time,
        };
        for (position, state) in states.enumerate() {
            match state {
                State::Op => {}
                State::Silent => {
                    answer.silent.get_or_insert(position);
                    answer.is_complete = false;
                }
                _ => {
                    answer.not_op.get_or_insert((position, state));
                }
            }
        }
        answer
    }
}

/// The state of a subdevice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Status {
    pub(super) state: State,
    /// Whether it has refused a state, or left one by itself.
    pub(super) has_failed: bool,
    /// Its reason.
    pub(super) code: u16,
}

macro_rules! of_group {
    ($running:expr, $group:ident => $what:expr) => {
        match $running {
            Running::Clockless($group) | Running::Free($group) => $what,
            Running::Clocked($group) => $what,
        }
    };
}

impl Running {
    /// Sends all outputs and receives all inputs, with the states and the reference clock's time.
    pub(super) async fn exchange(&self, main: &MainDevice<'_>) -> Result<Answer, Error> {
        let response = match self {
            // The library's other function would wait for its own lock for ever without a clock.
            Self::Clockless(group) => {
                let response = group.tx_rx(main).await?;
                return Ok(Answer::of(&response, group.len(), None));
            }
            Self::Free(group) => group.tx_rx_sync_system_time(main).await?,
            Self::Clocked(group) => group.tx_rx_sync_system_time(main).await?,
        };
        let subdevices = of_group!(self, group => group.len());
        Ok(Answer::of(&response, subdevices, response.extra))
    }

    /// Sets the outputs of a subdevice.
    pub(super) fn with_outputs(
        &self,
        main: &MainDevice<'_>,
        position: usize,
        set: impl FnOnce(&mut [u8]),
    ) {
        of_group!(self, group => if let Ok(subdevice) = group.subdevice(main, position) {
            set(&mut subdevice.outputs_raw_mut());
        });
    }

    /// Looks at the inputs of a subdevice.
    pub(super) fn with_inputs(
        &self,
        main: &MainDevice<'_>,
        position: usize,
        look: impl FnOnce(&[u8]),
    ) {
        of_group!(self, group => if let Ok(subdevice) = group.subdevice(main, position) {
            look(&subdevice.inputs_raw());
        });
    }

    /// Requests a state of all subdevices, and awaits no more than the frame.
    pub(super) async fn request(main: &MainDevice<'_>, state: State) -> Result<(), Error> {
        Command::bwr(RegisterAddress::AlControl.into())
            .ignore_wkc()
            .send(main, u16::from(state.bits()))
            .await
    }

    /// Asks a subdevice for its state.
    pub(super) async fn status(
        &self,
        main: &MainDevice<'_>,
        position: usize,
    ) -> Result<Status, Error> {
        let address =
            of_group!(self, group => group.subdevice(main, position)?.configured_address());
        // The state, a word that is reserved, the code.
        let read = Command::fprd(address, RegisterAddress::AlStatus.into());
        let [status, _, _, _, code @ ..]: [u8; 6] = read.receive(main).await?;
        Ok(Status {
            state: State::of(status & 0x0f),
            has_failed: status & 0x10 != 0,
            code: u16::from_le_bytes(code),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Answer, State};

    fn answer(
        states: &[State],
        subdevices: usize,
    ) -> (Option<(usize, State)>, Option<usize>, bool) {
        let answer = Answer::new(0, states.iter().copied(), subdevices, None);
        (answer.not_op, answer.silent, answer.is_complete)
    }

    #[test]
    fn a_silent_subdevice_hides_no_other() {
        let (op, silent, safe) = (State::Op, State::Silent, State::SafeOp);
        let left = Some((2, safe));
        assert_eq!(
            answer(&[op, silent, safe, silent], 4),
            (left, Some(1), false)
        );
        assert_eq!(answer(&[op, op, safe, State::Init], 4), (left, None, true));
        assert_eq!(answer(&[op, op], 2), (None, None, true));
    }

    #[test]
    fn a_state_that_is_missing_is_noticed() {
        assert_eq!(answer(&[State::Op], 2), (None, None, false));
        assert_eq!(answer(&[], 1), (None, None, false));
    }
}
