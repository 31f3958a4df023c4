//! Which system calls the path's rules allow.

use super::names;
use crate::Kind;
use luna_core::path::Call;

/// A system call: its number and its arguments.
pub(super) struct Made {
    pub(super) number: i64,
    pub(super) arguments: [u64; 6],
}

impl Made {
    /// The rule it breaks when it is made where `expected` is allowed.
    pub(super) fn breach(&self, expected: Option<Call>) -> Option<Kind> {
        if self.is_clock() || expected.is_some_and(|call| self.is_for(call)) {
            return None;
        }
        let number = self.number;
        Some(match self.futex_operation() {
            Some(
                libc::FUTEX_WAIT
                | libc::FUTEX_WAIT_BITSET
                | libc::FUTEX_WAIT_REQUEUE_PI
                | libc::FUTEX_LOCK_PI
                | libc::FUTEX_LOCK_PI2,
            ) => Kind::Lock {
                operation: self.operation_name(),
            },
            _ => Kind::SystemCall {
                number,
                name: names::name(number),
            },
        })
    }

    /// The clock is read without a system call where the machine permits; elsewhere the call is not
    /// the program's fault.
    fn is_clock(&self) -> bool {
        matches!(
            self.number,
            libc::SYS_clock_gettime | libc::SYS_gettimeofday | libc::SYS_time
        )
    }

    fn is_for(&self, call: Call) -> bool {
        let number = self.number;
        match call {
            // A futex, or the eventfd of a thread that sleeps in an epoll.
            Call::Wake => {
                self.futex_operation() == Some(libc::FUTEX_WAKE) || number == libc::SYS_write
            }
            Call::Sleep => {
                self.futex_operation() == Some(libc::FUTEX_WAIT_BITSET)
                    // The reactor, and its look at what is ready.
                    || matches!(
                        number,
                        libc::SYS_ppoll
                            | libc::SYS_epoll_wait
                            | libc::SYS_epoll_pwait
                            | libc::SYS_epoll_pwait2
                    )
            }
            Call::Lock => matches!(
                self.futex_operation(),
                Some(libc::FUTEX_LOCK_PI | libc::FUTEX_LOCK_PI2 | libc::FUTEX_UNLOCK_PI)
            ),
            Call::Fence => {
                number == libc::SYS_membarrier
                    && self.arguments[0] == libc::MEMBARRIER_CMD_PRIVATE_EXPEDITED as u64
            }
            Call::Boost => number == libc::SYS_sched_setscheduler,
            Call::File => match number {
                libc::SYS_read
                | libc::SYS_write
                | libc::SYS_readv
                | libc::SYS_writev
                | libc::SYS_epoll_ctl => true,
                // A datagram, unless the call waits.
                libc::SYS_sendto | libc::SYS_recvfrom => {
                    self.arguments[3] & libc::MSG_DONTWAIT as u64 != 0
                }
                _ => false,
            },
            // Opened once a thread, when its first loop begins.
            Call::Account => matches!(
                number,
                libc::SYS_getrusage | libc::SYS_openat | libc::SYS_pread64
            ),
        }
    }

    /// The futex operation, if it is one.
    fn futex_operation(&self) -> Option<i32> {
        (self.number == libc::SYS_futex).then(|| {
            self.arguments[1] as i32 & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME)
        })
    }

    fn operation_name(&self) -> &'static str {
        match self.futex_operation() {
            Some(libc::FUTEX_WAIT) => "FUTEX_WAIT",
            Some(libc::FUTEX_WAIT_BITSET) => "FUTEX_WAIT_BITSET",
            Some(libc::FUTEX_WAIT_REQUEUE_PI) => "FUTEX_WAIT_REQUEUE_PI",
            Some(libc::FUTEX_LOCK_PI) => "FUTEX_LOCK_PI",
            Some(libc::FUTEX_LOCK_PI2) => "FUTEX_LOCK_PI2",
            _ => "?",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn futex(operation: i32) -> Made {
        Made {
            number: libc::SYS_futex,
            arguments: [0, operation as u64, 0, 0, 0, 0],
        }
    }

    #[test]
    fn a_call_is_allowed_for_its_own_reason_alone() {
        let wake = futex(libc::FUTEX_WAKE | libc::FUTEX_PRIVATE_FLAG);
        assert_eq!(wake.breach(Some(Call::Wake)), None);
        for other in [None, Some(Call::Sleep), Some(Call::Lock), Some(Call::File)] {
            assert!(matches!(
                wake.breach(other),
                Some(Kind::SystemCall { name: "futex", .. })
            ));
        }
        let mut fence = futex(libc::MEMBARRIER_CMD_PRIVATE_EXPEDITED);
        fence.number = libc::SYS_membarrier;
        fence.arguments[0] = libc::MEMBARRIER_CMD_PRIVATE_EXPEDITED as u64;
        assert_eq!(fence.breach(Some(Call::Fence)), None);
        assert!(fence.breach(Some(Call::Lock)).is_some());
        fence.arguments[0] = libc::MEMBARRIER_CMD_GLOBAL as u64;
        assert!(
            fence.breach(Some(Call::Fence)).is_some(),
            "it waits for all"
        );
        let mut datagram = futex(0);
        datagram.number = libc::SYS_recvfrom;
        datagram.arguments[3] = libc::MSG_DONTWAIT as u64;
        assert_eq!(datagram.breach(Some(Call::File)), None);
        datagram.arguments[3] = libc::MSG_PEEK as u64;
        assert!(datagram.breach(Some(Call::File)).is_some(), "it waits");
        let lock = futex(libc::FUTEX_LOCK_PI2 | libc::FUTEX_PRIVATE_FLAG);
        assert_eq!(lock.breach(Some(Call::Lock)), None);
        let operation = "FUTEX_LOCK_PI2";
        assert_eq!(
            lock.breach(Some(Call::Sleep)),
            Some(Kind::Lock { operation })
        );
        // The standard library's locks wait by this operation, the framework's sleep by another.
        let waits = futex(libc::FUTEX_WAIT | libc::FUTEX_PRIVATE_FLAG);
        let operation = "FUTEX_WAIT";
        assert_eq!(
            waits.breach(Some(Call::Sleep)),
            Some(Kind::Lock { operation })
        );
    }

    #[test]
    fn the_clock_is_always_allowed() {
        let number = libc::SYS_clock_gettime;
        assert_eq!(
            Made {
                number,
                arguments: [0; 6]
            }
            .breach(None),
            None
        );
    }
}
