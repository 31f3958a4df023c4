//! Passes a priority on: from the holder of a mutex to the holder of the mutex that it waits for.

use super::core::CoreRef;
use super::entry::Entry;
use arrayvec::ArrayVec;
use luna_core::current::Inheritor;

/// How many holders a chain is followed along.
pub(super) const HOLDERS: usize = 8;

/// The number of wait points that are looked at in all, since a process may wait for several: one
/// in each branch.
pub(super) const STEPS: usize = 32;

/// A holder with a changed boost.
#[derive(Debug)]
pub(super) struct Changed {
    pub(super) inheritor: Inheritor,
    pub(super) is_more: bool,
}

/// Reports the holder's new priority to the mutex that it waits for, and so on along the chain.
/// Each holder on the way with a higher boost is queued to run: one that really waits is polled
/// once for nothing. Called without any lock.
pub(super) fn follow(changed: Option<Changed>) {
    let Some(Changed { inheritor, is_more }) = changed else {
        return;
    };
    // The holders on the way, each with the wait that was looked at last.
    let mut way = ArrayVec::<(Inheritor, usize), HOLDERS>::new();
    way.push((inheritor, 0));
    for _ in 0..STEPS {
        let Some((inheritor, above)) = way.last_mut() else {
            return;
        };
        // Also one that has a wait listed: it may have been handed what it waited for and be
        // queued, or another branch of it may be.
        if *above == 0 && is_more {
            inheritor.move_up();
        }
        // SAFETY: all that is listed with a process is an entry's, and its mutex lives while it is.
        let next = inheritor.next_wait(*above, |node| unsafe {
            let (entry, core) = Entry::waited_for(node);
            (node.addr().get(), entry, CoreRef::new(core))
        });
        let Some((address, entry, core)) = next else {
            way.pop();
            continue;
        };
        *above = address;
        if let Some(further) = core.reorder(entry) {
            if way.is_full() {
                if is_more {
                    further.move_up();
                }
            } else {
                way.push((further, 0));
            }
        }
    }
}
