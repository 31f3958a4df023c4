//! The way from SAFE-OP to OP.

use super::Stop;
use super::cycle::Cycles;
use super::running::{Answer, Running};
use crate::{Fault, State};
use luna::time::{FollowState, Follower};
use std::pin::pin;
use std::time::Duration;

/// After what time OP is requested again while subdevices are not there.
const REQUEST_EVERY: Duration = Duration::from_millis(50);

impl Cycles {
    /// Goes on with the start after an answer of all subdevices: OP is requested when the loop is
    /// in step with the clock.
    pub(super) async fn start(&mut self, answer: Answer) -> Result<(), Stop> {
        let within = self.start_limit;
        let elapsed = self.begun.map(|begun| luna::now() - begun);
        let elapsed = elapsed.unwrap_or_default();
        let is_late = elapsed > within;
        let unlocked = self.follower.as_ref().filter(|it| !is_locked(it));
        if let Some(follower) = unlocked.filter(|_| self.requested.is_none()) {
            return match is_late {
                true => Err(Fault::NotLocked {
                    phase_error: self.phase_error,
                    refused: follower.refused(),
                    within,
                }
                .into()),
                false => Ok(()),
            };
        }
        let Some((position, state)) = answer.not_op else {
            return match is_late {
                true => Err(Fault::Miscounted {
                    counter: answer.counter,
                    expected: self.counter,
                    within,
                }
                .into()),
                false => Ok(()),
            };
        };
        if is_late {
            let (state, code) = self.reason(position, state).await;
            return Err(Fault::NotOperational {
                position,
                state,
                code,
                after: elapsed,
            }
            .into());
        }
        match self.requested {
            Some(at) if luna::now() - at < REQUEST_EVERY => return Ok(()),
            Some(_) => self.ask(position, elapsed).await?,
            None => {}
        }
        self.request().await
    }

    /// # Errors
    ///
    /// The subdevice has refused OP. It would go on to do so: its error is not acknowledged.
    async fn ask(&mut self, position: usize, after: Duration) -> Result<(), Stop> {
        let status = pin!(self.running.status(&self.main, position));
        let deadline = luna::now() + self.patience;
        let neutral = Some(&self.neutral);
        match self.exchange.until(deadline, neutral, status).await {
            Ok(Some(Ok(status))) if status.has_failed => Err(Fault::NotOperational {
                position,
                state: status.state,
                code: Some(status.code),
                after,
            }
            .into()),
            // If it is lost it is asked again.
            Ok(_) => Ok(()),
            Err(error) => Err(Fault::Wait(error).into()),
        }
    }

    async fn request(&mut self) -> Result<(), Stop> {
        self.requested = Some(luna::now());
        let request = pin!(Running::request(&self.main, State::Op));
        let deadline = luna::now() + self.patience;
        let neutral = Some(&self.neutral);
        // If it is lost it is sent again.
        match self.exchange.until(deadline, neutral, request).await {
            Ok(_) => Ok(()),
            Err(error) => Err(Fault::Wait(error).into()),
        }
    }
}

fn is_locked(follower: &Follower) -> bool {
    follower.state() == FollowState::Locked
}
