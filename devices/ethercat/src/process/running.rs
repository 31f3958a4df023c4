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
#[derive(Debug, Clone, Copy)]
pub(super) struct Answer {
    pub(super) counter: u16,
    /// The first subdevice that is not in OP.
    pub(super) not_op: Option<(usize, State)>,
    /// The time of the reference clock when it had the frame.
    pub(super) time: Option<u64>,
}

impl Answer {
    fn new<T>(response: &TxRxResponse<MAX_SUBDEVICES, T>, time: Option<u64>) -> Self {
        let states = response.subdevice_states.iter();
        let mut states = states.map(|state| State::of((*state).into())).enumerate();
        Self {
            counter: response.working_counter,
            not_op: states.find(|(_, state)| *state != State::Op),
            time,
        }
    }
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
                return Ok(Answer::new(&response, None));
            }
            Self::Free(group) => group.tx_rx_sync_system_time(main).await?,
            Self::Clocked(group) => group.tx_rx_sync_system_time(main).await?,
        };
        Ok(Answer::new(&response, response.extra))
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

    /// The state of a subdevice, and its reason.
    pub(super) async fn status(
        &self,
        main: &MainDevice<'_>,
        position: usize,
    ) -> Result<(State, u16), Error> {
        let address =
            of_group!(self, group => group.subdevice(main, position)?.configured_address());
        // The state, a word that is reserved, the code.
        let read = Command::fprd(address, RegisterAddress::AlStatus.into());
        let [status, _, _, _, code @ ..]: [u8; 6] = read.receive(main).await?;
        Ok((State::of(status & 0x0f), u16::from_le_bytes(code)))
    }
}
