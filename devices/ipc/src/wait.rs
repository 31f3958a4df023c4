//! What a link waits for: a word of its partner, the partner's death, and an event of its own side.

use crate::IpcError;
use crate::session::Session;
use luna::external::FileReady;
use luna_machine::file;
use std::future::{Future, poll_fn};
use std::io::ErrorKind;
use std::pin::Pin;
use std::sync::atomic::Ordering::SeqCst;
use std::task::{Context, Poll};

/// What has happened on the other side.
pub(crate) enum Seen<R> {
    /// The words show this.
    Word(R),
    /// The partner's process has ended, and the words do not show it.
    Death,
}

/// The first of two events.
pub(crate) enum First<A, B> {
    Own(A),
    Other(B),
}

/// Waits of one session. The futures of files last for the session, since to withdraw one is a
/// system call. They lie in the caller's frame, which is not on the heap.
pub(crate) struct Waits<'w, 'f> {
    session: &'f Session,
    bell: Pin<&'w mut FileReady<'f>>,
    death: Option<Pin<&'w mut FileReady<'f>>>,
    /// Turns in which it looks before it waits, and those that are left.
    looks: u32,
    looks_left: u32,
}

impl<'w, 'f> Waits<'w, 'f> {
    /// `bell` waits for the session's bell.
    pub(crate) fn new(session: &'f Session, bell: Pin<&'w mut FileReady<'f>>) -> Self {
        Self {
            session,
            bell,
            death: None,
            looks: 0,
            looks_left: 0,
        }
    }

    /// `death` waits for the end of the partner's process.
    pub(crate) fn watch(&mut self, death: Pin<&'w mut FileReady<'f>>, looks: u32) {
        self.looks = looks;
        self.death = Some(death);
    }

    /// Waits until `own` is done, or the session has a partner.
    pub(crate) async fn partner<A>(
        &mut self,
        own: Pin<&mut impl Future<Output = A>>,
    ) -> Result<First<A, ()>, IpcError> {
        let is_bound = |session: &Session| session.is_bound().then_some(());
        Ok(match self.first(own, is_bound).await? {
            First::Own(own) => First::Own(own),
            // Nothing else is watched.
            First::Other(_) => First::Other(()),
        })
    }

    /// Waits until `own` is done, or `look` finds something in the words, or the partner has died.
    /// `own` comes first.
    pub(crate) async fn first<A, R>(
        &mut self,
        mut own: Pin<&mut impl Future<Output = A>>,
        look: impl Fn(&Session) -> Option<R>,
    ) -> Result<First<A, Seen<R>>, IpcError> {
        self.looks_left = self.looks;
        poll_fn(|cx| {
            if let Poll::Ready(done) = own.as_mut().poll(cx) {
                return Poll::Ready(Ok(First::Own(done)));
            }
            self.poll(cx, &look)
                .map(|seen| seen.map(|seen| First::Other(seen)))
        })
        .await
    }

    fn poll<R>(
        &mut self,
        cx: &mut Context<'_>,
        look: impl Fn(&Session) -> Option<R>,
    ) -> Poll<Result<Seen<R>, IpcError>> {
        let asleep = &self.session.own().asleep;
        let failed = |error| IpcError::system(self.session.name(), "wait for its bell", error);
        loop {
            if let Some(seen) = look(self.session) {
                return Poll::Ready(Ok(Seen::Word(seen)));
            }
            if let Some(left) = self.looks_left.checked_sub(1) {
                self.looks_left = left;
                // Another turn, after those of the processes that are ready now.
                cx.waker().wake_by_ref();
                return Poll::Pending;
            }
            // A partner that changes a word after the next look finds this, and rings.
            asleep.swap(1, SeqCst);
            if let Some(seen) = look(self.session) {
                asleep.store(0, SeqCst);
                return Poll::Ready(Ok(Seen::Word(seen)));
            }
            match self.bell.as_mut().poll(cx) {
                Poll::Ready(Ok(())) => {
                    drain(self.session).map_err(failed)?;
                    continue;
                }
                Poll::Ready(Err(error)) => {
                    return Poll::Ready(Err(failed(std::io::Error::other(error))));
                }
                Poll::Pending => {}
            }
            let Some(death) = &mut self.death else {
                return Poll::Pending;
            };
            return match death.as_mut().poll(cx) {
                // All that it did was before its end: so this look is the last one.
                Poll::Ready(Ok(())) => Poll::Ready(Ok(match look(self.session) {
                    Some(seen) => Seen::Word(seen),
                    None => Seen::Death,
                })),
                Poll::Ready(Err(error)) => Poll::Ready(Err(failed(std::io::Error::other(error)))),
                Poll::Pending => Poll::Pending,
            };
        }
    }
}

fn drain(session: &Session) -> std::io::Result<()> {
    let mut bytes = [0; 64];
    match file::read(session.bell(), &mut bytes) {
        Err(error) if error.kind() != ErrorKind::WouldBlock => Err(error),
        _ => Ok(()),
    }
}
